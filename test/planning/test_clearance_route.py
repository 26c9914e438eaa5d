import math

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from portnav_ros.geometry import polyline_lengths
from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError
from portnav_ros.planning.clearance_route import (
    RouteCost,
    clearance_field,
    clearance_route,
    descend,
    least_clearance,
    reachable,
    round_off,
)

RIGHT_ANGLE = Polygon([(0, 0), (1000, 0), (1000, 1000), (700, 1000), (700, 300), (0, 300)])
FLAT = RouteCost(least_m=20.0, weight=0.0)


def grid_of(water, **harbour):
    return Harbour('test', water, **harbour).clearance(10.0, buoys='all')


def length_of(points):
    return polyline_lengths(points)[-1]


@pytest.mark.parametrize('angle_rad', np.linspace(0.0, 2.0 * math.pi, 9))
def test_open_water_gives_the_distance_in_every_direction(angle_rad):
    grid = grid_of(box(-1000, -1000, 1000, 1000))
    start = (800.0 * math.cos(angle_rad), 800.0 * math.sin(angle_rad))
    field = clearance_field(grid, (0.0, 0.0), FLAT)
    route = descend(grid, field, start, (0.0, 0.0))
    assert length_of(route) == pytest.approx(800.0, rel=0.01)
    assert tuple(route[0]) == start
    assert tuple(route[-1]) == (0.0, 0.0)


def test_around_a_corner_the_route_is_the_taut_string():
    grid = grid_of(RIGHT_ANGLE)
    route = clearance_route(grid, (100.0, 150.0), (850.0, 900.0), FLAT, 10.0)
    corner = (700.0 + 20.0 / math.sqrt(2.0), 300.0 - 20.0 / math.sqrt(2.0))
    taut = math.dist((100.0, 150.0), corner) + math.dist(corner, (850.0, 900.0))
    assert length_of(route) == pytest.approx(taut, rel=0.03)
    assert least_clearance(grid, route) >= 12.0


def test_weight_buys_clearance_with_length():
    grid = grid_of(RIGHT_ANGLE)
    ends = (100.0, 60.0), (940.0, 900.0)
    straight, wide = (
        clearance_route(grid, *ends, RouteCost(20.0, 120.0, weight), 10.0) for weight in (0.0, 4.0)
    )
    assert length_of(wide) > length_of(straight)
    middle = slice(30, -30)
    assert least_clearance(grid, wide[middle]) > least_clearance(grid, straight[middle]) + 20.0


def test_field_falls_along_the_route_and_bounds_its_length():
    grid = grid_of(RIGHT_ANGLE)
    field = clearance_field(grid, (850.0, 900.0), RouteCost())
    route = descend(grid, field, (100.0, 150.0), (850.0, 900.0))
    rows, columns = ((route[:-3, 1] - grid.y0_m) // 10).astype(int), ((route[:-3, 0] - grid.x0_m) // 10)
    values = field[rows, columns.astype(int)]
    assert np.all(np.diff(values) <= 1e-3)
    assert values[0] >= length_of(route) * 0.98


def test_mirrored_water_gives_the_mirrored_route():
    mirrored = Polygon([(x, -y) for x, y in RIGHT_ANGLE.exterior.coords])
    route = clearance_route(grid_of(RIGHT_ANGLE), (100.0, 150.0), (850.0, 900.0), FLAT, 10.0)
    other = clearance_route(grid_of(mirrored), (100.0, -150.0), (850.0, -900.0), FLAT, 10.0)
    assert length_of(route) == pytest.approx(length_of(other), abs=5.0)


def test_buoy_is_passed_with_the_least_clearance():
    buoys = np.array([[500.0, 0.0, 2.0]])
    grid = grid_of(box(0, -200, 1000, 200), buoys=buoys, charted=np.array([True]))
    route = clearance_route(grid, (100.0, 0.0), (900.0, 0.0), RouteCost(30.0, weight=0.0), 10.0)
    assert np.hypot(route[:, 0] - 500.0, route[:, 1]).min() >= 22.0


def test_separate_basins_are_not_reachable():
    water = box(0, 0, 400, 400).union(box(600, 0, 1000, 400))
    grid = grid_of(water)
    field = clearance_field(grid, (200.0, 200.0), FLAT)
    assert not reachable(grid, field, (800.0, 200.0))
    assert not reachable(grid, field, (-5000.0, 0.0))
    with pytest.raises(ValueError, match='no route leads from'):
        descend(grid, field, (800.0, 200.0), (200.0, 200.0))


def test_goal_on_land_or_outside_the_grid_reaches_nothing():
    grid = grid_of(RIGHT_ANGLE)
    for goal in ((200.0, 800.0), (9e5, 0.0)):
        assert not np.isfinite(clearance_field(grid, goal, FLAT)).any()


def test_passage_narrower_than_asked_for_is_closed():
    water = box(0, 0, 400, 400).union(box(400, 180, 600, 220)).union(box(600, 0, 1000, 400))
    grid = grid_of(water)
    wide, narrow = (clearance_field(grid, (200.0, 200.0), RouteCost(m, weight=0.0)) for m in (30.0, 10.0))
    assert not reachable(grid, wide, (800.0, 200.0))
    assert reachable(grid, narrow, (800.0, 200.0))


def test_rounding_turns_a_right_angle_into_a_parabola():
    grid = grid_of(box(-2000, -2000, 2000, 2000))
    leg = np.arange(0.0, 1000.0, 10.0)
    points = np.vstack([np.column_stack([leg, 0 * leg]), np.column_stack([0 * leg + 1000.0, leg])])
    rounded = round_off(grid, points, 200.0, 25.0)
    assert np.array_equal(rounded[[0, -1]], points[[0, -1]])
    tangent = np.gradient(rounded, axis=0)
    turned = np.diff(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))
    arc = np.hypot(*np.diff(rounded, axis=0).T)
    assert 1.0 / np.abs(turned / arc).max() == pytest.approx(200.0 / math.sqrt(2.0), rel=0.05)


def test_rounding_never_gives_up_clearance():
    grid = grid_of(RIGHT_ANGLE)
    route = clearance_route(grid, (100.0, 150.0), (850.0, 900.0), RouteCost(60.0), 10.0)
    for reach_m in (50.0, 200.0, 1000.0):
        rounded = round_off(grid, route, reach_m, 60.0)
        assert least_clearance(grid, rounded) >= min(60.0, least_clearance(grid, route)) - 1e-6


def test_negative_cost_is_refused():
    with pytest.raises(ParamError, match='least_m'):
        RouteCost(least_m=-1.0)
