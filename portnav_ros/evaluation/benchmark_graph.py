"""`portnav benchmark graph`: latency in real time, real-time factor in lock-step, memory and CPU time.

Everything is measured from outside, on the processes that `portnav up` starts.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from portnav_ros.evaluation.planners import EvaluationError

POLL_S = 0.2
PATIENCE_S = 300.0
MISS_NOTHING = 'qos_overrides./cmd_actuators.subscription.depth:=50'  # two may come at once
MODULE = 'portnav_ros'
CLOCK_TICKS = os.sysconf('SC_CLK_TCK')
RATE = re.compile(r'(\w+) after ([\d.]+) s, ([\d.]+) times real time')


class Usage(NamedTuple):
    """Of one process: CPU time in s, and resident and proportional set size in MB."""

    cpu_s: float
    rss_mb: float
    pss_mb: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--planner', default='dwa', help='local planner (default: %(default)s)')
    parser.add_argument('--difficulty', default='harbour', help='name or file (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--seconds', type=float, default=20.0, help='of latency (default: %(default)s)')


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and return the figures.

    Raises:
        EvaluationError: the graph did not run; the message holds the end of its output.
    """
    with tempfile.TemporaryDirectory(prefix='portnav_') as folder:
        return {
            'planner': arguments.planner,
            'difficulty': arguments.difficulty,
            'seed': arguments.seed,
            **_measure_latency(arguments, Path(folder) / 'real_time'),
            **_measure_pace(arguments, Path(folder) / 'lock_step'),
        }


def _measure_latency(arguments: argparse.Namespace, out: Path) -> dict[str, Any]:
    graph = _start_graph(arguments, out, '--real-time')
    duration = ('-p', f'duration_s:={arguments.seconds}')
    probe = _start('nodes.latency_probe', '--ros-args', *duration, '-p', MISS_NOTHING)
    try:
        usage = _watch(graph, probe)
        if probe.returncode != 0:
            raise EvaluationError(_last_words(graph))
        latencies_s = json.loads(probe.communicate()[0].splitlines()[-1])
    finally:
        _end(probe)
        _end(graph)
    figures: dict[str, Any] = {}
    for name, found in latencies_s.items():
        p50, p99 = np.percentile(1e3 * np.array(found), (50, 99)) if found else (np.nan, np.nan)
        figures |= {f'{name}_p50_ms': float(p50), f'{name}_p99_ms': float(p99)}
        figures[f'{name}_samples'] = len(found)
    return {
        **figures,
        'memory_mb': sum(use.pss_mb for use in usage.values()),
        'memory_rss_mb': {name: use.rss_mb for name, use in usage.items()},
        'memory_pss_mb': {name: use.pss_mb for name, use in usage.items()},
    }


def _measure_pace(arguments: argparse.Namespace, out: Path) -> dict[str, Any]:
    graph = _start_graph(arguments, out, '--lock-step')
    try:
        usage = _watch(graph, graph)
    finally:
        _end(graph)
    log = out / 'log' / 'sim.log'
    told = RATE.search(log.read_text(encoding='utf-8')) if log.exists() else None
    if told is None:
        raise EvaluationError(_last_words(graph))
    cpu_s = sum(use.cpu_s for use in usage.values())
    return {
        'outcome': told[1],
        'simulated_s': float(told[2]),
        'real_time_factor': float(told[3]),
        'cpu_s': cpu_s,
        'simulated_s_per_cpu_s': float(told[2]) / cpu_s,
        'cpu_s_by_process': {name: use.cpu_s for name, use in usage.items()},
    }


def _start_graph(arguments: argparse.Namespace, out: Path, pace: str) -> subprocess.Popen[str]:
    options = ('--planner', arguments.planner, '--difficulty', arguments.difficulty)
    return _start('', 'up', *options, '--seed', str(arguments.seed), pace, '--out', str(out))


def _start(module: str, *arguments: str) -> subprocess.Popen[str]:
    name = f'{MODULE}.{module}' if module else MODULE
    environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'} | dict(os.environ)
    return subprocess.Popen(
        (sys.executable, '-m', name, *arguments),
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL if module else subprocess.STDOUT,  # the graph's tells why it ended
        text=True,
    )


def _watch(graph: subprocess.Popen[str], until: subprocess.Popen[str]) -> dict[str, Usage]:
    """Sample the graph's processes until one of two ends; the largest figures of each."""
    usage: dict[str, Usage] = {}
    end_s = time.monotonic() + PATIENCE_S
    while until.poll() is None and graph.poll() is None and time.monotonic() < end_s:
        for pid in _family(graph.pid):
            name, found = _name(pid), _usage(pid)
            if found is not None:
                usage[name] = Usage(*map(max, found, usage.get(name, found)))
        time.sleep(POLL_S)
    return usage


def _family(pid: int) -> Iterator[int]:
    """A process and all that descend from it."""
    yield pid
    for file in Path('/proc').glob(f'{pid}/task/*/children'):
        for child in _read(file).split():
            yield from _family(int(child))


def _name(pid: int) -> str:
    words = _read(Path(f'/proc/{pid}/cmdline')).split('\0')
    modules = [word for word in words if word.startswith(f'{MODULE}.nodes.')]
    if modules:
        return modules[0].rsplit('.', 1)[-1]
    return 'bringup' if 'up' in words else 'planning_worker' if 'serve' in ' '.join(words) else 'other'


def _usage(pid: int) -> Usage | None:
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


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE_S)


def _last_words(graph: subprocess.Popen[str]) -> str:
    _end(graph)
    said = graph.communicate()[0].splitlines()[-10:]
    return '\n'.join(['the graph did not run to the end:', *said])
