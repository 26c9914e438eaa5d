"""The autopilot as a node: an answer for every odometry, a stop where a setpoint is missing or old."""

import itertools
import math

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus

from portnav_ros.nodes.messages import (
    fill_odometry,
    fill_setpoint,
    new_odometry,
    new_setpoint,
    read_joints,
    read_stamp,
)
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.topics import TOPICS, offered_qos
from portnav_ros.types import Setpoint, VesselState

TICK_NS = 50_000_000
SECOND_NS = 1_000_000_000


def odometry(time_ns, yaw=0.0, surge=3.0):
    message = new_odometry()
    fill_odometry(message, time_ns, VesselState(0.0, 0.0, yaw, surge))
    return message


def setpoint(time_ns, yaw=0.5, speed=3.0):
    message = new_setpoint()
    fill_setpoint(message, time_ns, Setpoint(yaw, speed))
    return message


@pytest.fixture
def controller(graph, clock):
    return start(graph, clock, odom_age_s=60.0)


def start(graph, clock, **parameters):
    """A controller whose clock stands still, so that only stamps age, and that has had one odometry."""
    graph.listen('cmd_actuators', 'diagnostics')
    node = graph.add(PidController, **parameters)
    node.steady_s = clock
    graph.publish('odom', odometry(0))
    return node


def answer(graph, time_ns):
    return read_joints(graph.last('cmd_actuators', lambda m: read_stamp(m.header.stamp) == time_ns))


def steer_to(graph, time_ns, **wanted):
    """Send a setpoint and wait until it is in force, told by a rudder that is laid."""
    graph.publish('setpoint', setpoint(time_ns, **wanted))
    graph.last('cmd_actuators', lambda m: read_joints(m).rudder_rad != 0.0)


def test_the_rudder_turns_towards_the_setpoint(graph, controller):
    steer_to(graph, 0, yaw=0.5)
    graph.publish('odom', odometry(TICK_NS))
    assert answer(graph, TICK_NS).rudder_rad > 0.0
    graph.publish('odom', odometry(2 * TICK_NS, yaw=1.0))
    assert answer(graph, 2 * TICK_NS).rudder_rad < 0.0


def test_without_a_setpoint_the_vessel_is_stopped(graph, controller):
    graph.publish('odom', odometry(TICK_NS, surge=3.0))
    command = answer(graph, TICK_NS)
    assert command.thrust_n < 0.0
    assert command.rudder_rad == pytest.approx(0.0)
    graph.status('pid_controller', lambda status: status.message == 'stop: no setpoint yet')


def test_an_old_setpoint_gives_a_stop_that_keeps_the_heading(graph, controller):
    steer_to(graph, 0)
    graph.publish('odom', odometry(1_500_000_000))
    assert answer(graph, 1_500_000_000).thrust_n > 0.0
    graph.publish('odom', odometry(1_550_000_000, yaw=0.2))
    assert answer(graph, 1_550_000_000).thrust_n < 0.0
    graph.publish('odom', odometry(1_600_000_000, yaw=0.1))
    assert answer(graph, 1_600_000_000).rudder_rad > 0.0
    graph.status('pid_controller', lambda status: status.message == 'stop: setpoint too old')


@pytest.mark.parametrize(
    ('message', 'reason'),
    [(setpoint(0, speed=math.nan), 'not finite'), (setpoint(SECOND_NS), 'future')],
)
def test_a_bad_setpoint_is_refused_and_counted(graph, controller, message, reason):
    graph.until(lambda: graph.heard['cmd_actuators'])
    graph.publish('setpoint', message)
    _, _, values = graph.status(
        'pid_controller', lambda s: any(v.key == 'refused_setpoint' for v in s.values)
    )
    assert values['refused_setpoint'] == '1'
    assert values['setpoint_ns'] == '-1'


