import math

import numpy as np
import pytest

from portnav_ros.baselines.line_of_sight import LineOfSight
from portnav_ros.task.policy import Observation
from portnav_ros.types import YAW, Outcome, Y


def observe(own, path, progress):
    batch = len(own)
    return Observation(
        ranges=np.full((batch, 36), np.inf, np.float32),
        own=np.asarray(own, float),
        path=np.repeat(np.asarray(path, float)[None], batch, axis=0),
        path_length=np.full(batch, len(path)),
        progress=np.asarray(progress, float),
        features=np.zeros((batch, 1), np.float32),
    )


@pytest.mark.parametrize('leg_rad', [0.0, 0.7, -2.5, 3.1])
@pytest.mark.parametrize('deviation_m', [-80.0, 0.0, 5.0, 300.0])
def test_straight_leg_closed_form(leg_rad, deviation_m):
    along = np.array([math.cos(leg_rad), math.sin(leg_rad)])
    across = np.array([-along[1], along[0]])
    path = np.arange(0.0, 501.0, 10.0)[:, None] * along
    x, y = 200.0 * along + deviation_m * across
    own = [[x, y, 1.0, 3.0, 0.0, 0.0, 0.0]]

    yaw, speed = LineOfSight(lookahead_m=100.0, speed_mps=4.0).act(observe(own, path, [20.0]))[0]

    expected = leg_rad - math.atan(deviation_m / 100.0)
    assert math.isclose(math.cos(yaw - expected), 1.0, abs_tol=1e-9)
    assert speed == 4.0


def test_joins_the_path_and_arrives(canal, sail):
    world, states = sail(LineOfSight(), [canal(start=(60.0, 60.0, 0.5))])

    assert world.outcome[0] == Outcome.SUCCESS
    assert abs(states[-1, 0, Y]) < 1.0
    assert abs(states[-1, 0, YAW]) < 0.02


def test_is_blind(canal, sail):
    world, _ = sail(LineOfSight(), [canal(buoys=[(500.0, 0.0, 2.0)])])

    assert world.outcome[0] == Outcome.COLLISION_BUOY
