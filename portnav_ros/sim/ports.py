"""Random ports: dock sections along a backbone, or a canal with dock basins; berths and buoys.

The three uniform draws of layout ``sections`` are those of Herremans et al. (OMAE 2023); how the
docks connect is not told there, and is decided here (docs/world.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon, box

from portnav_ros.harbour import ClearanceGrid, Harbour
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.planning.clearance_route import (
    RouteCost,
    clearance_field,
    descend,
    least_clearance,
    reachable,
)
from portnav_ros.sim.scenario import ScenarioError
from portnav_ros.types import Array, Array32

Interval = tuple[float, float]
CHART_GRID_M = 0.01  # corners lie on it, as in a chart file: a port and its chart are equal
GRID_M = 10.0  # cell of the grid on which ports are checked and routes are planned
MAX_DRAWS = 400
CANAL_STATIONS = 13
BERTH_DEPTH_POWER = 4  # how strongly berths are drawn to the far end of a dock


@dataclass(frozen=True)
class PortParams:
    """What a random port is drawn from; an interval (low, high) is a uniform draw."""

    layout: Literal['sections', 'basins'] = 'basins'
    sections: int = 5
    section_length_m: Interval = (300.0, 900.0)
    centre_offset_m: Interval = (-600.0, 600.0)
    width_m: Interval = (300.0, 900.0)
    connector_m: float = 100.0
    canal_length_m: Interval = (3000.0, 3600.0)
    canal_width_m: Interval = (300.0, 400.0)
    canal_bend_rad: Interval = (-0.5, 0.5)
    basins: tuple[int, int] = (6, 8)
    basin_width_m: Interval = (260.0, 340.0)
    basin_depth_m: Interval = (550.0, 950.0)
    basin_skew_rad: Interval = (-0.2, 0.2)
    basin_flare_m: float = 120.0  # how much wider the mouth is on each side, cut at 45 degrees
    berths: int = 10
    berth_clearance_m: float = 80.0
    berth_mouth_m: float = 320.0  # berths of a basin lie this far from the canal
    berth_spacing_m: float = 220.0
    buoys: tuple[int, int] = (4, 10)
    buoy_radius_m: float = 2.0
    buoy_clearance_m: float = 30.0
    buoy_berth_gap_m: float = 120.0
    buoy_spacing_m: float = 80.0
    buoy_spread_m: float = 60.0  # standard deviation off a route between two berths
    passage_m: float = 25.0  # clearance with which every berth stays reachable between the buoys
    ranges: ClassVar[Ranges] = {
        'sections': (1, 50),
        'connector_m': (10.0, 2000.0),
        'basin_flare_m': (0.0, 1000.0),
        'berths': (2, 64),
        'berth_clearance_m': (1.0, 500.0),
        'berth_mouth_m': (0.0, 5000.0),
        'berth_spacing_m': (0.0, 5000.0),
        'buoy_radius_m': (0.1, 50.0),
        'buoy_clearance_m': (0.0, 1000.0),
        'buoy_berth_gap_m': (0.0, 1000.0),
        'buoy_spacing_m': (0.0, 1000.0),
        'buoy_spread_m': (0.0, 1000.0),
        'passage_m': (1.0, 500.0),
    }

    def __post_init__(self) -> None:
        """Refuse values from which no port can be drawn."""
        check_ranges(self)
        _check_intervals(self)


def _check_intervals(params: PortParams) -> None:
    positive = ('section_length_m', 'width_m', 'canal_length_m', 'canal_width_m', 'basin_width_m')
    either_sign = ('centre_offset_m', 'canal_bend_rad', 'basin_skew_rad')
    for name in (*positive, *either_sign, 'basin_depth_m', 'basins', 'buoys'):
        low, high = getattr(params, name)
        sound = math.isfinite(low) and math.isfinite(high) and low <= high
        if not sound or (name in positive and low <= 0.0) or (name in ('basins', 'buoys') and low < 0):
            raise ParamError(f'{name} = [{low}, {high}] is not an interval of allowed values')


def make_port(params: PortParams, rng: np.random.Generator) -> Harbour:
    """Draw a port: one connected water polygon, berths in its docks, uncharted buoys near the routes.

    The shape is drawn once, so its marginals are those of the parameters; berths and buoys are drawn
    by rejection.

    Raises:
        ScenarioError: berths or buoys find no room in the drawn water.
    """
    docks = section_docks(params, rng) if params.layout == 'sections' else basin_docks(params, rng)
    water = shapely.set_precision(shapely.union_all(docks), CHART_GRID_M)
    bare = Harbour(params.layout, water)
    grid = bare.clearance(GRID_M)
    if params.layout == 'basins':
        canal = docks[-1].buffer(params.berth_mouth_m)
        docks = [*(basin.difference(canal) for basin in docks[:-1]), docks[-1]]
    berths = draw_berths(grid, docks, params.berths, params.berth_clearance_m, params.berth_spacing_m, rng)
    buoys = _draw_buoys(params, bare, grid, berths, rng)
    return Harbour(params.layout, water, buoys, berths, np.zeros(len(buoys), dtype=np.bool_))


def section_docks(params: PortParams, rng: np.random.Generator) -> list[Polygon]:
    """Layout ``sections``: water [b - w/2, b + w/2] over each section, then the connectors.

    Returns:
        The N sections, then the N - 1 connectors across the hull of both intervals at each joint.
    """
    lengths = rng.uniform(*params.section_length_m, params.sections)
    centres = rng.uniform(*params.centre_offset_m, params.sections)
    widths = rng.uniform(*params.width_m, params.sections)
    joints = np.concatenate(([0.0], np.cumsum(lengths)))
    low, high = centres - 0.5 * widths, centres + 0.5 * widths
    docks = [box(joints[i], low[i], joints[i + 1], high[i]) for i in range(params.sections)]
    half = 0.5 * params.connector_m
    for i, joint in enumerate(joints[1:-1]):
        bottom, top = min(low[i], low[i + 1]), max(high[i], high[i + 1])
        docks.append(box(joint - half, bottom, joint + half, top))
    return docks


def basin_docks(params: PortParams, rng: np.random.Generator) -> list[Polygon]:
    """Layout ``basins``: dock basins on alternating sides of a bent canal, then the canal."""
    line = _canal_line(rng.uniform(*params.canal_length_m), rng.uniform(*params.canal_bend_rad))
    width = rng.uniform(*params.canal_width_m)
    canal = LineString(line).buffer(0.5 * width, cap_style='flat', join_style='mitre')
    count = int(rng.integers(params.basins[0], params.basins[1] + 1))
    first_side = 1.0 if rng.random() < 0.5 else -1.0
    docks = []
    for i in range(count):
        side = first_side if i % 2 == 0 else -first_side
        docks.append(_basin(params, line, width, (i + 0.5) / count, 1.0 / count, side, rng))
    return [*docks, canal]


def _canal_line(length_m: float, bend_rad: float) -> Array:
    """Centre line [S, 2] of the canal: an arc that turns by ``bend_rad`` in all, level in its middle."""
    share = np.linspace(0.0, 1.0, CANAL_STATIONS)
    middle = 0.5 * (share[1:] + share[:-1]) - 0.5
    steps = length_m * np.diff(share)
    yaw = bend_rad * middle
    line = np.column_stack([np.cumsum(steps * np.cos(yaw)), np.cumsum(steps * np.sin(yaw))])
    return np.vstack([[0.0, 0.0], line])


def _basin(
    params: PortParams,
    line: Array,
    canal_width_m: float,
    at: float,
    pitch: float,
    side: float,
    rng: np.random.Generator,
) -> Polygon:
    """Basin with a flared mouth, from the canal's centre line near the share ``at`` of its length."""
    width, depth = rng.uniform(*params.basin_width_m), rng.uniform(*params.basin_depth_m)
    length = float(np.hypot(*np.diff(line, axis=0).T).sum())
    margin = min((0.5 * width + params.basin_flare_m) / length + 0.02, 0.5)
    place = np.clip(at + rng.uniform(-0.3, 0.3) * pitch, margin, 1.0 - margin) * (CANAL_STATIONS - 1)
    k = min(int(place), CANAL_STATIONS - 2)
    foot = line[k] + (place - k) * (line[k + 1] - line[k])
    along = np.arctan2(*(line[k + 1] - line[k])[::-1])
    yaw = along + side * 0.5 * math.pi + rng.uniform(*params.basin_skew_rad)
    axis = np.array([math.cos(yaw), math.sin(yaw)])
    normal = np.array([-axis[1], axis[0]])
    half, flare, mouth = 0.5 * width, params.basin_flare_m, 0.5 * canal_width_m
    # along the axis, off it: one side of the basin from the canal to the head
    side_line = [(0.0, half + flare), (mouth, half + flare), (mouth + flare, half), (mouth + depth, half)]
    outline = [*side_line, *((along_m, -off_m) for along_m, off_m in reversed(side_line))]
    return Polygon([foot + along_m * axis + off_m * normal for along_m, off_m in outline])


