"""`portnav benchmark bringups`: starts the graph and ends it again, many times; nothing may be left."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from portnav_ros.evaluation.processes import marked
from portnav_ros.nodes.preparation import environment
from portnav_ros.nodes.process import tail

MARK = 'PORTNAV_BRINGUP'  # in the environment of all that a bringup starts
ACTIVE = 'is active after'
PLANNER = 'line_of_sight'
INTERRUPTED = 128 + signal.SIGINT
PATIENCE_S = 180.0
POLL_S = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--count', type=int, default=100, metavar='N', help='(default: %(default)s)')


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Start and end the graph; return times in s, and what went wrong."""
    failed, started_s, ended_s = {}, [], []
    with tempfile.TemporaryDirectory(prefix='portnav_') as folder:
        for number in tqdm(range(1, arguments.count + 1), unit='bringup'):
            out = Path(folder) / str(number)
            complaint, start_s, end_s = bring_up(out, f'{os.getpid()}-{number}')
            started_s.append(start_s)
            ended_s.append(end_s)
            if complaint:
                failed[str(number)] = complaint
    return {
        'bringups': arguments.count,
        'start_p50_s': float(np.median(started_s)),
        'start_max_s': max(started_s),
        'end_p50_s': float(np.median(ended_s)),
        'end_max_s': max(ended_s),
        'failed': failed,
    }


def bring_up(out: Path, mark: str) -> tuple[str, float, float]:
    """Start a graph, wait until all nodes are active, and end it as Ctrl-C does.

    Args:
        out: folder for the run.
        mark: that tells its processes from all others.

    Returns:
        What went wrong, or nothing; the times in s that start and end took.
    """
    out.mkdir(parents=True)
    log, begin_s = out / 'up.log', time.monotonic()
    words = ('up', '--planner', PLANNER, '--scenario', 'rough_canal', '--out', str(out / 'run'))
    with log.open('wb') as file:
        process = subprocess.Popen(
            (sys.executable, '-m', 'portnav_ros', *words),
            env=environment() | {MARK: mark},
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
        )
    up = _await_active(process, log)
    active_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    code = _code_of(process)
    left = marked(MARK, mark)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    complaints = (
        '' if up else 'it did not become active',
        '' if code == INTERRUPTED else f'it ended with code {code}' if code is not None else 'it did not end',
        f'{len(left)} processes were left' if left else '',
    )
    complaint = '; '.join(filter(None, complaints))
    return f'{complaint}; {tail(log)}' if complaint else '', active_s - begin_s, time.monotonic() - active_s


def _code_of(process: subprocess.Popen[bytes]) -> int | None:
    try:
        return process.wait(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        return None


def _await_active(process: subprocess.Popen[bytes], log: Path) -> bool:
    """Whether every node became active; the driver is the last."""
    limit_s = time.monotonic() + PATIENCE_S
    while f'sim {ACTIVE}' not in log.read_text(encoding='utf-8', errors='replace'):
        if process.poll() is not None or time.monotonic() > limit_s:
            return False
        time.sleep(POLL_S)
    return True
