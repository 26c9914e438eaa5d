"""Other vessels along their tracks."""

import math

import numpy as np
import pytest
from shapely import box

from portnav_ros.harbour import Harbour
from portnav_ros.sim.scenario import Arrival, Scenario, Tracks, Traffic
from portnav_ros.sim.traffic import TURN_RATE_RADPS
from portnav_ros.sim.world import TICK_S, World

NOTHING = np.zeros(1)


def there_and_back(length_m=200.0, turns=0.0):
    """Two berths, a track each way."""
    x = np.arange(0.0, length_m + 1.0, 10.0)
    out = np.column_stack([x + 500.0, np.full_like(x, 500.0), np.zeros_like(x)])
    back = np.column_stack([x[::-1] + 500.0, np.full_like(x, 500.0), np.full_like(x, math.pi)])
    points = np.vstack([out, back]).astype(np.float32)
    return Tracks(points, np.array([0, len(x), 2 * len(x)]), np.array([0, 1]), np.array([1, 0]))


def world(arrival, speed=5.0, seed=0):
    traffic = Traffic(
        there_and_back(),
        np.array([[50.0, 8.0]]),
        np.array([speed]),
        np.array([0]),
        np.array([0.0]),
        arrival,
        seed,
    )
    harbour = Harbour('open', box(0, 0, 2000, 1000))
    return World([Scenario('x', 0, harbour, (100.0, 100.0, 0.0), (1900.0, 900.0), traffic)])


def run(w, seconds):
    for _ in range(round(seconds / TICK_S)):
        w.tick(NOTHING, NOTHING)
    w.sense()
    return w.vessels[0, 0]


def test_vessel_sails_at_constant_speed():
    assert run(world(Arrival.RESPAWN), 20.0) == pytest.approx([600.0, 500.0, 0.0, 5.0], abs=1e-3)


def test_vessel_turns_at_its_berth_and_sails_back():
    w = world(Arrival.RESPAWN)
    x, y, yaw, speed = run(w, 45.0)
    assert (x, y, speed) == pytest.approx((700.0, 500.0, 0.0), abs=0.3)
    assert abs(math.remainder(yaw, math.tau)) == pytest.approx(5.0 * TURN_RATE_RADPS, abs=0.02)
    x, y, yaw, speed = run(w, math.pi / TURN_RATE_RADPS)
    assert speed == 5.0
    assert x == pytest.approx(700.0 - 5.0 * 5.0, abs=1.0)
    assert math.cos(yaw) == pytest.approx(-1.0)


def test_vessel_stops_or_vanishes_at_the_end_of_its_track():
    assert run(world(Arrival.STOP), 60.0) == pytest.approx([700.0, 500.0, 0.0, 0.0], abs=1e-3)
    assert np.isnan(run(world(Arrival.VANISH), 60.0)).all()


def test_next_track_departs_from_where_the_vessel_arrived_and_follows_the_seed():
    w = world(Arrival.RESPAWN, speed=50.0, seed=5)
    again = world(Arrival.RESPAWN, speed=50.0, seed=5)
    for _ in range(5):
        np.testing.assert_array_equal(run(w, 40.0), run(again, 40.0))
