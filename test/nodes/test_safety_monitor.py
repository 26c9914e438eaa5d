"""The safety monitor as a node: passes setpoints untouched, slows, stops with a reason, and releases."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from portnav_ros.nodes.messages import (
    fill_odometry,
    fill_scan,
    fill_setpoint,
    new_odometry,
    new_scan,
    new_setpoint,
    read_setpoint,
    read_stamp,
)
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Setpoint, VesselState

SECOND_NS = 1_000_000_000
RAYS = 180


class Stack:
    """A safety monitor, with a planner and a driver that feed it; time is what the driver tells."""

    def __init__(self, graph, clock, **parameters):
        self._graph, self._clock, self.begin_s = graph, clock, 100.0
        graph.listen('setpoint', 'safety_state', 'diagnostics', 'markers')
        self.node = graph.add(SafetyMonitor, **parameters)
        self.node.steady_s = clock

    def pass_to(self, time_ns):
        self._clock.now_s = self.begin_s + time_ns / SECOND_NS

    def odom(self, time_ns, ahead=0.0, yaw=0.1, surge=3.0):
        message = new_odometry()
        x = surge * time_ns / SECOND_NS + ahead
        fill_odometry(message, time_ns, VesselState(x, 0.0, yaw, surge))
        self._graph.publish('odom', message)

    def scan(self, time_ns, ranges=None):
        # never the same twice, as of a real sensor
        given = np.full(RAYS, 300.0 + time_ns / SECOND_NS, np.float32) if ranges is None else ranges
        message = new_scan(LidarParams(rays=len(given)), 0.1)
        fill_scan(message, time_ns, given)
        self._graph.publish('scan', message)

    def raw(self, time_ns, yaw=0.25, speed=4.0):
        message = new_setpoint()
        fill_setpoint(message, time_ns, Setpoint(yaw, speed), (12.0, 34.0))
        self._graph.publish('setpoint_raw', message)
        return message

    def moment(self, time_ns, ranges=None, **pose):
        """Scan and odometry of one moment, both taken in."""
        self.pass_to(time_ns)
        self.odom(time_ns, **pose)
        self._graph.until(lambda: self.node._time_ns == time_ns, 'the odometry')
        self.scan(time_ns, ranges)
        self._graph.until(lambda: self.node._scan_ns == time_ns, 'the scan')

    def sail(self, time_ns, **wanted):
        """A moment with a setpoint of its own, which is passed."""
        self.moment(time_ns)
        raw = self.raw(time_ns, **wanted)
        self._graph.last('setpoint', lambda message: message == raw)

    def stopped(self, reason):
        """Wait for a stop; returns its setpoint."""
        self._graph.last('safety_state', lambda state: state.message == f'stop: {reason}')
        return read_setpoint(self._graph.last('setpoint', lambda m: m.twist.twist.linear.x == 0.0))

    def released(self, first, **pose):
        """All is well from a tenth of a second on: sailing is allowed 2 s later, not before."""
        for tenth in range(first, first + 23):
            assert tenth >= first + 20 or self.state() != 'passing'
            self.moment(tenth * SECOND_NS // 10, **pose)
            self.raw(tenth * SECOND_NS // 10)
        self._graph.until(lambda: self.state() == 'passing', 'release')

    def state(self):
        return self._graph.heard['safety_state'][-1].message


@pytest.fixture
def stack(graph, clock):
    return Stack(graph, clock)


def wall_ahead(distance_m):
    """Ranges to a wall across the bow, at a distance from the sensor."""
    angles = -math.pi + 2.0 * math.pi / RAYS * np.arange(RAYS)
    ranges = np.full(RAYS, np.inf, np.float32)
    ahead = np.abs(angles) < 0.5
    ranges[ahead] = distance_m / np.cos(angles[ahead])
    return ranges


def test_a_setpoint_passes_to_the_last_bit_and_at_once(graph, stack):
    stack.moment(SECOND_NS)
    raw = stack.raw(SECOND_NS, yaw=0.1234567890123)
    assert graph.last('setpoint', lambda m: m.twist.twist.linear.x) == raw
    graph.last('safety_state', lambda state: state.message == 'passing')


def test_an_absent_planner_is_answered_by_a_stop_that_is_repeated(graph, stack):
    stack.moment(SECOND_NS, yaw=0.7)
    assert stack.stopped('no setpoint_raw yet') == pytest.approx((0.7, 0.0))
    count = len(graph.heard['setpoint'])
    graph.until(lambda: len(graph.heard['setpoint']) > count + 3, 'more stops')


def test_a_silent_planner_is_answered_by_a_stop_and_has_to_be_well_for_a_while(graph, stack):
    stack.sail(0)
    for tenth in range(1, 18):
        stack.moment(tenth * SECOND_NS // 10)
    stack.stopped('setpoint_raw too old')
    stack.released(18)


@pytest.mark.parametrize('lost', ['odom', 'scan'])
def test_a_lost_sensor_is_answered_by_a_stop(stack, lost):
    stack.sail(SECOND_NS)
    for tenth in range(11, 17):
        stack.pass_to(tenth * SECOND_NS // 10)
        if lost == 'odom':
            stack.scan(tenth * SECOND_NS // 10)
        else:
            stack.odom(tenth * SECOND_NS // 10)
    assert stack.stopped(f'{lost} too old').speed_mps == 0.0


@pytest.mark.parametrize(
    ('ranges', 'reason'),
    [
        (np.full(RAYS, np.nan, np.float32), 'scan too old'),
        (np.full(RAYS, np.inf, np.float32), 'scan with fewer than 1 returns'),
        (np.full(RAYS // 2, 100.0, np.float32), 'scan too old'),
    ],
    ids=['nan', 'inf', 'short'],
)
def test_a_blind_sensor_is_answered_by_a_stop(stack, ranges, reason):
    stack.sail(SECOND_NS)
    for tenth in range(11, 17):
        stack.moment(tenth * SECOND_NS // 10, ranges=ranges)
    stack.stopped(reason)


def test_a_frozen_scan_is_answered_by_a_stop(stack):
    ranges = np.full(RAYS, 100.0, np.float32)
    stack.sail(SECOND_NS)
    for tenth in range(11, 18):
        stack.moment(tenth * SECOND_NS // 10, ranges=ranges)
    stack.stopped('scan frozen')


def test_a_scan_from_before_the_first_odometry_is_not_compared(graph, stack):
    ranges = np.arange(100.0, 100.0 + RAYS, dtype=np.float32)
    stack.scan(SECOND_NS, ranges)
    graph.until(lambda: stack.node._scan_ns == SECOND_NS, 'the scan')
    for tenth in range(11, 13):
        stack.moment(tenth * SECOND_NS // 10, ranges=ranges, ahead=500.0 - 0.3 * tenth)
    raw = stack.raw(1_200_000_000, yaw=0.1)
    assert graph.last('setpoint', lambda m: m.twist.twist.linear.x) == raw


def test_odometry_that_jumps_is_answered_by_a_stop_until_it_is_steady(stack):
    stack.sail(SECOND_NS)
    stack.moment(1_100_000_000, ahead=100.0)
    stack.stopped('odometry jumped')
    stack.released(12, ahead=100.0)


@pytest.mark.parametrize(
    ('wanted', 'reason'),
    [
        ({'speed': math.nan}, 'setpoint_raw refused: setpoint: a value is not finite'),
        ({'speed': 99.0}, 'setpoint_raw asks for 99.0 m/s'),
        ({'speed': -1.0}, 'setpoint_raw asks for -1.0 m/s'),
        ({'yaw': 0.25 + math.pi}, 'setpoint_raw jumps by 3.14 rad'),
    ],
    ids=['nan', 'fast', 'astern', 'jump'],
)
def test_nonsense_is_answered_by_a_stop(stack, wanted, reason):
    stack.sail(SECOND_NS)
    stack.moment(1_100_000_000, yaw=0.2)
    stack.raw(1_100_000_000, **wanted)
    assert stack.stopped(reason) == pytest.approx((0.2, 0.0))


def test_a_wall_ahead_slows_the_vessel_and_a_close_one_stops_it(graph, stack):
    stack.sail(SECOND_NS, yaw=0.1)
    stack.moment(1_100_000_000, ranges=wall_ahead(60.0))
    slowed = read_setpoint(graph.last('setpoint', lambda m: 0.0 < m.twist.twist.linear.x < 4.0))
    assert slowed.yaw_rad == pytest.approx(0.1)
    stack.moment(1_200_000_000, ranges=wall_ahead(14.0))
    assert stack.stopped('no room to stop in') == pytest.approx((0.1, 0.0))


def test_without_zones_a_wall_ahead_is_the_planners_affair(graph, clock):
    stack = Stack(graph, clock, zones=False)
    stack.moment(SECOND_NS, ranges=wall_ahead(14.0))
    raw = stack.raw(SECOND_NS)
    assert graph.last('setpoint', lambda m: m.twist.twist.linear.x) == raw


def test_the_emergency_stop_is_a_service(graph, stack):
    stack.sail(SECOND_NS)
    assert (
        graph.call(SetBool, 'safety_monitor/emergency_stop', data=True).message == 'emergency stop by service'
    )
    stack.stopped('emergency stop')
    assert graph.heard['safety_state'][-1].level == DiagnosticStatus.ERROR
    graph.call(SetBool, 'safety_monitor/emergency_stop', data=False)
    stack.released(11)


@pytest.mark.parametrize('first', ['topic', 'service'])
def test_an_emergency_stop_by_one_way_is_not_released_by_the_other(graph, stack, first):
    second = 'service' if first == 'topic' else 'topic'

    def order(way, data):
        if way == 'topic':
            graph.publish('emergency_stop', Bool(data=data))
            graph.until(lambda: ('topic' in stack.node._orders.by) is data, 'the order')
        else:
            graph.call(SetBool, 'safety_monitor/emergency_stop', data=data)

    stack.sail(SECOND_NS)
    order(first, True)
    stack.stopped('emergency stop')
    order(second, True)
    order(second, False)
    for tenth in range(11, 36):
        stack.moment(tenth * SECOND_NS // 10)
        stack.raw(tenth * SECOND_NS // 10)
    assert stack.state() == 'stop: emergency stop'
    order(first, False)
    stack.released(36)


@pytest.mark.parametrize('durability', [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL])
def test_the_emergency_stop_is_a_topic_for_any_publisher(graph, stack, durability):
    stack.sail(SECOND_NS)
    publisher = graph.other.create_publisher(
        Bool, 'emergency_stop', QoSProfile(depth=1, durability=durability)
    )
    graph.until(publisher.get_subscription_count, 'a listener')
    publisher.publish(Bool(data=True))
    stack.stopped('emergency stop')


def test_the_emergency_stop_is_asked_for_in_every_way(graph, stack):
    reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
    ends = graph.other.get_subscriptions_info_by_topic('emergency_stop')
    found = {(end.qos_profile.reliability == reliable, end.qos_profile.durability == latched) for end in ends}
    assert found == {(False, False), (True, False), (True, True)}


def test_an_emergency_stop_that_was_latched_before_is_heard(graph, clock):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.other.create_publisher(Bool, 'emergency_stop', latched).publish(Bool(data=True))
    stack = Stack(graph, clock)
    stack.moment(SECOND_NS)
    stack.stopped('emergency stop')


def test_a_clock_that_jumps_back_stops_the_vessel_for_a_while(graph, stack):
    stack.sail(5 * SECOND_NS)
    stack.begin_s += 5.0
    stack.odom(0)
    stack.stopped('no scan since the clock jumped')
    stack.released(1)


def test_a_deactivated_monitor_leaves_a_stop(graph, stack):
    stack.sail(SECOND_NS)
    stack.node.trigger_deactivate()
    stack.stopped('the safety monitor was deactivated')


def test_in_lock_step_a_setpoint_is_answered_with_odometry_and_scan_of_its_stamp(graph, clock):
    stack = Stack(graph, clock, lock_step=True)
    raw = stack.raw(SECOND_NS)
    stack.odom(SECOND_NS)
    graph.until(lambda: stack.node._time_ns == SECOND_NS, 'the odometry')
    assert not graph.heard['setpoint']
    stack.scan(SECOND_NS)
    assert graph.last('setpoint') == raw


def test_in_lock_step_nonsense_is_answered_too(graph, clock):
    stack = Stack(graph, clock, lock_step=True)
    stack.raw(SECOND_NS, speed=math.nan)
    stack.odom(SECOND_NS)
    stack.scan(SECOND_NS)
    message = graph.last('setpoint')
    assert (read_stamp(message.header.stamp), message.twist.twist.linear.x) == (SECOND_NS, 0.0)


def test_the_way_of_a_stop_is_drawn_for_who_listens(graph, stack):
    stack.sail(SECOND_NS, yaw=0.1)
    (marker,) = graph.last('markers').markers
    assert marker.ns == 'stop_zone'
    assert marker.points[-1].x == pytest.approx(
        math.hypot(marker.points[-1].x, marker.points[-1].y), rel=0.01
    )
    assert marker.points[-1].x > 10.0


def test_a_stop_from_before_the_first_odometry_keeps_the_heading_found_then(stack):
    stack.node._watch()
    stack.moment(SECOND_NS, yaw=2.0)
    assert stack.stopped('no setpoint_raw yet').yaw_rad == pytest.approx(2.0)
