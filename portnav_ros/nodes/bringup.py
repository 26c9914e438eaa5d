"""``portnav up``: the whole graph of nodes, from start to a clean end. See docs/bringup.md."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from portnav_ros.nodes.domain_lock import DomainBusyError, hold_domain, read_domain
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.preparation import (
    DISCOVERY,
    Configuration,
    environment,
    load,
    make_options,
    prepare,
    read_configuration,
)
from portnav_ros.nodes.process import Command
from portnav_ros.nodes.supervisor import (
    Limits,
    NodeDiedError,
    NodeRefusedError,
    NotReadyError,
    Report,
    StopRequest,
    Supervisor,
)
from portnav_ros.nodes.table import LOCAL_PLANNERS, NAMES, RECORDER
from portnav_ros.types import Outcome

if TYPE_CHECKING:
    from portnav_ros.nodes.lifecycle_manager import LifecycleManager

POLL_S = 1.0
RECORDER_PATIENCE_S = 10.0
# Options of a graph that a command line hands on under their own names.
GIVEN = ('planner', 'model', 'allow_mismatch', 'difficulty', 'scenario', 'chart', 'seed', 'rate', 'storage')


class Exit(IntEnum):
    """Exit codes of ``portnav up``; a signal gives 128 plus its number."""

    SUCCESS = 0  # the goal was reached, or the graph was told to end
    MISTAKE = 2  # in the input, told by a node or, as an exception, before any has started
    DOMAIN_BUSY = 3
    NOT_READY = 4
    NODE_DIED = 5
    COLLISION = 10
    TIMEOUT = 11


class GraphResult(NamedTuple):
    """How a graph ended. time_s: simulated; wall_s: from ready to the end of the episode."""

    code: int
    outcome: Outcome
    message: str
    time_s: float
    wall_s: float


Follow = Callable[[Report], None]
Say = Callable[[str], None]


def sail(
    options: GraphOptions,
    configuration: Configuration,
    out: Path,
    follow: Follow = lambda report: None,
    say: Say = print,
) -> GraphResult:
    """Run a graph until its episode has ended, a signal comes or a node dies; then nothing runs any more.

    Args:
        options: what to run.
        configuration: parameters of the nodes.
        out: folder for chart, parameters, logs and bag.
        follow: is called with every report of a node: the sim sends time_s, distance_m to the goal,
            speed_mps and outcome.
        say: takes lines for the user.

    Raises:
        DomainBusyError: another graph runs on this domain.
        DomainError, ParamError, ScenarioError, ChartError, ModelError: the options cannot be run.
    """
    lock = hold_domain(read_domain(os.environ), options.namespace)
    try:
        commands = prepare(options, configuration, load(options), out)
        return _supervise(commands, options, lock, follow, say)
    finally:
        os.close(lock)


def _supervise(
    commands: Sequence[Command], options: GraphOptions, lock: int, follow: Follow, say: Say
) -> GraphResult:
    episode = _Episode(follow, say, recorded=any(command.name == RECORDER for command in commands))
    limits = Limits(ready_s=options.ready_s)
    try:
        make_manager = _manager(commands, options)
        with Supervisor(commands, environment(), say, limits, (lock,), make_manager) as supervisor:
            episode.take(supervisor.wait_ready())
            episode.start()
            while not episode.ended:
                episode.take(supervisor.poll(POLL_S))
            episode.stop()
            patience_s = time.monotonic() + RECORDER_PATIENCE_S
            while episode.unrecorded and time.monotonic() < patience_s:
                episode.take(supervisor.poll(POLL_S))
    except NotReadyError as error:
        return episode.result(Exit.NOT_READY, str(error))
    except NodeRefusedError as error:
        return episode.result(Exit.MISTAKE, str(error))
    except NodeDiedError as error:
        return episode.result(Exit.NODE_DIED, str(error))
    except StopRequest as request:
        return episode.result(128 + request.number, f'stopped by {request}')
    return episode.result(_exit_code(episode.outcome), episode.outcome.name)


def _manager(commands: Sequence[Command], options: GraphOptions) -> Callable[[], LifecycleManager] | None:
    names = [command.name for command in commands if command.managed]

    def make() -> LifecycleManager:
        os.environ.setdefault(*DISCOVERY)  # as for the nodes
        from portnav_ros.nodes.lifecycle_manager import LifecycleManager

        return LifecycleManager(names, options.namespace.strip('/'), options.remaps)

    return make if names else None


class _Episode:
    """What the sim has said of the episode."""

    def __init__(self, follow: Follow, say: Say, recorded: bool) -> None:
        self.outcome = Outcome.RUNNING
        self.ended = False
        self._recorded_s = -1.0 if recorded else math.inf
        self._follow = follow
        self._say = say
        self._time_s = 0.0
        self._start_s = self._end_s = float('nan')

    @property
    def unrecorded(self) -> bool:
        return self._recorded_s < self._time_s - 1e-6

    def start(self) -> None:
        self._start_s = time.monotonic()

    def stop(self) -> None:
        self._end_s = time.monotonic()

    def take(self, reports: Sequence[Report]) -> None:
        for report in reports:
            self._follow(report)
            if 'failure' in report.values:
                self._say(f'{report.node}: {report.values["failure"]}')
                self._recorded_s = math.inf
            self._time_s = report.values.get('time_s', self._time_s)
            self._recorded_s = report.values.get('recorded_s', self._recorded_s)
            if 'outcome' in report.values:
                self.outcome = Outcome[report.values['outcome']]
            self.ended = self.ended or report.finished or self.outcome is not Outcome.RUNNING

    def result(self, code: int, message: str) -> GraphResult:
        return GraphResult(int(code), self.outcome, message, self._time_s, self._end_s - self._start_s)


def _exit_code(outcome: Outcome) -> Exit:
    if outcome.collision:
        return Exit.COLLISION
    return Exit.TIMEOUT if outcome is Outcome.TIMEOUT else Exit.SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``portnav up``."""
    add_graph_arguments(parser)
    parser.add_argument('--namespace', metavar='NS', help='of every node')
    parser.add_argument(
        '--without',
        action='append',
        choices=NAMES,
        metavar='NODE',
        help=f'leave a node out, because something else plays its part; repeatable: {", ".join(NAMES)}',
    )
    parser.add_argument('--record', action=argparse.BooleanOptionalAction, help='record a bag (default)')
    parser.epilog = (
        'exit codes: 0 goal reached, 2 a mistake in the input, 3 another graph on this ROS domain, '
        '4 a node did not get ready, 5 a node died, 10 collision, 11 time-out of the episode, '
        '130 Ctrl-C, 143 SIGTERM'
    )


