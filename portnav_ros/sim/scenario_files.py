"""Named scenarios: water, own ship and other vessels written out in YAML, varied a little by seed."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import shapely
from shapely.geometry import LineString, MultiPoint, Polygon
from shapely.geometry.base import BaseGeometry

from portnav_ros.charts import read_chart
from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.geometry import resample_polyline
from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError, Ranges, check_ranges, override, read_yaml
from portnav_ros.planning.clearance_route import RouteCost, clearance_route, round_off
from portnav_ros.sim.difficulty import load_vessel, preset_path
from portnav_ros.sim.mission import coarseness, grid_resolution
from portnav_ros.sim.scenario import (
    PATH_SPACING_M,
    TRACK_SPACING_M,
    Arrival,
    LidarParams,
    Scenario,
    ScenarioError,
    Traffic,
    no_traffic,
)
from portnav_ros.sim.tracks import TrackParams, follow, join_tracks
from portnav_ros.types import Array

Point = tuple[float, float]
SHORE_M = 0.01  # a line this far ashore still lies on the water
BUOY_RADIUS_MAX_M = 100.0  # as in a chart


@dataclass(frozen=True)
class VesselPlan:
    """Another vessel of a named scenario."""

    waypoints: tuple[Point, ...] = ()
    speed_mps: float = 4.0
    length_m: float = 110.0
    beam_m: float = 11.4
    ranges: ClassVar[Ranges] = {'speed_mps': (0.0, 50.0), 'length_m': (1.0, 500.0), 'beam_m': (0.3, 80.0)}

    def __post_init__(self) -> None:
        """Refuse a vessel that cannot sail."""
        check_ranges(self)


@dataclass(frozen=True)
class Jitter:
    """How a seed varies the other vessels and the buoys of a named scenario; every draw is uniform."""

    along_m: float = 0.0  # vessels begin up to this far along their tracks
    across_m: float = 0.0  # their waypoints move up to this far to either side
    speed: float = 0.0  # their speeds change by up to this share
    buoys_m: Point = (0.0, 0.0)  # buoys move up to this far along x and y, each way
    ranges: ClassVar[Ranges] = {'along_m': (0.0, 5000.0), 'across_m': (0.0, 1000.0), 'speed': (0.0, 0.9)}

    def __post_init__(self) -> None:
        """Refuse negative spreads."""
        check_ranges(self)
        if min(self.buoys_m) < 0.0:
            raise ParamError(f'buoys_m = {self.buoys_m} must not be negative')


@dataclass(frozen=True)
class ScenarioFile:
    """The keys of config/scenarios/*.yaml.

    Either ``water``, the corners of one polygon, or ``chart``, a file (relative to the scenario's).
    ``buoys`` are not on the planner's chart. Without ``path`` a clearance route is laid.
    """

    name: str = ''
    vessel: str = 'cemt_iv'
    water: tuple[Point, ...] = ()
    chart: str = ''
    buoys: tuple[tuple[float, float, float], ...] = ()
    start: tuple[float, float, float] | None = None
    goal: Point | None = None
    path: tuple[Point, ...] = ()
    start_speed_mps: float = 3.0
    goal_radius_m: float = 50.0
    time_limit_s: float = 900.0
    arrival: Literal['stop', 'vanish'] = 'stop'
    jitter: Jitter = field(default_factory=Jitter)
    route: RouteCost = field(default_factory=RouteCost)
    rounding_m: float = 100.0
    lidar: LidarParams = field(default_factory=LidarParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    ranges: ClassVar[Ranges] = {
        'start_speed_mps': (0.0, 50.0),
        'goal_radius_m': (1.0, 5000.0),
        'time_limit_s': (1.0, 1e6),
        'rounding_m': (0.0, 5000.0),
    }

    def __post_init__(self) -> None:
        """Refuse values that no scenario has."""
        check_ranges(self)


def load_scenario(name_or_path: str | Path, seed: int = 0) -> Scenario:
    """Read a named scenario: a name in config/scenarios, or a YAML file.

    Args:
        name_or_path: which one.
        seed: varies the other vessels and the buoys as the file's ``jitter`` says.

    Raises:
        ParamError: no such file, an unknown key, a wrong type, or a number that is not finite or no
            radius; names the file and the key.
        ScenarioError: start, goal, path, a buoy or a vessel's track lies outside the water, the start is
            a goal already, or no path leads to the goal.
    """
    file = preset_path('scenarios', name_or_path)
    values = read_yaml(file)
    vessels = _read_vessels(values.pop('traffic', []), file)
    spec = override(ScenarioFile(name=file.stem), values, str(file))
    if spec.start is None or spec.goal is None:
        raise ScenarioError(f'{file}: start and goal are missing; give start: [x, y, yaw], goal: [x, y]')
    _check_numbers(spec, vessels, file)
    _check_ends(spec.start[:2], spec.goal, spec.goal_radius_m, file)
    harbour = _harbour(spec, seed, file)
    _check_buoys(harbour, spec, file)
    _check_on_water(harbour, [spec.start[:2], spec.goal], f'{file}: start or goal')
    traffic = _traffic(harbour, spec, vessels, seed, file)
    path = _path(harbour, spec, spec.start[:2], spec.goal, file)
    return Scenario(
        name=spec.name,
        seed=seed,
        harbour=harbour,
        start=spec.start,
        goal=spec.goal,
        traffic=traffic,
        path=path,
        start_speed_mps=spec.start_speed_mps,
        goal_radius_m=spec.goal_radius_m,
        time_limit_s=spec.time_limit_s,
        vessel=load_vessel(spec.vessel),
        autopilot=spec.autopilot,
        lidar=spec.lidar,
    )


def _read_vessels(items: Any, file: Path) -> list[VesselPlan]:
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise ParamError(f'{file}: traffic: expected a list of mappings with waypoints and speed_mps')
    plans = [override(VesselPlan(), item, f'{file}: traffic[{i}]') for i, item in enumerate(items)]
    for i, plan in enumerate(plans):
        if len(plan.waypoints) < 2:
            raise ParamError(f'{file}: traffic[{i}]: waypoints: at least two points [x, y] are needed')
    return plans


def _check_numbers(spec: ScenarioFile, vessels: list[VesselPlan], file: Path) -> None:
    """Raise ParamError unless every coordinate is finite and every buoy has a radius."""
    _check_finite(spec, f'{file}')
    _check_finite(spec.jitter, f'{file}: jitter')
    for i, vessel in enumerate(vessels):
        _check_finite(vessel, f'{file}: traffic[{i}]')
    for i, (_, _, radius_m) in enumerate(spec.buoys):
        if not 0.0 < radius_m <= BUOY_RADIUS_MAX_M:
            raise ParamError(
                f'{file}: buoys[{i}]: radius {radius_m} m is outside (0, {BUOY_RADIUS_MAX_M:.0f}]; '
                'give [x, y, radius]'
            )


def _check_finite(owner: Any, where: str) -> None:
    for key in (item.name for item in dataclasses.fields(owner)):
        value = getattr(owner, key)
        if isinstance(value, tuple) and not np.isfinite(np.array(value, float)).all():
            raise ParamError(f'{where}: {key}: holds a number that is not finite; give finite ones')


def _check_ends(start: Point, goal: Point, radius_m: float, file: Path) -> None:
    apart_m = math.dist(start, goal)
    if apart_m <= radius_m:
        raise ScenarioError(
            f'{file}: goal: {goal} is {apart_m:.1f} m from the start and counts as reached within '
            f'{radius_m} m; move it further off or lower goal_radius_m'
        )


def _harbour(spec: ScenarioFile, seed: int, file: Path) -> Harbour:
    if bool(spec.water) == bool(spec.chart):
        raise ScenarioError(f'{file}: give either water (corners of a polygon) or chart (a file)')
    if spec.chart:
        chart = read_chart(file.parent / spec.chart)
        water, charted = chart.water, chart
    elif len(spec.water) < 3:
        raise ScenarioError(f'{file}: water: at least three corners [x, y] are needed')
    else:
        water, charted = Polygon(spec.water), None
    extra = _moved_buoys(spec, seed)
    known = charted.buoys if charted else np.zeros((0, 3))
    flags = charted.charted if charted else np.zeros(0, dtype=np.bool_)
    return Harbour(
        spec.name,
        water,
        np.vstack([known, extra]),
        charted.berths if charted else np.zeros((0, 3)),
        np.concatenate([flags, np.zeros(len(extra), dtype=np.bool_)]),
        charted.origin if charted else None,
    )


def _moved_buoys(spec: ScenarioFile, seed: int) -> Array:
    """Buoys [K, 3] of the file where the seed puts them."""
    buoys = np.array(spec.buoys, float).reshape(-1, 3)
    rng = np.random.default_rng((seed, len(buoys)))  # not the vessels' stream
    buoys[:, :2] += rng.uniform(-1.0, 1.0, (len(buoys), 2)) * spec.jitter.buoys_m
    return buoys


def _check_on_water(harbour: Harbour, points: list[Point], what: str) -> None:
    dry = np.flatnonzero(~harbour.contains(np.array(points)))
    if len(dry):
        raise ScenarioError(f'{what}: {tuple(points[dry[0]])} lies on land; move it onto the water')


def _check_buoys(harbour: Harbour, spec: ScenarioFile, file: Path) -> None:
    """Raise ScenarioError unless each buoy lies on water wherever a seed puts it."""
    reach = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]) * spec.jitter.buoys_m
    for i, (x, y, _) in enumerate(spec.buoys):
        dry = _dry_point(harbour, MultiPoint(np.array([x, y]) + reach).convex_hull)
        if dry is not None:
            raise ScenarioError(
                f'{file}: buoys[{i}]: {dry} lies on land; move the buoy onto the water'
                f'{" or lower jitter: buoys_m" if any(spec.jitter.buoys_m) else ""}'
            )


def _check_line(harbour: Harbour, line: Array, what: str) -> None:
    """Raise ScenarioError unless all of a polyline [W, 2] lies on water."""
    dry = _dry_point(harbour, LineString(line))
    if dry is not None:
        raise ScenarioError(f'{what} crosses land at {dry}; lead it round by more points on the water')


def _dry_point(harbour: Harbour, shape: BaseGeometry) -> Point | None:
    """Return a place, to 0.1 m, where a shape lies more than SHORE_M ashore; None without one."""
    if shapely.covers(harbour.water, shape):
        return None
    ashore = shape.difference(harbour.water.buffer(SHORE_M))
    if ashore.is_empty:
        return None
    place = max(shapely.get_parts(ashore), key=shapely.length).centroid
    return round(place.x, 1), round(place.y, 1)


def _path(harbour: Harbour, spec: ScenarioFile, start: Point, goal: Point, file: Path) -> Array:
    if spec.path:
        legs = np.array([start, *spec.path, goal])
        _check_line(harbour, legs, f'{file}: path: a leg')
        return resample_polyline(legs, PATH_SPACING_M)
    grid = harbour.clearance(grid_resolution(harbour), buoys='charted')
    try:
        route = clearance_route(grid, start, goal, spec.route, PATH_SPACING_M)
    except ValueError as error:
        raise ScenarioError(
            f'{file}: {error}; give path or lower route: least_m{coarseness(grid)}'
        ) from error
    return resample_polyline(round_off(grid, route, spec.rounding_m, spec.route.least_m), PATH_SPACING_M)


def _traffic(
    harbour: Harbour, spec: ScenarioFile, vessels: list[VesselPlan], seed: int, file: Path
) -> Traffic:
    if not vessels:
        return no_traffic()
    rng = np.random.default_rng(seed)
    tracks, progress = [], []
    for i, vessel in enumerate(vessels):
        across_m = spec.jitter.across_m * rng.uniform(-1.0, 1.0)
        waypoints = _moved_aside(np.array(vessel.waypoints), across_m)
        _check_on_water(harbour, [(x, y) for x, y in waypoints], f'{file}: traffic[{i}]: waypoints')
        tracks.append(follow(waypoints, TrackParams()))
        _check_line(harbour, tracks[-1][:, :2].astype(float), f'{file}: traffic[{i}]: waypoints: the track')
        along_m = spec.jitter.along_m * rng.random()
        progress.append(min(along_m, (len(tracks[-1]) - 1) * TRACK_SPACING_M))
    count = len(vessels)
    factor = 1.0 + spec.jitter.speed * rng.uniform(-1.0, 1.0, count)
    return Traffic(
        join_tracks(tracks, [2 * i for i in range(count)], [2 * i + 1 for i in range(count)]),
        hull=np.array([[vessel.length_m, vessel.beam_m] for vessel in vessels]),
        speed=factor * np.array([vessel.speed_mps for vessel in vessels]),
        track=np.arange(count),
        progress=np.array(progress),
        arrival=Arrival[spec.arrival.upper()],
        seed=seed,
    )


def _moved_aside(waypoints: Array, across_m: float) -> Array:
    """Shift a polyline [W, 2] to the left of the line from its first to its last point."""
    heading = waypoints[-1] - waypoints[0]
    left = np.array([-heading[1], heading[0]]) / max(float(np.hypot(*heading)), 1e-9)
    return waypoints + across_m * left
