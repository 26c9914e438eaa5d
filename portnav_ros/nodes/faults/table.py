"""The one table of faults: what `portnav benchmark faults` and the tests try."""

from __future__ import annotations

import math
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
from nav_msgs.msg import Odometry

from portnav_ros.evaluation.processes import WORKER
from portnav_ros.nodes.faults import spoils
from portnav_ros.nodes.faults.graph import GOAL, LOCAL_PLANNER
from portnav_ros.nodes.faults.injector import Spoil
from portnav_ros.nodes.faults.rig import Fault, Rig
from portnav_ros.nodes.faults.verdict import NEUTRAL_S
from portnav_ros.nodes.messages import fill_setpoint, new_setpoint
from portnav_ros.nodes.safety_monitor import SafetyParams
from portnav_ros.nodes.topics import TOPICS, offered_qos
from portnav_ros.types import Setpoint

_LIMITS = SafetyParams()
PERIOD_S = _LIMITS.planner_period_s
SENSOR_S = _LIMITS.age_s + PERIOD_S
PLANNER_S = _LIMITS.setpoint_age_s + PERIOD_S
DRIVER_S = NEUTRAL_S + PERIOD_S
OTHER_GOAL, LAND = (3700.0, 10.0), (2000.0, -300.0)
HUNG_S, SLOW_S = 5.0, 0.3
PLANNING_S = 0.2  # of CPU time, a small part of a search
JUMP_S, JUMP_M = 100.0, 100.0
WATCHED_S = 5.0

Begin = Callable[[Rig], AbstractContextManager[None]]


def _spoiling(topic: str, make: Callable[[], Spoil]) -> Begin:
    return lambda rig: rig.spoilt(topic, make())


def _always(spoil: Spoil) -> Callable[[], Spoil]:
    return lambda: spoil


def _killing(node: str) -> Begin:
    @contextmanager
    def begin(rig: Rig) -> Iterator[None]:
        rig.graph.signal(node, signal.SIGKILL)
        yield

    return begin


def _shifting_clock(by_s: float) -> Begin:
    @contextmanager
    def begin(rig: Rig) -> Iterator[None]:
        rig.injector.shift_clock(by_s)
        yield

    return begin


@contextmanager
def _hang_planner(rig: Rig) -> Iterator[None]:
    pid = rig.graph.pid(LOCAL_PLANNER)
    rig.graph.signal(LOCAL_PLANNER, signal.SIGSTOP)
    try:
        yield
    finally:
        assert rig.graph.pid(LOCAL_PLANNER) == pid, 'a process that hangs has not died'
        rig.graph.signal(LOCAL_PLANNER, signal.SIGCONT)


@contextmanager
def _slow_planner(rig: Rig) -> Iterator[None]:
    relay = rig.injector.relays['setpoint_raw']
    relay.delay_s = SLOW_S
    try:
        yield
    finally:
        relay.delay_s = 0.0


@contextmanager
def _kill_driver(rig: Rig) -> Iterator[None]:
    rig.graph.kill_driver()
    try:
        yield
    finally:
        rig.graph.start_driver()


@contextmanager
def _rival(rig: Rig) -> Iterator[None]:
    with rig.another_node('rival') as node:
        publisher = node.create_publisher(Odometry, 'setpoint', offered_qos(TOPICS['setpoint']))
        message = new_setpoint()
        fill_setpoint(message, 0, Setpoint(math.pi, 3.0))
        publisher.publish(message)
        yield


@contextmanager
def _late_joiner(rig: Rig) -> Iterator[None]:
    """Hear what is latched, and leave again."""
    missing = {name for name, row in TOPICS.items() if row.latched} - {'episode', 'emergency_stop'}
    with rig.another_node('late_joiner') as node:
        for name in missing:
            row = TOPICS[name]
            node.create_subscription(
                row.type, name, lambda _, name=name: missing.discard(name), offered_qos(row)
            )
        rig.until(lambda: not missing, 'what is latched')
        yield


def _going_to(x_m: float, y_m: float) -> Begin:
    """Send a goal, and the scenario's own one afterwards."""

    @contextmanager
    def begin(rig: Rig) -> Iterator[None]:
        rig.send_goal(x_m, y_m)
        try:
            yield
        finally:
            rig.set_out(GOAL)

    return begin


