"""Processes of a graph as the kernel tells of them: who descends from whom, CPU time and memory."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

MODULE = 'portnav_ros'
BRINGUP, WORKER, OTHER = 'bringup', 'planning_worker', 'other'
CLOCK_TICKS = os.sysconf('SC_CLK_TCK')


class Usage(NamedTuple):
    """Of one process: CPU time in s, and resident and proportional set size in MB."""

    cpu_s: float
    rss_mb: float
    pss_mb: float


def family(pid: int) -> Iterator[int]:
    """Yield a process and all that descend from it."""
    yield pid
    for file in Path('/proc').glob(f'{pid}/task/*/children'):
        for child in _read(file).split():
            yield from family(int(child))


def process_name(pid: int) -> str:
    """Return which node a process is, or BRINGUP, WORKER, OTHER."""
    words = _read(Path(f'/proc/{pid}/cmdline')).split('\0')
    modules = [word for word in words if word.startswith(f'{MODULE}.nodes.')]
    if modules:
        return modules[0].rsplit('.', 1)[-1]
    return BRINGUP if 'up' in words else WORKER if 'serve' in ' '.join(words) else OTHER


def marked(variable: str, value: str) -> list[int]:
    """Return the processes with a variable in their environment; those that have ended do not count."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        state = _read(folder / 'stat').rpartition(')')[2].split()[:1]
        if state not in ([], ['Z']) and f'{variable}={value}' in _read(folder / 'environ').split('\0'):
            found.append(int(folder.name))
    return found


def read_usage(pid: int) -> Usage | None:
    """Return what a process has used, None once it is gone."""
    stat = _read(Path(f'/proc/{pid}/stat')).rpartition(')')[2].split()
    memory = re.findall(r'^(Rss|Pss): +(\d+) kB', _read(Path(f'/proc/{pid}/smaps_rollup')), re.MULTILINE)
    if not stat or len(memory) < 2:
        return None
    sizes_mb = {key: int(value) / 1024.0 for key, value in memory}
    return Usage((int(stat[11]) + int(stat[12])) / CLOCK_TICKS, sizes_mb['Rss'], sizes_mb['Pss'])


def _read(file: Path) -> str:
    """Read a file of a process; empty once the process is gone."""
    try:
        return file.read_text(encoding='utf-8', errors='replace')
    except OSError:
        return ''
