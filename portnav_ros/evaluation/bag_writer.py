"""Writes rosbag2 bags without ROS: sqlite3 or mcap, definitions inside, readable whenever the writer dies."""

from __future__ import annotations

import contextlib
import copy
import sqlite3
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Storage = Literal['sqlite3', 'mcap']
STORAGES: tuple[Storage, ...] = ('sqlite3', 'mcap')
COMPLETE = 'complete'  # key of the metadata: 'true' once the bag was closed
TYPES = get_typestore(Stores.ROS2_JAZZY)
TYPES.register(  # came to Jazzy after its release
    get_types_from_msg('std_msgs/Header header\ngeometry_msgs/PoseStamped[] goals\n', 'nav_msgs/msg/Goals')
)

_FOREVER = QosTime(0x7FFFFFFF, 0x7FFFFFFF)


class BagError(RuntimeError):
    """A bag cannot be written or read; the message names the file and the mend."""


class BagWriter:
    """One bag being written.

    The same messages give the same bytes. What was written before the last checkpoint survives the
    death of the process; close() completes the bag. Every method raises BagError where the disk refuses.

    Args:
        path: folder, which must not exist yet.
        storage: file format.
        metadata: custom data, such as seed, configuration and versions.
    """

    def __init__(self, path: Path, storage: Storage, metadata: Mapping[str, str]) -> None:
        self._path = path
        self._last_ns = 0
        self._described = False
        self._connections: list[Connection] = []
        with self._disk():
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
            for key, value in metadata.items():
                self._writer.set_custom_data(key, value)
            self._writer.set_custom_data(COMPLETE, 'false')
            self._writer.open()
            if isinstance(self._writer.storage, Sqlite3Writer):
                # A checkpoint has to outlive the process, not the power supply.
                self._writer.storage.conn.execute('PRAGMA synchronous = OFF')

    def add_topic(self, name: str, message_type: str, depth: int = 10, latched: bool = False) -> int:
        """Declare a topic; returns the number to write it by."""
        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        qos = Qos(
            QosHistory.KEEP_LAST,
            depth,
            QosReliability.RELIABLE,
            durability,
            _FOREVER,
            _FOREVER,
            QosLiveliness.AUTOMATIC,
            _FOREVER,
            False,
        )
        with self._disk():
            connection = self._writer.add_connection(
                name, message_type, typestore=TYPES, offered_qos_profiles=[qos]
            )
        self._connections.append(connection)
        return len(self._connections) - 1

    def write(self, topic: int, stamp_ns: int, data: bytes) -> None:
        """Append a serialised message; one that is older than the last is filed with the last's stamp."""
        self._last_ns = max(self._last_ns, stamp_ns)
        with self._disk():
            self._writer.write(self._connections[topic], self._last_ns, data)

    def checkpoint(self) -> None:
        """Make everything written so far readable, even if this process dies now.

        The first one describes the bag in metadata.yaml, so it comes after the last add_topic().
        """
        storage = self._writer.storage
        with self._disk():
            if isinstance(storage, Sqlite3Writer):
                storage.conn.commit()
            elif isinstance(storage, McapWriter):
                if storage.chunk.bio.tell():
                    storage.close_chunk()
                storage.bio.flush()
            if not self._described:
                self._write_metadata()

    def close(self) -> None:
        """Complete the bag."""
        with self._disk():
            self._writer.set_custom_data(COMPLETE, 'true')
            self._writer.close()

    def abort(self) -> None:
        """Let go of a bag that can no longer be written; the last checkpoint stays readable."""
        with contextlib.suppress(OSError, sqlite3.Error):
            self._writer.abort()

    def _write_metadata(self) -> None:
        assert self._writer.storage is not None
        snapshot = copy.copy(self._writer)
        snapshot.storage = _NoStorage(self._writer.storage.path)
        snapshot.close()
        self._described = True

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        try:
            yield
        except (OSError, WriterError, sqlite3.Error) as error:
            raise BagError(f'{self._path}: cannot be written: {error}') from error


class _NoStorage:
    """Lets the library write metadata.yaml of a bag that stays open."""

    def __init__(self, path: Path, compression: CompressionMode = CompressionMode.NONE) -> None:
        self.path = path

    def add_msgtype(self, connection: Connection) -> None:
        """Do nothing."""

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Do nothing."""

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Do nothing."""

    def close(self, version: int, metadata: str) -> None:
        """Do nothing."""

    def abort(self) -> None:
        """Do nothing."""
