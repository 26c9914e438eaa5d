"""One node as a process: with a status pipe and a log, signalled and collected with all it has started."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from portnav_ros.nodes import guardian
from portnav_ros.nodes.status_pipe import STATUS_FD, StatusReader
from portnav_ros.nodes.table import OnDeath

TAIL_LINES = 15


class Command(NamedTuple):
    """What to run, where its output goes and what its death means; managed: it has a node's lifecycle."""

    name: str
    argv: tuple[str, ...]
    log: Path
    on_death: OnDeath = OnDeath.END
    finishes: bool = False
    stops_last: bool = False
    managed: bool = False


class NodeProcess:
    """A running command; leads a process group of its own, so that a terminal's Ctrl-C does not reach it.

    ``up``: it has said so; ``ready``: it does its work.
    """

    def __init__(self, command: Command, environment: dict[str, str]) -> None:
        self.command = command
        self.reader = StatusReader()
        self.started_s = time.monotonic()
        self.up = self.ready = False
        self.configured_after_s = math.nan
        command.log.parent.mkdir(parents=True, exist_ok=True)
        with command.log.open('ab') as log:
            self._process = subprocess.Popen(
                command.argv,
                env=environment | {STATUS_FD: str(self.reader.writer)},
                pass_fds=(self.reader.writer,),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        os.close(self.reader.writer)
        self.death = os.pidfd_open(self._process.pid)  # readable once the process has ended

    @property
    def pid(self) -> int:
        """Process and process group."""
        return self._process.pid

    def signal(self, number: int) -> None:
        """Send a signal to the process and to all it has started."""
        try:
            os.killpg(self.pid, number)
        except ProcessLookupError:
            return

    def has_ended(self) -> bool:
        """Whether it waits to be collected."""
        return bool(os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT))

    def collect(self) -> int:
        """Exit code of a process that has ended; kills what it left behind.

        The group is signalled before the process is waited for, while its number cannot be taken by another.
        """
        self.signal(signal.SIGKILL)
        self.reader.close()
        os.close(self.death)
        return self._process.wait()


class Guardian:
    """A process that ends what is left of the others, should this one be killed: guardian.py.

    Args:
        held_files: descriptors that it keeps open until the last process has ended.
    """

    def __init__(self, held_files: tuple[int, ...]) -> None:
        self._process = subprocess.Popen(
            (sys.executable, '-I', '-S', guardian.__file__),
            stdin=subprocess.PIPE,
            start_new_session=True,
            pass_fds=held_files,
        )

    def tell(self, group: int) -> None:
        """Name a process group that has started, or, with a minus, one that has ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(f'{group}\n'.encode())
            self._process.stdin.flush()

    def close(self) -> None:
        """Let it go, once the others have ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()


def tail(log: Path, lines: int = TAIL_LINES) -> str:
    """The last lines of a log, indented, below its name."""
    text = log.read_text(encoding='utf-8', errors='replace') if log.exists() else ''
    body = '\n'.join(f'    {line}' for line in text.splitlines()[-lines:])
    return f'the end of {log}:\n{body or "    (empty)"}'


def describe(code: int) -> str:
    """An exit code in words."""
    return f'was killed by {signal.Signals(-code).name}' if code < 0 else f'ended with code {code}'
