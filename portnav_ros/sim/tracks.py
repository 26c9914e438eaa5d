"""What other vessels sail: a track for every ordered pair of berths.

A route of clearance cost is sailed as MOOS-IvP's waypoint behaviour steers: towards a point a fixed
lead ahead on the route, the yaw rate proportional to speed. The track is then a curve of bounded
curvature that does not depend on the speed, so it can be tabled once and sailed by any vessel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from portnav_ros.geometry import wrap_angle
from portnav_ros.harbour import ClearanceGrid, Harbour
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.planning.clearance_route import (
    RouteCost,
    clearance_field,
    descend_into,
    least_clearance,
    reachable,
)
from portnav_ros.sim.scenario import TRACK_SPACING_M, ScenarioError, Tracks
from portnav_ros.types import Array, Array32, IntArray

STEP_M = 2.0  # arc between two steps of a sailed track
TRIES = 3  # times the turning radius is halved until the track keeps clear


@dataclass(frozen=True)
class TrackParams:
    """How other vessels find and follow their routes."""

    clearance_m: float = 15.0  # a route stays half a beam plus this off quays and buoys
    comfort_m: float = 60.0
    weight: float = 1.0
    turn_radius_m: float = 150.0
    lead_m: float = 80.0  # look-ahead on the route
    slip_m: float = 15.0  # a berth counts as reached this far abeam
    ranges: ClassVar[Ranges] = {
        'clearance_m': (0.0, 500.0),
        'comfort_m': (0.1, 5000.0),
        'weight': (0.0, 1000.0),
        'turn_radius_m': (1.0, 5000.0),
        'lead_m': (5.0, 1000.0),
        'slip_m': (0.0, 200.0),
    }

    def __post_init__(self) -> None:
        """Refuse values that no vessel can sail."""
        check_ranges(self)


def build_tracks(
    harbour: Harbour, nodes: Array, beam_m: float, params: TrackParams, resolution_m: float
) -> Tracks:
    """Table the tracks between all ordered pairs of nodes.

    Args:
        harbour: its buoys, charted or not, are kept clear of.
        nodes: [D, >= 2] m, where tracks begin and end.
        beam_m: of the widest vessel; every track keeps half of it off quays and buoys.
        params: how routes are found and sailed.
        resolution_m: cell of the route planner's grid.

    Returns:
        D (D - 1) tracks, sorted by origin, then destination. They begin and end exactly at nodes.

    Raises:
        ScenarioError: a node cannot be reached with the clearance asked for.
    """
    grid = harbour.clearance(resolution_m, buoys='all')
    cost = RouteCost(0.5 * beam_m + params.clearance_m, params.comfort_m, params.weight)
    table: dict[tuple[int, int], Array32] = {}
    for goal in range(len(nodes)):
        field = _field_to(harbour, grid, nodes, goal, cost)
        for start in range(len(nodes)):
            if start != goal:
                table[start, goal] = _track(grid, field, nodes[start, :2], nodes[goal, :2], beam_m, params)
    pairs = sorted(table)
    tracks = [table[pair] for pair in pairs]
    return join_tracks(tracks, [pair[0] for pair in pairs], [pair[1] for pair in pairs])


def join_tracks(tracks: list[Array32], origin: list[int], destination: list[int]) -> Tracks:
    """Pack tracks [., 3] into one table."""
    offsets = np.concatenate(([0], np.cumsum([len(track) for track in tracks])))
    points = np.concatenate(tracks).astype(np.float32)
    return Tracks(points, offsets, np.array(origin, np.int64), np.array(destination, np.int64))


def _field_to(harbour: Harbour, grid: ClearanceGrid, nodes: Array, goal: int, cost: RouteCost) -> Array32:
    field = clearance_field(grid, (nodes[goal, 0], nodes[goal, 1]), cost)
    for start in range(len(nodes)):
        if not reachable(grid, field, (nodes[start, 0], nodes[start, 1])):
            raise ScenarioError(
                f'{harbour.name}: no route with {cost.least_m:.0f} m of clearance from berth {start} to '
                f'berth {goal}; move the berths off the quays or lower the traffic clearance_m'
            )
    return field


def _track(
    grid: ClearanceGrid, field: Array32, start: Array, goal: Array, beam_m: float, params: TrackParams
) -> Array32:
    row = int((start[1] - grid.y0_m) / grid.resolution_m)
    column = int((start[0] - grid.x0_m) / grid.resolution_m)
    capacity = int(1.5 * field[row, column] / STEP_M) + 256
    ends = (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1]))
    turn = params.turn_radius_m, params.lead_m, params.slip_m
    return _sail_clear(grid, field, *ends, capacity, 0.5 * beam_m, *turn)


def follow(waypoints: Array, params: TrackParams) -> Array32:
    """Sail a polyline [W, 2] as other vessels do.

    Returns:
        Track [., 3]: x, y in m, yaw in rad, TRACK_SPACING_M apart; both ends are exact.
    """
    route = _resample(waypoints, STEP_M)
    sailed = np.empty((2 * len(route) + 256, 3))
    count = _sail(route, params.turn_radius_m, params.lead_m, sailed)
    _meet_goal(sailed[:count], route[-1])
    return _space(sailed[:count])


@njit(cache=True)
def _sail_clear(
    grid: ClearanceGrid,
    field: Array32,
    start_xy: tuple[float, float],
    goal_xy: tuple[float, float],
    capacity: int,
    least_m: float,
    turn_radius_m: float,
    lead_m: float,
    slip_m: float,
) -> Array32:
    """Descend the field, then sail the route with the widest turns that keep clear."""
    vertices = np.empty((capacity, 2))
    count = descend_into(grid, field, start_xy, goal_xy, vertices)
    route = _resample(vertices[:count], STEP_M)
    sailed = np.empty((2 * capacity, 3))
    for attempt in range(TRIES):
        shrink = 0.5**attempt
        count = _sail(route, turn_radius_m * shrink, lead_m * shrink, sailed)
        miss = math.hypot(sailed[count - 1, 0] - goal_xy[0], sailed[count - 1, 1] - goal_xy[1])
        if miss <= slip_m:
            _meet_goal(sailed[:count], route[-1])
            track = _space(sailed[:count])
            if least_clearance(grid, track) >= least_m:
                return track
    count = _sail(route, STEP_M, 2.0 * STEP_M, sailed)
    _meet_goal(sailed[:count], route[-1])
    return _space(sailed[:count])


@njit(cache=True)
def _resample(points: Array, spacing_m: float) -> Array:
    """Vertices at a fixed arc spacing (shrunk so that both ends are kept), compiled."""
    lengths = np.zeros(len(points))
    for k in range(1, len(points)):
        step = math.hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1])
        lengths[k] = lengths[k - 1] + step
    count = max(math.ceil(lengths[-1] / spacing_m), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)
    out = np.empty((count + 1, points.shape[1]))
    for axis in range(points.shape[1]):
        out[:, axis] = np.interp(at, lengths, points[:, axis].copy())
    return out


@njit(cache=True)
def _sail(route: Array, turn_radius_m: float, lead_m: float, sailed: Array) -> int:
    """Steer along a route of vertices STEP_M apart; write x, y, yaw and return their number.

    The last tangent is prolonged beyond the goal, so that the vessel arrives along it.
    """
    last = len(route) - 1
    ahead = max(int(lead_m / STEP_M), 1)
    back = max(last - ahead, 0)
    run = max(last - back, 1)
    end_x, end_y = (route[last, 0] - route[back, 0]) / run, (route[last, 1] - route[back, 1]) / run
    x, y = route[0, 0], route[0, 1]
    first = min(ahead, last)
    yaw = math.atan2(route[first, 1] - y, route[first, 0] - x)
    near, count = 0, 0
    while count < len(sailed):
        sailed[count, 0], sailed[count, 1], sailed[count, 2] = x, y, yaw
        count += 1
        near = _nearest_ahead(route, near, x, y)
        over = near + ahead - last
        target_x, target_y = route[min(near + ahead, last), 0], route[min(near + ahead, last), 1]
        if over > 0:
            target_x, target_y = target_x + over * end_x, target_y + over * end_y
        if (x - route[last, 0]) * end_x + (y - route[last, 1]) * end_y >= 0.0 and near >= last - ahead:
            break
        error = wrap_angle(math.atan2(target_y - y, target_x - x) - yaw)
        turn = 2.0 * math.sin(error) / lead_m if abs(error) < 1.5 else math.copysign(1.0, error)
        most = 1.0 / turn_radius_m
        yaw += min(max(turn, -most), most) * STEP_M
        x += STEP_M * math.cos(yaw)
        y += STEP_M * math.sin(yaw)
    return count


@njit(cache=True, inline='always')
def _nearest_ahead(route: Array, near: int, x: float, y: float) -> int:
    """Index of the first local minimum of distance at or after ``near``."""
    gap = (route[near, 0] - x) ** 2 + (route[near, 1] - y) ** 2
    while near + 1 < len(route):
        next_gap = (route[near + 1, 0] - x) ** 2 + (route[near + 1, 1] - y) ** 2
        if next_gap > gap:
            break
        near, gap = near + 1, next_gap
    return near


@njit(cache=True)
def _meet_goal(sailed: Array, goal: Array) -> None:
    """Ease the last hundred metres onto the goal: the next track begins exactly there."""
    miss_x, miss_y = goal[0] - sailed[-1, 0], goal[1] - sailed[-1, 1]
    span = min(50, len(sailed) - 1)
    for k in range(span):
        share = 1.0 - k / span
        ease = share * share * (3.0 - 2.0 * share)
        sailed[-1 - k, 0] += ease * miss_x
        sailed[-1 - k, 1] += ease * miss_y


@njit(cache=True)
def _space(sailed: Array) -> Array32:
    """Thin a sailed curve to points TRACK_SPACING_M apart; lengths shrink so that both ends are kept."""
    length = (len(sailed) - 1) * STEP_M
    count = max(round(length / TRACK_SPACING_M), 1)
    at = np.linspace(0.0, len(sailed) - 1.0, count + 1)
    knots = np.arange(len(sailed)).astype(np.float64)
    track = np.empty((count + 1, 3), np.float32)
    for axis in range(3):
        track[:, axis] = np.interp(at, knots, sailed[:, axis].copy())
    return track


@njit(cache=True)
def pose_on_track(
    points: Array32, offsets: IntArray, track: int, progress_m: float
) -> tuple[float, float, float]:
    """x, y in m and yaw in rad at an arc length along a track; held at both ends."""
    first, last = offsets[track], offsets[track + 1] - 1
    at = min(max(progress_m / TRACK_SPACING_M, 0.0), float(last - first))
    i = first + min(int(at), last - first - 1)
    share = at - (i - first)
    a, b = points[i], points[i + 1]
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