@contextmanager
def _new_goal(rig: Rig) -> Iterator[None]:
    rig.set_out(OTHER_GOAL)
    yield
    rig.set_out(GOAL)


@contextmanager
def _kill_global_planner(rig: Rig) -> Iterator[None]:
    """Kill it while it plans; once it is back, it plans again."""
    begin_s = rig.graph.cpu_s(WORKER)
    rig.send_goal(*OTHER_GOAL)
    rig.until(lambda: rig.graph.cpu_s(WORKER) > begin_s + PLANNING_S, 'a search')
    rig.graph.signal('global_planner', signal.SIGKILL)
    yield
    rig.set_out(GOAL)


@contextmanager
def _fill_disk(rig: Rig) -> Iterator[None]:
    """Let no file of the recorder grow any more, as on a full disk."""
    resource.prlimit(rig.graph.pid('bag_recorder'), resource.RLIMIT_FSIZE, (0, 0))
    yield


FAULTS = (
    Fault('scan_lost', SENSOR_S, 'scan too old', _spoiling('scan', _always(spoils.lose))),
    Fault('scan_frozen', SENSOR_S, 'scan frozen', _spoiling('scan', spoils.freeze_scan)),
    Fault('scan_nan', SENSOR_S, 'only NaN', _spoiling('scan', _always(spoils.fill_ranges(math.nan)))),
    Fault('scan_inf', SENSOR_S, 'returns', _spoiling('scan', _always(spoils.fill_ranges(math.inf)))),
    Fault('scan_zero', SENSOR_S, 'from range_min', _spoiling('scan', _always(spoils.fill_ranges(0.0)))),
    Fault('scan_short', SENSOR_S, 'rays, expected', _spoiling('scan', _always(spoils.shorten))),
    Fault(
        'scan_loss_20_percent',
        None,
        '',
        _spoiling('scan', lambda: spoils.lose_some(0.2, np.random.default_rng(0))),
        WATCHED_S,
    ),
    Fault('odom_lost', SENSOR_S, 'odom too old', _spoiling('odom', _always(spoils.lose))),
    Fault('odom_frozen', SENSOR_S, 'odometry frozen', _spoiling('odom', spoils.freeze_pose)),
    Fault('odom_jump', SENSOR_S, 'odometry jumped', _spoiling('odom', lambda: spoils.jump(JUMP_M, 10))),
    Fault('odom_nan', SENSOR_S, 'not finite', _spoiling('odom', _always(spoils.not_a_number))),
    Fault('clock_forward', SENSOR_S, 'since the clock jumped', _shifting_clock(JUMP_S), 0.0),
    Fault('clock_back', SENSOR_S, 'since the clock jumped', _shifting_clock(-JUMP_S), 0.0),
    Fault('planner_hung', PLANNER_S, 'setpoint_raw too old', _hang_planner, HUNG_S),
    Fault('planner_slow', None, '', _slow_planner, WATCHED_S),
    Fault(
        'planner_nan',
        PLANNER_S,
        'setpoint_raw refused',
        _spoiling('setpoint_raw', _always(spoils.not_a_number)),
    ),
    Fault('planner_heading_jump', PLANNER_S, 'jumps by', _spoiling('setpoint_raw', spoils.turn_about)),
    Fault('two_publishers', SENSOR_S, 'rival', _rival),
    Fault('late_joiner', None, '', _late_joiner, 1.0),
    Fault('new_goal', None, '', _new_goal, 1.0),
    Fault('goal_on_land', PLANNER_S, 'is on land', _going_to(*LAND)),
    Fault('global_planner_killed', None, 'global_planner was killed', _kill_global_planner, 0.0),
    Fault('planner_killed', PLANNER_S, 'setpoint_raw too old', _killing(LOCAL_PLANNER), 0.0),
    Fault('safety_killed', PLANNER_S, 'stop: setpoint too old', _killing('safety_monitor'), 0.0),
    Fault('pid_killed', DRIVER_S, 'pid_controller was killed', _killing('pid_controller'), 0.0),
    Fault('driver_killed', SENSOR_S, 'odom too old', _kill_driver),
    Fault('recorder_disk_full', None, 'recording has stopped', _fill_disk, 1.0),
    Fault('recorder_killed', None, 'bag_recorder was killed', _killing('bag_recorder'), WATCHED_S),
)
BY_NAME = {fault.name: fault for fault in FAULTS}
