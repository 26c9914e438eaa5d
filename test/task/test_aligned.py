import dataclasses
import math

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.sim.lidar import ray_directions
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams, setpoints_of
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.task.tracking import TRACK_KNOWN, TRACK_SIZE

LIDAR = LidarParams(rays=180, range_max_m=300.0)
SECTORS = 60
PARAMS = ObservationParams(layout='aligned', ages=(0, 3), sectors=SECTORS)
PATH = np.column_stack([np.arange(0.0, 2000.0, 10.0), np.zeros(200)])


def disc_scan(own, centre, radius):
    """Ranges of a scan from a state row that sees one disc."""
    c, s = math.cos(own[2]), math.sin(own[2])
    rays = ray_directions(LIDAR.rays) @ np.array([[c, s], [-s, c]])
    to = np.array(centre) - own[:2]
    along = rays @ to
    off = np.abs(rays[:, 0] * to[1] - rays[:, 1] * to[0])
    hit = (along > 0.0) & (off < radius)
    depth = along - np.sqrt(np.maximum(radius**2 - off**2, 0.0))
    return np.where(hit, depth, LIDAR.range_max_m).astype(np.float32)


def sail(tracks, centres, radius=8.0):
    """Features after a vessel's states [T, 7] while one disc stands at centres [T, 2]."""
    observer = Observer(1, LIDAR, PARAMS)
    observer.reset(np.array([True]), [PATH])
    for own, centre in zip(tracks, centres, strict=True):
        observation = observer.update(own[None], disc_scan(own, centre, radius)[None], np.zeros((1, 2)))
    return observation.features[0]


def track(yaws, speed=5.0):
    own = np.zeros((len(yaws), 7))
    own[:, 0] = 200.0 + speed * np.arange(len(yaws))
    own[:, 2] = yaws
    own[:, 3] = speed
    return own


def nearest(sectors):
    return int(np.argmax(sectors)), float(np.max(sectors))


def test_size_is_as_declared():
    assert PARAMS.size == 2 * SECTORS + 2 + 3 + 2 * PARAMS.path_points + 2 + 1
    assert len(sail(track([0.0]), [(300.0, 0.0)])) == PARAMS.size


def test_what_stands_still_coincides_while_the_vessel_turns_and_sails():
    features = sail(track([0.0, 0.1, 0.25, 0.45]), [(330.0, 30.0)] * 4, radius=15.0)
    now, then = features[:SECTORS], features[SECTORS : 2 * SECTORS]
    assert nearest(now)[0] == nearest(then)[0]
    assert nearest(now)[1] == pytest.approx(nearest(then)[1], abs=0.02)


def test_what_moves_is_seen_where_it_was():
    centres = [(400.0, 0.0), (390.0, 0.0), (380.0, 0.0), (370.0, 0.0)]
    features = sail(track([0.0] * 4, speed=0.0), centres)
    closeness = nearest(features[:SECTORS])[1] - nearest(features[SECTORS : 2 * SECTORS])[1]
    assert closeness == pytest.approx(30.0 / LIDAR.range_max_m, abs=1e-3)


def test_sectors_count_from_the_course_not_the_heading():
    ahead = SECTORS // 2
    for yaw in (-1.0, 0.0, 0.7):
        index, closeness = nearest(sail(track([yaw]), [(300.0, 3.0)])[:SECTORS])
        assert index == ahead
        assert closeness == pytest.approx(1.0 - 92.0 / 300.0, abs=0.01)


def test_a_first_scan_fills_every_age():
    features = sail(track([0.3]), [(260.0, 40.0)])
    np.testing.assert_array_equal(features[:SECTORS], features[SECTORS : 2 * SECTORS])


def test_a_wall_seen_from_afar_has_no_gap_when_close():
    """Rays 2 degrees apart spread over more than a sector once the vessel has come closer."""
    params = ObservationParams(layout='aligned', ages=(10,), sectors=180)
    observer = Observer(1, LIDAR, params)
    observer.reset(np.array([True]), [PATH])
    rays = ray_directions(LIDAR.rays)
    for own in track([0.0] * 11, speed=10.0):
        ahead = rays[:, 0] > 0.1
        ranges = np.full(LIDAR.rays, LIDAR.range_max_m)
        ranges[ahead] = (420.0 - own[0]) / rays[ahead, 0]
        observation = observer.update(own[None], ranges[None].astype(np.float32), np.zeros((1, 2)))
    assert (observation.features[0][70:110] > 0.0).all()


def test_nothing_in_reach_is_zero():
    assert not sail(track([0.0]), [(2000.0, 0.0)])[: 2 * SECTORS].any()


def test_tracks_come_last_and_only_with_aligned_scans():
    watching = dataclasses.replace(PARAMS, tracks=3)
    assert watching.size == PARAMS.size + 3 * TRACK_SIZE
    with pytest.raises(ParamError, match='tracks = 3 needs layout = aligned'):
        ObservationParams(tracks=3)
    with pytest.raises(ParamError, match='tracks'):
        ObservationParams(layout='aligned', tracks=-1)


def test_tracks_survive_a_checkpoint():
    params = dataclasses.replace(PARAMS, tracks=3)
    first, second = Observer(1, LIDAR, params), Observer(1, LIDAR, params)
    first.reset(np.array([True]), [PATH])
    rows = track(np.zeros(6))
    for k, own in enumerate(rows):
        scan = disc_scan(own, (350.0 - 4.0 * k, 10.0), 8.0)[None]
        if k == 4:
            second.load_state_dict(first.state_dict())
            later = second.update(own[None], scan, np.zeros((1, 2))).features.copy()
        seen = first.update(own[None], scan, np.zeros((1, 2))).features
        if k == 4:
            np.testing.assert_array_equal(later, seen)
            assert seen[0, -3 * TRACK_SIZE + TRACK_KNOWN] == pytest.approx(0.25)


def test_ages_are_refused_with_their_value():
    with pytest.raises(ParamError, match='ages'):
        ObservationParams(layout='aligned', ages=())
    with pytest.raises(ParamError, match='layout'):
        ObservationParams(layout='polar')


def test_actions_count_from_the_course_of_the_path():
    params = ActionParams(reference='path')
    own = np.zeros((1, 7))
    own[:, 2] = 1.0
    reference = params.reference_rad(own, np.array([[0.0, 0.0, 0.4]]))
    np.testing.assert_allclose(setpoints_of(np.array([14]), reference, params.table()), [[0.6, 5.0]])
    with pytest.raises(ParamError, match='reference'):
        ActionParams(reference='north')