def test_an_odometry_that_is_not_finite_gets_no_answer(graph, controller):
    graph.publish('odom', odometry(TICK_NS, surge=math.inf))
    graph.publish('odom', odometry(2 * TICK_NS))
    answer(graph, 2 * TICK_NS)
    assert TICK_NS not in [read_stamp(m.header.stamp) for m in graph.heard['cmd_actuators']]
    assert 'not finite' in controller.vitals.reasons['odom']


def test_a_silent_driver_gets_neutral_and_is_trusted_again_after_a_while(graph, clock):
    start(graph, clock)
    steer_to(graph, 0)
    clock.now_s += 0.6
    graph.last('cmd_actuators', lambda m: read_joints(m) == (0.0, 0.0))
    graph.status('pid_controller', lambda status: status.message == 'stop: odom too old')
    for tick in range(1, 43):
        clock.now_s += 0.05
        graph.publish('setpoint', setpoint(tick * TICK_NS))
        graph.publish('odom', odometry(tick * TICK_NS))
        assert (answer(graph, tick * TICK_NS).thrust_n > 0.0) == (tick == 42)


def test_odometry_whose_stamp_stands_still_gets_neutral(graph, clock):
    start(graph, clock)
    graph.publish('odom', odometry(TICK_NS))
    answer(graph, TICK_NS)
    for _ in range(12):
        clock.now_s += 0.05
        graph.publish('odom', odometry(TICK_NS))
    graph.last('cmd_actuators', lambda m: read_joints(m) == (0.0, 0.0))


def test_without_odometry_not_even_a_setpoint_moves_the_vessel(graph, clock):
    node = start(graph, clock)
    steer_to(graph, 0)
    clock.now_s += 0.6
    graph.heard['cmd_actuators'].clear()
    graph.publish('setpoint', setpoint(TICK_NS, speed=0.0))
    graph.until(lambda: node._setpoint_ns == TICK_NS, 'the setpoint')
    graph.until(lambda: len(graph.heard['cmd_actuators']) > 2, 'commands')
    assert {read_joints(m) for m in graph.heard['cmd_actuators']} == {(0.0, 0.0)}


def test_a_time_without_odometry_is_none_of_braking(graph, clock):
    start(graph, clock, astern_s=0.98)
    answer(graph, 0)
    clock.now_s += 30.0
    graph.publish('odom', odometry(30 * SECOND_NS))
    graph.last('cmd_actuators', lambda m: read_stamp(m.header.stamp) and read_joints(m).thrust_n < 0.0)


def test_astern_thrust_ends_after_a_while(graph, clock):
    node = start(graph, clock, odom_age_s=60.0, astern_s=0.98)
    for tick in range(1, 25):
        graph.publish('odom', odometry(tick * TICK_NS))
        assert (answer(graph, tick * TICK_NS).thrust_n < 0.0) == (tick < 19)
    graph.status('pid_controller', lambda status: status.message == 'stop: no setpoint yet')
    assert node.health().values['thrust_bound'] == 'reached'


def test_in_a_stop_thrust_ahead_ends_after_a_while_too(graph, clock):
    start(graph, clock, odom_age_s=60.0, setpoint_age_s=60.0, release_s=0.0, astern_s=0.98)
    graph.publish('setpoint', setpoint(0, speed=0.0))
    graph.last('cmd_actuators', lambda m: read_joints(m).rudder_rad != 0.0)
    for tick in range(1, 25):
        graph.publish('odom', odometry(tick * TICK_NS, surge=-0.3))
        assert (answer(graph, tick * TICK_NS).thrust_n > 0.0) == (tick < 20)


