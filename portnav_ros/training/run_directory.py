"""The folder of one training run: configuration, metrics, checkpoint, best model, TensorBoard events.

A run that is killed and resumed writes the same ``metrics.jsonl`` as an uninterrupted one, apart from
the fields in WALL_CLOCK.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from portnav_ros.params import read_yaml

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

WALL_CLOCK = ('steps_per_s', 'time_share')


class TrainingError(ValueError):
    """A training run cannot be started or resumed; the message names the folder and the mend."""


class RunDirectory:
    """Files of one run.

    Public paths: ``config`` (config.yaml), ``metrics`` (metrics.jsonl), ``checkpoint`` (a folder),
    ``best_model`` (best.safetensors, its card best.json beside it).
    """

    def __init__(self, path: Path) -> None:
        """Name the files; `create` and `reopen` are the ways to get one that exists."""
        self.path = path
        self.config = path / 'config.yaml'
        self.metrics = path / 'metrics.jsonl'
        self.checkpoint = path / 'checkpoint'
        self.best_model = path / 'best.safetensors'
        self._events: SummaryWriter | None = None

    @classmethod
    def create(cls, path: Path, config: Mapping[str, Any]) -> RunDirectory:
        """Begin a run.

        Args:
            path: a folder that is not there yet or is empty.
            config: plain values (see `plain`): algorithm, seed, parameters, provenance.

        Raises:
            TrainingError: the folder holds a run, or anything else, already.
        """
        run = cls(path)
        run.check_free()
        run.checkpoint.mkdir(parents=True)
        text = yaml.safe_dump(plain(config), sort_keys=False, allow_unicode=True)
        write_atomically(run.config, text.encode())
        run._open_events()
        return run

    @classmethod
    def reopen(cls, path: Path, steps: int) -> RunDirectory:
        """Go on with a run from a checkpoint; metrics of later steps than the checkpoint's are cut off.

        Raises:
            TrainingError: there is no run in the folder.
        """
        run = cls(path)
        run.read_config()
        run._cut_back(steps)
        run.checkpoint.mkdir(exist_ok=True)
        run._open_events(purge_step=steps + 1)
        return run

    def check_free(self) -> None:
        """Refuse a folder in which no run can begin.

        Raises:
            TrainingError: it holds a run, or anything else, already.
        """
        if self.config.exists():
            raise TrainingError(
                f'{self.path}: holds a run already; continue it with --resume or choose another --out'
            )
        if self.path.exists() and any(self.path.iterdir()):
            raise TrainingError(f'{self.path}: is not empty; choose another --out')

    def read_config(self) -> dict[str, Any]:
        """What the run was begun with.

        Raises:
            TrainingError: there is no run in the folder.
            ParamError: its config.yaml cannot be read.
        """
        if not self.config.exists():
            raise TrainingError(f'{self.path}: holds no run to resume (no {self.config.name})')
        return read_yaml(self.config)

    def log(self, line: Mapping[str, Any]) -> None:
        """Append a line to metrics.jsonl, and its numbers to TensorBoard; ``steps`` is required."""
        with self.metrics.open('a', encoding='utf-8') as file:
            file.write(json.dumps(line, allow_nan=False) + '\n')
        if self._events is not None:
            for name, value in flat(line).items():
                if isinstance(value, (int, float)) and name != 'steps':
                    self._events.add_scalar(name, value, line['steps'])
            self._events.flush()

    def close(self) -> None:
        """Close what is open."""
        if self._events is not None:
            self._events.close()

    def _cut_back(self, steps: int) -> None:
        lines = read_metrics(self.metrics)
        kept = [json.dumps(line) + '\n' for line in lines if line['steps'] <= steps]
        write_atomically(self.metrics, ''.join(kept).encode())

    def _open_events(self, purge_step: int | None = None) -> None:
        if importlib.util.find_spec('tensorboard') is None or importlib.util.find_spec('torch') is None:
            print("no TensorBoard events: pip install 'portnav_ros[train]'", file=sys.stderr)
            return
        from torch.utils.tensorboard import SummaryWriter  # optional, and loads slowly

        self._events = SummaryWriter(str(self.path / 'events'), purge_step=purge_step)


def read_metrics(file: Path) -> list[dict[str, Any]]:
    """Lines of a metrics.jsonl; a last line that a kill cut short is left out.

    Raises:
        TrainingError: another line is not JSON; names the line.
    """
    if not file.exists():
        return []
    parsed = []
    lines = file.read_text(encoding='utf-8').split('\n')
    for number, text in enumerate(lines[:-1], start=1):
        try:
            parsed.append(json.loads(text))
        except json.JSONDecodeError as error:
            raise TrainingError(f'{file}: line {number} is not JSON ({error.msg}); remove it') from error
    return parsed


def write_atomically(file: Path, content: bytes) -> None:
    """Write a file so that a kill leaves either the old or the new one."""
    temporary = file.with_name(f'{file.name}.new')
    with temporary.open('wb') as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(file)


def plain(value: Any) -> Any:
    """Nested tuples and paths as what YAML and JSON hold: lists and strings."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def flat(line: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Nested mappings as one with keys ``outer/inner``."""
    values: dict[str, Any] = {}
    for key, value in line.items():
        if isinstance(value, Mapping):
            values |= flat(value, f'{prefix}{key}/')
        else:
            values[f'{prefix}{key}'] = value
    return values
