"""Reads bags without ROS: what is in them, damaged ones too, and the episode they tell."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rosbags.highlevel import AnyReader, AnyReaderError

from portnav_ros.evaluation.bag_writer import COMPLETE, BagError

METADATA = 'metadata.yaml'
_INFORMATION = 'rosbag2_bagfile_information'
_MAGIC = b'\x89MCAP0\r\n'
_FOOTER = b'\x02' + struct.pack('<QQQI', 20, 0, 0, 0) + _MAGIC  # says: no summary, scan the file
_DATA_END, _HEADER_SIZE = 0x0F, 9
_TABLES = ('schema', 'metadata', 'topics', 'message_definitions', 'messages')


class Bag(NamedTuple):
    """What a bag holds.

    messages: for each topic (stamp in ns, message) in the order of the bag. metadata: the custom data.
    lost: what is missing of a damaged recording, in words; empty for a whole one.
    """

    path: Path
    messages: dict[str, list[tuple[int, Any]]]
    metadata: dict[str, str]
    lost: str


def read_bag(path: Path) -> Bag:
    """Read a bag, or as much of it as a damaged one still holds.

    Args:
        path: the bag's folder, the folder that holds ``bag/``, or a single .db3 or .mcap file.

    Raises:
        BagError: there is no bag, or nothing in it can be read.
    """
    file = _storage_file(path)
    metadata, lost = _read_metadata(file.parent)
    try:
        messages, unreadable = _read_messages(file)
        return Bag(file.parent, messages, metadata, '; '.join(filter(None, (lost, unreadable))))
    except (AnyReaderError, sqlite3.Error, OSError, ValueError, struct.error) as error:
        reason = f'{file.name} is damaged ({error})'
    with tempfile.TemporaryDirectory() as folder:
        mended = Path(folder) / file.name
        try:
            _MENDERS[file.suffix](file, mended)
            messages, _ = _read_messages(mended)
        except (AnyReaderError, sqlite3.Error, OSError, ValueError, struct.error) as error:
            raise BagError(f'{file}: nothing can be read ({error}); record the run again') from error
    return Bag(file.parent, messages, metadata, f'{reason}; what could be read of it ends early')


def _storage_file(path: Path) -> Path:
    if path.suffix in _MENDERS and path.is_file():
        return path
    for folder in (path, path / 'bag'):
        files = sorted(file for file in folder.glob('*') if file.suffix in _MENDERS)
        if files:
            return files[0]
    raise BagError(f'{path}: no .db3 or .mcap file here; name the folder that portnav recorded into')


def _read_metadata(folder: Path) -> tuple[dict[str, str], str]:
    file = folder / METADATA
    try:
        information = yaml.safe_load(file.read_text(encoding='utf-8'))[_INFORMATION]
        metadata = dict(information['custom_data'] or {})
    except (OSError, yaml.YAMLError, TypeError, KeyError) as error:
        return {}, f'{METADATA} is missing or damaged ({type(error).__name__})'
    if metadata.pop(COMPLETE, 'true') != 'true':
        return metadata, 'the recording was cut off; it ends with its last checkpoint'
    return metadata, ''


def _read_messages(file: Path) -> tuple[dict[str, list[tuple[int, Any]]], str]:
    """Messages by topic, and how many were recorded as they came but are none."""
    if file.with_name(file.name + '-journal').exists():
        raise ValueError('a write was under way when the recorder died')
    unreadable: Counter[str] = Counter()
    with AnyReader([file]) as reader:
        messages: dict[str, list[tuple[int, Any]]] = {item.topic: [] for item in reader.connections}
        for connection, stamp, data in reader.messages():
            try:
                message = reader.deserialize(data, connection.msgtype)
            except (AnyReaderError, UnicodeDecodeError):
                unreadable[connection.topic] += 1
            else:
                messages[connection.topic].append((stamp, message))
    return messages, ', '.join(f'{count} unreadable on {topic}' for topic, count in unreadable.items())


def _mend_sqlite(source: Path, target: Path) -> None:
    """Copy row by row up to the damage; the copy's journal undoes a write that was under way."""
    copy = target.with_name('damaged')
    shutil.copy(source, copy)
    with suppress(FileNotFoundError):
        shutil.copy(source.with_name(source.name + '-journal'), copy.with_name(copy.name + '-journal'))
    with closing(sqlite3.connect(copy)) as old, closing(sqlite3.connect(target)) as new:
        old.execute('PRAGMA writable_schema = ON')  # opens a file that is shorter than it says
        for (statement,) in old.execute('SELECT sql FROM sqlite_master WHERE type = "table"').fetchall():
            new.execute(statement)
        for table in _TABLES:
            _copy_rows(old, new, table)
        new.commit()


def _copy_rows(old: sqlite3.Connection, new: sqlite3.Connection, table: str) -> None:
    with suppress(sqlite3.DatabaseError):
        for row in old.execute(f'SELECT * FROM {table} ORDER BY rowid'):
            new.execute(f'INSERT INTO {table} VALUES ({", ".join("?" * len(row))})', row)


def _mend_mcap(source: Path, target: Path) -> None:
    """Keep the whole records before the damage and close the file behind them."""
    data = source.read_bytes()
    if not data.startswith(_MAGIC):
        raise ValueError('not an mcap file')
    end = len(_MAGIC)
    while end + _HEADER_SIZE <= len(data) and data[end] != _DATA_END:
        (size,) = struct.unpack_from('<Q', data, end + 1)
        if end + _HEADER_SIZE + size > len(data):
            break
        end += _HEADER_SIZE + size
    target.write_bytes(data[:end] + _FOOTER)


_MENDERS: dict[str, Callable[[Path, Path], None]] = {'.db3': _mend_sqlite, '.mcap': _mend_mcap}
