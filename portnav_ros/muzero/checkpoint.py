"""Checkpoints of a training run, from which it goes on to the bit.

A checkpoint is a set of files in one folder, named by ``state.json``, which is replaced last and in one
piece: a kill leaves either the old set or the new one. The replay is written once, in files of a range of
decisions each; a later checkpoint names those again that are still in the ring. Nothing is pickled.
"""

from __future__ import annotations

import io
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import torch

from portnav_ros.muzero.replay import Replay, Segment
from portnav_ros.training.run_directory import TrainingError, write_atomically
from portnav_ros.types import AnyArray

STATE = 'state.json'
SCHEMA = 1
DECISIONS_PER_FILE = 65_536


class Saved(NamedTuple):
    """What a checkpoint holds besides the replay.

    arrays: numpy arrays by name. tensors: what torch gave as state_dicts. counters: plain numbers and
    strings.
    """

    arrays: dict[str, AnyArray]
    tensors: dict[str, Any]
    counters: dict[str, Any]


class Checkpoints:
    """The folder of a run's checkpoints; only the last one is kept."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ranges: list[tuple[int, int]] = []  # decisions of the replay on disk, first and end

    def save(self, name: str, saved: Saved, replay: Replay) -> None:
        """Write a checkpoint; `name` tells it from the one before."""
        ranges = self._write_replay(replay)
        document = {
            'schema': SCHEMA,
            'arrays': f'arrays-{name}.npz',
            'tensors': f'tensors-{name}.pt',
            'replay': ranges,
            'written': replay.written,
            'counters': saved.counters,
        }
        tensors = io.BytesIO()
        torch.save(saved.tensors, tensors)
        write_arrays(self._folder / f'arrays-{name}.npz', saved.arrays)
        write_atomically(self._folder / f'tensors-{name}.pt', tensors.getvalue())
        write_atomically(self._folder / STATE, json.dumps(document).encode())
        self._ranges = ranges
        self._drop_others({STATE, f'arrays-{name}.npz', f'tensors-{name}.pt', *map(range_name, ranges)})

    def load(self, replay: Replay, device: torch.device) -> Saved | None:
        """Read the checkpoint and fill the replay; None where there is none yet.

        Raises:
            TrainingError: a file is missing or damaged, or was written by another version.
        """
        document = self._read_state()
        if document is None:
            return None
        with refusing(self._folder / STATE):
            tensors_file, arrays_file = (self._folder / document[key] for key in ('tensors', 'arrays'))
            self._ranges = [(int(first), int(end)) for first, end in document['replay']]
        with refusing(tensors_file):
            tensors = torch.load(tensors_file, weights_only=True, map_location=device)
        arrays = read_arrays(arrays_file)
        with refusing(self._folder):
            replay.restore(document['written'], (self._read_segment(item, replay) for item in self._ranges))
        return Saved(arrays, tensors, document['counters'])

    def _write_replay(self, replay: Replay) -> list[tuple[int, int]]:
        kept = [item for item in self._ranges if item[1] > replay.oldest]
        first = max(self._ranges[-1][1] if self._ranges else 0, replay.oldest)
        step = max(DECISIONS_PER_FILE // replay.batch, 1)
        new = [(at, min(at + step, replay.written)) for at in range(first, replay.written, step)]
        for item in new:
            segment = replay.segment(*item)._asdict()
            write_arrays(self._folder / range_name(item), segment)
        return kept + new

    def _read_segment(self, item: tuple[int, int], replay: Replay) -> tuple[int, Segment]:
        file = self._folder / range_name(item)
        arrays = read_arrays(file)
        other = sorted(arrays.keys() ^ set(Segment._fields))
        if other:
            raise TrainingError(
                f'{file}: {", ".join(other)}: the replay of this version has other fields; '
                'begin a new run with another --out, or resume with the version that began it'
            )
        segment = Segment(**arrays)
        with refusing(file):
            for name, array, row in zip(Segment._fields, segment, replay.segment(0, 0), strict=True):
                expected = (item[1] - item[0], *row.shape[1:])
                if array.shape != expected:
                    raise ValueError(f'{name} has shape {array.shape}, expected {expected}')
        return item[0], segment

    def _read_state(self) -> dict[str, Any] | None:
        file = self._folder / STATE
        if not file.exists():
            return None
        try:
            document: dict[str, Any] = json.loads(file.read_text(encoding='utf-8'))
        except ValueError as error:
            raise TrainingError(f'{file}: not valid JSON ({error}); begin a new run') from error
        if document.get('schema') != SCHEMA:
            raise TrainingError(f'{file}: schema {document.get("schema")}: this version reads {SCHEMA}')
        return document

    def _drop_others(self, names: set[str]) -> None:
        for file in self._folder.iterdir():
            if file.name not in names:
                file.unlink()


@contextmanager
def refusing(file: Path) -> Iterator[None]:
    """Name the file or folder whose content numpy, zip or torch cannot use.

    Raises:
        TrainingError: it is missing, damaged or of another run.
    """
    try:
        yield
    except TrainingError:
        raise
    except (
        OSError,
        LookupError,
        TypeError,
        ValueError,
        RuntimeError,
        EOFError,
        BadZipFile,
        UnpicklingError,
        zlib.error,
    ) as error:
        reason = str(error).partition('\n')[0]
        raise TrainingError(
            f'{file}: the checkpoint is damaged or of another run ({type(error).__name__}: {reason}); '
            'begin a new run with another --out'
        ) from error


def range_name(item: tuple[int, int]) -> str:
    """File of a range of decisions."""
    return f'replay-{item[0]}-{item[1]}.npz'


def write_arrays(file: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Write arrays uncompressed, in one piece, down to the disk."""
    temporary = file.with_name(f'{file.name}.new')
    with temporary.open('wb') as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]  # names as keywords
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(file)


def read_arrays(file: Path) -> dict[str, AnyArray]:
    """Read arrays by name.

    Raises:
        TrainingError: the file is missing, damaged or no set of arrays.
    """
    with refusing(file), np.load(file, allow_pickle=False) as content:
        return {name: content[name] for name in content.files}
