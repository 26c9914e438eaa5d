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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.processes import MODULE, Usage, family, process_name, read_usage

POLL_S = 0.2
PATIENCE_S = 300.0
MISS_NOTHING = 'qos_overrides./cmd_actuators.subscription.depth:=50'  # two may come at once
RATE = re.compile(r'(\w+) after ([\d.]+) s, ([\d.]+) times real time')


class Sample(NamedTuple):
    """What the processes of a graph have used up to a time in s."""

    time_s: float
    usage: dict[str, Usage]


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
        samples = _watch(graph, probe)
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
    usage, cpu_s = _most(samples), _spent(samples, arguments.seconds)
    return {
        **figures,
        'cpu_of_one_core': sum(cpu_s.values()) / arguments.seconds,
        'cpu_share': _shares(cpu_s),
        'memory_mb': sum(use.pss_mb for use in usage.values()),
        'memory_rss_mb': {name: use.rss_mb for name, use in usage.items()},
        'memory_pss_mb': {name: use.pss_mb for name, use in usage.items()},
    }


def _measure_pace(arguments: argparse.Namespace, out: Path) -> dict[str, Any]:
    graph = _start_graph(arguments, out, '--lock-step')
    try:
        samples = _watch(graph, graph)
    finally:
        _end(graph)
    log = out / 'log' / 'sim.log'
    told = RATE.search(log.read_text(encoding='utf-8')) if log.exists() else None
    if told is None:
        raise EvaluationError(_last_words(graph))
    usage, simulated_s, factor = _most(samples), float(told[2]), float(told[3])
    cpu_s = sum(use.cpu_s for use in usage.values())
    return {
        'outcome': told[1],
        'simulated_s': simulated_s,
        'real_time_factor': factor,
        'cpu_s': cpu_s,
        'simulated_s_per_cpu_s': simulated_s / cpu_s,
        'cpu_s_by_process': {name: use.cpu_s for name, use in usage.items()},
        'cpu_share_lock_step': _shares(_spent(samples, simulated_s / factor)),
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


def _watch(graph: subprocess.Popen[str], until: subprocess.Popen[str]) -> list[Sample]:
    """Sample the graph's processes until one of two ends."""
    samples = []
    end_s = time.monotonic() + PATIENCE_S
    while until.poll() is None and graph.poll() is None and time.monotonic() < end_s:
        usage = {process_name(pid): read_usage(pid) for pid in family(graph.pid)}
        samples.append(
            Sample(time.monotonic(), {name: use for name, use in usage.items() if use is not None})
        )
        time.sleep(POLL_S)
    return samples


def _most(samples: list[Sample]) -> dict[str, Usage]:
    """Largest figures of each process."""
    most: dict[str, Usage] = {}
    for sample in samples:
        for name, use in sample.usage.items():
            most[name] = Usage(*map(max, use, most.get(name, use)))
    return most


def _spent(samples: list[Sample], seconds: float) -> dict[str, float]:
    """CPU time in s of each process over the last seconds, in which the vessel sailed."""
    first = next(sample for sample in samples if sample.time_s >= samples[-1].time_s - seconds)
    last = _most(samples)
    return {name: last[name].cpu_s - use.cpu_s for name, use in first.usage.items()}


def _shares(cpu_s: dict[str, float]) -> dict[str, float]:
    return {name: used_s / sum(cpu_s.values()) for name, used_s in cpu_s.items()}


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE_S)


def _last_words(graph: subprocess.Popen[str]) -> str:
    _end(graph)
    said = graph.communicate()[0].splitlines()[-10:]
    return '\n'.join(['the graph did not run to the end:', *said])
