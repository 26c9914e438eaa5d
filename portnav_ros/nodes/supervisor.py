"""The graph's processes: started together, awaited until ready, restarted or ended, never orphaned."""

from __future__ import annotations

import contextlib
import os
import select
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

from portnav_ros.nodes import guardian
from portnav_ros.nodes.process import Command, NodeProcess, describe, tail
from portnav_ros.nodes.table import OnDeath

REFUSED = (2, 3)  # exit codes of a node: its parameters, chart or scenario; no model
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Limits(NamedTuple):
    """Patience of the supervisor."""

    ready_s: float = 120.0  # a first start compiles kernels
    notice_s: float = 4.0  # then say what is still awaited
    interrupt_s: float = 5.0  # between SIGINT and SIGTERM
    terminate_s: float = 3.0  # between SIGTERM and SIGKILL
    restarts: int = 3
    back_off_s: float = 0.5  # doubles with every restart of a node


class Report(NamedTuple):
    """What a node said over its status pipe; ``finished`` when it ended by itself in good order."""

    node: str
    values: dict[str, Any]
    finished: bool = False


class SupervisorError(RuntimeError):
    """The processes cannot go on; the message says which node, why and where its log is."""


class NodeDiedError(SupervisorError):
    """A node that the others cannot do without has ended."""


class NodeRefusedError(NodeDiedError):
    """A node has ended before it was ready, because it cannot use what it was given."""


class NotReadyError(SupervisorError):
    """A node did not become ready in time."""


