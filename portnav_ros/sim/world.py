"""The world: B environments of own ship, traffic, quays, buoys and ranging sensor.

The hot path is compiled and holds preallocated arrays with the batch axis first. A world is
deterministic in its scenarios and the commands it is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from portnav_ros.control.autopilot import PID_SIZE
from portnav_ros.sim import kernels
from portnav_ros.sim.kernels import Body, Chart
from portnav_ros.sim.lidar import Sensor, ray_directions
from portnav_ros.sim.scenario import Scenario, ScenarioError
from portnav_ros.sim.traffic import Crowd
from portnav_ros.types import STATE_SIZE, SURGE, YAW, AnyArray, Array, Array32, IntArray, Outcome, X, Y
from portnav_ros.vessel import VesselParams

TICK_S = kernels.TICK_S
DECISION_S = kernels.DECISION_S


class Capacity(NamedTuple):
    """Rows that the padded arrays of a world hold for each environment."""

    walls: int
    buoys: int
    vessels: int
    tracks: int
    points: int


def _check_hull(vessel: VesselParams) -> None:
    """Refuse a vessel that could pass through a quay between two looks for contacts."""
    way_m = vessel.speed_max_mps * kernels.CHECK_S
    if way_m > vessel.length_m:
        raise ScenarioError(
            f'vessel {vessel.name}: length_m = {vessel.length_m:g} is less than the {way_m:.2f} m that it '
            f'sails at speed_max_mps = {vessel.speed_max_mps:.2f} in the {kernels.CHECK_S:g} s between two '
            f'looks for contacts; raise length_m or lower speed_max_mps (by thrust_max_n)'
        )


def _needs(scenario: Scenario) -> Capacity:
    traffic = scenario.traffic
    return Capacity(
        len(scenario.harbour.walls),
        len(scenario.harbour.buoys),
        len(traffic),
        len(traffic.tracks.origin),
        len(traffic.tracks.points),
    )


class World:
    """B environments that advance together.

    Public arrays, all views of what the kernels write: own [B, 7] state rows, time_s [B], outcome
    [B] (types.Outcome), ranges [B, R] m, vessels [B, M, 4] x, y, yaw, speed (NaN where there is
    none), clearance [B, 3] m from the hull to the nearest quay, buoy and vessel when last sensed,
    setpoint [B, 2] and command [B, 2] last given. An environment whose episode has ended stands still.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        """Build a world of one environment for each scenario.

        Raises:
            ScenarioError: no scenario, scenarios with different vessels, autopilots or sensors, or a
                vessel that is shorter than the way it sails from one look for contacts to the next.
        """
        if not scenarios:
            raise ScenarioError('a world needs at least one scenario')
        first = scenarios[0]
        _check_hull(first.vessel)
        self.batch = len(scenarios)
        self.vessel, self.autopilot, self.lidar = first.vessel, first.autopilot, first.lidar
        self._model, self._gains = self.vessel.model(), self.autopilot.gains()
        lidar = self.lidar
        self._rays = ray_directions(lidar.rays)
        self._sensor = Sensor(lidar.range_min_m, lidar.range_max_m, lidar.noise_m, lidar.drop_out)
        self._body = _new_body(self.batch, lidar.rays)
        self._capacity = Capacity(*(max(1, *column) for column in zip(*map(_needs, scenarios), strict=True)))
        self._chart, self._crowd = (
            _new_chart(self.batch, self._capacity),
            _new_crowd(self.batch, self._capacity),
        )
        for b, scenario in enumerate(scenarios):
            self.reset(b, scenario)

    @property
    def own(self) -> Array:
        """State rows [B, 7]."""
        return self._body.own

    @property
    def time_s(self) -> Array:
        """Time since the start of each episode [B] in s."""
        return np.asarray(self._body.ticks * TICK_S, np.float64)

    @property
    def limit_s(self) -> Array:
        """Time limit of each episode [B] in s."""
        return np.asarray(self._body.limit * TICK_S, np.float64)

    @property
    def memory(self) -> Array:
        """What the autopilots remember [B, 2]."""
        return self._body.memory

    @property
    def outcome(self) -> IntArray:
        """How each episode stands [B], as types.Outcome."""
        return self._body.outcome

    @property
    def ranges(self) -> Array32:
        """What the sensor read last [B, R] in m."""
        return self._body.ranges

    @property
    def vessels(self) -> Array:
        """Poses of the other vessels [B, M, 4]: x, y, yaw, speed."""
        return self._crowd.pose

    @property
    def walls(self) -> Array:
        """Quay edges [B, E, 4] in m, of which `wall_counts` [B] are in use."""
        return self._chart.walls

    @property
    def wall_counts(self) -> IntArray:
        """Number of quay edges of each environment [B]."""
        return self._chart.wall_count

    @property
    def chart(self) -> Chart:
        """Walls, buoys and goals, as the kernels read them."""
        return self._chart

    @property
    def crowd(self) -> Crowd:
        """The other vessels, as the kernels read them."""
        return self._crowd

    @property
    def hulls(self) -> Array:
        """Length and beam of the other vessels [B, M, 2] in m."""
        return self._crowd.hull

    @property
    def clearance(self) -> Array:
        """Gap from the hull to the nearest quay, buoy and vessel [B, 3] in m, when last sensed."""
        return self._body.clearance

    @property
    def setpoint(self) -> Array:
        """Last setpoints [B, 2]: yaw in rad, speed in m/s."""
        return self._body.setpoint

    @property
    def command(self) -> Array:
        """Last actuator commands [B, 2]: rudder in rad, thrust in N."""
        return self._body.command

    def reset(self, b: int, scenario: Scenario) -> None:
        """Load a scenario into environment b and sense once.

        Raises:
            ScenarioError: the scenario's vessel, autopilot or sensor is not this world's.
        """
        if (scenario.vessel, scenario.autopilot, scenario.lidar) != (self.vessel, self.autopilot, self.lidar):
            raise ScenarioError(f'{scenario.name}: scenarios of a world share vessel, autopilot, lidar')
        needs = _needs(scenario)
        if any(need > have for need, have in zip(needs, self._capacity, strict=True)):
            self._grow(Capacity(*map(max, needs, self._capacity)))
        _load_chart(self._chart, b, scenario)
        _load_crowd(self._crowd, b, scenario)
        _load_body(self._body, b, scenario)
        chart = Chart._make(array[b : b + 1] for array in self._chart)
        crowd = Crowd._make(array[b : b + 1] for array in self._crowd)
        body = Body._make(array[b : b + 1] for array in self._body)
        kernels.sense_all(chart, crowd, body, self._model, self._rays, self._sensor)

    def copy(self, other: World, rows: IntArray) -> None:
        """Make the first N environments what those of `rows` [N] are now in another world.

        Where the worlds differ in size, the environments behind them are left without a port.

        Args:
            other: a world with the same vessel, autopilot and sensor.
            rows: environments of the other world; one may come several times.

        Raises:
            ScenarioError: the other world's vessel, autopilot or sensor is not this one's.
        """
        if (other.vessel, other.autopilot, other.lidar) != (self.vessel, self.autopilot, self.lidar):
            raise ScenarioError('a world copies worlds that share its vessel, autopilot, lidar')
        if self._capacity != other._capacity:
            self._capacity = other._capacity
            self._chart, self._crowd = (
                _new_chart(self.batch, self._capacity),
                _new_crowd(self.batch, self._capacity),
            )
        parts: Iterable[tuple[AnyArray, AnyArray]] = zip(
            (*self._chart, *self._crowd, *self._body),
            (*other._chart, *other._crowd, *other._body),
            strict=True,
        )
        for copied, array in parts:
            copied[: len(rows)] = array[rows]

    def tick(self, rudder_rad: Array, thrust_n: Array) -> None:
        """Advance every environment by TICK_S under actuator commands [B]."""
        self._body.command[:, 0] = rudder_rad
        self._body.command[:, 1] = thrust_n
        kernels.tick_all(self._chart, self._crowd, self._body, self._model)

    def sense(self) -> None:
        """Cast the rays of every environment."""
        kernels.sense_all(self._chart, self._crowd, self._body, self._model, self._rays, self._sensor)

    def step(self, setpoints: Array) -> None:
        """Advance by DECISION_S with the autopilot on setpoints [B, 2] (yaw rad, speed m/s), then sense."""
        self._body.setpoint[:] = setpoints
        kernels.step_all(
            self._chart, self._crowd, self._body, self._model, self._gains, self._rays, self._sensor
        )

    def state_dict(self) -> dict[str, AnyArray]:
        """Copies of all that changes, by name, for a checkpoint."""
        parts = (self._chart, self._crowd, self._body)
        return {name: array.copy() for part in parts for name, array in part._asdict().items()}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint of a world with as many environments, the same vessel and sensor."""
        self._chart = chart = Chart._make(state[name].copy() for name in Chart._fields)
        self._crowd = crowd = Crowd._make(state[name].copy() for name in Crowd._fields)
        self._body = Body._make(state[name].copy() for name in Body._fields)
        padded = (chart.walls, chart.buoys, crowd.hull, crowd.origin, crowd.points)
        self._capacity = Capacity(*(array.shape[1] for array in padded))

    def _grow(self, capacity: Capacity) -> None:
        chart, crowd = _new_chart(self.batch, capacity), _new_crowd(self.batch, capacity)
        pairs: Iterable[tuple[AnyArray, AnyArray]] = zip(
            (*chart, *crowd), (*self._chart, *self._crowd), strict=True
        )
        for new, old in pairs:
            new[tuple(slice(size) for size in old.shape)] = old
        self._capacity, self._chart, self._crowd = capacity, chart, crowd


def _new_body(batch: int, rays: int) -> Body:
    return Body(
        own=np.zeros((batch, STATE_SIZE)),
        memory=np.zeros((batch, PID_SIZE)),
        setpoint=np.zeros((batch, 2)),
        command=np.zeros((batch, 2)),
        ticks=np.zeros(batch, np.int64),
        limit=np.zeros(batch, np.int64),
        outcome=np.zeros(batch, np.int64),
        ranges=np.zeros((batch, rays), np.float32),
        clearance=np.zeros((batch, 3)),
        seen=np.zeros((batch, kernels.SEEN_SIZE)),
    )


def _new_chart(batch: int, capacity: Capacity) -> Chart:
    return Chart(
        walls=np.zeros((batch, capacity.walls, 4)),
        wall_count=np.zeros(batch, np.int64),
        buoys=np.zeros((batch, capacity.buoys, 3)),
        buoy_count=np.zeros(batch, np.int64),
        goal=np.zeros((batch, 3)),
    )


def _new_crowd(batch: int, capacity: Capacity) -> Crowd:
    def integers(*shape: int) -> IntArray:
        return np.zeros((batch, *shape), np.int64)

    vessels, tracks = capacity.vessels, capacity.tracks
    return Crowd(
        points=np.zeros((batch, capacity.points, 3), np.float32),
        offsets=integers(tracks + 1),
        origin=integers(tracks),
        destination=integers(tracks),
        tracks=integers(),
        vessels=integers(),
        hull=np.zeros((batch, vessels, 2)),
        speed=np.zeros((batch, vessels)),
        arrival=integers(),
        seed=integers(),
        track=integers(vessels),
        leg=integers(vessels),
        progress=np.zeros((batch, vessels)),
        turn=np.zeros((batch, vessels)),
        pose=np.full((batch, vessels, 4), np.nan),
    )


def _fill(row: AnyArray, values: AnyArray) -> int:
    row[: len(values)] = values
    return len(values)


def _load_chart(chart: Chart, b: int, scenario: Scenario) -> None:
    chart.wall_count[b] = _fill(chart.walls[b], scenario.harbour.walls)
    chart.buoy_count[b] = _fill(chart.buoys[b], scenario.harbour.buoys)
    chart.goal[b] = (*scenario.goal, scenario.goal_radius_m)


def _load_crowd(crowd: Crowd, b: int, scenario: Scenario) -> None:
    traffic = scenario.traffic
    _fill(crowd.points[b], traffic.tracks.points)
    _fill(crowd.offsets[b], traffic.tracks.offsets)
    _fill(crowd.destination[b], traffic.tracks.destination)
    crowd.tracks[b] = _fill(crowd.origin[b], traffic.tracks.origin)
    _fill(crowd.hull[b], traffic.hull)
    _fill(crowd.speed[b], traffic.speed)
    _fill(crowd.track[b], traffic.track)
    crowd.vessels[b] = _fill(crowd.progress[b], traffic.progress)
    crowd.arrival[b] = int(traffic.arrival)
    crowd.seed[b] = traffic.seed if len(traffic) else scenario.seed
    crowd.leg[b], crowd.turn[b], crowd.pose[b] = 0, 0.0, np.nan


def _load_body(body: Body, b: int, scenario: Scenario) -> None:
    for array in (body.own, body.memory, body.command, body.ticks, body.outcome):
        array[b] = 0
    body.own[b, [X, Y, YAW]] = scenario.start
    body.own[b, SURGE] = scenario.start_speed_mps
    body.setpoint[b] = (scenario.start[2], scenario.start_speed_mps)
    body.limit[b] = round(scenario.time_limit_s / TICK_S)
    body.outcome[b] = Outcome.RUNNING
