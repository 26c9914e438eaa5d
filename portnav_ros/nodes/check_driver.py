"""``portnav check-driver``: does a driver, the sim or a vessel's, speak the contract? See docs/vessel.md."""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from tqdm import tqdm

from portnav_ros.evaluation.driver.checks import check_driver
from portnav_ros.evaluation.driver.moves import STEPS, Step, check_moves, command_of, moves_left_out
from portnav_ros.evaluation.driver.record import DriverRecord, Expected, Finding, Move
from portnav_ros.evaluation.signals import terminable
from portnav_ros.nodes.domain_lock import read_domain
from portnav_ros.nodes.driver_probe import SPIN_S, DriverProbe, SpinOnce
from portnav_ros.nodes.preparation import DISCOVERY, make_options, read_configuration
from portnav_ros.params import ParamError
from portnav_ros.sim.difficulty import load_difficulty, load_vessel
from portnav_ros.types import Actuation

DISCOVERY_S = 5.0
SETTLE_S = 0.5  # after the first odometry, for the other topics to be found
SERVICE_S = 3.0
SILENCE_S = 1.0  # of odometry, past which moves end
PATIENCE = 3.0  # with simulated time that runs slower than the clock
NEUTRAL = Actuation(0.0, 0.0)
PARTING_S = 0.5  # neutral commands at the end
Say = Callable[[str], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--seconds', type=float, default=30.0, metavar='S', help='to listen (default 30)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the findings')
    parser.add_argument('--namespace', default='', metavar='NS', help='of the driver')
    parser.add_argument(
        '--difficulty', metavar='D', help='names vessel and lidar, as for `portnav up` (name or YAML file)'
    )
    parser.add_argument(
        '--move',
        action=argparse.BooleanOptionalAction,
        default=False,
        help='MOVES THE VESSEL: gently, for 45 s, for the checks of rudder, thrust, neutral and ~/enable',
    )
    parser.add_argument(
        '--room', type=float, default=150.0, metavar='M', help='moves end this far off (default 150 m)'
    )
    parser.epilog = 'exit codes: 0 nothing failed, 1 something failed, 2 a mistake in the input, 130 Ctrl-C'


def run(arguments: argparse.Namespace) -> int:
    """Check a driver; returns 1 if any check failed, else 0.

    Raises:
        ParamError: the options cannot be used.
        DomainError: ROS_DOMAIN_ID is no domain.
    """
    if not (1.0 <= arguments.seconds <= 3600.0 and arguments.room > 0.0):
        raise ParamError('--seconds must lie in [1, 3600], and --room above 0')
    if arguments.move and arguments.difficulty is None:
        raise ParamError('--move needs --difficulty: the vessel that it names decides what is gentle')
    if arguments.json and not arguments.json.resolve().parent.is_dir():
        raise ParamError(f'--json {arguments.json}: make the folder first')
    expected = _expected(arguments.difficulty)
    read_domain(os.environ)
    os.environ.setdefault(*DISCOVERY)  # as for `portnav up`
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    probe = DriverProbe(namespace=arguments.namespace.strip('/') or None)
    try:
        executor.add_node(probe)
        room_m = arguments.room if arguments.move else None
        with terminable():
            findings = examine(probe, executor.spin_once, arguments.seconds, expected, room_m, tqdm.write)
    finally:
        probe.destroy_node()
        rclpy.try_shutdown()
    print('\n'.join(table(findings)))
    if arguments.json:
        text = json.dumps([finding._asdict() for finding in findings], indent=2)
        arguments.json.write_text(text + '\n', encoding='utf-8')
    return 1 if any(finding.status == 'fail' for finding in findings) else 0


def examine(
    probe: DriverProbe,
    spin_once: SpinOnce,
    seconds: float,
    expected: Expected,
    room_m: float | None,
    say: Say,
) -> list[Finding]:
    """Listen, make the moves where they are wanted and nothing has failed, and judge.

    Args:
        probe: the node that listens.
        spin_once: serves its callbacks for at most so many seconds.
        seconds: to listen before any move.
        expected: vessel and lidar.
        room_m: how far the vessel may go; None: no moves.
        say: takes lines for the user.
    """
    _discover(probe, spin_once)
    probe.begin()
    _listen(probe, spin_once, seconds, 'listening', lambda: True)
    probe.look_around()
    findings = check_driver(probe.record, expected)
    reason = _reason_to_stay(findings, probe.record, room_m)
    if reason:
        return findings + moves_left_out(reason)
    moves = lead(probe, spin_once, STEPS, expected, room_m or 0.0, say)
    probe.look_around()
    return check_driver(probe.record, expected) + check_moves(moves, probe.record, expected)


def lead(
    probe: DriverProbe,
    spin_once: SpinOnce,
    steps: Sequence[Step],
    expected: Expected,
    room_m: float,
    say: Say,
) -> list[Move]:
    """Lead the vessel through steps, each announced; whatever happens, the last command is neutral.

    Returns:
        The moves that were made in whole: they end early where the vessel leaves its room.
    """
    begin, moves = probe.record.odometry[-1].position, []

    def safe() -> bool:
        newest = probe.record.odometry[-1]
        return probe.now_s - newest.heard_s <= SILENCE_S and math.dist(newest.position, begin) <= room_m

    try:
        for step in steps:
            say(_announcement(step, command_of(step, expected.vessel)))
            begin_s = probe.record.odometry[-1].stamp_s
            probe.command = command_of(step, expected.vessel)
            if step.enable is not None and not probe.enable(step.enable, spin_once, SERVICE_S):
                say('~/enable did not say yes: no further moves')
                break
            _listen(probe, spin_once, step.duration_s, step.name, safe)
            if not safe():
                say(f'odometry fell silent, or the vessel left its room of {room_m:g} m: no further moves')
                break
            moves.append(Move(step.name, begin_s, probe.record.odometry[-1].stamp_s, probe.command))
    finally:
        probe.command = NEUTRAL
        probe.send(NEUTRAL)
        _listen(probe, spin_once, PARTING_S, 'neutral', lambda: True)
        probe.command = None
    return moves


def table(findings: Sequence[Finding]) -> Iterator[str]:
    """One line per check, with the mend below what failed, and a summary."""
    for finding in findings:
        yield f'{finding.status:8}  {finding.check:19}  {finding.found}'
        if finding.mend:
            yield f'{"":8}  {"":19}  -> {finding.mend}'
    count = Counter(finding.status for finding in findings)
    yield f'\n{count["ok"]} passed, {count["fail"]} failed, {count["left out"]} left out'


def _expected(difficulty: str | None) -> Expected:
    given = {'difficulty': difficulty}
    options = make_options(read_configuration(None), 'config/portnav.yaml', {}, given)
    chosen = load_difficulty(options.difficulty)
    return Expected(load_vessel(chosen.vessel), chosen.lidar)


def _discover(probe: DriverProbe, spin_once: SpinOnce) -> None:
    """Wait for the odometry, for the other topics to be found, and for the clock if there is one."""
    for seconds, found in (
        (DISCOVERY_S, lambda: probe.record.odometry),
        (SETTLE_S, lambda: False),
        (DISCOVERY_S, lambda: probe.record.simulated or not probe.count_publishers('clock')),
    ):
        end_s = time.monotonic() + seconds
        while not found() and time.monotonic() < end_s:
            spin_once(SPIN_S)


def _listen(
    probe: DriverProbe, spin_once: SpinOnce, seconds: float, text: str, go_on: Callable[[], bool]
) -> None:
    """Serve callbacks for so many seconds of the driver's time, with a bar."""
    begin_s, patience_s = probe.now_s, time.monotonic() + PATIENCE * seconds + 1.0
    layout = '{desc:18} {percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} s'
    with tqdm(total=seconds, desc=text, bar_format=layout, leave=False, disable=None) as bar:
        while (gone_s := probe.now_s - begin_s) < seconds and time.monotonic() < patience_s and go_on():
            spin_once(SPIN_S)
            bar.update(min(gone_s, seconds) - bar.n)


def _reason_to_stay(findings: Sequence[Finding], record: DriverRecord, room_m: float | None) -> str:
    """Why no move is made; empty where nothing is in the way."""
    if room_m is None:
        return 'needs --move: THE VESSEL MOVES'
    if any(finding.status == 'fail' for finding in findings):
        return 'not tried: mend first what failed'
    if record.publishers['cmd_actuators']:
        others = ', '.join(end.node for end in record.publishers['cmd_actuators'])
        return f'not tried: {others} commands the vessel; end the stack first'
    return ''


def _announcement(step: Step, command: Actuation | None) -> str:
    what = (
        'no commands'
        if command is None
        else f'rudder {command.rudder_rad:+.2f} rad, {command.thrust_n:.0f} N'
    )
    enable = {None: '', True: ', enabled', False: ', disabled'}[step.enable]
    return f'{step.name}, {step.duration_s:.0f} s: {what}{enable}'
