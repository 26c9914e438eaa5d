"""Other vessels along their tracks."""

import itertools
import math

import numpy as np
import pytest
from shapely import box

from portnav_ros.harbour import Harbour
from portnav_ros.sim.scenario import Arrival, Scenario, Tracks, Traffic
from portnav_ros.sim.traffic import TURN_RATE_RADPS
from portnav_ros.sim.world import TICK_S, World
from portnav_ros.types import Outcome

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


FROM, TO = (0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1)


def triangle_world(seed):
    """Three berths, two tracks from each; both vessels begin on the first. Nobody has to turn."""
    berths = np.array([[500.0, 500.0, 0.0], [700.0, 500.0, 0.0], [600.0, 700.0, 0.0]])
    points = [np.linspace(berths[a], berths[z], 11) for a, z in zip(FROM, TO, strict=True)]
    offsets = np.arange(len(points) + 1) * 11
    tracks = Tracks(np.vstack(points).astype(np.float32), offsets, np.array(FROM), np.array(TO))
    hulls, speeds, none = np.full((2, 2), (50.0, 8.0)), np.full(2, 50.0), np.zeros(2)
    traffic = Traffic(tracks, hulls, speeds, none.astype(int), none, Arrival.RESPAWN, seed)
    harbour = Harbour('open', box(0, 0, 2000, 1000))
    return World([Scenario('x', 0, harbour, (100.0, 100.0, 0.0), (1900.0, 900.0), traffic)])


def legs(w, count):
    """Tracks that each vessel takes one after the other: two lists of count numbers."""
    taken = [[], []]
    while min(map(len, taken)) < count:
        for m, tracks in enumerate(taken):
            if w.crowd.leg[0, m] == len(tracks):
                tracks.append(int(w.crowd.track[0, m]))
        w.step(np.zeros((1, 2)))
        assert w.outcome[0] == Outcome.RUNNING
    return [tracks[:count] for tracks in taken]


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
    vessels = legs(triangle_world(seed=5), 24)
    for tracks in vessels:
        assert all(FROM[after] == TO[before] for before, after in itertools.pairwise(tracks))
    assert vessels == legs(triangle_world(seed=5), 24)
    assert len({tuple(legs(triangle_world(seed), 24)[0]) for seed in range(5)}) == 5


def test_next_track_differs_by_vessel_and_by_leg():
    first, second = legs(triangle_world(seed=5), 24)
    assert first[0] == second[0]
    assert first != second
    assert set(first) == set(second) == set(range(6))
