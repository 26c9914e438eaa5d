import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shapely.geometry import LineString, Point

from portnav_ros import geometry

ANGLES = st.floats(-1e3, 1e3)
COORDINATES = st.floats(-1e4, 1e4)
GRID = st.integers(-20, 20)
POINTS = st.tuples(GRID, GRID)


@given(ANGLES)
def test_wrapped_angle_is_the_same_direction(angle):
    wrapped = geometry.wrap_angle(angle)
    assert -math.pi - 1e-12 <= wrapped < math.pi + 1e-12
    assert_allclose([math.cos(wrapped), math.sin(wrapped)], [math.cos(angle), math.sin(angle)], atol=1e-9)


def test_half_a_turn_wraps_to_minus_pi():
    assert geometry.wrap_angle(math.pi) == geometry.wrap_angle(-math.pi) == -math.pi


def test_body_frame_is_forward_and_left():
    heading_north = (10.0, 20.0, math.pi / 2)
    assert_allclose(geometry.to_body(*heading_north, 10.0, 25.0), (5.0, 0.0), atol=1e-12)
    assert_allclose(geometry.to_body(*heading_north, 7.0, 20.0), (0.0, 3.0), atol=1e-12)


@given(COORDINATES, COORDINATES, ANGLES, COORDINATES, COORDINATES)
def test_body_frame_keeps_distance_and_bearing(x, y, yaw, px, py):
    forward, left = geometry.to_body(x, y, yaw, px, py)
    back_x = x + math.cos(yaw) * forward - math.sin(yaw) * left
    back_y = y + math.sin(yaw) * forward + math.cos(yaw) * left
    assert_allclose([back_x, back_y], [px, py], atol=1e-6)


@given(POINTS, POINTS, POINTS)
def test_distance_to_a_segment(point, start, end):
    expected = Point(point).distance(LineString([start, end])) ** 2
    measured = geometry.segment_distance_squared(*map(float, (*point, *start, *end)))
    assert measured == pytest.approx(expected, abs=1e-9)


def test_polyline_lengths():
    points = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])
    assert_allclose(geometry.polyline_lengths(points), [0.0, 5.0, 11.0])


@given(st.floats(0.5, 50.0))
def test_resampling_keeps_ends_and_length_of_a_straight_line(spacing):
    line = np.array([[0.0, 0.0], [30.0, 40.0], [60.0, 80.0]])
    points = geometry.resample_polyline(line, spacing)
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert_allclose(points[[0, -1]], line[[0, -1]])
    assert_allclose(steps, steps[0])
    assert steps[0] <= spacing + 1e-9


def test_resampling_a_short_line_keeps_both_ends():
    line = np.array([[0.0, 0.0], [1.0, 0.0]])
    assert_allclose(geometry.resample_polyline(line, 10.0), line)


def test_yaws_of_a_circle_turn_once_without_a_jump():
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    yaws = geometry.polyline_yaws(np.column_stack([np.cos(angle), np.sin(angle)]))
    assert np.all(np.diff(yaws) > 0.0)
    assert yaws[180] == pytest.approx(angle[180] + math.pi / 2, abs=0.02)


@pytest.mark.parametrize('spacing', [0.1, 4.0, 13.0, 1000.0])
def test_a_polyline_of_other_spacing_is_resampled(spacing):
    line = np.column_stack(
        [np.append(np.arange(0.0, 1000.0, spacing), 1000.0), np.zeros(math.ceil(1000.0 / spacing) + 1)]
    )
    spaced = geometry.spaced_polyline(line, 10.0)
    assert_allclose(spaced, np.column_stack([np.arange(0.0, 1001.0, 10.0), np.zeros(101)]), atol=1e-9)


def test_a_polyline_that_is_spaced_already_stays_to_the_bit():
    angle = np.linspace(0.0, 3.0, 40)
    bend = 130.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    spaced = geometry.resample_polyline(bend, 10.0)
    assert geometry.spaced_polyline(spaced, 10.0) is spaced
    empty = np.zeros((0, 2))
    assert geometry.spaced_polyline(empty, 10.0) is empty