class StopRequest(Exception):  # noqa: N818 - a request, not an error
    """A signal asked to stop."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class Supervisor:
    """Runs a graph of processes; a context manager, so that none outlives it.

    Args:
        commands: what to run.
        environment: of every process.
        say: takes one line for the user.
        held_files: descriptors that stay open until the last process has ended, such as a lock.
    """

    def __init__(
        self,
        commands: Sequence[Command],
        environment: dict[str, str],
        say: Callable[[str], None],
        limits: Limits = Limits(),  # noqa: B008 - immutable
        held_files: tuple[int, ...] = (),
    ) -> None:
        self._commands = {command.name: command for command in commands}
        self._environment = environment
        self._say = say
        self._limits = limits
        self._held_files = held_files
        self._running: dict[str, NodeProcess] = {}
        self._deaths = dict.fromkeys(self._commands, 0)
        self._restart_at_s: dict[str, float] = {}
        self._selector = selectors.DefaultSelector()
        self._signals: list[int] = []

    def __enter__(self) -> Self:
        """Start every process."""
        self._take_signals()
        self._guardian = subprocess.Popen(
            (sys.executable, '-I', '-S', guardian.__file__),
            stdin=subprocess.PIPE,
            start_new_session=True,
            pass_fds=self._held_files,
        )
        try:
            for name in self._commands:
                self._launch(name)
        except OSError:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop every process and give signals back to who had them."""
        self.stop()
        assert self._guardian.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._guardian.stdin.close()
        self._guardian.wait()
        signal.set_wakeup_fd(-1)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._selector.close()
        os.close(self._wake_reader)
        os.close(self._wake_writer)

    def wait_ready(self) -> list[Report]:
        """Return once every process has reported ready, with what else they said.

        Raises:
            NotReadyError: one took longer than the limit.
            NodeDiedError: one ended while starting.
            StopRequest: a signal came.
        """
        notice_s = time.monotonic() + self._limits.notice_s
        reports: list[Report] = []
        while waiting := [name for name, process in self._running.items() if not process.ready]:
            if time.monotonic() > notice_s:
                self._say(f'waiting for {", ".join(waiting)} (a first start compiles kernels, once)')
                notice_s = float('inf')
            reports += self.poll(0.5)
        return reports

    def poll(self, timeout_s: float) -> list[Report]:
        """What the nodes have said; waits for news no longer than the time-out.

        Raises:
            NodeDiedError: a node died whose death ends the graph, or too often.
            NotReadyError: a node did not become ready in time.
            StopRequest: a signal came.
        """
        self._check_times()
        reports: list[Report] = []
        for key, _ in self._selector.select(timeout_s):
            reports += key.data()
        if self._signals:
            raise StopRequest(self._signals.pop())
        return reports

    def stop(self) -> None:
        """End every process: SIGINT, then SIGTERM, then SIGKILL; a signal meanwhile cuts the wait short."""
        steps = (
            (signal.SIGINT, self._limits.interrupt_s),
            (signal.SIGTERM, self._limits.terminate_s),
            (signal.SIGKILL, self._limits.terminate_s),
        )
        for stops_last in (False, True):
            for number, patience_s in steps:
                group = [p for p in self._running.values() if p.command.stops_last == stops_last]
                for process in group:
                    if number != signal.SIGINT:
                        self._say(f'{process.command.name} does not end: {number.name}')
                    process.signal(number)
                self._await_end(group, time.monotonic() + patience_s)

    def _await_end(self, group: list[NodeProcess], limit_s: float) -> None:
        while group and time.monotonic() < limit_s and not self._signals:
            select.select([*(process.death for process in group), self._wake_reader], [], [], 0.1)
            self._on_wake()
            for process in [process for process in group if process.has_ended()]:
                group.remove(process)
                self._forget(process)
        self._signals.clear()

    def _take_signals(self) -> None:
        self._wake_reader, self._wake_writer = os.pipe()
        for descriptor in (self._wake_reader, self._wake_writer):
            os.set_blocking(descriptor, False)
        self._selector.register(self._wake_reader, selectors.EVENT_READ, self._on_wake)
        signal.set_wakeup_fd(self._wake_writer, warn_on_full_buffer=False)
        self._handlers = {
            number: signal.signal(number, lambda n, _: self._signals.append(n)) for number in SIGNALS
        }

    def _on_wake(self) -> list[Report]:
        with contextlib.suppress(BlockingIOError):
            os.read(self._wake_reader, 256)
        return []

    def _launch(self, name: str) -> None:
        process = NodeProcess(self._commands[name], self._environment)
        self._running[name] = process
        self._tell_guardian(process.pid)
        events = (
            (process.reader.descriptor, lambda: self._on_report(process)),
            (process.death, lambda: self._on_death(process)),
        )
        for descriptor, action in events:
            self._selector.register(descriptor, selectors.EVENT_READ, action)

    def _tell_guardian(self, group: int) -> None:
        assert self._guardian.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._guardian.stdin.write(f'{group}\n'.encode())
            self._guardian.stdin.flush()

    def _on_report(self, process: NodeProcess) -> list[Report]:
        if self._running.get(process.command.name) is not process:
            return []
        reports = process.reader.read()
        if not process.reader.open:
            self._ignore(process.reader.descriptor)
        process.ready = process.ready or any('ready' in values for values in reports)
        return [Report(process.command.name, values) for values in reports]

    def _on_death(self, process: NodeProcess) -> list[Report]:
        command, reports = process.command, self._on_report(process)
        code = self._forget(process)
        if command.finishes and code == 0:
            return [*reports, Report(command.name, {}, finished=True)]
        how = f'{command.name} {describe(code)}'
        if not process.ready and not self._deaths[command.name]:
            kind = NodeRefusedError if code in REFUSED else NodeDiedError
            raise kind(f'{how} while starting; {tail(command.log)}')
        self._deaths[command.name] += 1
        if command.on_death is OnDeath.GO_ON:
            self._say(f'{how}; the rest runs on without it; {tail(command.log)}')
        elif command.on_death is OnDeath.END or self._deaths[command.name] > self._limits.restarts:
            raise NodeDiedError(f'{how} (death {self._deaths[command.name]}); {tail(command.log)}')
        else:
            self._schedule(command.name, how)
        return reports

    def _schedule(self, name: str, how: str) -> None:
        deaths = self._deaths[name]
        wait_s = self._limits.back_off_s * 2 ** (deaths - 1)
        self._say(f'{how}; starting it again in {wait_s:g} s (restart {deaths} of {self._limits.restarts})')
        self._restart_at_s[name] = time.monotonic() + wait_s

    def _check_times(self) -> None:
        now_s = time.monotonic()
        for name in [name for name, when_s in self._restart_at_s.items() if when_s <= now_s]:
            del self._restart_at_s[name]
            self._launch(name)
        for name, process in self._running.items():
            waited_s = now_s - process.started_s
            if not process.ready and waited_s > self._limits.ready_s:
                raise NotReadyError(
                    f'{name} is not ready after {waited_s:.0f} s; {tail(process.command.log)}'
                )

    def _forget(self, process: NodeProcess) -> int:
        del self._running[process.command.name]
        self._ignore(process.reader.descriptor)
        self._ignore(process.death)
        code = process.collect()
        self._tell_guardian(-process.pid)
        return code

    def _ignore(self, descriptor: int) -> None:
        if descriptor in self._selector.get_map():
            self._selector.unregister(descriptor)
