"""Global plans: RRT* (Karaman and Frazzoli 2011, IJRR 30) of OMPL on a clearance grid.

The same chart, ends, parameters and seed give the same plan in every process: the search is bounded
by a count of iterations, and a clock only ends what has gone wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from ompl import base, geometric, util
from scipy.ndimage import label

from portnav_ros.harbour import ClearanceGrid, Harbour, clearance_at
from portnav_ros.params import check_range
from portnav_ros.planning.route import segment_clear, segment_clearance, shortcut, smooth
from portnav_ros.types import Array, IntArray

CHUNK = 500  # iterations between two looks at the clock and at the caller's wish to stop
SAME_PLACE_M = 0.01


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


class PlanCancelledError(Exception):
    """The caller wanted the search to stop."""


@dataclass(frozen=True)
class RrtStarParams:
    """How a route is searched.

    iterations: spent on every plan. iterations_max: spent at most until a first path is found.
    range_m: longest edge of the tree. snap_m: how far start and goal may lie from water that the
    hull clears. turn_radius_m: what corners are widened to where there is room. comfort_m: clearance
    beyond the hull's that the smoothed path takes where it costs little.
    """

    iterations: int = 5000
    iterations_max: int = 200_000
    range_m: float = 400.0
    goal_bias: float = 0.05
    time_limit_s: float = 10.0
    resolution_m: float = 5.0
    snap_m: float = 100.0
    turn_radius_m: float = 150.0
    comfort_m: float = 60.0

    def __post_init__(self) -> None:
        """Refuse values with which no search ends."""
        check_range(
            self,
            iterations=(1, 100_000_000),
            iterations_max=(1, 100_000_000),
            range_m=(1.0, 100_000.0),
            goal_bias=(0.0, 0.9),
            time_limit_s=(0.01, 3600.0),
            resolution_m=(0.1, 100.0),
            snap_m=(0.0, 1000.0),
            turn_radius_m=(0.0, 5000.0),
            comfort_m=(0.0, 5000.0),
        )


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

    start: tuple[float, float]
    entry: tuple[float, float]
    leave: tuple[float, float]
    goal: tuple[float, float]


def plan_route(
    harbour: Harbour,
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    params: RrtStarParams,
    hull_clearance_m: float,
    seed: int,
) -> Array:
    """Plan a smooth path [W, 2] in m from start to goal, at most PATH_SPACING_M between points.

    Every point keeps ``hull_clearance_m`` off quays and charted buoys, but for the legs to a start or
    goal that lies closer (within ``params.snap_m`` of open water).

    Raises:
        PlanError: there is no such path.
    """
    return plan_in(prepare(harbour, params.resolution_m, hull_clearance_m), start_xy, goal_xy, params, seed)


def prepare(harbour: Harbour, resolution_m: float, hull_clearance_m: float) -> PlanSpace:
    """Rasterise a chart once for many plans."""
    grid = harbour.clearance(resolution_m, 'charted')
    labels, _ = label(grid.distance >= max(hull_clearance_m, 1e-6))
    return PlanSpace(harbour, grid, labels, hull_clearance_m)


def plan_in(
    space: PlanSpace,
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    params: RrtStarParams,
    seed: int,
    cancelled: Callable[[], bool] = lambda: False,
) -> Array:
    """As plan_route, on a prepared chart.

    Args:
        space: the chart.
        start_xy: x, y in m.
        goal_xy: x, y in m.
        params: how to search.
        seed: of the sampling.
        cancelled: asked every CHUNK iterations.

    Raises:
        PlanError: there is no such path.
        PlanCancelledError: ``cancelled`` said so.
    """
    ends = find_ends(space, start_xy, goal_xy, params.snap_m)
    search = RouteSearch(space, ends, params, seed)
    limit = base.timedPlannerTerminationCondition(params.time_limit_s)
    while search.iterations < (params.iterations if search.solved else params.iterations_max):
        if cancelled():
            raise PlanCancelledError
        if limit.eval():
            break
        search.grow(CHUNK)
    if not search.solved:
        raise PlanError(
            PlanFailure.TIMEOUT, f'no path within {search.iterations} iterations or {params.time_limit_s} s'
        )
    return refine(space, ends, search.path(), params)


def refine(space: PlanSpace, ends: Ends, path: Array, params: RrtStarParams) -> Array:
    """Shorten and smooth what the search found, and join it to start and goal."""
    short = shortcut(space.grid, path, space.margin_m)
    points = np.vstack([ends.start, short, ends.goal])
    steps = np.hypot(*np.diff(points, axis=0).T)
    points = points[np.concatenate(([True], steps > SAME_PLACE_M))]
    points = np.vstack([points, ends.goal]) if len(points) == 1 else points
    points[-1] = ends.goal
    return smooth(space.grid, points, space.margin_m, params.turn_radius_m, params.comfort_m)


def find_ends(
    space: PlanSpace, start_xy: tuple[float, float], goal_xy: tuple[float, float], snap_m: float
) -> Ends:
    """Snap start and goal to the nearest connected water that the hull clears.

    Raises:
        PlanError: an end lies outside the chart, on land or in a buoy, or the two are not connected.
    """
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


class RouteSearch:
    """A growing RRT* tree between two ends that the hull clears."""

    def __init__(self, space: PlanSpace, ends: Ends, params: RrtStarParams, seed: int) -> None:
        util.noOutputHandler()
        util.RNG.setSeed(seed % (2**32 - 1) + 1)
        information = _space_information(space)
        self._problem = base.ProblemDefinition(information)
        start, goal = information.allocState(), information.allocState()
        start[0], start[1] = ends.entry
        goal[0], goal[1] = ends.leave
        self._problem.setStartAndGoalStates(start, goal, SAME_PLACE_M)
        self._problem.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
        self._tree = geometric.RRTstar(information)
        self._tree.setRange(params.range_m)
        self._tree.setGoalBias(params.goal_bias)
        self._tree.setProblemDefinition(self._problem)
        self._tree.setup()
        self.iterations = 0

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return bool(self._problem.hasExactSolution())

    def grow(self, iterations: int) -> None:
        """Draw so many samples more."""
        count = itertools.count()
        self._tree.solve(base.PlannerTerminationCondition(lambda: next(count) >= iterations))
        self.iterations += iterations

    def path(self) -> Array:
        """Vertices [W, 2] in m of the best path so far."""
        return np.array([[state[0], state[1]] for state in self._problem.getSolutionPath().getStates()])


def _space_information(space: PlanSpace) -> Any:
    plane = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(zip(space.harbour.bounds[:2], space.harbour.bounds[2:], strict=True)):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    plane.setBounds(bounds)
    information = base.SpaceInformation(plane)
    information.setStateValidityChecker(_ClearPoint(information, space.grid, space.margin_m))
    information.setMotionValidator(_ClearSegment(information, space.grid, space.margin_m))
    information.setup()
    return information


class _ClearPoint(base.StateValidityChecker):  # type: ignore[misc]
    """A point is valid where the hull clears it; a closure in its place would leak the whole problem."""

    def __init__(self, information: Any, grid: ClearanceGrid, margin_m: float) -> None:
        super().__init__(information)
        self._grid = grid
        self._margin_m = margin_m

    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        return bool(clearance_at(self._grid, state[0], state[1]) >= self._margin_m)


class _ClearSegment(base.MotionValidator):  # type: ignore[misc]
    """A leg is checked along its whole length; OMPL's own validator strides by 1 % of the chart."""

    def __init__(self, information: Any, grid: ClearanceGrid, margin_m: float) -> None:
        super().__init__(information)
        self._grid = grid
        self._margin_m = margin_m

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 - OMPL's name
        return bool(segment_clear(self._grid, a[0], a[1], b[0], b[1], self._margin_m))


