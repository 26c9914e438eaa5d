"""Tracks of what stands alone in a scan."""

import math

import numpy as np
import pytest

from portnav_ros.sim.lidar import cast_disc, cast_edge, ray_directions
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.params import TaskParams
from portnav_ros.task.tracking import (
    MISSED_MAX,
    SLOTS,
    THING,
    TRACK_KNOWN,
    TRACK_SIZE,
    find_things,
    follow,
    known_tracks,
    new_tracks,
    write_tracks,
)
from portnav_ros.types import YAW

RAYS, REACH_M = 180, 400.0
EVERY = np.array([True])
WALL_M = 60.0


def at(x=0.0, y=0.0, yaw=0.0):
    return np.array([x, y, yaw, 5.0, 0.0, 0.0, 0.0])


def scan(own, discs=(), hulls=(), walls=()):
    """Ranges [R] of discs (x, y, radius), hulls (x, y, yaw, length, beam) and walls (x0, y0, x1, y1)."""
    cosine, sine = math.cos(own[2]), math.sin(own[2])
    rays = ray_directions(RAYS)
    ranges = np.full(RAYS, REACH_M, np.float32)

    def seen(x, y):
        return cosine * (x - own[0]) + sine * (y - own[1]), cosine * (y - own[1]) - sine * (x - own[0])

    for x, y, radius in discs:
        cast_disc(rays, ranges, *seen(x, y), radius)
    edges = list(walls)
    for x, y, yaw, length, beam in hulls:
        c, s = math.cos(yaw), math.sin(yaw)
        ends = [(a * length / 2.0, b * beam / 2.0) for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        corners = [(x + c * a - s * b, y + s * a + c * b) for a, b in ends]
        edges += [(*corners[k], *corners[k - 1]) for k in range(4)]
    for x0, y0, x1, y1 in edges:
        cast_edge(rays, ranges, *seen(x0, y0), *seen(x1, y1))
    return ranges


def canal(own):
    """Two parallel quays."""
    return [(own[0] + side * 15.0, side, own[0] - side * 15.0, side) for side in (-WALL_M, WALL_M)]


def things(own, ranges):
    found = np.empty((RAYS, THING))
    return found[: find_things(own, ranges, REACH_M, found)]


def watch(states, scans):
    """Tracks [SLOTS, ..] after states [T, 7] and their scans."""
    tracks = new_tracks(1)
    for k, (own, ranges) in enumerate(zip(states, scans, strict=True)):
        follow(tracks, own[None], ranges[None], REACH_M, np.array([k == 0]), EVERY)
    return tracks[0]


def told(tracks, own, course=0.0, count=4):
    """Features of the known tracks, a row for each."""
    out = np.full(count * TRACK_SIZE, 9.0, np.float32)
    write_tracks(tracks, own, course, REACH_M, 5.0, out)
    rows = out.reshape(count, TRACK_SIZE)
    return rows[rows[:, TRACK_KNOWN] > 0.0]


@pytest.mark.parametrize('yaw', [0.0, 0.7, 3.1])
def test_a_hull_between_quays_stands_alone_and_the_quays_do_not(yaw):
    own = at(yaw=yaw)
    (thing,) = things(own, scan(own, hulls=[(150.0, 10.0, 0.5, 100.0, 12.0)], walls=canal(own)))
    assert math.hypot(thing[0] - 150.0, thing[1] - 10.0) < 25.0
    ends = thing[2:].reshape(2, 2)
    assert 60.0 < math.hypot(*(ends[0] - ends[1])) < 105.0
    assert len(things(own, scan(own, walls=canal(own)))) == 0


def test_what_a_nearer_wall_half_hides_does_not_stand_alone():
    own = at()
    hull, pier = (200.0, 0.0, math.pi / 2.0, 100.0, 12.0), (100.0, 5.0, 100.0, 60.0)
    assert len(things(own, scan(own, hulls=[hull]))) == 1
    assert len(things(own, scan(own, hulls=[hull], walls=[pier]))) == 1  # the pier alone
    assert things(own, scan(own, hulls=[hull], walls=[pier]))[0, 0] == pytest.approx(100.0, abs=1.0)


def test_what_is_longer_than_a_hull_is_none():
    own = at()
    assert len(things(own, scan(own, walls=[(150.0, -75.0, 150.0, 75.0)]))) == 1
    assert len(things(own, scan(own, walls=[(150.0, -90.0, 150.0, 90.0)]))) == 0


@pytest.mark.parametrize('ray', [89, 90, 93])
def test_a_ray_without_a_return_splits_nothing(ray):
    """Neither a hull abeam nor a quay, whose pieces would stand alone."""
    own = at()
    ranges = scan(own, hulls=[(120.0, 0.0, math.pi / 2.0, 60.0, 12.0)], walls=canal(own))
    whole = things(own, ranges)
    ranges[[ray, 20, 24, 150]] = REACH_M
    (thing,) = things(own, ranges)
    np.testing.assert_allclose(thing[:2], whole[0, :2], atol=3.0)


def test_nothing_in_reach_and_walls_all_around():
    own = at()
    assert len(things(own, np.full(RAYS, np.inf, np.float32))) == 0
    assert len(things(own, np.full(RAYS, 50.0, np.float32))) == 0


def approach(seconds, speed=(-4.0, 1.0), radius=6.0):
    """Own vessel that sails and turns, and a disc that moves."""
    states = np.array([at(4.0 * k, 0.2 * k, 0.03 * k) for k in range(seconds)])
    centres = np.array([(300.0 + speed[0] * k, -20.0 + speed[1] * k) for k in range(seconds)])
    scans = [
        scan(own, [(*centre, radius)], walls=canal(own)) for own, centre in zip(states, centres, strict=True)
    ]
    return states, scans, centres


def test_a_moving_thing_is_followed_by_a_turning_vessel():
    states, scans, centres = approach(25)
    (row,) = told(watch(states, scans), states[-1])
    np.testing.assert_allclose(REACH_M * row[:2], centres[-1] - states[-1][:2], atol=10.0)
    np.testing.assert_allclose(5.0 * row[2:4], (-4.0, 1.0), atol=0.8)
    np.testing.assert_allclose(5.0 * row[4:6], (-4.0, 1.0), atol=0.4)
    assert row[TRACK_KNOWN] == 1.0
    assert row[11] == 0.0


def test_features_are_seen_along_the_course():
    states, scans, _ = approach(15)
    tracks = watch(states, scans)
    ahead, (turned,) = told(tracks, states[-1]), told(tracks, states[-1], course=0.4)
    c, s = math.cos(0.4), math.sin(0.4)
    for k in range(0, 10, 2):
        x, y = ahead[0, k : k + 2]
        np.testing.assert_allclose(turned[k : k + 2], (c * x + s * y, c * y - s * x), atol=1e-5)
    np.testing.assert_array_equal(turned[10:], ahead[0, 10:])


def test_what_is_known_is_told_in_the_map():
    states, scans, centres = approach(25)
    tracks = watch(states, scans)
    (row,) = known_tracks(tracks)
    np.testing.assert_allclose(row[:2], centres[-1], atol=10.0)
    np.testing.assert_allclose(row[2:4], (-4.0, 1.0), atol=0.4)
    assert math.hypot(*(row[4:6] - row[6:8])) < 12.0
    assert known_tracks(new_tracks(1)[0]).shape == (0, 8)


def test_a_turn_shows_in_the_quick_velocity_first():
    states = np.array([at(-200.0, -50.0)] * 40)
    yaw = np.concatenate([np.zeros(25), np.linspace(0.0, 0.9, 15)])
    steps = 4.0 * np.column_stack([np.cos(yaw), np.sin(yaw)])
    centres = np.cumsum(steps, axis=0) - (150.0, 30.0)
    scans = [scan(states[0], [(*centre, 6.0)]) for centre in centres]
    (row,) = told(watch(states, scans), states[-1])
    quick, slow = (math.atan2(row[k + 1], row[k]) for k in (2, 4))
    assert 0.9 > quick > slow + 0.15
    assert slow > 0.0


def test_a_hidden_thing_is_expected_where_it_sailed_to_and_forgotten_in_time():
    states, scans, centres = approach(30)
    blind = np.full(RAYS, REACH_M, np.float32)
    hidden = [*scans[:20], *[blind] * 5]
    (row,) = told(watch(states[:25], hidden), states[24])
    np.testing.assert_allclose(REACH_M * row[:2], centres[24] - states[24][:2], atol=12.0)
    assert row[11] == pytest.approx(5.0 / MISSED_MAX)
    gone = watch(states[: 20 + MISSED_MAX + 1], [*scans[:20], *[blind] * (MISSED_MAX + 1)])
    assert len(told(gone, states[-1])) == 0
    assert not gone.any()


def test_what_was_seen_once_is_not_told_of():
    states, scans, _ = approach(2)
    assert len(told(watch(states[:1], scans[:1]), states[0])) == 0
    assert len(told(watch(states, scans), states[1])) == 1


def test_a_fresh_vessel_forgets_all():
    states, scans, _ = approach(10)
    tracks = watch(states, scans)[None].copy()
    blind = np.full((1, RAYS), REACH_M, np.float32)
    follow(tracks, states[-1:], blind, REACH_M, np.array([True]), EVERY)
    assert not tracks.any()


def test_others_than_those_asked_for_stay():
    states, scans, _ = approach(10)
    tracks = np.concatenate([watch(states, scans)[None]] * 2)
    before = tracks.copy()
    follow(
        tracks,
        states[[-1, -1]],
        np.stack([scans[-1]] * 2),
        REACH_M,
        ~EVERY.repeat(2),
        np.array([False, True]),
    )
    np.testing.assert_array_equal(tracks[0], before[0])
    assert (tracks[1] != before[1]).any()


def test_the_nearest_come_first_and_what_stands_still_counts_as_farther():
    states = np.array([at(0.0, 0.0)] * 12)
    scans = [
        scan(states[0], [(80.0, 40.0, 5.0), (150.0 - 3.0 * k, -40.0, 5.0), (330.0 - 3.0 * k, 60.0, 5.0)])
        for k in range(12)
    ]
    rows = told(watch(states, scans), states[-1])
    far = REACH_M * np.hypot(rows[:, 0], rows[:, 1])
    assert far[0] == pytest.approx(math.hypot(117.0, 40.0), abs=10.0)
    assert far[1] == pytest.approx(math.hypot(80.0, 40.0), abs=10.0)
    assert far[2] == pytest.approx(math.hypot(297.0, 60.0), abs=10.0)
    assert len(told(watch(states, scans), states[-1], count=1)) == 1


def test_more_things_than_slots_lose_none_of_those_that_are_followed():
    own = at()
    angles = np.linspace(-3.0, 3.0, SLOTS + 6)
    discs = [(150.0 * math.cos(a), 150.0 * math.sin(a), 4.0) for a in angles]
    tracks = watch(np.array([own] * 3), [scan(own, discs)] * 3)
    assert (tracks[:, 12] == 3.0).all()


def test_noise_leaves_a_velocity():
    rng = np.random.default_rng(0)
    states, scans, _ = approach(25)
    for ranges in scans:
        hit = ranges < REACH_M
        ranges[hit] += rng.normal(0.0, 0.5, hit.sum()).astype(np.float32)
        ranges[rng.random(RAYS) < 0.02] = np.inf
    rows = told(watch(states, scans), states[-1])
    nearest = np.hypot(5.0 * rows[:, 4] + 4.0, 5.0 * rows[:, 5] - 1.0).min()
    assert nearest < 0.8


def in_view(world, b):
    """Where the vessels within 300 m are from the own one, unless a quay is in between, and their lengths."""
    away = world.vessels[b][:, :2] - world.own[b, :2]
    for n in np.flatnonzero(np.hypot(*away.T) < 300.0):
        bearing = math.atan2(away[n, 1], away[n, 0]) - world.own[b, YAW]
        ray = round((bearing + math.pi) / (2.0 * math.pi) * world.lidar.rays) % world.lidar.rays
        if world.ranges[b, ray] > math.hypot(*away[n]) - world.hulls[b, n, 0]:
            yield away[n], world.hulls[b, n, 0]


def test_vessels_of_a_port_are_in_the_features():
    """Nine in ten of those within 300 m in view, as a vessel that follows its path sees them."""
    observation = ObservationParams(layout='aligned', ages=(0,), sectors=12, tracks=8)
    task = TaskParams(observation, ActionParams((0.0,), (5.0,), 'path', 4))
    env = PortVectorEnv(16, difficulty='paper', ports=2, task=task)
    features, infos = env.reset(seed=0)
    found = []
    for _ in range(40):
        features, _, terminated, truncated, infos = env.step(np.zeros(16, np.int64))
        tracks = features[:, -8 * TRACK_SIZE :].reshape(16, 8, TRACK_SIZE)
        for b in np.flatnonzero(~terminated & ~truncated & (env.world.time_s > 3.0)):
            course = env.world.own[b, YAW] - infos['errors'][b, 2]
            turn = np.array([[math.cos(course), math.sin(course)], [-math.sin(course), math.cos(course)]])
            places = REACH_M * tracks[b, tracks[b, :, TRACK_KNOWN] > 0.0, :2] @ turn
            for place, length in in_view(env.world, b):
                found.append((np.hypot(*(places - place).T) < length).any())
    assert len(found) > 100
    assert np.mean(found) > 0.9
