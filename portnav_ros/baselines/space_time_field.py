"""Time-to-go of a point that turns at will among the vessels' true future.

Solved backwards in time on a grid: from a cell the point stays or moves one step in any of 16
directions, and time spent close to a quay, a buoy or a vessel counts more. It is what the search in
full dynamics is led by: it knows which side to pass on and when to wait.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.geometry import TWO_PI, segment_distance_squared
from portnav_ros.harbour import ClearanceGrid
from portnav_ros.types import YAW, Array, Array32, X, Y

DIRECTIONS = 16
NEVER_S = 1e6


class Haste(NamedTuple):
    """Time step of the layers, speed of the point, and what closeness costs.

    A place closer than half_beam_m to anything is closed; time counts up to (1 + weight) times where
    something is closer than comfort_m beyond that.
    """

    step_s: float
    speed_mps: float
    half_beam_m: float
    comfort_m: float
    weight: float


@njit(cache=True, nogil=True)
def time_to_go(grid: ClearanceGrid, rest: Array32, poses: Array, hulls: Array, haste: Haste) -> Array32:
    """Seconds to go [T + 1, H, W] from each cell at each layer of time; +inf where closed.

    Args:
        grid: clearance from everything that is fixed.
        rest: [H, W] s from each cell after the last layer, when the vessels are forgotten.
        poses: [T, M, 4] of the vessels at each layer.
        hulls: [M, 2] m.
        haste: steps and costs.
    """
    layers = len(poses)
    togo = np.full((layers + 1, *rest.shape), np.inf, np.float32)
    togo[layers] = rest
    quiet = _pace(grid, rest, haste)
    pace = np.empty_like(quiet)
    for k in range(layers - 1, -1, -1):
        pace[:] = quiet
        for m in range(len(hulls)):
            _slow_near(grid, pace, poses[k, m], hulls[m], haste)
        _step_back(togo[k + 1], togo[k], pace, rest, grid.resolution_m, haste)
    return togo


@njit(cache=True, nogil=True)
def _pace(grid: ClearanceGrid, rest: Array32, haste: Haste) -> Array32:
    """How much a second counts in each cell without vessels; +inf where closed."""
    pace = np.full(rest.shape, np.inf, np.float32)
    for i in range(rest.shape[0]):
        for j in range(rest.shape[1]):
            if rest[i, j] < np.inf:
                spare = max(grid.distance[i, j] - haste.half_beam_m, 0.0)
                pace[i, j] = 1.0 + haste.weight * max(1.0 - spare / haste.comfort_m, 0.0)
    return pace


@njit(cache=True, nogil=True)
def _slow_near(grid: ClearanceGrid, pace: Array32, pose: Array, hull: Array, haste: Haste) -> None:
    """Raise the pace about one vessel's hull, taken as a line with a half-beam about it."""
    if math.isnan(pose[X]):
        return
    closed = haste.half_beam_m + 0.5 * hull[1]
    half = 0.5 * hull[0]
    ax, ay = half * math.cos(pose[YAW]), half * math.sin(pose[YAW])
    reach = half + closed + haste.comfort_m
    cell = grid.resolution_m
    first_row = max(int((pose[Y] - reach - grid.y0_m) / cell), 0)
    last_row = min(int((pose[Y] + reach - grid.y0_m) / cell), pace.shape[0] - 1)
    first_column = max(int((pose[X] - reach - grid.x0_m) / cell), 0)
    last_column = min(int((pose[X] + reach - grid.x0_m) / cell), pace.shape[1] - 1)
    for i in range(first_row, last_row + 1):
        y = grid.y0_m + (i + 0.5) * cell - pose[Y]
        for j in range(first_column, last_column + 1):
            x = grid.x0_m + (j + 0.5) * cell - pose[X]
            gap = math.sqrt(segment_distance_squared(x, y, -ax, -ay, ax, ay)) - closed
            if gap <= 0.0:
                pace[i, j] = np.inf
            elif gap < haste.comfort_m:
                pace[i, j] += haste.weight * (1.0 - gap / haste.comfort_m)


@njit(cache=True, nogil=True)
def _step_back(
    later: Array32, now: Array32, pace: Array32, rest: Array32, cell_m: float, haste: Haste
) -> None:
    """Fill the layer before `later`: the best of staying and of one step in each direction."""
    step = haste.speed_mps * haste.step_s / cell_m
    moves = np.zeros((DIRECTIONS + 1, 2))
    for d in range(DIRECTIONS):
        moves[d, 0] = step * math.sin(d * TWO_PI / DIRECTIONS)
        moves[d, 1] = step * math.cos(d * TWO_PI / DIRECTIONS)
    for i in range(1, now.shape[0] - 1):
        for j in range(1, now.shape[1] - 1):
            if not pace[i, j] < np.inf:
                continue
            best = NEVER_S
            for d in range(DIRECTIONS + 1):
                beyond = sample(later, i + moves[d, 0], j + moves[d, 1])
                if beyond < best and _is_open(pace, i, j, moves[d, 0], moves[d, 1], step):
                    best = beyond
            best += haste.step_s * pace[i, j]
            if rest[i, j] < haste.step_s * pace[i, j]:
                best = min(best, rest[i, j])
            now[i, j] = best


@njit(cache=True, nogil=True, inline='always')
def _is_open(pace: Array32, row: int, column: int, rows: float, columns: float, step: float) -> bool:
    """Whether no cell between the ends of a move is closed."""
    stops = math.ceil(1.5 * step)
    for k in range(1, stops):
        share = k / stops
        if not pace[round(row + share * rows), round(column + share * columns)] < np.inf:
            return False
    return True


@njit(cache=True, nogil=True, inline='always')
def sample(layer: Array32, row: float, column: float) -> float:
    """Bilinear look-up in [H, W] at fractional indices; NEVER_S in and beyond closed cells."""
    if not (0.0 <= row < layer.shape[0] - 1 and 0.0 <= column < layer.shape[1] - 1):
        return NEVER_S
    i, j = int(row), int(column)
    v, u = row - i, column - j
    if not layer[i + (v > 0.5), j + (u > 0.5)] < NEVER_S:
        return NEVER_S
    total, weight = 0.0, 0.0
    for di in range(2):
        for dj in range(2):
            value = layer[i + di, j + dj]
            if value < NEVER_S:
                share = (v if di else 1.0 - v) * (u if dj else 1.0 - u)
                total += share * value
                weight += share
    return total / weight
