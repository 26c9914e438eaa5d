"""The graph's processes: started together, awaited until ready, restarted or ended, never orphaned."""

from __future__ import annotations

import select
import selectors
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from portnav_ros.nodes.pending_signals import PendingSignals
from portnav_ros.nodes.process import Command, Guardian, NodeProcess, describe, tail
from portnav_ros.nodes.table import OnDeath

if TYPE_CHECKING:  # it loads ROS, which is better done while the nodes start
    from portnav_ros.nodes.lifecycle_manager import LifecycleManager

REFUSED = (2, 3)  # exit codes of a node: its parameters, chart or scenario; no model
MANAGE_S = 1.0  # between two looks at what the manager has to do, if it waits for nothing
LOOK_S = 0.005  # that it may take for a look


class Limits(NamedTuple):
    """Patience of the supervisor."""

    ready_s: float = 120.0  # a first start compiles kernels
    notice_s: float = 4.0  # then say what is still awaited
    rest_s: float = 3.0  # to deactivate, before SIGINT
    interrupt_s: float = 5.0  # between SIGINT and SIGTERM
    terminate_s: float = 3.0  # between SIGTERM and SIGKILL
    restarts: int = 3
    forgiven_s: float = 600.0  # after so long a life, a death is a node's first
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
        make_manager: of managed nodes, which are ready when active; others are as soon as they say so.
    """

    def __init__(
        self,
        commands: Sequence[Command],
        environment: dict[str, str],
        say: Callable[[str], None],
        limits: Limits = Limits(),  # noqa: B008 - immutable
        held_files: tuple[int, ...] = (),
        make_manager: Callable[[], LifecycleManager] | None = None,
    ) -> None:
        self._commands = {command.name: command for command in commands}
        self._environment, self._say = environment, say
        self._limits = limits
        self._held_files = held_files
        self._make_manager = make_manager
        self._manager: LifecycleManager | None = None
        self._running: dict[str, NodeProcess] = {}
        self._deaths = dict.fromkeys(self._commands, 0)
        self._restart_at_s, self._manage_at_s = dict[str, float](), 0.0
        self._selector = selectors.DefaultSelector()

    def __enter__(self) -> Self:
        """Start every process."""
        self._signals = PendingSignals()
        self._selector.register(self._signals.descriptor, selectors.EVENT_READ, self._on_signal)
        self._guardian = Guardian(self._held_files)
        try:
            for name in self._commands:
                self._launch(name)
            if self._make_manager is not None:
                self._manager = self._make_manager()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Deactivate every node, end its process by SIGINT, SIGTERM or SIGKILL, and give the signals back.

        A signal meanwhile cuts a wait short.
        """
        try:
            self._rest()
        finally:
            self._end()
        self._guardian.close()
        if self._manager is not None:
            self._manager.close()
        self._selector.close()
        self._signals.close()

    def wait_ready(self) -> list[Report]:
        """Return once every process is ready, with what else they said.

        Raises:
            NotReadyError: one took longer than the limit.
            NodeDiedError: one ended while starting.
            StopRequest: a signal came.
        """
        notice_s = time.monotonic() + self._limits.notice_s
        reports: list[Report] = []
        while waiting := [name for name, process in self._running.items() if not process.ready]:
            if time.monotonic() > notice_s:
                behind = ', '.join(self._behind() or waiting)
                self._say(f'waiting for {behind} (a first start compiles kernels, once)')
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
        reports, wait_s = self._manage(), timeout_s
        if self._manager is not None:
            wait_s = 0.0 if self._manager.waits(self._pids()) else min(MANAGE_S, timeout_s)
        for key, _ in self._selector.select(wait_s):
            reports += key.data()
        if self._signals:
            raise StopRequest(self._signals.take())
        return reports

    def _end(self) -> None:
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

    def _manage(self) -> list[Report]:
        """Let the manager work; tells which nodes have become active, and how long that took."""
        now_s = time.monotonic()
        if self._manager is None or (now_s < self._manage_at_s and not self._manager.waits(self._pids())):
            return []
        self._manage_at_s, reports = now_s + MANAGE_S, []
        for name, active in self._manager.step(self._pids(), LOOK_S).items():
            process = self._running[name]
            after_s = time.monotonic() - process.started_s
            if active:
                process.ready = True
                values = {'configured_after_s': process.configured_after_s, 'active_after_s': after_s}
                reports.append(Report(name, values))
            else:
                process.configured_after_s = after_s
        return reports

    def _rest(self) -> None:
        """Deactivate what is active, as long as it answers and no signal comes."""
        if self._manager is None:
            return
        self._manager.begin_rest()
        limit_s = time.monotonic() + self._limits.rest_s
        while not self._signals and time.monotonic() < limit_s and self._manager.waits(self._pids()):
            self._manager.step(self._pids(), LOOK_S)
        self._signals.clear()

    def _pids(self) -> dict[str, int | None]:
        """Process of each node that runs, or is to run again; None where it cannot be spoken to."""
        running = {
            name: process.pid if process.up and not process.has_ended() else None
            for name, process in self._running.items()
        }
        return running | dict.fromkeys(self._restart_at_s)

    def _behind(self) -> Mapping[str, str]:
        return self._manager.behind(self._pids()) if self._manager is not None else {}

    def _await_end(self, group: list[NodeProcess], limit_s: float) -> None:
        while group and time.monotonic() < limit_s and not self._signals:
            select.select([*(process.death for process in group), self._signals.descriptor], [], [], 0.1)
            self._signals.quiet()
            for process in [process for process in group if process.has_ended()]:
                group.remove(process)
                self._forget(process)
        self._signals.clear()

    def _on_signal(self) -> list[Report]:
        self._signals.quiet()
        return []

    def _launch(self, name: str) -> None:
        process = NodeProcess(self._commands[name], self._environment)
        self._running[name] = process
        self._guardian.tell(process.pid)
        events = (
            (process.reader.descriptor, lambda: self._on_report(process)),
            (process.death, lambda: self._on_death(process)),
        )
        for descriptor, action in events:
            self._selector.register(descriptor, selectors.EVENT_READ, action)

    def _on_report(self, process: NodeProcess) -> list[Report]:
        if self._running.get(process.command.name) is not process:
            return []
        reports = process.reader.read()
        if not process.reader.open:
            self._ignore(process.reader.descriptor)
        process.up = process.up or any('ready' in values for values in reports)
        process.ready = process.ready or (process.up and not process.command.managed)
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
        forgiven = time.monotonic() - process.started_s > self._limits.forgiven_s
        self._deaths[command.name] = 1 + (0 if forgiven else self._deaths[command.name])
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
                blamed, why = next(iter(self._behind().items()), (name, 'it has said nothing'))
                log = self._commands[blamed].log
                raise NotReadyError(f'{blamed} is not ready after {waited_s:.0f} s: {why}; {tail(log)}')

    def _forget(self, process: NodeProcess) -> int:
        del self._running[process.command.name]
        self._ignore(process.reader.descriptor)
        self._ignore(process.death)
        code = process.collect()
        self._guardian.tell(-process.pid)
        return code

    def _ignore(self, descriptor: int) -> None:
        if descriptor in self._selector.get_map():
            self._selector.unregister(descriptor)
