"""Sensors that go on sending, but no longer look."""

import math

import numpy as np
import pytest

from portnav_ros.safety.plausibility import PlausibilityParams, judge_odometry, judge_scan, ray_misfit
from portnav_ros.types import Scan, VesselState

RAYS = 180
STEP = 2.0 * math.pi / RAYS
ANGLES = -math.pi + STEP * np.arange(RAYS)
PARAMS = PlausibilityParams()


def scan_of(ranges, angle_min=-math.pi, step=STEP):
    return Scan(np.asarray(ranges, np.float32), angle_min, step, 0.5, 400.0)


def canal(half_width_m=50.0):
    """Between two straight quays without an end, along the x axis."""
    with np.errstate(divide='ignore'):
        distance = np.abs(half_width_m / np.sin(ANGLES))
    return np.where(distance < 400.0, distance, np.inf)


def judged(scans, states):
    seen, reason = None, ''
    for scan, state in zip(scans, states, strict=True):
        seen, reason = judge_scan(PARAMS, seen, scan, state)
    return reason


def under_way(count, spacing_m=0.5, yaw_rad=0.0):
    return [
        VesselState(spacing_m * k * math.cos(yaw_rad), spacing_m * k * math.sin(yaw_rad), yaw_rad, 5.0)
        for k in range(count)
    ]


def test_a_repeated_scan_is_frozen_once_its_returns_should_have_moved():
    scan = scan_of(np.full(RAYS, 100.0))
    assert judged([scan] * 2, under_way(2)) == ''
    assert judged([scan] * 5, under_way(5)) == 'scan frozen'


def test_a_scan_that_changes_in_one_ray_is_not_frozen():
    scans = [scan_of(np.where(np.arange(RAYS) == k, 99.0, 100.0)) for k in range(5)]
    assert judged(scans, under_way(5)) == ''


def test_a_repeated_scan_of_a_vessel_at_rest_is_not_frozen():
    assert judged([scan_of(np.full(RAYS, 100.0))] * 50, under_way(50, spacing_m=0.0)) == ''


def test_straight_quays_may_look_the_same_all_along():
    assert judged([scan_of(canal())] * 200, under_way(200)) == ''


def test_straight_quays_do_not_look_the_same_from_nearer():
    crabbing = [state._replace(yaw_rad=0.3) for state in under_way(20)]
    assert judged([scan_of(canal())] * 20, crabbing) == 'scan frozen'


def test_a_vessel_that_turns_does_not_see_the_same():
    states = [VesselState(0.0, 0.0, 0.01 * k) for k in range(20)]
    ranges = 100.0 + 20.0 * np.sin(3.0 * ANGLES)
    assert judged([scan_of(ranges)] * 20, states) == 'scan frozen'


def test_a_scan_without_a_return_is_not_believed_unless_on_open_water():
    scan = scan_of(np.full(RAYS, np.inf))
    assert judged([scan], under_way(1)) == 'scan with fewer than 1 returns'
    assert judge_scan(PlausibilityParams(least_returns=0), None, scan, VesselState(0, 0, 0))[1] == ''


def test_a_sensor_under_a_cover_is_not_believed():
    assert judged([scan_of(np.full(RAYS, -np.inf))], under_way(1)) == 'scan with fewer than 1 returns'


def test_what_is_too_close_does_not_confuse_what_follows_it():
    ranges = np.full(RAYS, 50.0, np.float32)
    ranges[:5] = -np.inf
    assert judged([scan_of(ranges)] * 5, under_way(5)) == 'scan frozen'


@pytest.mark.parametrize(
    ('scan', 'reason'),
    [
        (scan_of(np.ones(RAYS)), ''),
        (scan_of(np.ones(90)), '90 rays, expected 180 (lidar.rays)'),
        (scan_of(np.ones(RAYS), angle_min=0.0), 'angle_min 0.0000'),
        (scan_of(np.ones(RAYS), step=-STEP), 'angle_increment -0.0349'),
    ],
)
def test_rays_that_look_elsewhere_are_told(scan, reason):
    assert reason in ray_misfit(scan, RAYS)
    assert bool(ray_misfit(scan, RAYS)) == bool(reason)


def reasons(states, step_s=0.05):
    seen, found = None, []
    for k, state in enumerate(states):
        seen, reason = judge_odometry(PARAMS, seen, state, k * step_s)
        found.append(reason)
    return found


def test_a_vessel_under_way_is_believed():
    assert not any(reasons(under_way(50, spacing_m=0.25)))


def test_a_pose_that_stands_while_the_vessel_is_told_to_move_is_frozen():
    found = reasons([VesselState(3.0, 4.0, 0.5, 5.0)] * 10)
    assert found[:5] == [''] * 5
    assert found[-1] == 'odometry frozen'


def test_a_vessel_at_rest_is_not_frozen():
    assert not any(reasons([VesselState(3.0, 4.0, 0.5, 0.0)] * 1000))


def test_a_pose_that_jumps_is_told_once():
    states = under_way(5, spacing_m=0.25)
    states += [state._replace(x_m=state.x_m + 100.0) for state in under_way(10, spacing_m=0.25)[5:]]
    assert reasons(states) == [''] * 5 + ['odometry jumped'] + [''] * 4


def test_a_heading_that_jumps_is_told_and_one_that_wraps_is_not():
    assert reasons([VesselState(0, 0, 0.0), VesselState(0, 0, 1.5)])[-1] == 'odometry jumped'
    assert reasons([VesselState(0, 0, math.pi - 0.01), VesselState(0, 0, 0.01 - math.pi)])[-1] == ''


def test_after_lost_messages_the_pose_may_have_come_further():
    states = [VesselState(0, 0, 0, 5.0), VesselState(25.0, 0, 0, 5.0)]
    assert reasons(states, step_s=5.0)[-1] == ''
    assert reasons(states, step_s=0.05)[-1] == 'odometry jumped'
