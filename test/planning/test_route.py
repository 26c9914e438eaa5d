import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.harbour import ClearanceGrid, Harbour
from portnav_ros.planning.route import (
    PATH_SPACING_M,
    route_clearance,
    route_length,
    segment_clear,
    segment_clearance,
    shortcut,
    smooth,
)

MARGIN_M = 20.0


@pytest.fixture(scope='module')
def corner() -> ClearanceGrid:
    """An L of 400 m wide water around a quay whose corner is (400, 400)."""
    return Harbour('corner', box(0, 0, 1200, 1200) - box(400, 400, 1200, 1200)).clearance(5.0)


def turn_radii(points: np.ndarray) -> np.ndarray:
    legs = np.diff(points, axis=0)
    turns = np.abs(np.diff(np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))))
    return np.hypot(*legs[0]) / np.maximum(turns, 1e-9)


def test_a_segment_through_a_quay_is_not_clear(corner: ClearanceGrid) -> None:
    assert not segment_clear(corner, 200.0, 1100.0, 1100.0, 200.0, 0.1)
    assert segment_clear(corner, 200.0, 1100.0, 200.0, 200.0, MARGIN_M)


def test_a_thin_wall_is_never_strided_over() -> None:
    water = box(0, 0, 3000, 400) - box(1500, -1, 1501, 401)
    grid = Harbour('wall', water).clearance(5.0)
    rng = np.random.default_rng(0)
    for y0, y1 in rng.uniform(50, 350, (200, 2)):
        assert not segment_clear(grid, 100.0, y0, 2900.0, y1, MARGIN_M)


def test_segment_clearance_is_the_distance_to_a_parallel_quay(corner: ClearanceGrid) -> None:
    assert segment_clearance(corner, 600.0, 370.0, 1000.0, 370.0) == pytest.approx(30.0, abs=0.5)


def test_shortcut_finds_the_shortest_way_round_a_corner(corner: ClearanceGrid) -> None:
    detour = np.array([[380.0, 1100.0], [100.0, 700.0], [60.0, 60.0], [700.0, 100.0], [1100.0, 380.0]])
    detour[:, 0] = np.minimum(detour[:, 0], 380.0 + (detour[:, 1] < 300.0) * 1000.0)
    short = shortcut(corner, detour, MARGIN_M)
    assert route_length(short) < route_length(detour)
    assert route_clearance(corner, short) >= MARGIN_M - 0.5
    np.testing.assert_array_equal(short[[0, -1]], detour[[0, -1]])


def test_smoothing_widens_a_corner_and_keeps_clear(corner: ClearanceGrid) -> None:
    sharp = np.array([[200.0, 1100.0], [200.0, 200.0], [1100.0, 200.0]])
    curve = smooth(corner, sharp, MARGIN_M, 100.0)
    assert turn_radii(curve).min() > 80.0
    assert route_clearance(corner, curve) >= MARGIN_M - 0.5
    np.testing.assert_array_equal(curve[[0, -1]], sharp[[0, -1]])


def test_smoothed_points_are_evenly_spaced(corner: ClearanceGrid) -> None:
    curve = smooth(corner, np.array([[200.0, 1100.0], [200.0, 200.0], [1100.0, 200.0]]), MARGIN_M, 100.0)
    steps = np.hypot(*np.diff(curve, axis=0).T)
    assert (steps <= PATH_SPACING_M + 1e-9).all()
    assert steps.min() > 0.95 * PATH_SPACING_M


def test_a_straight_route_stays_straight(corner: ClearanceGrid) -> None:
    line = np.array([[200.0, 100.0], [200.0, 1100.0]])
    curve = smooth(corner, line, MARGIN_M, 100.0)
    np.testing.assert_allclose(curve[:, 0], 200.0, atol=1e-9)
    assert route_length(curve) == pytest.approx(1000.0)


def test_smoothing_mirrors_with_the_harbour() -> None:
    water = box(0, 0, 1200, 1200) - box(400, 400, 1200, 1200)
    here = Harbour('here', water).clearance(5.0)
    sharp = np.array([[370.0, 1100.0], [370.0, 370.0], [1100.0, 370.0]])
    swapped = smooth(here, sharp[::-1, ::-1].copy(), MARGIN_M, 100.0)
    np.testing.assert_allclose(smooth(here, sharp, MARGIN_M, 100.0), swapped[::-1, ::-1], atol=3.0)


def test_a_leg_that_lies_closer_than_the_margin_is_not_made_worse(corner: ClearanceGrid) -> None:
    berth = np.array([[395.0, 900.0], [300.0, 900.0], [200.0, 200.0], [1100.0, 200.0]])
    curve = smooth(corner, berth, MARGIN_M, 150.0)
    np.testing.assert_array_equal(curve[0], berth[0])
    assert route_clearance(corner, curve) >= 4.0
    assert route_clearance(corner, curve[8:]) >= MARGIN_M - 0.5


def test_comfort_takes_a_route_off_the_quay_where_there_is_room(corner: ClearanceGrid) -> None:
    along = np.array([[375.0, 1100.0], [375.0, 500.0]])
    close = smooth(corner, along, MARGIN_M, 100.0)
    wide = smooth(corner, along, MARGIN_M, 100.0, comfort_m=60.0)
    assert close[:, 0].min() == pytest.approx(375.0, abs=1e-6)
    assert wide[len(wide) // 2, 0] < 355.0
    assert route_length(wide) < 1.08 * route_length(close)
