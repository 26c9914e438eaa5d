"""Where the own ship sails: a harbour made ready for draws, and missions drawn between its berths."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from portnav_ros.geometry import polyline_lengths, resample_polyline
from portnav_ros.harbour import ClearanceGrid, Harbour
from portnav_ros.planning.clearance_route import RouteCost, clearance_field, descend, reachable, round_off
from portnav_ros.sim.difficulty import Difficulty
from portnav_ros.sim.ports import GRID_M, draw_berths
from portnav_ros.sim.scenario import PATH_SPACING_M, ScenarioError, Tracks, no_traffic
from portnav_ros.sim.tracks import build_tracks
from portnav_ros.types import Array

HEADING_REACH_M = 60.0  # the own ship starts towards the path point this far ahead
MAX_CELLS = 4_000_000  # of the grid on which a large chart is searched
MAX_WATER_CELLS = 250_000  # of them on water


class Mission(NamedTuple):
    """Start (x, y, yaw), goal (x, y) and path [W, 2] of the own ship."""

    start: tuple[float, float, float]
    goal: tuple[float, float]
    path: Array


class Site(NamedTuple):
    """A harbour made ready: the nodes of its traffic and missions, tracks, and grid of the own path."""

    harbour: Harbour
    nodes: Array
    tracks: Tracks
    grid: ClearanceGrid


def make_site(harbour: Harbour, difficulty: Difficulty, nodes: Array | None = None) -> Site:
    """Table the tracks between the nodes, by default the berths, and rasterise the charted water.

    Raises:
        ScenarioError: a node cannot be reached by the traffic.
    """
    nodes = harbour.berths if nodes is None else nodes
    resolution = grid_resolution(harbour)
    traffic = difficulty.traffic
    if traffic.vessels:
        tracks = build_tracks(harbour, nodes, traffic.beam_max_m, traffic.track, resolution)
    else:
        tracks = no_traffic().tracks
    return Site(harbour, nodes, tracks, harbour.clearance(resolution, buoys='charted'))


def grid_resolution(harbour: Harbour) -> float:
    """Cell in m of the grid on which routes are planned: GRID_M, coarser on a very large chart."""
    x_min, y_min, x_max, y_max = harbour.bounds
    box_m2 = (x_max - x_min) * (y_max - y_min)
    return max(GRID_M, math.sqrt(max(box_m2 / MAX_CELLS, harbour.water.area / MAX_WATER_CELLS)))


def coarseness(grid: ClearanceGrid) -> str:
    """What an error adds where a chart is too large for cells of GRID_M; nothing elsewhere."""
    if grid.resolution_m <= GRID_M:
        return ''
    return (
        f'; so large a chart has cells of {grid.resolution_m:.1f} m, not {GRID_M:.0f} m, in which narrow '
        'water is lost: cut it to the part to sail in'
    )


def draw_mission(
    site: Site, difficulty: Difficulty, rng: np.random.Generator, strict: bool = True
) -> Mission:
    """Draw a goal, then a start from which the route is as long as asked for.

    Raises:
        ScenarioError: no two nodes are connected or, if ``strict``, as far apart as asked for.
    """
    low, high = difficulty.path_length_m
    best: tuple[float, Mission] | None = None
    for goal in rng.permutation(len(site.nodes)):
        routes = _routes_to(site, int(goal), difficulty.path)
        for start in rng.permutation(len(routes)):
            length = polyline_lengths(routes[start])[-1]
            if low <= length <= high:
                return _mission(site.grid, routes[start], difficulty)
            excess = max(low - length, length - high)
            if best is None or excess < best[0]:
                best = excess, _mission(site.grid, routes[start], difficulty)
    if best is None:
        raise ScenarioError(
            f'no two berths are connected; lower path: least_m or add berths{coarseness(site.grid)}'
        )
    if strict:
        raise ScenarioError(
            f'no path between berths is {low:.0f} to {high:.0f} m long; widen path_length_m or the port'
        )
    return best[1]


def _routes_to(site: Site, goal: int, cost: RouteCost) -> list[Array]:
    goal_xy = (float(site.nodes[goal, 0]), float(site.nodes[goal, 1]))
    field = clearance_field(site.grid, goal_xy, cost)
    starts = [(float(x), float(y)) for k, (x, y) in enumerate(site.nodes[:, :2]) if k != goal]
    return [descend(site.grid, field, xy, goal_xy) for xy in starts if reachable(site.grid, field, xy)]


def _mission(grid: ClearanceGrid, route: Array, difficulty: Difficulty) -> Mission:
    path = resample_polyline(route, PATH_SPACING_M)
    path = round_off(grid, path, difficulty.rounding_m, difficulty.path.least_m)
    path = resample_polyline(path, PATH_SPACING_M)
    ahead = path[min(round(HEADING_REACH_M / PATH_SPACING_M), len(path) - 1)] - path[0]
    start = (float(path[0, 0]), float(path[0, 1]), math.atan2(ahead[1], ahead[0]))
    return Mission(start, (float(path[-1, 0]), float(path[-1, 1])), path)


def chart_nodes(harbour: Harbour, difficulty: Difficulty, rng: np.random.Generator) -> Array:
    """Places [D, 3] on a chart between which vessels can sail: its berths, else random ones.

    A berth alongside a quay is moved out to where a vessel can turn in.

    Raises:
        ScenarioError: there are no two such places.
    """
    traffic = difficulty.traffic
    least_m = max(0.5 * traffic.beam_max_m + traffic.track.clearance_m, difficulty.path.least_m)
    grid = harbour.clearance(grid_resolution(harbour), buoys='all')
    nodes = _off_quays(grid, harbour.berths, least_m + grid.resolution_m)
    if len(nodes) < 2:
        nodes = _random_nodes(harbour, grid, difficulty, least_m, rng)
    nodes = _connected(grid, nodes, least_m)
    if len(nodes) < 2:
        raise ScenarioError(
            f'{harbour.name}: no two places are connected by water {2.0 * least_m:.0f} m wide; '
            f'add berths, take a smaller vessel or lower path: least_m{coarseness(grid)}'
        )
    return nodes


def _random_nodes(
    harbour: Harbour, grid: ClearanceGrid, difficulty: Difficulty, least_m: float, rng: np.random.Generator
) -> Array:
    water = list(shapely.get_parts(harbour.water))
    port = difficulty.port
    for share in (1.0, 0.5, 0.25):
        clearance_m = max(share * port.berth_clearance_m, least_m + grid.resolution_m)
        try:
            spacing_m = share * port.berth_spacing_m
            return draw_berths(grid, [shapely.union_all(water)], port.berths, clearance_m, spacing_m, rng)
        except ScenarioError as error:
            reason = error
    raise ScenarioError(f'{harbour.name}: {reason}{coarseness(grid)}')


def _off_quays(grid: ClearanceGrid, berths: Array, clearance_m: float) -> Array:
    """Move each berth to the nearest cell with the clearance."""
    cells = np.argwhere(grid.distance >= clearance_m)
    places = (cells[:, ::-1] + 0.5) * grid.resolution_m + np.array([grid.x0_m, grid.y0_m])
    moved = berths.copy()
    for k, (x, y) in enumerate(berths[:, :2]):
        if len(places):
            moved[k, :2] = places[np.argmin(np.hypot(places[:, 0] - x, places[:, 1] - y))]
    return moved if len(places) else berths[:0]


def _connected(grid: ClearanceGrid, nodes: Array, least_m: float) -> Array:
    """The largest set of nodes that reach each other, and no two at the same place."""
    nodes = nodes[np.sort(np.unique(nodes[:, :2], axis=0, return_index=True)[1])]
    best = np.zeros(len(nodes), dtype=bool)
    for x, y in nodes[:, :2]:
        field = clearance_field(grid, (x, y), RouteCost(least_m, weight=0.0))
        members = np.array([reachable(grid, field, (a, b)) for a, b in nodes[:, :2]])
        if members.sum() > best.sum():
            best = members
    return nodes[best]
