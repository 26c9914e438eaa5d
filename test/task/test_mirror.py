"""Port and starboard exchanged."""

import dataclasses

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.mirror import mirror_of
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.task.tracking import TRACK_KNOWN, TRACK_SIZE

ALIGNED = ObservationParams(layout='aligned', ages=(0, 2), sectors=60)
LIDAR = LidarParams(rays=180, range_max_m=300.0)


def seen(sign, rng):
    """Features after four periods of one drive, or of its mirror image about the x axis (sign -1)."""
    path = np.column_stack([np.arange(0.0, 800.0, 10.0), sign * 20.0 * np.sin(np.arange(80) / 9.0)])
    observer = Observer(1, LIDAR, ALIGNED)
    observer.reset(np.array([True]), [path])
    for t in range(4):
        own = np.zeros((1, 7))
        own[0, :5] = 5.0 * t, sign * (3.0 + t), sign * (0.1 + 0.05 * t), 4.0, sign * 0.02
        ranges = rng.uniform(20.0, 290.0, LIDAR.rays).astype(np.float32)
        if sign < 0:
            ranges = np.roll(ranges[::-1], 1)  # ray i looks where ray -i did
        setpoint = np.array([[sign * 0.3, 2.5]])
        features = observer.update(own, ranges[None], setpoint).features
    return features[0]


def test_features_of_the_mirrored_scene():
    mirror = mirror_of(ALIGNED, ActionParams())
    port, starboard = seen(1.0, np.random.default_rng(0)), seen(-1.0, np.random.default_rng(0))
    mirrored = mirror.features(port)
    scans = 2 * ALIGNED.sectors
    np.testing.assert_allclose(mirrored[scans:], starboard[scans:], atol=1e-6)
    same = np.isclose(mirrored[:scans], starboard[:scans], atol=1e-5)
    assert same.mean() > 0.95  # a point on the edge of two sectors may fall into either


def test_tracks_of_the_mirrored_scene():
    """Also their ends, which change places."""
    params = dataclasses.replace(ALIGNED, tracks=3)
    mirror = mirror_of(params, ActionParams())
    path = np.column_stack([np.arange(0.0, 800.0, 10.0), np.zeros(80)])
    told = []
    for sign in (1.0, -1.0):
        observer = Observer(1, LIDAR, params)
        observer.reset(np.array([True]), [path])
        for t in range(5):
            ranges = np.full(LIDAR.rays, LIDAR.range_max_m, np.float32)
            ranges[70 + t : 75 + t] = 120.0 + np.arange(5.0) - 4.0 * t
            ranges[110:118] = 80.0 - 2.0 * np.arange(8.0)
            if sign < 0:
                ranges = np.roll(ranges[::-1], 1)
            own = np.array([[4.0 * t, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0]])
            features = observer.update(own, ranges[None], np.zeros((1, 2)))
        told.append(features.features[0, -3 * TRACK_SIZE :])
    assert (told[0].reshape(3, TRACK_SIZE)[:, TRACK_KNOWN] > 0.0).tolist() == [True, True, False]
    assert np.abs(told[0] - told[1]).max() > 0.1
    mirrored = mirror.features(np.concatenate([np.zeros(params.size - 3 * TRACK_SIZE), told[0]]))
    np.testing.assert_allclose(mirrored[-3 * TRACK_SIZE :], told[1], atol=1e-5)


@pytest.mark.parametrize('tracks', [0, 2])
def test_twice_mirrored_is_as_before(tracks):
    params = dataclasses.replace(ALIGNED, tracks=tracks)
    mirror = mirror_of(params, ActionParams())
    values = np.random.default_rng(1).normal(size=(3, params.size)).astype(np.float32)
    np.testing.assert_array_equal(mirror.features(mirror.features(values)), values)
    np.testing.assert_array_equal(mirror.action[mirror.action], np.arange(27))


def test_actions_keep_their_speed_and_turn_the_other_way():
    params = ActionParams()
    table = params.table()
    mirrored = table[mirror_of(ALIGNED, params).action]
    np.testing.assert_allclose(mirrored[:, 0], -table[:, 0], atol=1e-12)
    np.testing.assert_array_equal(mirrored[:, 1], table[:, 1])


def test_what_is_not_symmetric_is_refused():
    with pytest.raises(ParamError, match='aligned'):
        mirror_of(ObservationParams(), ActionParams())
    with pytest.raises(ParamError, match='symmetric'):
        mirror_of(ALIGNED, dataclasses.replace(ActionParams(), heading_change_rad=(-0.1, 0.0, 0.3)))
