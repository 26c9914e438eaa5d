"""Hull distances against shapely."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, affinity, box

from portnav_ros.sim.contact import edge_gap, hull_gap, meets_edge, point_gap

HALF_LENGTH, HALF_BEAM = 10.0, 2.5
HULL = box(-HALF_LENGTH, -HALF_BEAM, HALF_LENGTH, HALF_BEAM)
coordinate = st.floats(-40.0, 40.0)


@settings(max_examples=200, deadline=None)
@given(coordinate, coordinate, coordinate, coordinate)
def test_edge_gap_is_the_distance_of_the_shapes(x0, y0, x1, y1):
    expected = HULL.distance(LineString([(x0, y0), (x1, y1)]))
    gap = edge_gap(HALF_LENGTH, HALF_BEAM, x0, y0, x1, y1)
    assert gap == pytest.approx(expected, abs=1e-6)
    if expected > 1e-9:
        assert not meets_edge(HALF_LENGTH, HALF_BEAM, x0, y0, x1, y1)


@settings(max_examples=100, deadline=None)
@given(coordinate, coordinate)
def test_point_gap_is_the_distance_of_the_shapes(x, y):
    assert point_gap(HALF_LENGTH, HALF_BEAM, x, y) == pytest.approx(HULL.distance(Point(x, y)), abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(coordinate, coordinate, st.floats(-4.0, 4.0))
def test_hull_gap_is_the_distance_of_the_shapes(x, y, yaw):
    other = affinity.translate(affinity.rotate(box(-15, -4, 15, 4), np.degrees(yaw), origin=(0, 0)), x, y)
    gap = hull_gap(HALF_LENGTH, HALF_BEAM, x, y, yaw, 15.0, 4.0)
    assert gap == pytest.approx(HULL.distance(other), abs=1e-6)


def test_hull_inside_another_touches():
    assert hull_gap(50.0, 10.0, 3.0, 1.0, 0.4, 4.0, 1.0) == 0.0
    assert hull_gap(4.0, 1.0, 3.0, 1.0, 0.4, 50.0, 10.0) == 0.0
