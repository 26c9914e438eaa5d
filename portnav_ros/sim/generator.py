"""Random scenarios: a port, a mission of the own ship in it, and traffic; deterministic in a seed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from portnav_ros.charts import read_chart
from portnav_ros.geometry import resample_polyline
from portnav_ros.harbour import Harbour
from portnav_ros.sim.difficulty import Difficulty, load_difficulty, load_vessel
from portnav_ros.sim.mission import Mission, Site, chart_nodes, draw_mission, make_site
from portnav_ros.sim.ports import make_port
from portnav_ros.sim.scenario import PATH_SPACING_M, Scenario, ScenarioError, Traffic
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.sim.traffic_draw import draw_traffic
from portnav_ros.types import Array
from portnav_ros.vessel import VesselParams

T = TypeVar('T')
__all__ = [
    'ScenarioPool',
    'chart_scenario',
    'load_difficulty',
    'load_scenario',
    'load_vessel',
    'make_scenario',
]

Route = Callable[[Harbour, tuple[float, float], tuple[float, float], int], Array]
Progress = Callable[[int, int], None]

ATTEMPTS = 20  # fresh draws before a scenario counts as impossible
STREAMS = 3  # of random numbers: port, mission, traffic


def make_scenario(difficulty: Difficulty, seed: int, route: Route | None = None) -> Scenario:
    """Draw the scenario of a seed: port, mission and traffic from three independent streams.

    Args:
        difficulty: what to draw from.
        seed: 0 or greater; the same seed gives the same scenario, whichever planner lays the path.
        route: lays the global path, called with harbour, start, goal and seed; without it the
            planner that the difficulty names.

    Raises:
        ScenarioError: nothing fits in a bounded number of draws; names the difficulty and the seed.
    """
    vessel = load_vessel(difficulty.vessel)

    def draw(streams: list[np.random.Generator]) -> Scenario:
        site = make_site(make_port(difficulty.port, streams[0]), difficulty)
        mission = draw_mission(site, difficulty, streams[1])
        mission = _lay_path(site.harbour, mission, difficulty, seed, route)
        traffic = draw_traffic(site.tracks, mission.start, difficulty.traffic, streams[2])
        return _compose(difficulty, vessel, seed, site.harbour, mission, traffic)

    return _attempt(draw, difficulty, seed)


def chart_scenario(
    harbour: Harbour, difficulty: Difficulty, seed: int, route: Route | None = None
) -> Scenario:
    """Draw a mission and traffic on a given chart, between its berths or, without any, open water.

    Where no two berths are as far apart as the difficulty asks, the pair nearest to that is taken;
    where the water has no room for all the traffic, there is less.

    Raises:
        ScenarioError: the chart has no two places between which a vessel of this size can sail.
    """
    vessel = load_vessel(difficulty.vessel)

    def draw(streams: list[np.random.Generator]) -> Scenario:
        nodes = chart_nodes(harbour, difficulty, streams[0])
        site = make_site(harbour, difficulty, nodes)
        mission = draw_mission(site, difficulty, streams[1], strict=False)
        mission = _lay_path(harbour, mission, difficulty, seed, route)
        traffic = draw_traffic(site.tracks, mission.start, difficulty.traffic, streams[2], strict=False)
        return _compose(difficulty, vessel, seed, harbour, mission, traffic)

    return _attempt(draw, difficulty, seed)


def find_scenario(difficulty: str, seed: int, scenario: str | None, chart: Path | None) -> Scenario:
    """Make what a user names: a named scenario, else a mission on a chart, else one in a random port.

    The path is the quick clearance route, since whoever asks in this way plans the route elsewhere.

    Raises:
        ScenarioError, ChartError, ParamError: it cannot be made.
    """
    if scenario is not None:
        return load_scenario(scenario, seed)
    settings = dataclasses.replace(load_difficulty(difficulty), route='clearance')
    if chart is not None:
        harbour = read_chart(chart)
        return dataclasses.replace(chart_scenario(harbour, settings, seed), name=harbour.name)
    return make_scenario(settings, seed)


class ScenarioPool:
    """Ports prepared once, from which scenarios are drawn in well under a millisecond.

    Each port holds ``resets_per_port`` missions. A draw takes a port and a mission at random and
    fresh traffic, and keeps no memory, so that a run that is resumed draws on as if uninterrupted.
    """

    def __init__(
        self,
        difficulty: Difficulty,
        ports: int,
        seed: int,
        route: Route | None = None,
        progress: Progress | None = None,
    ) -> None:
        """Prepare the ports of seeds ``seed * ports`` onwards.

        Args:
            difficulty: what to draw from.
            ports: how many to hold.
            seed: of the pool.
            route: lays the global paths, as in ``make_scenario``.
            progress: called with the number of ports ready and the number asked for.

        Raises:
            ScenarioError: a port cannot be made.
        """
        self.difficulty = difficulty
        self._vessel = load_vessel(difficulty.vessel)
        self._sites: list[tuple[Site, list[Mission]]] = []
        for k in range(ports):
            self._sites.append(_prepare(difficulty, seed * ports + k, route))
            if progress is not None:
                progress(k + 1, ports)

    def __len__(self) -> int:
        return len(self._sites)

    def draw(self, rng: np.random.Generator) -> Scenario:
        """Draw a scenario: port, mission and traffic.

        Raises:
            ScenarioError: the traffic finds no room.
        """
        site, missions = self._sites[int(rng.integers(len(self._sites)))]
        mission = missions[int(rng.integers(len(missions)))]
        traffic = draw_traffic(site.tracks, mission.start, self.difficulty.traffic, rng)
        seed = traffic.seed if len(traffic) else int(rng.integers(2**31))
        return _compose(self.difficulty, self._vessel, seed, site.harbour, mission, traffic)


def _prepare(difficulty: Difficulty, seed: int, route: Route | None) -> tuple[Site, list[Mission]]:
    def draw(streams: list[np.random.Generator]) -> tuple[Site, list[Mission]]:
        site = make_site(make_port(difficulty.port, streams[0]), difficulty)
        drawn = [draw_mission(site, difficulty, streams[1]) for _ in range(difficulty.resets_per_port)]
        return site, [_lay_path(site.harbour, mission, difficulty, seed, route) for mission in drawn]

    return _attempt(draw, difficulty, seed)


def _attempt(draw: Callable[[list[np.random.Generator]], T], difficulty: Difficulty, seed: int) -> T:
    """Call draw with fresh independent streams until it succeeds."""
    if seed < 0:
        raise ScenarioError(f'seed = {seed}: a seed is 0 or greater')
    for attempt in range(ATTEMPTS):
        sequence = np.random.SeedSequence(seed, spawn_key=(attempt,))
        try:
            return draw([np.random.default_rng(child) for child in sequence.spawn(STREAMS)])
        except ScenarioError as error:
            reason = error
    raise ScenarioError(
        f'difficulty {difficulty.name}, seed {seed}: nothing fits in {ATTEMPTS} draws; the last: {reason}'
    )


def _lay_path(
    harbour: Harbour, mission: Mission, difficulty: Difficulty, seed: int, route: Route | None
) -> Mission:
    """Replace the clearance route by that of the planner asked for; the start's heading stays."""
    if route is not None:
        points = route(harbour, mission.start[:2], mission.goal, seed)
        return mission._replace(path=resample_polyline(points, PATH_SPACING_M))
    if difficulty.route == 'clearance':
        return mission
    return mission._replace(path=_rrt_star(harbour, mission.start[:2], mission.goal, difficulty, seed))


def _rrt_star(
    harbour: Harbour,
    start: tuple[float, float],
    goal: tuple[float, float],
    difficulty: Difficulty,
    seed: int,
) -> Array:
    """Plan as the global planner node does under the bringup, so that the path is the same to the bit."""
    from portnav_ros.planning.rrt_star import RrtStarParams, plan_route  # ompl loads slowly

    params = RrtStarParams(comfort_m=difficulty.path.comfort_m)
    return plan_route(harbour, start, goal, params, difficulty.path.least_m, seed)


def _compose(
    difficulty: Difficulty,
    vessel: VesselParams,
    seed: int,
    harbour: Harbour,
    mission: Mission,
    traffic: Traffic,
) -> Scenario:
    return Scenario(
        name=difficulty.name,
        seed=seed,
        harbour=harbour,
        start=mission.start,
        goal=mission.goal,
        traffic=traffic,
        path=mission.path,
        start_speed_mps=difficulty.start_speed_mps,
        goal_radius_m=difficulty.goal_radius_m,
        time_limit_s=difficulty.time_limit_s,
        vessel=vessel,
        autopilot=difficulty.autopilot,
        lidar=difficulty.lidar,
    )