@pytest.mark.parametrize(
    ('surge', 'text'), [(-0.3, 'thrust the same way for too long: held at 0'), (-0.1, 'ok')]
)
def test_thrust_held_back_is_a_warning_while_the_vessel_moves(graph, clock, surge, text):
    node = start(graph, clock, odom_age_s=60.0, setpoint_age_s=60.0, release_s=0.0, astern_s=0.2)
    graph.publish('setpoint', setpoint(0, speed=0.0))
    graph.last('cmd_actuators', lambda m: read_joints(m).rudder_rad != 0.0)
    for tick in range(1, 10):
        graph.publish('odom', odometry(tick * TICK_NS, surge=surge))
        answer(graph, tick * TICK_NS)
    health = node.health()
    assert (health.text, health.values['thrust_bound']) == (text, 'reached')


def test_under_way_thrust_ahead_is_not_bounded(graph, clock):
    start(graph, clock, odom_age_s=60.0, setpoint_age_s=60.0, astern_s=0.2)
    steer_to(graph, 0)
    for tick in range(1, 10):
        graph.publish('odom', odometry(tick * TICK_NS))
        assert answer(graph, tick * TICK_NS).thrust_n > 0.0


def test_two_publishers_of_setpoints_stop_the_vessel_and_are_named(graph, controller):
    steer_to(graph, 0)
    rival = rclpy.create_node('rival', context=graph.context)
    rival.create_publisher(TOPICS['setpoint'].type, 'setpoint', offered_qos(TOPICS['setpoint']))
    level, text, _ = graph.status('pid_controller', lambda status: 'publishers' in status.message)
    assert level == DiagnosticStatus.ERROR
    assert text == 'stop: 2 publishers on setpoint: /other and /rival'
    graph.publish('odom', odometry(TICK_NS))
    assert answer(graph, TICK_NS).thrust_n < 0.0
    rival.destroy_node()


def test_a_clock_that_jumps_back_begins_anew(graph, controller):
    steer_to(graph, 0)
    graph.publish('odom', odometry(SECOND_NS))
    graph.publish('odom', odometry(0))
    graph.status(
        'pid_controller', lambda status: status.message == 'stop: no setpoint since the clock jumped'
    )


def test_in_lock_step_the_answer_waits_for_the_setpoint_of_the_decision(graph, clock):
    start(graph, clock, lock_step=True)
    graph.publish('setpoint', setpoint(0))
    answer(graph, 0)
    graph.publish('odom', odometry(SECOND_NS - TICK_NS))
    answer(graph, SECOND_NS - TICK_NS)
    graph.publish('odom', odometry(SECOND_NS))
    graph.status('pid_controller', lambda s: any(v.value == str(SECOND_NS) for v in s.values))
    assert SECOND_NS not in [read_stamp(m.header.stamp) for m in graph.heard['cmd_actuators']]
    graph.publish('setpoint', setpoint(SECOND_NS))
    answer(graph, SECOND_NS)


def test_a_repeated_odometry_gets_the_same_answer(graph, clock):
    start(graph, clock, lock_step=True, **{'autopilot.heading_ki': 5.0})
    graph.publish('setpoint', setpoint(0, yaw=0.01))
    first = answer(graph, 0)
    graph.publish('odom', odometry(0))
    graph.until(lambda: len(graph.heard['cmd_actuators']) > 1)
    assert read_joints(graph.heard['cmd_actuators'][-1]) == first


def test_commands_can_be_held_to_the_rates_of_the_actuators(graph, clock):
    node = start(graph, clock, odom_age_s=60.0, limit_rates=True)
    graph.publish('setpoint', setpoint(0, yaw=1.5, speed=5.0))
    commands = []
    for k in range(1, 40):
        graph.publish('odom', odometry(k * TICK_NS))
        commands.append(answer(graph, k * TICK_NS))
    vessel = node.params.vessel
    steps = [(b.rudder_rad - a.rudder_rad, b.thrust_n - a.thrust_n) for a, b in itertools.pairwise(commands)]
    assert max(abs(rudder) for rudder, _ in steps) == pytest.approx(0.05 * vessel.rudder_rate_radps)
    assert max(abs(thrust) for _, thrust in steps) == pytest.approx(0.05 * vessel.thrust_rate_nps)