def _entries(
    space: PlanSpace, xy: tuple[float, float], snap_m: float
) -> dict[int, tuple[float, tuple[float, float]]]:
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
    found: dict[int, tuple[float, tuple[float, float]]] = {}
    for k in np.argsort(distance, kind='stable'):
        number = int(window[rows[k], columns[k]])
        if distance[k] > snap_m:
            break
        if number not in found and segment_clearance(grid, *xy, x[k], y[k]) >= floor:
            found[number] = (float(distance[k]), (float(x[k]), float(y[k])))
    return found


def _cell(grid: ClearanceGrid, xy: tuple[float, float]) -> tuple[int, int]:
    row = int(np.floor((xy[1] - grid.y0_m) / grid.resolution_m))
    return row, int(np.floor((xy[0] - grid.x0_m) / grid.resolution_m))


def _in_buoy(harbour: Harbour, xy: tuple[float, float]) -> bool:
    buoys = harbour.buoys[harbour.charted]
    return bool((np.hypot(buoys[:, 0] - xy[0], buoys[:, 1] - xy[1]) <= buoys[:, 2]).any())


def _occupied(which: str, xy: tuple[float, float], margin_m: float, snap_m: float) -> str:
    return f'the {which} {_text(xy)} is on land or has no water {margin_m} m clear of all within {snap_m} m'


def _text(xy: tuple[float, float]) -> str:
    return f'({xy[0]:.1f}, {xy[1]:.1f})'