def draw_berths(
    grid: ClearanceGrid,
    docks: Sequence[Polygon],
    count: int,
    clearance_m: float,
    spacing_m: float,
    rng: np.random.Generator,
) -> Array:
    """Draw berths [count, 3] at least ``spacing_m`` apart, one dock after the other.

    Within a dock a place is the likelier the farther it lies from the middle of the port by water.
    The yaw points the way a vessel leaves by. The last dock is used when all others are full.

    Raises:
        ScenarioError: there is no room for that many.
    """
    cells = np.argwhere(grid.distance >= clearance_m)
    places = (cells[:, ::-1] + 0.5) * grid.resolution_m + np.array([grid.x0_m, grid.y0_m])
    if len(places) == 0:
        raise ScenarioError(f'no water lies {clearance_m} m off the quays; lower berth_clearance_m')
    middle = places[np.argmin(np.hypot(*(places - places.mean(axis=0)).T))]
    field = clearance_field(grid, (middle[0], middle[1]), RouteCost(0.5 * clearance_m, weight=0.0))
    weight = field[cells[:, 0], cells[:, 1]].astype(float)
    weight[~np.isfinite(weight)] = 0.0
    member = [shapely.contains_xy(dock, places[:, 0], places[:, 1]) for dock in docks]
    turns = [*rng.permutation(len(docks) - 1), *rng.permutation(len(docks) - 1)]
    berths: list[Array] = []
    for dock in [*turns, *[len(docks) - 1] * count]:
        share = np.cumsum(np.where(member[dock], weight, 0.0) ** BERTH_DEPTH_POWER)
        if len(berths) == count or share[-1] <= 0.0:
            continue
        k = int(np.searchsorted(share, rng.random() * share[-1], side='right'))
        berths.append(places[min(k, len(places) - 1)])
        weight[np.hypot(*(places - berths[-1]).T) < spacing_m] = 0.0
    if len(berths) < count:
        raise ScenarioError(
            f'only {len(berths)} of {count} berths fit; lower berths, berth_spacing_m or berth_clearance_m'
        )
    yaws = [_leaving_yaw(grid, field, berth, middle) for berth in berths]
    return np.column_stack([np.array(berths), yaws])


