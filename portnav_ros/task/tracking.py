"""Tracks of the things that stand alone in a scan: where they are, how they move, how far they reach.

A thing stands alone where the rays to both sides of it go further: vessels and buoys do, quays do not.
Its track follows the mean of its points with a g-h filter, whose gains are at first those of a
straight line through all that was seen (the growing-memory filter of Brookner, Tracking and Kalman
Filtering Made Easy, 1998, chapter 1) and then stay, so that old sightings are forgotten.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from portnav_ros.geometry import TWO_PI
from portnav_ros.task.aligned import JOIN_M
from portnav_ros.types import YAW, Array, Array32, BoolArray, X, Y

SLOTS = 24  # tracks that are kept of one vessel's surroundings
TRACK_SIZE = 12  # features of a track
EXTENT_MAX_M = 160.0  # of a thing that stands alone
GATE_M = 15.0  # between where a thing was expected and where one is seen
GATE_SHARE = 0.35  # of its extent, for what is seen of a hull changes
GATE_MPS = 4.0  # for each second that it was not seen
MISSED_MAX = 8  # seconds unseen after which a track ends
QUICK_S, SLOW_S = 8, 24  # memories of the two velocities
SPEED_MAX_MPS = 12.0
STILL_MPS, STILL_M = 0.7, 200.0  # what hardly moves counts as so much farther away
AGE_S = 20.0
EXTENT_SCALE_M = 100.0

MIRRORED_TRACK = np.array([0, 1, 2, 3, 4, 5, 8, 9, 6, 7, 10, 11])  # the ends change places
MIRRORED_SIGN = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, 1], np.float32)
TRACK_KNOWN = 10  # feature that is above 0 where there is a track

AT_X, AT_Y, V_X, V_Y, SLOW_X, SLOW_Y, SLOW_VX, SLOW_VY, A_X, A_Y, B_X, B_Y, SEEN, MISSED = range(14)
ROW = 14
THING = 6  # mean x, y and both ends of a thing


def new_tracks(batch: int) -> Array:
    """Allocate no tracks [B, SLOTS, ROW]: a row is one where it was SEEN at least once."""
    return np.zeros((batch, SLOTS, ROW))


def known_tracks(tracks: Array) -> Array:
    """Places, velocities (of the long memory) and both ends [N, 8] m of the rows [SLOTS, ROW] to tell of."""
    columns = [AT_X, AT_Y, SLOW_VX, SLOW_VY, A_X, A_Y, B_X, B_Y]
    return np.asarray(tracks[tracks[:, SEEN] > 1.0][:, columns])


@njit(cache=True, nogil=True)
def follow(
    tracks: Array, own: Array, ranges: Array32, range_max_m: float, fresh: BoolArray, which: BoolArray
) -> None:
    """Take in the scans [B, R] of the vessels `which` [B] at their states [B, 7]; a fresh one forgets all."""
    things = np.empty((ranges.shape[1], THING))
    for b in np.flatnonzero(which):
        if fresh[b]:
            tracks[b] = 0.0
        count = find_things(own[b], ranges[b], range_max_m, things)
        _update(tracks[b], things[:count])


@njit(cache=True, nogil=True)
def find_things(own: Array, ranges: Array32, range_max_m: float, things: Array) -> int:
    """Write mean and ends [.., 6] m of what stands alone in a scan [R]; return how many."""
    rays = len(ranges)
    points = np.empty((rays, 2))
    valid = np.empty(rays, np.bool_)
    step = TWO_PI / rays
    for i in range(rays):
        valid[i] = 0.0 <= ranges[i] < range_max_m
        bearing = own[YAW] - math.pi + i * step
        points[i, 0] = own[X] + ranges[i] * math.cos(bearing)
        points[i, 1] = own[Y] + ranges[i] * math.sin(bearing)
    following = np.zeros(rays, np.int64)  # rays from each to the next one that hit the same thing
    for i in range(rays):
        j, k = (i + 1) % rays, (i + 2) % rays
        if valid[i] and valid[j]:
            following[i] = 1 if _near(points, i, j) else 0
        elif valid[i] and valid[k]:
            following[i] = 2 if _near(points, i, k) else 0
    count = 0
    for first in range(rays):
        if not valid[first] or following[first - 1] == 1 or following[first - 2] == 2:
            continue
        thing, last, size = things[count], first, 1
        thing[:2] = points[first]
        while following[last] > 0:
            last = (last + following[last]) % rays
            size += 1
            thing[:2] += points[last]
        thing[:2] /= size
        thing[2:4], thing[4:] = points[first], points[last]
        extent = math.hypot(thing[4] - thing[2], thing[5] - thing[3])
        if extent < EXTENT_MAX_M and _clear(ranges, valid, first, -1) and _clear(ranges, valid, last, 1):
            count += 1
    return count


@njit(cache=True, nogil=True, inline='always')
def _near(points: Array, i: int, j: int) -> bool:
    return bool((points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2 < JOIN_M**2)


@njit(cache=True, nogil=True, inline='always')
def _clear(ranges: Array32, valid: BoolArray, end: int, side: int) -> bool:
    """Whether the rays beside the end of a thing go further; one without a return is looked past."""
    for k in (1, 2):
        beside = (end + k * side) % len(ranges)
        if valid[beside]:
            return bool(ranges[beside] > ranges[end])
    return True


@njit(cache=True, nogil=True)
def _update(tracks: Array, things: Array) -> None:
    """Expect every track a second later, give each the nearest thing, begin new ones with the rest."""
    taken = np.zeros(len(things), np.bool_)
    for n in range(len(tracks)):
        track = tracks[n]
        if track[SEEN] == 0.0:
            continue
        track[AT_X] += track[V_X]
        track[AT_Y] += track[V_Y]
        track[SLOW_X] += track[SLOW_VX]
        track[SLOW_Y] += track[SLOW_VY]
        found = _nearest(track, things, taken)
        if found >= 0:
            taken[found] = True
            _correct(track, things[found])
        else:
            track[MISSED] += 1.0
            for k in (A_X, B_X):
                track[k] += track[V_X]
                track[k + 1] += track[V_Y]
            if track[MISSED] > min(MISSED_MAX, track[SEEN]):
                track[:] = 0.0
    for k in range(len(things)):
        if taken[k]:
            continue
        for n in range(len(tracks)):
            if tracks[n, SEEN] == 0.0:
                tracks[n, :] = 0.0
                tracks[n, AT_X : AT_Y + 1] = things[k, :2]
                tracks[n, SLOW_X : SLOW_Y + 1] = things[k, :2]
                tracks[n, A_X : B_Y + 1] = things[k, 2:]
                tracks[n, SEEN] = 1.0
                break


@njit(cache=True, nogil=True)
def _nearest(track: Array, things: Array, taken: BoolArray) -> int:
    extent = math.hypot(track[B_X] - track[A_X], track[B_Y] - track[A_Y])
    gate = GATE_M + GATE_MPS * track[MISSED]
    found, least = -1, math.inf
    for k in range(len(things)):
        if taken[k]:
            continue
        size = math.hypot(things[k, 4] - things[k, 2], things[k, 5] - things[k, 3])
        off = math.hypot(things[k, 0] - track[AT_X], things[k, 1] - track[AT_Y])
        if off < gate + GATE_SHARE * max(extent, size) and off < least:
            found, least = k, off
    return found


@njit(cache=True, nogil=True)
def _correct(track: Array, thing: Array) -> None:
    track[SEEN] += 1.0
    track[MISSED] = 0.0
    _filter(track[AT_X:SLOW_X], thing, min(track[SEEN], QUICK_S))
    _filter(track[SLOW_X:A_X], thing, min(track[SEEN], SLOW_S))
    track[A_X : B_Y + 1] = thing[2:]


@njit(cache=True, nogil=True)
def _filter(state: Array, thing: Array, n: float) -> None:
    """Correct place and velocity [4] by the n-th sighting; places at the second share their velocity."""
    g = 2.0 * (2.0 * n - 1.0) / (n * (n + 1.0))
    h = 6.0 / (n * (n + 1.0))
    for axis in range(2):
        error = thing[axis] - state[axis]
        state[axis] += g * error
        state[2 + axis] += h * error
    speed = math.hypot(state[2], state[3])
    if speed > SPEED_MAX_MPS:
        state[2] *= SPEED_MAX_MPS / speed
        state[3] *= SPEED_MAX_MPS / speed


@njit(cache=True, nogil=True)
def write_tracks(
    tracks: Array, own: Array, course: float, range_m: float, speed_mps: float, out: Array32
) -> None:
    """Write the nearest tracks [SLOTS, ROW] as features [T * TRACK_SIZE], seen with x along the course.

    Of each: place, quick and slow velocity, both ends from the place, for how long it is known, and for
    how long it was not seen; zeros where there is none.
    """
    cost = np.full(len(tracks), math.inf)
    for n in range(len(tracks)):
        track = tracks[n]
        if track[SEEN] > 1.0:
            cost[n] = math.hypot(track[AT_X] - own[X], track[AT_Y] - own[Y])
            if math.hypot(track[SLOW_VX], track[SLOW_VY]) < STILL_MPS:
                cost[n] += STILL_M
    order = np.argsort(cost)
    cosine, sine = math.cos(course), math.sin(course)
    out[:] = 0.0
    for t in range(len(out) // TRACK_SIZE):
        track, row = tracks[order[t]], out[t * TRACK_SIZE : (t + 1) * TRACK_SIZE]
        if cost[order[t]] == math.inf:
            break
        for at, x, y, scale in (
            (0, track[AT_X] - own[X], track[AT_Y] - own[Y], range_m),
            (2, track[V_X], track[V_Y], speed_mps),
            (4, track[SLOW_VX], track[SLOW_VY], speed_mps),
            (6, track[A_X] - track[AT_X], track[A_Y] - track[AT_Y], EXTENT_SCALE_M),
            (8, track[B_X] - track[AT_X], track[B_Y] - track[AT_Y], EXTENT_SCALE_M),
        ):
            row[at] = (cosine * x + sine * y) / scale
            row[at + 1] = (cosine * y - sine * x) / scale
        row[10] = min(track[SEEN], AGE_S) / AGE_S
        row[11] = track[MISSED] / MISSED_MAX
