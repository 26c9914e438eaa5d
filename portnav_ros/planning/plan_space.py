"""Where a plan may go: connected water that the hull clears, and how start and goal are tied to it."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label

from portnav_ros.harbour import ClearanceGrid, Harbour, clearance_at
from portnav_ros.planning.route import segment_clearance
from portnav_ros.types import IntArray

Point = tuple[float, float]


class PlanFailure(StrEnum):
    """Why there is no plan."""

    START_OCCUPIED = 'START_OCCUPIED'
    GOAL_OCCUPIED = 'GOAL_OCCUPIED'
    GOAL_OUTSIDE_MAP = 'GOAL_OUTSIDE_MAP'
    TIMEOUT = 'TIMEOUT'
    NO_VALID_PATH = 'NO_VALID_PATH'


class PlanError(ValueError):
    """There is no plan; ``reason`` tells programs why, ``detail`` tells people."""

    def __init__(self, reason: PlanFailure, detail: str) -> None:
        super().__init__(f'{reason}: {detail}')
        self.reason = reason
        self.detail = detail


class PlanSpace(NamedTuple):
    """What does not change between two plans on one chart.

    labels: [H, W], the number of the connected water that a cell belongs to, 0 where the clearance
    is below ``margin_m``.
    """

    harbour: Harbour
    grid: ClearanceGrid
    labels: IntArray
    margin_m: float


class Ends(NamedTuple):
    """Start and goal as given, and the nearest points that the hull clears, all x, y in m."""

    start: Point
    entry: Point
    leave: Point
    goal: Point


def prepare(harbour: Harbour, resolution_m: float, hull_clearance_m: float) -> PlanSpace:
    """Rasterise a chart once for many plans."""
    grid = harbour.clearance(resolution_m, 'charted')
    labels, _ = label(grid.distance >= max(hull_clearance_m, 1e-6))
    return PlanSpace(harbour, grid, labels, hull_clearance_m)


def find_ends(space: PlanSpace, start_xy: Point, goal_xy: Point, snap_m: float) -> Ends:
    """Snap start and goal to the nearest connected water that the hull clears.

    Raises:
        PlanError: an end is not finite or lies outside the chart, on land or in a buoy, or the two are not
            connected.
    """
    if not np.isfinite(start_xy).all():
        raise PlanError(PlanFailure.START_OCCUPIED, _nowhere('start', start_xy))
    if not np.isfinite(goal_xy).all():
        raise PlanError(PlanFailure.GOAL_OUTSIDE_MAP, _nowhere('goal', goal_xy))
    x_min, y_min, x_max, y_max = space.harbour.bounds
    if not (x_min <= goal_xy[0] <= x_max and y_min <= goal_xy[1] <= y_max):
        raise PlanError(PlanFailure.GOAL_OUTSIDE_MAP, f'the goal {_text(goal_xy)} is outside the chart')
    starts = _entries(space, start_xy, snap_m)
    if not starts:
        raise PlanError(PlanFailure.START_OCCUPIED, _occupied('start', start_xy, space.margin_m, snap_m))
    goals = _entries(space, goal_xy, snap_m)
    if not goals:
        raise PlanError(PlanFailure.GOAL_OCCUPIED, _occupied('goal', goal_xy, space.margin_m, snap_m))
    shared = starts.keys() & goals.keys()
    if not shared:
        raise PlanError(
            PlanFailure.NO_VALID_PATH,
            f'no water {space.margin_m} m clear of all joins {_text(start_xy)} and {_text(goal_xy)}',
        )
    best = min(shared, key=lambda number: (starts[number][0] + goals[number][0], number))
    return Ends(start_xy, starts[best][1], goals[best][1], goal_xy)


def _entries(space: PlanSpace, xy: Point, snap_m: float) -> dict[int, tuple[float, Point]]:
    """Nearest clear point of each connected water within reach: {label: (distance in m, x, y)}.

    Empty when the point lies on land or in a buoy.
    """
    grid, margin = space.grid, space.margin_m
    here = float(clearance_at(grid, *xy))
    row, column = _cell(grid, xy)
    if not space.harbour.contains(np.array([xy]))[0] or _in_buoy(space.harbour, xy):
        return {}
    if here >= margin and space.labels[row, column] > 0:
        return {int(space.labels[row, column]): (0.0, (float(xy[0]), float(xy[1])))}
    reach = int(np.ceil(snap_m / grid.resolution_m))
    first = max(row - reach, 0), max(column - reach, 0)
    window = space.labels[first[0] : row + reach + 1, first[1] : column + reach + 1]
    rows, columns = np.nonzero(window)
    x = grid.x0_m + (columns + first[1] + 0.5) * grid.resolution_m
    y = grid.y0_m + (rows + first[0] + 0.5) * grid.resolution_m
    distance = np.hypot(x - xy[0], y - xy[1])
    floor = min(here, margin) - 0.5 * grid.resolution_m
    found: dict[int, tuple[float, Point]] = {}
    for k in np.argsort(distance, kind='stable'):
        number = int(window[rows[k], columns[k]])
        if distance[k] > snap_m:
            break
        if number not in found and segment_clearance(grid, *xy, x[k], y[k]) >= floor:
            found[number] = (float(distance[k]), (float(x[k]), float(y[k])))
    return found


def _cell(grid: ClearanceGrid, xy: Point) -> tuple[int, int]:
    row = int(np.floor((xy[1] - grid.y0_m) / grid.resolution_m))
    return row, int(np.floor((xy[0] - grid.x0_m) / grid.resolution_m))


def _in_buoy(harbour: Harbour, xy: Point) -> bool:
    buoys = harbour.buoys[harbour.charted]
    return bool((np.hypot(buoys[:, 0] - xy[0], buoys[:, 1] - xy[1]) <= buoys[:, 2]).any())


def _occupied(which: str, xy: Point, margin_m: float, snap_m: float) -> str:
    return f'the {which} {_text(xy)} is on land or has no water {margin_m} m clear of all within {snap_m} m'


def _nowhere(which: str, xy: Point) -> str:
    return f'the {which} {_text(xy)} is no place; give finite x and y, in m of the map frame'


def _text(xy: Point) -> str:
    return f'({xy[0]:.1f}, {xy[1]:.1f})'
