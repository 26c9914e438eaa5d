"""Trains several runs as processes of their own, with one progress bar; all of it can be resumed."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from tqdm import tqdm

from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.training_runs import Run

POLL_S = 1.0
PR_SET_PDEATHSIG = 1  # of prctl(2)
_QUIET = {'TQDM_MININTERVAL': '60'}  # a log needs no bar ten times a second


class Crew(NamedTuple):
    """What a run is given. jobs: runs at once. device, threads: of each, as `portnav train` takes them."""

    jobs: int = 1
    device: str = 'cpu'
    threads: int = 1


def train_all(runs: Sequence[Run], crew: Crew) -> list[str]:
    """Train what is not finished yet, in the order given; returns the names of runs that failed.

    A run that fails does not stop the others: its log says why, and the same call resumes it.

    Raises:
        EvaluationError: no run may work at a time.
        KeyboardInterrupt: Ctrl-C, after every run under way has saved; a second one ends them at once.
    """
    if crew.jobs < 1:
        raise EvaluationError(f'--jobs {crew.jobs} must be at least 1')
    fleet = _Fleet(runs, crew)
    try:
        fleet.train()
    finally:
        fleet.stop()
    return fleet.failed


class _Fleet:
    """Runs waiting, under way and done."""

    def __init__(self, runs: Sequence[Run], crew: Crew) -> None:
        self.failed: list[str] = []
        self._crew = crew
        self._waiting = deque(run for run in runs if not run.finished())
        self._active: dict[subprocess.Popen[bytes], Run] = {}
        self._done = {run.name: run.steps_done() for run in runs}
        total = sum(run.steps for run in runs)
        self._bar = tqdm(  # without smoothing the time to go is that of all steps so far
            total=total,
            initial=sum(self._done.values()),
            unit='step',
            unit_scale=True,
            smoothing=0,
            miniters=0,
        )

    def train(self) -> None:
        """Keep as many runs under way as may be, until none is left."""
        while self._waiting or self._active:
            while self._waiting and len(self._active) < self._crew.jobs:
                run = self._waiting.popleft()
                self._active[_start(run, self._crew)] = run
            time.sleep(POLL_S)
            self._show()
            self._collect()

    def stop(self) -> None:
        """Let what is under way save and end, and wait for it."""
        if self._active:
            self._bar.write(f'saving {len(self._active)} runs; Ctrl-C again ends them without')
        try:
            for process in self._active:
                process.send_signal(signal.SIGINT)
            for process in self._active:
                process.wait()
        except KeyboardInterrupt:
            for process in self._active:
                process.kill()
                process.wait()
            raise
        finally:
            self._bar.close()

    def _show(self) -> None:
        for run in self._active.values():
            self._done[run.name] = run.steps_done()
        self._bar.set_description_str(', '.join(run.name for run in self._active.values()), refresh=False)
        self._bar.update(sum(self._done.values()) - self._bar.n)

    def _collect(self) -> None:
        for process, run in list(self._active.items()):
            code = process.poll()
            if code is None:
                continue
            del self._active[process]
            if code:
                self.failed.append(run.name)
                self._bar.write(f'{run.name}: ended with code {code}; see {run.log}')


def _start(run: Run, crew: Crew) -> subprocess.Popen[bytes]:
    """Begin or resume a run in a session of its own, out of reach of the terminal's Ctrl-C."""
    options = [*run.command(), '--device', crew.device, '--threads', str(crew.threads)]
    with run.log.open('ab') as log:
        return subprocess.Popen(
            [sys.executable, '-m', 'portnav_ros', 'train', *options],
            env=_QUIET | os.environ,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )


def _end_with_parent() -> None:
    """Have a run end if this process is killed, since two must never write to one folder.

    The signal comes once for each thread of this process, and a second Ctrl-C ends a run at once: then it
    goes on from its last checkpoint.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a command in a shell's background is born deaf to it
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGINT)
