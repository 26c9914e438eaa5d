"""The rough track of a plan: closed forms."""

import math

import numpy as np
import pytest

from portnav_ros.muzero.rollout import predicted_track
from portnav_ros.task.actions import ActionParams
from portnav_ros.vessel import VesselParams

VESSEL = VesselParams(turn_gain=100.0)  # turns at once
PATH = np.column_stack([np.arange(0.0, 2000.0, 10.0), np.zeros(200)])
AHEAD = ActionParams((-0.5, 0.0, 0.5), (4.0,), hold=2)


def own(x=0.0, y=0.0, yaw=0.0, surge=4.0):
    return np.array([x, y, yaw, surge, 0.0, 0.0, 0.0])


def test_heading_kept_is_a_straight_line_at_the_setpoints_speed():
    track = predicted_track(np.array([1, 1, 1]), own(yaw=0.3), PATH, AHEAD, 100.0, VESSEL)
    expected = 4.0 * np.arange(7)[:, None] * [math.cos(0.3), math.sin(0.3)]
    np.testing.assert_allclose(track, expected, atol=1e-9)


def test_heading_changes_add_up():
    track = predicted_track(np.array([2, 2]), own(), PATH, AHEAD, 100.0, VESSEL)
    headings = np.arctan2(*np.diff(track, axis=0).T[::-1])
    np.testing.assert_allclose(headings, [0.5, 0.5, 1.0, 1.0])


def test_counted_from_the_course_no_change_leads_to_the_path():
    params = ActionParams((0.0,), (4.0,), reference='path', hold=2)
    track = predicted_track(np.zeros(60, int), own(y=50.0, yaw=0.5), PATH, params, 100.0, VESSEL)
    assert abs(track[-1, 1]) < 1.0
    assert track[-1, 0] == pytest.approx(480.0, rel=0.1)


def test_a_heavy_vessel_turns_and_speeds_up_slowly():
    heavy = VesselParams(turn_gain=0.5, rudder_max_rad=0.5, length_m=100.0, beam_m=10.0, mass_kg=1e6)
    track = predicted_track(np.array([2]), own(surge=2.0), PATH, AHEAD, 100.0, heavy)
    first, second = np.diff(track, axis=0)
    rate = heavy.thrust_max_n / heavy.mass_kg
    assert np.hypot(*first) == pytest.approx(2.0 + rate)
    assert math.atan2(first[1], first[0]) == pytest.approx(0.5 * 2.0 / 100.0 * 0.5)
    assert np.hypot(*second) == pytest.approx(2.0 + 2.0 * rate)


def test_no_actions_no_track():
    assert predicted_track(np.zeros(0, int), own(), PATH, AHEAD, 100.0, VESSEL).shape == (1, 2)
