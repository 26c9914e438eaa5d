"""Other vessels at the start of an episode: drawn under way on their tracks, clear of the own ship."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from portnav_ros.sim.difficulty import TrafficParams
from portnav_ros.sim.scenario import TRACK_SPACING_M, Arrival, ScenarioError, Tracks, Traffic, no_traffic
from portnav_ros.sim.tracks import pose_on_track
from portnav_ros.types import Array, Array32, IntArray

TRIES = 64  # places drawn for each vessel
LOOK_STEP_S = 5.0


def draw_traffic(
    tracks: Tracks,
    own: tuple[float, float, float],
    params: TrafficParams,
    rng: np.random.Generator,
    strict: bool = True,
) -> Traffic:
    """Draw hulls, speeds and places of other vessels.

    A vessel begins anywhere along a random track, ``start_gap_m`` from the own ship and the others,
    and does not come within ``clear_start_m`` of the own start in the first ``clear_start_s``.

    Without ``strict`` a vessel that finds no place, and those after it, are left out.

    Raises:
        ScenarioError: a vessel finds no place and ``strict`` holds.
    """
    count = params.vessels
    if count == 0:
        return no_traffic()
    length = rng.uniform(*params.length_m, count)
    hull = np.column_stack([length, length / rng.uniform(*params.length_over_beam, count)])
    speed = rng.uniform(*params.speed_mps, count)
    lots = rng.random((count, TRIES, 2))
    track, progress = np.zeros(count, np.int64), np.zeros(count)
    clear = np.array([params.start_gap_m, params.clear_start_m, params.clear_start_s])
    placed = _place(tracks.points, tracks.offsets, own[0], own[1], speed, lots, clear, track, progress)
    if strict and placed < count:
        raise ScenarioError(
            f'vessel {placed} of {count} finds no place in {TRIES} draws; lower vessels or start_gap_m'
        )
    arrival = Arrival[params.arrival.upper()]
    seed = int(rng.integers(2**31))
    return Traffic(tracks, hull[:placed], speed[:placed], track[:placed], progress[:placed], arrival, seed)


@njit(cache=True)
def _place(
    points: Array32,
    offsets: IntArray,
    own_x: float,
    own_y: float,
    speed: Array,
    lots: Array,
    clear: Array,
    track: IntArray,
    progress: Array,
) -> int:
    """Fill track and progress [M] from lots [M, TRIES, 2]; the number of vessels placed."""
    at = np.empty((len(speed), 2))
    for m in range(len(speed)):
        found = False
        for lot in lots[m]:
            n = min(int(lot[0] * (len(offsets) - 1)), len(offsets) - 2)
            along = lot[1] * (offsets[n + 1] - offsets[n] - 1) * TRACK_SPACING_M
            x, y, _ = pose_on_track(points, offsets, n, along)
            found = math.hypot(x - own_x, y - own_y) >= clear[0]
            for k in range(m):
                found = found and math.hypot(x - at[k, 0], y - at[k, 1]) >= clear[0]
            if found and _stays_clear(points, offsets, n, along, speed[m], own_x, own_y, clear):
                track[m], progress[m], at[m, 0], at[m, 1] = n, along, x, y
                break
            found = False
        if not found:
            return m
    return len(speed)


@njit(cache=True)
def _stays_clear(
    points: Array32,
    offsets: IntArray,
    track: int,
    progress: float,
    speed: float,
    own_x: float,
    own_y: float,
    clear: Array,
) -> bool:
    for step in range(int(clear[2] / LOOK_STEP_S) + 1):
        x, y, _ = pose_on_track(points, offsets, track, progress + speed * step * LOOK_STEP_S)
        if math.hypot(x - own_x, y - own_y) < clear[1]:
            return False
    return True
