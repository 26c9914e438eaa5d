"""Rays against what they must hit."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from portnav_ros.sim.lidar import Sensor, cast_disc, cast_edge, disturb, hash_uniform, ray_directions

REACH = 300.0


def brute_force(rays, x0, y0, x1, y1):
    """Distance along every ray to an edge seen with its left side, by solving each ray for itself."""
    ranges = np.full(len(rays), REACH)
    for i, (dx, dy) in enumerate(rays):
        matrix = np.array([[dx, x0 - x1], [dy, y0 - y1]])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        t, u = np.linalg.solve(matrix, [x0, y0])
        if t > 0 and -1e-12 <= u <= 1 + 1e-12 and x0 * y1 - y0 * x1 > 0:
            ranges[i] = min(ranges[i], t)
    return ranges


coordinate = st.floats(-250.0, 250.0)


@settings(max_examples=200, deadline=None)
@given(coordinate, coordinate, coordinate, coordinate)
def test_edge_equals_brute_force(x0, y0, x1, y1):
    if min(math.hypot(x0, y0), math.hypot(x1, y1), math.hypot(x1 - x0, y1 - y0)) < 1.0:
        return
    if abs(x0 * y1 - y0 * x1) < 1.0:
        return
    rays = ray_directions(90)
    ranges = np.full(90, REACH, np.float32)
    cast_edge(rays, ranges, x0, y0, x1, y1)
    expected = brute_force(rays, x0, y0, x1, y1)
    on_end = [
        abs(math.remainder(math.atan2(y, x) - math.atan2(ray[1], ray[0]), 2 * math.pi)) < 1e-9
        for ray in rays
        for x, y in ((x0, y0), (x1, y1))
    ]
    clear = ~np.array(on_end).reshape(90, 2).any(axis=1)
    np.testing.assert_allclose(ranges[clear], expected[clear], rtol=1e-4, atol=1e-3)


def test_edge_across_the_stern_is_seen_by_both_ends_of_the_sweep():
    rays = ray_directions(36)
    ranges = np.full(36, REACH, np.float32)
    cast_edge(rays, ranges, -50.0, 30.0, -50.0, -30.0)
    hit = np.flatnonzero(ranges < REACH)
    assert set(hit) == {0, 1, 2, 3, 33, 34, 35}
    assert ranges[0] == pytest.approx(50.0)
    assert ranges[1] == pytest.approx(ranges[35])


def test_edge_from_behind_is_not_seen():
    rays = ray_directions(36)
    ranges = np.full(36, REACH, np.float32)
    cast_edge(rays, ranges, 50.0, 30.0, 50.0, -30.0)
    assert (ranges == REACH).all()


def test_disc_ahead():
    rays = ray_directions(360)
    ranges = np.full(360, REACH, np.float32)
    cast_disc(rays, ranges, 100.0, 0.0, 2.0)
    assert ranges[180] == pytest.approx(98.0)
    half_width = math.degrees(math.asin(0.02))
    assert (ranges < REACH).sum() == 2 * int(half_width) + 1


def test_readings_follow_rep_117():
    ranges = np.array([0.1, 10.0, 300.0], np.float32)
    disturb(ranges, Sensor(0.5, 300.0, 0.0, 0.0), 0, 0)
    assert ranges.tolist() == [-math.inf, 10.0, math.inf]


def test_noise_has_the_asked_spread_and_drop_out_the_asked_share():
    ranges = np.full(20_000, 100.0, np.float32)
    disturb(ranges, Sensor(0.5, 300.0, 0.5, 0.1), seed=3, tick=7)
    kept = ranges[np.isfinite(ranges)]
    assert np.isinf(ranges).mean() == pytest.approx(0.1, abs=0.01)
    assert kept.std() == pytest.approx(0.5, rel=0.05)
    assert kept.mean() == pytest.approx(100.0, abs=0.02)


def test_hash_is_uniform_and_without_state():
    values = np.array([hash_uniform(1, i, j, 0) for i in range(100) for j in range(100)])
    counts, _ = np.histogram(values, bins=20, range=(0.0, 1.0))
    assert values[0] == hash_uniform(1, 0, 0, 0)
    assert ((counts - 500) ** 2 / 500).sum() < 43.8  # chi-squared, 19 degrees of freedom, p = 0.001
