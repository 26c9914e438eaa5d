"""Ceiling of the ladder: a privileged planner that knows every buoy and the traffic's true future.

It plans the whole episode before its start and then recites the plan. A world is deterministic and
the search runs its kernels, so an episode ends as planned: what it fails at shows how much of a
difficulty no policy could have solved with these setpoints (up to the width of the beam).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from portnav_ros.baselines.space_time_field import Haste, time_to_go
from portnav_ros.baselines.space_time_search import Problem, search, traffic_future
from portnav_ros.harbour import ClearanceGrid
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.planning.clearance_route import RouteCost, clearance_field
from portnav_ros.sim.kernels import CHECK_S
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import DECISION_S, World
from portnav_ros.task.policy import Observation
from portnav_ros.types import SURGE, YAW, Array, Array32, BoolArray


@dataclass(frozen=True)
class SpaceTimeParams:
    """The search: setpoints of the paper's range, held.

    tries: time in s for which a setpoint is held and width of the beam, one try after the other.
    """

    heading_change_deg: tuple[float, ...] = (-60.0, -20.0, 0.0, 20.0, 60.0)
    speed_mps: tuple[float, ...] = (1.0, 5.0)
    tries: tuple[tuple[float, int], ...] = ((20.0, 16), (20.0, 64), (10.0, 256), (20.0, 512))
    margin_m: float = 2.0
    lead_s: float = 15.0
    layer_s: float = 8.0
    resolution_m: float = 20.0
    comfort_m: float = 50.0
    weight: float = 1.0
    cruise: float = 0.9  # speed of the point, as a share of the vessel's
    ranges: ClassVar[Ranges] = {
        'margin_m': (0.0, 50.0),
        'lead_s': (0.0, 120.0),
        'layer_s': (1.0, 60.0),
        'resolution_m': (1.0, 100.0),
        'comfort_m': (0.1, 500.0),
        'weight': (0.0, 100.0),
        'cruise': (0.1, 1.0),
    }

    def __post_init__(self) -> None:
        """Refuse an empty search."""
        check_ranges(self)
        if not (self.heading_change_deg and self.speed_mps and self.tries):
            raise ParamError('heading_change_deg, speed_mps and tries need at least one value each')

    def table(self) -> Array:
        """Heading change in rad and speed in m/s of each edge [A, 2]."""
        return np.array([(math.radians(h), s) for h in self.heading_change_deg for s in self.speed_mps])


class Plan(NamedTuple):
    """Setpoints [T, 2], one for each decision, and whether they reach the goal."""

    setpoints: Array
    arrives: bool


def plan_episode(scenario: Scenario, params: SpaceTimeParams | None = None) -> Plan:
    """Plan a whole episode, with one try of the search after the other until one finds a way."""
    params = params or SpaceTimeParams()
    world = World([scenario])
    problem = _problem(scenario, world, params)
    plan = Plan(np.zeros((0, 2)), False)
    for hold_s, width in params.tries:
        problem = problem._replace(decisions=round(hold_s / DECISION_S))
        plan = Plan(*search(problem, world.own[0], width, math.ceil(scenario.time_limit_s / hold_s)))
        if plan.arrives:
            break
    return plan


class SpaceTime:
    """Recites a plan for each of B vessels; the episode's runner tells it each scenario by `prepare`."""

    def __init__(self, params: SpaceTimeParams | None = None) -> None:
        """Plan with the given search."""
        self._params = params or SpaceTimeParams()
        self._plans: dict[int, Plan] = {}
        self._decision: dict[int, int] = {}

    def prepare(self, b: int, scenario: Scenario) -> None:
        """Learn and plan the scenario that vessel b is about to start."""
        self._plans[b] = plan_episode(scenario, self._params)
        self._decision[b] = 0

    def reset(self, which: BoolArray) -> None:
        """Start the plans of the vessels [B] (bool) from their beginning."""
        for b in np.flatnonzero(which):
            self._decision[int(b)] = 0

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]; past its plan's end a vessel keeps its heading at its last speed."""
        setpoints = observation.own[:, [YAW, SURGE]].copy()
        for b, plan in self._plans.items():
            if self._decision[b] < len(plan.setpoints):
                setpoints[b] = plan.setpoints[self._decision[b]]
                self._decision[b] += 1
        return setpoints


def _problem(scenario: Scenario, world: World, params: SpaceTimeParams) -> Problem:
    vessel = scenario.vessel
    grid = scenario.harbour.clearance(params.resolution_m, buoys='all')
    poses = np.empty((round(scenario.time_limit_s / CHECK_S) + 1, *world.vessels.shape[1:]))
    traffic_future(world.crowd, poses)
    poses = np.ascontiguousarray(poses[:, : len(scenario.traffic)])
    return Problem(
        vessel.model(),
        scenario.autopilot.gains(),
        scenario.harbour.walls,
        scenario.harbour.buoys,
        np.array([*scenario.goal, scenario.goal_radius_m]),
        grid,
        _togo(scenario, grid, poses, params),
        params.layer_s,
        poses,
        scenario.traffic.hull,
        params.table(),
        1,
        params.margin_m,
        params.lead_s,
    )


def _togo(scenario: Scenario, grid: ClearanceGrid, poses: Array, params: SpaceTimeParams) -> Array32:
    """Time-to-go [T + 1, H, W] in s of a point at layers of time."""
    vessel = scenario.vessel
    half_beam_m = 0.5 * vessel.beam_m + params.margin_m
    haste = Haste(
        params.layer_s, params.cruise * vessel.speed_max_mps, half_beam_m, params.comfort_m, params.weight
    )
    cost = RouteCost(half_beam_m, params.comfort_m, params.weight)
    rest = clearance_field(grid, scenario.goal, cost) / np.float32(haste.speed_mps)
    stride = round(params.layer_s / CHECK_S)
    return time_to_go(grid, rest, poses[::stride].copy(), scenario.traffic.hull, haste)