def _leaving_yaw(grid: ClearanceGrid, field: Array32, berth: Array, middle: Array) -> float:
    route = descend(grid, field, (berth[0], berth[1]), (middle[0], middle[1]))
    ahead = route[min(10, len(route) - 1)] - route[0]
    return math.atan2(ahead[1], ahead[0])


def _draw_buoys(
    params: PortParams, bare: Harbour, grid: ClearanceGrid, berths: Array, rng: np.random.Generator
) -> Array:
    """Draw buoys [K, 3] beside routes between berths; every berth stays reachable past them."""
    count = int(rng.integers(params.buoys[0], params.buoys[1] + 1))
    for _ in range(10):
        buoys = _scatter_buoys(params, grid, berths, count, rng)
        marked = Harbour(bare.name, bare.water, buoys, charted=np.zeros(len(buoys), dtype=np.bool_))
        if len(buoys) == count and _all_reachable(marked, berths, params.passage_m):
            return buoys
    raise ScenarioError(
        f'{count} buoys find no room; lower buoys, buoy_spacing_m, buoy_clearance_m or passage_m'
    )


def _scatter_buoys(
    params: PortParams, grid: ClearanceGrid, berths: Array, count: int, rng: np.random.Generator
) -> Array:
    buoys = np.zeros((0, 3))
    routes = _sample_routes(grid, berths, params.passage_m, rng)
    for _ in range(MAX_DRAWS):
        if len(buoys) == count:
            break
        route = routes[int(rng.integers(len(routes)))]
        k = int(rng.integers(1, len(route)))
        tangent = route[k] - route[k - 1]
        normal = np.array([-tangent[1], tangent[0]]) / max(float(np.hypot(*tangent)), 1e-9)
        place = route[k] + rng.normal(0.0, params.buoy_spread_m) * normal
        room = least_clearance(grid, place[None, :]) - params.buoy_radius_m
        if room < params.buoy_clearance_m or _nearest(place, berths) < params.buoy_berth_gap_m:
            continue
        if _nearest(place, buoys) >= params.buoy_spacing_m:
            buoys = np.vstack([buoys, [*place, params.buoy_radius_m]])
    return buoys


def _sample_routes(
    grid: ClearanceGrid, berths: Array, least_m: float, rng: np.random.Generator
) -> list[Array]:
    """Routes from every berth to two of them."""
    routes = []
    for goal in rng.choice(len(berths), size=2, replace=False):
        goal_xy = (berths[goal, 0], berths[goal, 1])
        field = clearance_field(grid, goal_xy, RouteCost(least_m))
        others = (berth for i, berth in enumerate(berths) if i != goal)
        routes += [descend(grid, field, (berth[0], berth[1]), goal_xy) for berth in others]
    return routes


def _nearest(place: Array, others: Array) -> float:
    if len(others) == 0:
        return math.inf
    return float(np.hypot(others[:, 0] - place[0], others[:, 1] - place[1]).min())


def _all_reachable(harbour: Harbour, berths: Array, least_m: float) -> bool:
    grid = harbour.clearance(GRID_M, buoys='all')
    field = clearance_field(grid, (berths[0, 0], berths[0, 1]), RouteCost(least_m, weight=0.0))
    return all(reachable(grid, field, (x, y)) for x, y in berths[:, :2])
