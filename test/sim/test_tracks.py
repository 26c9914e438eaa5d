import math

import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.harbour import Harbour
from portnav_ros.planning.clearance_route import least_clearance
from portnav_ros.sim.ports import GRID_M, PortParams, make_port
from portnav_ros.sim.scenario import TRACK_SPACING_M, ScenarioError
from portnav_ros.sim.tracks import TrackParams, build_tracks, follow, pose_on_track

BEAM_M = 14.0


def split(tracks):
    return np.split(tracks.points, tracks.offsets[1:-1])


@pytest.fixture(scope='module', params=[0, 1, 2])
def port(request):
    harbour = make_port(PortParams(), np.random.default_rng(request.param))
    return harbour, build_tracks(harbour, harbour.berths, BEAM_M, TrackParams(), GRID_M)


def test_every_ordered_pair_has_a_track_that_joins_its_berths_exactly(port):
    harbour, tracks = port
    count = len(harbour.berths)
    expected = [(a, b) for a in range(count) for b in range(count) if a != b]
    assert list(zip(tracks.origin, tracks.destination, strict=True)) == expected
    for track, a, b in zip(split(tracks), tracks.origin, tracks.destination, strict=True):
        assert np.allclose(track[0, :2], harbour.berths[a, :2], atol=1e-3)
        assert np.allclose(track[-1, :2], harbour.berths[b, :2], atol=1e-3)


def test_tracks_keep_the_hull_off_quays_and_buoys(port):
    harbour, tracks = port
    grid = harbour.clearance(5.0, buoys='all')
    assert least_clearance(grid, tracks.points.astype(float)) >= 0.5 * BEAM_M - 5.0


def test_tracks_have_no_jumps_and_the_yaw_points_along(port):
    for track in split(port[1]):
        steps = np.diff(track[:, :2].astype(float), axis=0)
        gaps = np.hypot(*steps.T)
        assert gaps.min() > 0.8 * TRACK_SPACING_M
        assert gaps.max() < 1.1 * TRACK_SPACING_M
        assert np.abs(np.diff(track[:, 2])).max() < 0.3
        off = np.arctan2(steps[:, 1], steps[:, 0]) - track[:-1, 2]
        assert np.abs((off + math.pi) % (2.0 * math.pi) - math.pi).max() < 0.3


def test_tracks_are_deterministic(port):
    harbour, tracks = port
    again = build_tracks(harbour, harbour.berths, BEAM_M, TrackParams(), GRID_M)
    assert np.array_equal(tracks.points, again.points)


def test_curvature_is_bounded_by_the_turning_radius():
    corner = np.array([[0.0, 0.0], [1000.0, 0.0], [1000.0, 1000.0]])
    track = follow(corner, TrackParams(turn_radius_m=200.0, lead_m=80.0))
    turned = np.abs(np.diff(track[:, 2])) / TRACK_SPACING_M
    assert turned.max() <= 1.0 / 200.0 + 1e-3
    assert turned.max() > 0.8 / 200.0


def test_straight_route_is_sailed_straight():
    track = follow(np.array([[0.0, 0.0], [1000.0, 500.0]]), TrackParams())
    assert np.allclose(track[:, 2], math.atan2(1.0, 2.0), atol=1e-3)
    assert np.allclose(track[:, 1], 0.5 * track[:, 0], atol=1e-2)
    assert tuple(track[-1, :2]) == (1000.0, 500.0)


def test_track_of_the_mirrored_route_is_mirrored():
    route = np.array([[0.0, 0.0], [600.0, 100.0], [900.0, 700.0]])
    track, mirrored = (follow(route * [1.0, side], TrackParams()) for side in (1.0, -1.0))
    assert np.allclose(track * [1.0, -1.0, -1.0], mirrored, atol=1e-2)


def test_pose_is_interpolated_and_held_at_both_ends():
    harbour = Harbour('canal', box(0, -200, 1000, 200))
    nodes = np.array([[100.0, 0.0, 0.0], [900.0, 0.0, 0.0]])
    tracks = build_tracks(harbour, nodes, BEAM_M, TrackParams(), GRID_M)
    for progress_m, x_m in ((-50.0, 100.0), (0.0, 100.0), (405.0, 505.0), (9000.0, 900.0)):
        x, y, yaw = pose_on_track(tracks.points, tracks.offsets, 0, progress_m)
        assert (x, y, yaw) == pytest.approx((x_m, 0.0, 0.0), abs=1.5)


def test_unreachable_berth_is_named():
    harbour = Harbour('two ponds', box(0, 0, 400, 400).union(box(600, 0, 1000, 400)))
    nodes = np.array([[200.0, 200.0, 0.0], [800.0, 200.0, 0.0]])
    with pytest.raises(ScenarioError, match=r'two ponds: no route .* from berth 1 to berth 0'):
        build_tracks(harbour, nodes, BEAM_M, TrackParams(), GRID_M)
