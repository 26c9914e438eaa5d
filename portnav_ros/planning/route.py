"""Routes after the search: visibility on a clearance grid, shortcuts, smoothing, even spacing."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numba import njit

from portnav_ros.geometry import polyline_lengths, resample_polyline
from portnav_ros.harbour import ClearanceGrid, clearance_at
from portnav_ros.types import Array

PATH_SPACING_M = 10.0
SHORTCUT_SPACING_M = 20.0
ROUNDS = (4.0, 2.0, 1.0)  # spacing of the smoothed points in units of PATH_SPACING_M, coarse to fine
SWEEPS = 150
OVER_RELAXATION = 1.6


def route_length(points: Array) -> float:
    """Length in m of a polyline [W, 2]."""
    return float(polyline_lengths(points)[-1])


@njit(cache=True)
def segment_clear(grid: ClearanceGrid, ax: float, ay: float, bx: float, by: float, margin_m: float) -> bool:
    """Whether a segment keeps ``margin_m`` of clearance; strides as far as the clearance allows."""
    length = math.hypot(bx - ax, by - ay)
    least_step = 0.5 * grid.resolution_m
    along = 0.0
    while True:
        share = along / length if length > 0.0 else 0.0
        clearance = clearance_at(grid, ax + share * (bx - ax), ay + share * (by - ay))
        if clearance < margin_m:
            return False
        if along >= length:
            return True
        along = min(along + max(clearance - margin_m, least_step), length)


@njit(cache=True)
def segment_clearance(grid: ClearanceGrid, ax: float, ay: float, bx: float, by: float) -> float:
    """Least clearance in m along a segment, sampled at half the grid's resolution."""
    steps = max(math.ceil(math.hypot(bx - ax, by - ay) / (0.5 * grid.resolution_m)), 1)
    least = np.inf
    for k in range(steps + 1):
        share = k / steps
        least = min(least, clearance_at(grid, ax + share * (bx - ax), ay + share * (by - ay)))
    return least


def route_clearance(grid: ClearanceGrid, points: Array) -> float:
    """Least clearance in m along a polyline [W, 2], its segments included."""
    ends = np.hstack([points[:-1], points[1:]])
    return min(segment_clearance(grid, *map(float, row)) for row in ends)


def shortcut(grid: ClearanceGrid, points: Array, margin_m: float) -> Array:
    """Shortest polyline [V, 2] through points of a route [W, 2] whose new legs keep ``margin_m``.

    Legs between neighbours are taken as they are, so a route that comes closer stays a route.
    """
    dense = _densify(points, SHORTCUT_SPACING_M)
    return dense[_visible_chain(grid, dense, margin_m)]


def smooth(
    grid: ClearanceGrid, points: Array, margin_m: float, turn_radius_m: float, comfort_m: float = 0.0
) -> Array:
    """Bend a route [W, 2] into a curve of about the given radius, where there is room.

    The curve is a beam under tension (length scale ``turn_radius_m``) between fixed ends, pushed off
    obstacles nearer than ``margin_m + comfort_m`` (an elastic band: Quinlan and Khatib 1993, ICRA; a
    metre costs 1 + q^2, where q falls from 1 at the margin to 0 at the edge of comfort). It relaxes by
    over-relaxed Gauss-Seidel sweeps, coarse to fine. A point moves only if the legs at it keep
    ``margin_m``, or at least what they kept before.

    Returns:
        Polyline [V, 2] at a fixed spacing of PATH_SPACING_M or less, both ends kept.
    """
    curve = points
    for scale in ROUNDS:
        spacing_m = scale * PATH_SPACING_M
        curve = _densify(curve, spacing_m)
        if len(curve) > 2:
            _relax(grid, curve, margin_m, (turn_radius_m / spacing_m) ** 2, comfort_m, spacing_m)
    return resample_polyline(curve, PATH_SPACING_M)


def _densify(points: Array, spacing_m: float) -> Array:
    """Add vertices so that no leg exceeds the spacing; the old vertices stay."""
    pieces = [points[:1]]
    for a, b in itertools.pairwise(points):
        count = max(math.ceil(math.hypot(*(b - a)) / spacing_m), 1)
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.vstack(pieces)


