"""Global plans: RRT* (Karaman and Frazzoli 2011, IJRR 30) of OMPL on a clearance grid.

The same chart, ends, parameters and seed give the same plan in every process: the search is bounded
by a count of iterations, and a clock only ends what has gone wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from ompl import base, geometric, util

from portnav_ros.harbour import ClearanceGrid, Harbour, clearance_at
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.planning.plan_space import Ends, PlanError, PlanFailure, PlanSpace, find_ends, prepare
from portnav_ros.planning.route import segment_clear, shortcut, smooth
from portnav_ros.types import Array

CHUNK = 500  # iterations between two looks at the clock and at the caller's wish to stop
SAME_PLACE_M = 0.01


class PlanCancelledError(Exception):
    """The caller wanted the search to stop."""


@dataclass(frozen=True)
class RrtStarParams:
    """How a route is searched.

    iterations: spent on every plan. iterations_max: spent at most until a first path is found.
    range_m: longest edge of the tree. goal_bias: share of the samples that are the goal itself.
    time_limit_s: after which a search has gone wrong and is ended. resolution_m: cell of the clearance
    grid. snap_m: how far start and goal may lie from water that the hull clears. turn_radius_m: what
    corners are widened to where there is room. comfort_m: clearance beyond the hull's that the smoothed
    path takes where it costs little.
    """

    iterations: int = 2000
    iterations_max: int = 200_000
    range_m: float = 400.0
    goal_bias: float = 0.05
    time_limit_s: float = 10.0
    resolution_m: float = 5.0
    snap_m: float = 100.0
    turn_radius_m: float = 150.0
    comfort_m: float = 60.0
    ranges: ClassVar[Ranges] = {
        'iterations': (1, 100_000_000),
        'iterations_max': (1, 100_000_000),
        'range_m': (1.0, 100_000.0),
        'goal_bias': (0.0, 0.9),
        'time_limit_s': (0.01, 3600.0),
        'resolution_m': (0.1, 100.0),
        'snap_m': (0.0, 1000.0),
        'turn_radius_m': (0.0, 5000.0),
        'comfort_m': (0.0, 5000.0),
    }

    def __post_init__(self) -> None:
        """Refuse values with which no search ends."""
        check_ranges(self)


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
