"""Room for a stop: of a vessel that is rehearsed with its own dynamics."""

import math

import numpy as np
import pytest

from portnav_ros.control.autopilot import PID_SIZE, AutopilotParams, steer
from portnav_ros.safety.mounting import Mounting
from portnav_ros.safety.zones import Zone, ZoneParams, scan_points
from portnav_ros.types import SURGE, Scan, Setpoint, X
from portnav_ros.vessel import VesselParams, move_actuators, move_hull

VESSEL = VesselParams()
PARAMS = ZoneParams(margin_m=3.0)
ZONE = Zone(PARAMS, VESSEL, AutopilotParams())


def at_speed(surge, yaw=0.0, yaw_rate=0.0):
    return np.array([0.0, 0.0, yaw, surge, yaw_rate, 0.0, 0.0])


def wall(distance_m, across=True):
    """Points of a wall ahead of the bow, or along the port side, at a distance from the hull."""
    along = np.linspace(-150.0, 150.0, 301)
    if across:
        return np.column_stack([np.full(301, 0.5 * VESSEL.length_m + distance_m), along])
    return np.column_stack([along, np.full(301, 0.5 * VESSEL.beam_m + distance_m)])


def sailed_while_stopping(speed):
    """Way of a vessel under its autopilot: a second at a speed, then the stop."""
    own, memory = at_speed(speed), np.zeros(PID_SIZE)
    own[6] = VESSEL.drag_kg_per_m * speed * speed
    for tick in range(20_000):
        wanted = speed if tick < 20 else 0.0
        rudder, thrust = steer(AutopilotParams().gains(), VESSEL.model(), memory, own, 0.0, wanted, 0.05)
        move_actuators(VESSEL.model(), own, rudder, thrust, 0.05)
        move_hull(VESSEL.model(), own, 0.05)
        if own[SURGE] < 0.05:
            return own[X]
    raise AssertionError('the vessel does not stop')


def test_with_nothing_in_sight_there_is_no_limit():
    assert ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), np.zeros((0, 2))) == math.inf


@pytest.mark.parametrize('speed', [2.0, 5.0])
def test_the_limit_begins_where_the_vessel_could_not_stop_any_more(speed):
    needed_m = sailed_while_stopping(speed) + PARAMS.margin_m
    asked = Setpoint(0.0, speed)
    assert ZONE.limit_mps(at_speed(speed), asked, wall(1.03 * needed_m)) == math.inf
    assert 0.0 < ZONE.limit_mps(at_speed(speed), asked, wall(0.97 * needed_m)) < speed


def test_the_nearer_the_slower_until_there_is_no_speed_left():
    limits = [ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), wall(d)) for d in np.arange(70.0, 0.0, -2.0)]
    assert limits == sorted(limits, reverse=True)
    assert limits[-1] == 0.0
    assert min(limit for limit in limits if limit) == PARAMS.steerage_mps


def test_a_quay_alongside_is_no_obstacle_however_near():
    for gap_m in (0.5, 2.9, 3.5):
        assert ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), wall(gap_m, across=False)) == math.inf


def test_towards_a_quay_alongside_there_is_room_for_steerage_at_most():
    assert ZONE.limit_mps(at_speed(5.0), Setpoint(1.0, 5.0), wall(3.5, across=False)) <= 1.0


def test_a_turn_away_is_a_way_out():
    ahead = np.column_stack([np.full(41, 45.0), np.linspace(-30.0, 1.0, 41)])
    straight = ZONE.limit_mps(at_speed(4.0), Setpoint(0.0, 4.0), ahead)
    to_port = ZONE.limit_mps(at_speed(4.0), Setpoint(1.0, 4.0), ahead)
    assert straight < to_port


def test_port_and_starboard_are_alike():
    corner = np.array([[25.0, 6.0], [40.0, 3.0]])
    for yaw, rate in ((0.4, 0.02), (0.2, -0.01)):
        port = ZONE.limit_mps(at_speed(4.0, yaw_rate=rate), Setpoint(yaw, 4.0), corner)
        mirrored = ZONE.limit_mps(at_speed(4.0, yaw_rate=-rate), Setpoint(-yaw, 4.0), corner * [1.0, -1.0])
        assert port == mirrored < 4.0


def test_headings_are_of_the_map_and_points_of_the_body():
    turned = ZONE.limit_mps(at_speed(5.0, yaw=2.0), Setpoint(2.0, 5.0), wall(30.0))
    assert turned == ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), wall(30.0))


def test_returns_of_the_own_hull_do_not_count():
    assert ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), np.array([[5.0, 1.0]])) == math.inf


def test_the_way_of_a_stop_is_told_in_the_map():
    own = at_speed(5.0, yaw=math.pi / 2.0)
    own[:2] = 100.0, 200.0
    track = ZONE.stop_track(own, math.pi / 2.0, 5.0)
    assert track[-1] == pytest.approx((100.0, 200.0 + sailed_while_stopping(5.0)), abs=1.0)


def test_a_vessel_without_astern_thrust_is_rehearsed_to_an_end():
    zone = Zone(PARAMS, VesselParams(thrust_min_n=0.0), AutopilotParams())
    assert zone.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), wall(100.0)) < 5.0


def test_points_of_a_scan_are_its_returns():
    ranges = np.array([10.0, np.inf, 20.0, np.nan], np.float32)
    points = scan_points(Scan(ranges, -math.pi, math.pi / 2.0, 0.5, 400.0))
    np.testing.assert_allclose(points, [[-10.0, 0.0], [20.0, 0.0]], atol=1e-6)


def test_what_is_too_close_to_be_measured_is_at_the_least_range():
    scan = Scan(np.array([-np.inf, np.inf], np.float32), 0.0, math.pi, 0.5, 400.0)
    np.testing.assert_allclose(scan_points(scan), [[0.5, 0.0]])


def test_a_sensor_at_the_bow_that_is_too_close_stops_the_vessel():
    ranges = np.full(8, np.inf, np.float32)
    ranges[0] = -np.inf
    length_m = VesselParams().length_m
    points = Mounting(x_m=0.5 * length_m + 1.0).points(Scan(ranges, 0.0, math.pi / 4.0, 2.0, 400.0))
    assert ZONE.limit_mps(at_speed(5.0), Setpoint(0.0, 5.0), points) == 0.0