@njit(cache=True)
def _visible_chain(grid: ClearanceGrid, points: Array, margin: float) -> Array:
    """Indices of the shortest chain from the first to the last point over clear legs."""
    count = len(points)
    cost = np.full(count, np.inf)
    before = np.zeros(count, np.int64)
    cost[0] = 0.0
    for i in range(count - 1):
        for j in range(i + 1, count):
            ax, ay, bx, by = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
            through = cost[i] + math.hypot(bx - ax, by - ay)
            if through < cost[j] and (j == i + 1 or segment_clear(grid, ax, ay, bx, by, margin)):
                cost[j] = through
                before[j] = i
    chain = [count - 1]
    while chain[-1] > 0:
        chain.append(before[chain[-1]])
    return np.array(chain[::-1])


@njit(cache=True)
def _relax(
    grid: ClearanceGrid, curve: Array, margin: float, stiffness: float, comfort: float, spacing: float
) -> None:
    """Minimise sum |dp|^2 + stiffness |d2p|^2 + 2 (spacing q)^2 over the inner points of a curve, in place.

    The legs' clearances are kept in ``kept`` so that each is looked up once.
    """
    count = len(curve)
    kept = np.empty(count - 1)
    for i in range(count - 1):
        kept[i] = segment_clearance(grid, curve[i, 0], curve[i, 1], curve[i + 1, 0], curve[i + 1, 1])
    for sweep in range(SWEEPS):
        for k in range(1, count - 1):
            i = k if sweep % 2 == 0 else count - 1 - k
            push_x, push_y = _push(grid, curve[i, 0], curve[i, 1], margin, comfort, spacing)
            x, y = _rest(curve, i, stiffness, push_x, push_y)
            for share in (OVER_RELAXATION, 0.5, 0.1):
                if _move(grid, curve, kept, margin, i, share * (x - curve[i, 0]), share * (y - curve[i, 1])):
                    break


@njit(cache=True, inline='always')
def _push(
    grid: ClearanceGrid, x: float, y: float, margin: float, comfort: float, spacing: float
) -> tuple[float, float]:
    """Force that drives a point to where it has ``margin + comfort`` of clearance."""
    closeness = min((margin + comfort - clearance_at(grid, x, y)) / comfort, 1.0) if comfort > 0.0 else 0.0
    if closeness <= 0.0:
        return 0.0, 0.0
    step = grid.resolution_m
    slope_x = (clearance_at(grid, x + step, y) - clearance_at(grid, x - step, y)) / (2.0 * step)
    slope_y = (clearance_at(grid, x, y + step) - clearance_at(grid, x, y - step)) / (2.0 * step)
    force = 2.0 * spacing * spacing * closeness / comfort
    return force * slope_x, force * slope_y


@njit(cache=True, inline='always')
def _rest(curve: Array, i: int, stiffness: float, push_x: float, push_y: float) -> tuple[float, float]:
    """Where inner point i would lie at rest, its neighbours and the push held."""
    count = len(curve)
    # d2p at i is in the energy always; d2p at a neighbour only where that is an inner point.
    share = 1.0 + 2.0 * stiffness
    x = share * (curve[i - 1, 0] + curve[i + 1, 0]) + push_x
    y = share * (curve[i - 1, 1] + curve[i + 1, 1]) + push_y
    weight = 2.0 * share
    if i >= 2:
        x += stiffness * (2.0 * curve[i - 1, 0] - curve[i - 2, 0])
        y += stiffness * (2.0 * curve[i - 1, 1] - curve[i - 2, 1])
        weight += stiffness
    if i + 2 < count:
        x += stiffness * (2.0 * curve[i + 1, 0] - curve[i + 2, 0])
        y += stiffness * (2.0 * curve[i + 1, 1] - curve[i + 2, 1])
        weight += stiffness
    return x / weight, y / weight


@njit(cache=True, inline='always')
def _move(
    grid: ClearanceGrid, curve: Array, kept: Array, margin: float, i: int, dx: float, dy: float
) -> bool:
    """Shift point i if both legs at it keep the margin or what they kept before; whether it moved."""
    x, y = curve[i, 0] + dx, curve[i, 1] + dy
    left = segment_clearance(grid, curve[i - 1, 0], curve[i - 1, 1], x, y)
    if left < min(margin, kept[i - 1]):
        return False
    right = segment_clearance(grid, x, y, curve[i + 1, 0], curve[i + 1, 1])
    if right < min(margin, kept[i]):
        return False
    curve[i, 0], curve[i, 1] = x, y
    kept[i - 1], kept[i] = left, right
    return True
