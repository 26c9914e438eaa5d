"""Routes that prefer open water: an Eikonal cost-to-go on a clearance grid, and descent along it.

The cost-to-go T solves ``|grad T| = 1 + weight * closeness^2`` by fast sweeping (Zhao 2005,
Mathematics of Computation 74) with the locking of Bak, McLaughlin and Renzi (2010), so that a route
is not bound to the directions of the grid. One field per destination serves every origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from portnav_ros.geometry import resample_polyline
from portnav_ros.harbour import ClearanceGrid, clearance_at
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import Array, Array32

MAX_ROUNDS = 64
STEP_CELLS = 0.5


@dataclass(frozen=True)
class RouteCost:
    """What a route pays: its length, dearer near obstacles, and never closer than ``least_m``.

    closeness is 1 at ``least_m`` from an obstacle and falls linearly to 0 at ``least_m + comfort_m``.
    """

    least_m: float = 25.0
    comfort_m: float = 60.0
    weight: float = 1.0
    ranges: ClassVar[Ranges] = {'least_m': (0.0, 1000.0), 'comfort_m': (0.1, 5000.0), 'weight': (0.0, 1000.0)}

    def __post_init__(self) -> None:
        """Refuse negative distances."""
        check_ranges(self)


def clearance_field(grid: ClearanceGrid, goal_xy: tuple[float, float], cost: RouteCost) -> Array32:
    """Cost-to-go [H, W] in m (dearer metres count more) to a goal; +inf where no route leads.

    The goal itself may lie closer to an obstacle than ``cost.least_m`` only by one cell.
    """
    slowness = _slowness(grid.distance, cost.least_m, cost.comfort_m, cost.weight)
    field: Array32 = np.full(grid.distance.shape, np.inf, np.float32)
    row, column = _cell(grid, goal_xy[0], goal_xy[1])
    if 0 < row < field.shape[0] - 1 and 0 < column < field.shape[1] - 1:
        _seed(field, slowness, grid, goal_xy[0], goal_xy[1], row, column)
        _sweep(field, slowness, grid.resolution_m)
    return field


def reachable(grid: ClearanceGrid, field: Array32, start_xy: tuple[float, float]) -> bool:
    """Whether the field leads from a start to its goal."""
    row, column = _cell(grid, start_xy[0], start_xy[1])
    inside = 0 <= row < field.shape[0] and 0 <= column < field.shape[1]
    return inside and bool(np.isfinite(field[row, column]))


def descend(
    grid: ClearanceGrid, field: Array32, start_xy: tuple[float, float], goal_xy: tuple[float, float]
) -> Array:
    """Follow the cost-to-go from a start to its goal.

    Returns:
        Polyline [W, 2] in m with vertices half a cell apart; both ends are exact.

    Raises:
        ValueError: the start is not ``reachable``.
    """
    if not reachable(grid, field, start_xy):
        raise ValueError(f'no route leads from {start_xy} to {goal_xy}')
    points = np.empty((4 * sum(field.shape) * 8, 2))
    count = descend_into(grid, field, start_xy, goal_xy, points)
    return points[:count].copy()


def clearance_route(
    grid: ClearanceGrid,
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    cost: RouteCost,
    spacing_m: float,
) -> Array:
    """Route [W, 2] from start to goal at a fixed arc spacing.

    Raises:
        ValueError: no route keeps ``cost.least_m`` of clearance.
    """
    field = clearance_field(grid, goal_xy, cost)
    return resample_polyline(descend(grid, field, start_xy, goal_xy), spacing_m)


@njit(cache=True, inline='always')
def _cell(grid: ClearanceGrid, x_m: float, y_m: float) -> tuple[int, int]:
    row = math.floor((y_m - grid.y0_m) / grid.resolution_m)
    return row, math.floor((x_m - grid.x0_m) / grid.resolution_m)


@njit(cache=True)
def _slowness(distance: Array32, least: float, comfort: float, weight: float) -> Array32:
    """Cost per metre in each cell; 0 marks a cell that must not be entered."""
    rows, columns = distance.shape
    slowness = np.zeros(distance.shape, np.float32)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            spare = distance[row, column] - least
            if spare >= 0.0 and distance[row, column] > 0.0:
                closeness = max(1.0 - spare / comfort, 0.0)
                slowness[row, column] = 1.0 + weight * closeness * closeness
    return slowness


@njit(cache=True)
def _seed(
    field: Array32, slowness: Array32, grid: ClearanceGrid, x: float, y: float, row: int, column: int
) -> None:
    """Exact distances in the cells about the goal."""
    for i in range(row - 1, row + 2):
        for j in range(column - 1, column + 2):
            if slowness[i, j] > 0.0:
                dx = grid.x0_m + (j + 0.5) * grid.resolution_m - x
                dy = grid.y0_m + (i + 0.5) * grid.resolution_m - y
                field[i, j] = math.hypot(dx, dy) * slowness[i, j]


@njit(cache=True)
def _sweep(field: Array32, slowness: Array32, spacing: float) -> None:
    """Gauss-Seidel sweeps in four directions until no cell changes."""
    rows, columns = field.shape
    awake = np.zeros(field.shape, np.bool_)
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            if np.isfinite(field[i, j]):
                _wake(awake, field, i, j)
    for sweep in range(4 * MAX_ROUNDS):
        changed = False
        for a in range(1, rows - 1):
            i = a if sweep % 4 < 2 else rows - 1 - a
            for b in range(1, columns - 1):
                j = b if sweep % 2 == 0 else columns - 1 - b
                if not awake[i, j]:
                    continue
                awake[i, j] = False
                if slowness[i, j] > 0.0 and _relax(field, i, j, slowness[i, j] * spacing):
                    _wake(awake, field, i, j)
                    changed = True
        if not changed:
            break


@njit(cache=True, inline='always')
def _wake(awake: Array, field: Array32, i: int, j: int) -> None:
    value = field[i, j]
    awake[i - 1, j] |= field[i - 1, j] > value
    awake[i + 1, j] |= field[i + 1, j] > value
    awake[i, j - 1] |= field[i, j - 1] > value
    awake[i, j + 1] |= field[i, j + 1] > value


@njit(cache=True, inline='always')
def _relax(field: Array32, i: int, j: int, step: float) -> bool:
    """Godunov upwind solution of the Eikonal equation in one cell; whether it got smaller."""
    a = min(field[i - 1, j], field[i + 1, j])
    b = min(field[i, j - 1], field[i, j + 1])
    low, high = min(a, b), max(a, b)
    if high - low >= step:
        value = low + step
    else:
        value = 0.5 * (low + high + math.sqrt(2.0 * step * step - (high - low) ** 2))
    if value < field[i, j] - 1e-3:
        field[i, j] = value
        return True
    return False


@njit(cache=True)
def _slope(field: Array32, i: int, j: int) -> tuple[float, float]:
    """Upwind gradient (x, y) of the field in a cell, per cell."""
    here = field[i, j]
    west, east, south, north = field[i, j - 1], field[i, j + 1], field[i - 1, j], field[i + 1, j]
    gx, gy = 0.0, 0.0
    if min(west, east) < here:
        gx = here - west if west < east else east - here
    if min(south, north) < here:
        gy = here - south if south < north else north - here
    return gx, gy


@njit(cache=True)
def _direction(field: Array32, u: float, v: float) -> tuple[float, float]:
    """Unit vector down the field at column u, row v (cell centres are integers); 0, 0 if flat."""
    j, i = math.floor(u), math.floor(v)
    gx, gy = 0.0, 0.0
    for di in range(2):
        for dj in range(2):
            if np.isfinite(field[i + di, j + dj]):
                share = abs(1.0 - dj - (u - j)) * abs(1.0 - di - (v - i))
                sx, sy = _slope(field, i + di, j + dj)
                gx += share * sx
                gy += share * sy
    size = math.hypot(gx, gy)
    if size < 1e-9:
        return 0.0, 0.0
    return -gx / size, -gy / size


@njit(cache=True)
def descend_into(
    grid: ClearanceGrid,
    field: Array32,
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    points: Array,
) -> int:
    """Write the route into points [W, 2] and return its length; the compiled part of ``descend``."""
    resolution = grid.resolution_m
    x, y = start_xy
    points[0, 0], points[0, 1] = x, y
    count = 1
    while count < len(points) - 1 and math.hypot(x - goal_xy[0], y - goal_xy[1]) > 1.5 * resolution:
        u, v = (x - grid.x0_m) / resolution - 0.5, (y - grid.y0_m) / resolution - 0.5
        dx, dy = _direction(field, u, v)
        row, column = _cell(grid, x, y)
        ahead = _cell(grid, x + dx * STEP_CELLS * resolution, y + dy * STEP_CELLS * resolution)
        if (dx == 0.0 and dy == 0.0) or field[ahead] > field[row, column]:
            row, column = _lowest_neighbour(field, row, column)
            x = grid.x0_m + (column + 0.5) * resolution
            y = grid.y0_m + (row + 0.5) * resolution
        else:
            x += dx * STEP_CELLS * resolution
            y += dy * STEP_CELLS * resolution
        points[count, 0], points[count, 1] = x, y
        count += 1
    points[count, 0], points[count, 1] = goal_xy
    return count + 1


@njit(cache=True)
def _lowest_neighbour(field: Array32, row: int, column: int) -> tuple[int, int]:
    best_row, best_column = row, column
    for i in range(row - 1, row + 2):
        for j in range(column - 1, column + 2):
            if field[i, j] < field[best_row, best_column]:
                best_row, best_column = i, j
    return best_row, best_column


def round_off(grid: ClearanceGrid, points: Array, reach_m: float, least_m: float) -> Array:
    """Round the corners of a route so that a vessel can follow it.

    Each point becomes the mean of the route over ``reach_m`` to either side, less towards the ends,
    so that a right angle turns into a parabola of radius 0.7 reach_m at its tightest. The reach is
    shortened until the route keeps ``least_m`` of clearance, or all that it had.

    Args:
        grid: where the water is.
        points: [W, 2] m, evenly spaced.
        reach_m: half the length of the mean.
        least_m: clearance to keep.
    """
    spacing_m = float(np.hypot(*(points[1] - points[0])))
    allowed_m = min(least_m, least_clearance(grid, points))
    reach = min(int(reach_m / max(spacing_m, 1e-6)), len(points))
    while reach > 0:
        rounded = _running_mean(points, reach)
        if least_clearance(grid, rounded) >= allowed_m:
            return rounded
        reach = reach * 3 // 4
    return points


def _running_mean(points: Array, reach: int) -> Array:
    """Mean of [W, 2] over at most ``reach`` points to either side, as many on both; ends are kept."""
    index = np.arange(len(points))
    half = np.minimum(reach, np.minimum(index, index[::-1]))
    sums = np.vstack([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    mean: Array = (sums[index + half + 1] - sums[index - half]) / (2 * half + 1)[:, None]
    return mean


@njit(cache=True)
def least_clearance(grid: ClearanceGrid, points: Array) -> float:
    """Least clearance in m over the points [W, >= 2] of a route."""
    least = np.inf
    for k in range(len(points)):
        least = min(least, clearance_at(grid, points[k, 0], points[k, 1]))
    return least
