"""Other vessels: constant speed along tracks, not reactive; a new track at each arrival."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.geometry import wrap_angle
from portnav_ros.sim.lidar import hash_uniform
from portnav_ros.sim.scenario import TRACK_SPACING_M, Arrival
from portnav_ros.types import Array, Array32, BoolArray, IntArray

TURN_RATE_RADPS = 0.05  # a vessel that turns at its berth
RESPAWN = int(Arrival.RESPAWN)
VANISH = int(Arrival.VANISH)


class Crowd(NamedTuple):
    """The other vessels of B environments, M at most in each, N tracks at most.

    points: [B, P, 3], offsets: [B, N + 1], origin, destination: [B, N] as in scenario.Tracks.
    tracks, vessels: [B] numbers in use. hull: [B, M, 2] m. speed: [B, M] m/s. arrival: [B].
    seed: [B], of the next tracks and of the sensor's noise. track, leg: [B, M]. progress: [B, M] m along
    the track. turn: [B, M] rad still to turn before sailing. pose: [B, M, 4] x, y, yaw, speed; NaN for
    a vessel that has vanished.
    """

    points: Array32
    offsets: IntArray
    origin: IntArray
    destination: IntArray
    tracks: IntArray
    vessels: IntArray
    hull: Array
    speed: Array
    arrival: IntArray
    seed: IntArray
    track: IntArray
    leg: IntArray
    progress: Array
    turn: Array
    pose: Array


@njit(cache=True, nogil=True)
def move_vessels(crowd: Crowd, moving: BoolArray, dt_s: float) -> None:
    """Advance the vessels of the environments that are moving [B] along their tracks."""
    turn_step = TURN_RATE_RADPS * dt_s
    for b in range(len(moving)):
        if not moving[b]:
            continue
        for m in range(crowd.vessels[b]):
            turn = crowd.turn[b, m]
            if turn != 0.0:
                done = abs(turn) <= turn_step
                crowd.turn[b, m] = 0.0 if done else turn - math.copysign(turn_step, turn)
                continue
            crowd.progress[b, m] += crowd.speed[b, m] * dt_s
            track = crowd.track[b, m]
            points = crowd.offsets[b, track + 1] - crowd.offsets[b, track]
            length = (points - 1) * TRACK_SPACING_M
            if crowd.progress[b, m] >= length:
                crowd.progress[b, m] = length
                if crowd.arrival[b] == RESPAWN:
                    _take_new_track(crowd, b, m)


@njit(cache=True, nogil=True)
def _take_new_track(crowd: Crowd, b: int, m: int) -> None:
    here = crowd.destination[b, crowd.track[b, m]]
    departing = 0
    for n in range(crowd.tracks[b]):
        departing += crowd.origin[b, n] == here
    if departing == 0:
        return
    crowd.leg[b, m] += 1
    chosen = int(hash_uniform(crowd.seed[b], m, crowd.leg[b, m], 0) * departing)
    yaw = crowd.points[b, crowd.offsets[b, crowd.track[b, m] + 1] - 1, 2]
    for n in range(crowd.tracks[b]):
        if crowd.origin[b, n] == here:
            if chosen == 0:
                crowd.track[b, m] = n
                break
            chosen -= 1
    crowd.progress[b, m] = 0.0
    first = crowd.points[b, crowd.offsets[b, crowd.track[b, m]], 2]
    crowd.turn[b, m] = wrap_angle(first - yaw)


@njit(cache=True, nogil=True)
def place_vessels(crowd: Crowd, lead_s: Array) -> None:
    """Write the poses of all vessels as of `lead_s` [B] after they last moved."""
    for b in range(len(lead_s)):
        for m in range(crowd.vessels[b]):
            start = crowd.offsets[b, crowd.track[b, m]]
            last = crowd.offsets[b, crowd.track[b, m] + 1] - 1
            turn = crowd.turn[b, m]
            lead_m = crowd.speed[b, m] * lead_s[b] if turn == 0.0 else 0.0
            at = (crowd.progress[b, m] + lead_m) / TRACK_SPACING_M
            i = min(start + int(at), last)
            j = min(i + 1, last)
            share = min(at - (i - start), 1.0)
            for axis in range(3):
                a, z = crowd.points[b, i, axis], crowd.points[b, j, axis]
                crowd.pose[b, m, axis] = a + share * (z - a)
            crowd.pose[b, m, 2] -= turn
            done = i >= last and crowd.arrival[b] != RESPAWN
            crowd.pose[b, m, 3] = 0.0 if done or turn != 0.0 else crowd.speed[b, m]
            if done and crowd.arrival[b] == VANISH:
                crowd.pose[b, m, :] = np.nan