def add_graph_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that ``up`` and ``demo`` share."""
    parser.add_argument('--planner', choices=LOCAL_PLANNERS, help='local planner')
    parser.add_argument('--model', type=Path, metavar='FILE', help='of a learned planner: its weights')
    parser.add_argument(
        '--allow-mismatch',
        action='store_true',
        default=None,
        help='sail another vessel than the model was trained for',
    )
    parser.add_argument('--difficulty', metavar='D', help='paper, harbour, easy or a YAML file')
    world = parser.add_mutually_exclusive_group()
    world.add_argument('--scenario', metavar='NAME', help='a named scenario or its YAML file')
    world.add_argument('--chart', type=Path, metavar='FILE', help='GeoJSON or nav2 map YAML')
    parser.add_argument('--seed', type=int, metavar='N', help='of port, traffic and planner')
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument('--lock-step', action='store_true', help='deterministic, as fast as it goes')
    pace.add_argument('--real-time', action='store_true', help='as fast as the clock')
    pace.add_argument('--rate', type=float, metavar='N', help='N times as fast as the clock')
    parser.add_argument('--config', type=Path, metavar='FILE', help='YAML: only what differs')
    parser.add_argument('--storage', choices=('sqlite3', 'mcap'), help='format of the bag')
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for bag, logs and parameters')


def options_from(
    arguments: argparse.Namespace, defaults: Mapping[str, Any], **given: Any
) -> tuple[GraphOptions, Configuration]:
    """Options and configuration of a command line.

    Args:
        arguments: as add_graph_arguments declares them.
        defaults: of the command, below the configuration.
        given: further options of the command line; None for what was not.

    Raises:
        ParamError: an unknown key, a wrong type or a value out of range.
    """
    configuration = read_configuration(arguments.config)
    for name in GIVEN:
        given[name] = getattr(arguments, name)
    if arguments.lock_step:
        given['mode'] = 'lock_step'
    elif arguments.real_time or arguments.rate is not None:
        given['mode'] = 'real_time'
    source = str(arguments.config or 'config/portnav.yaml')
    return make_options(configuration, source, defaults, given), configuration


def default_folder(seed: int) -> Path:
    """Folder of a run that was given none: portnav_out/DATE-TIME-SEED."""
    return Path('portnav_out') / f'{time.strftime("%Y%m%d-%H%M%S")}-{seed}'


def run(arguments: argparse.Namespace) -> int:
    """Run the graph; returns an exit code as in Exit."""
    without = tuple(arguments.without) if arguments.without else None
    options, configuration = options_from(
        arguments, {}, namespace=arguments.namespace, without=without, record=arguments.record
    )
    out = arguments.out or default_folder(options.seed)
    print(f'{", ".join(spec.name for spec in options.nodes)} in {out}', flush=True)
    if warning := _foreign_port(options):
        print(f'portnav: warning: {warning}', file=sys.stderr)
    try:
        result = sail(options, configuration, out, _announce)
    except DomainBusyError as error:
        print(f'portnav: error: {error}', file=sys.stderr)
        return Exit.DOMAIN_BUSY
    sailed = f'{result.time_s:.0f} s sailed; ' if result.time_s else ''  # a vessel's driver tells no time
    print(f'{result.message}\n{sailed}everything is in {out}')
    return result.code


def _foreign_port(options: GraphOptions) -> str:
    """What is odd about sailing something else than the sim on a port that was never asked for."""
    if 'sim' not in options.without or options.chart or options.scenario:
        return ''
    port = f'the random port {options.seed} of {options.difficulty}'
    return f'no --chart: routes are planned on {port}, which no vessel but a simulated one is in'


def _announce(report: Report) -> None:
    if (time_s := report.values.get('active_after_s')) is not None:
        ready_s = report.values['configured_after_s']
        print(f'{report.node} is active after {time_s:.1f} s (configured: {ready_s:.1f} s)', flush=True)
