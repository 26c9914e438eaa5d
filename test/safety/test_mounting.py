"""The scan of a sensor that is somewhere on the vessel, told from the middle of the hull."""

import math

import numpy as np
import pytest

from portnav_ros.safety.mounting import Mounting
from portnav_ros.types import Scan

RAYS = 360
STEP = 2.0 * math.pi / RAYS
ANGLES = -math.pi + STEP * np.arange(RAYS)


def round_pond(x_m, y_m, yaw_rad, radius_m=100.0):
    """What a sensor at a pose sees of a round pond about the origin."""
    angles = ANGLES + yaw_rad
    along = x_m * np.cos(angles) + y_m * np.sin(angles)
    ranges = -along + np.sqrt(along**2 + radius_m**2 - x_m**2 - y_m**2)
    return Scan(ranges.astype(np.float32), -math.pi, STEP, 0.5, 400.0)


@pytest.mark.parametrize('pose', [(0.0, 0.0, 1.0), (20.0, 0.0, 0.0), (-10.0, 3.0, math.pi)])
def test_returns_are_put_where_they_are(pose):
    points = Mounting(*pose).points(round_pond(*pose))
    np.testing.assert_allclose(np.hypot(*points.T), 100.0, rtol=1e-5)


@pytest.mark.parametrize('pose', [(0.0, 0.0, 1.0), (20.0, 0.0, 0.0), (-10.0, 3.0, math.pi)])
def test_a_centred_scan_is_as_from_the_middle(pose):
    ranges = Mounting(*pose).centred(round_pond(*pose)).ranges
    seen = np.isfinite(ranges)
    np.testing.assert_allclose(ranges[seen], 100.0, rtol=1e-5)
    assert seen.mean() > 0.8


def test_a_turned_sensor_only_turns_the_rays():
    scan = round_pond(0.0, 0.0, 0.0)
    scan.ranges[RAYS // 2] = 30.0  # ahead of the sensor, which looks to port
    centred = Mounting(yaw_rad=math.pi / 2.0).centred(scan)
    assert centred.ranges.argmin() == RAYS // 2 + RAYS // 4


def test_a_sensor_in_the_middle_changes_nothing():
    scan = round_pond(0.0, 0.0, 0.0)
    assert Mounting().centred(scan) is scan
