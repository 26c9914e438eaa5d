"""A privileged teacher: what each action is worth when every vessel in sight goes where it will go.

An action is held for a while, then the path is followed again, and the vessel's own kernels tell what
becomes of it (a rollout policy: Bertsekas, Rollout, Policy Iteration and Distributed Reinforcement
Learning, 2020, chapter 2, with line of sight as the base policy). The teacher knows the tracks of
the vessels that the sensor could see now, and those alone: what no sensor tells would teach nothing.
It works on any state that a learner gets itself into, and takes about 60 us an action.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from portnav_ros.params import ParamError, Ranges, check_range, check_ranges
from portnav_ros.sim.scenario import PATH_SPACING_M
from portnav_ros.sim.world import World
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.policy import Observation
from portnav_ros.training.foresight_kernels import Bounds, Course, future_of, value_actions
from portnav_ros.types import Array, Array32, BoolArray, IntArray


@dataclass(frozen=True)
class ForesightParams:
    """How far the teacher looks and what it minds.

    holds_s: times for which an action is tried, the best of which counts. margin_m: kept from
    everything. path_weight: of the path errors, in units of the reward's path terms. haste: cost of a
    second. collision: cost of a collision within certain_s; later ones, which may still be avoided,
    cost less, down to late_share of it at the horizon. closeness: cost of a second spent touching,
    falling to none at a gap of comfort_m. lookahead_m: of the line of sight.
    """

    horizon_s: int = 60
    holds_s: tuple[int, ...] = (8, 20, 40)
    margin_m: float = 4.0
    path_weight: float = 1.0
    haste: float = 1.0
    collision: float = 400.0
    certain_s: float = 30.0
    late_share: float = 0.3
    comfort_m: float = 25.0
    closeness: float = 3.0
    lookahead_m: float = 100.0
    ranges: ClassVar[Ranges] = {
        'horizon_s': (1, 600),
        'margin_m': (0.0, 100.0),
        'path_weight': (0.0, 1e3),
        'haste': (0.0, 1e3),
        'collision': (0.0, 1e6),
        'late_share': (0.0, 1.0),
        'comfort_m': (1.0, 60.0),
        'closeness': (0.0, 1e3),
        'lookahead_m': (1.0, 1000.0),
    }

    def __post_init__(self) -> None:
        """Refuse a look ahead that ends before it begins."""
        check_ranges(self)
        check_range(self, certain_s=(0.0, self.horizon_s))
        rising = all(a < b for a, b in zip(self.holds_s, self.holds_s[1:], strict=False))
        if not self.holds_s or not rising or self.holds_s[0] < 1 or self.holds_s[-1] > self.horizon_s:
            raise ParamError(f'holds_s = {self.holds_s} must rise from 1 to horizon_s = {self.horizon_s}')


class Lesson(NamedTuple):
    """What actions are worth to N vessels.

    action: [N, K]. value: [N, K] units of reward; only differences within a row mean anything.
    """

    action: IntArray
    value: Array32


class Foresight:
    """Knows the future of the traffic in every environment of a world."""

    def __init__(self, world: World, actions: ActionParams, params: ForesightParams) -> None:
        """Look into every environment.

        Raises:
            ParamError: actions are not counted from the course of the path.
        """
        if actions.reference != 'path':
            raise ParamError('the teacher needs task.actions.reference = path')
        self._world = world
        self._table = actions.table()
        self._params = params
        self._base = int(np.argmax(self._table[:, 1] - np.abs(self._table[:, 0])))
        self._bounds = Bounds(
            params.horizon_s,
            np.array(params.holds_s, np.int64),
            params.margin_m,
            params.path_weight,
            params.haste,
            params.collision,
            params.certain_s,
            params.late_share,
            params.comfort_m,
            params.closeness,
            params.lookahead_m,
            world.lidar.range_max_m,
        )
        self.poses = np.zeros((world.batch, 0, 0, 4))
        self.look(np.ones(world.batch, dtype=bool))

    def look(self, which: BoolArray) -> None:
        """Look ahead in the environments [B] whose episode has just begun."""
        seconds = int(self._world.limit_s.max()) + self._params.horizon_s + 2
        shape = self._world.batch, seconds, self._world.vessels.shape[1], 4
        if shape != self.poses.shape:
            which = np.ones(self._world.batch, dtype=bool)
            self.poses = np.full(shape, np.nan)
        future_of(self._world.crowd, self._world.time_s, which, self.poses)

    def teach(
        self, observation: Observation, vessels: IntArray, count: int, rng: np.random.Generator
    ) -> Lesson:
        """Value K actions of each vessel: to follow the path at full speed, and others at random.

        Args:
            observation: of all B.
            vessels: [N] whom to teach.
            count: K.
            rng: draws the actions.
        """
        lots = rng.random((len(vessels), len(self._table)))
        lots[:, self._base] = -1.0
        action = np.argsort(lots, axis=1)[:, :count]
        return Lesson(action, self.value(observation, vessels, action))

    def value(
        self,
        observation: Observation,
        vessels: IntArray,
        action: IntArray,
        time_s: Array | None = None,
    ) -> Array32:
        """Value [N, K] of actions [N, K] of the vessels [N], in units of reward.

        time_s: [B] since the episodes began, where that is not the world's own time.
        """
        world = self._world
        poses, now_s = self.future(world.time_s if time_s is None else time_s)
        course = Course(observation.path, observation.path_length, observation.progress, PATH_SPACING_M)
        value = np.zeros(action.shape, np.float32)
        value_actions(
            self._bounds,
            world.vessel.model(),
            world.autopilot.gains(),
            observation.own,
            world.memory,
            now_s,
            course,
            world.chart,
            poses,
            world.hulls,
            self._table,
            vessels,
            action,
            value,
        )
        return value

    def future(self, time_s: Array) -> tuple[Array, Array]:
        """Where the traffic will be, for vessels at the times [B].

        Returns:
            Poses [B, T, M, 4], one a second: x, y in m, yaw in rad, speed in m/s, NaN where none is; and
            which of these seconds is now [B].
        """
        return self.poses, time_s


class Extrapolation(Foresight):
    """Knows place, heading and speed of the vessels in sight, and supposes that they keep the last two."""

    def future(self, time_s: Array) -> tuple[Array, Array]:
        """Where the traffic would be; see Foresight."""
        seconds = np.arange(self._params.horizon_s + 2)
        x, y, yaw, speed = np.moveaxis(self.poses[np.arange(len(time_s)), np.rint(time_s).astype(int)], -1, 0)
        ways = seconds[None, :, None] * speed[:, None]
        still = np.zeros_like(ways)
        way_x, way_y = ways * np.cos(yaw)[:, None], ways * np.sin(yaw)[:, None]
        columns = x[:, None] + way_x, y[:, None] + way_y, yaw[:, None] + still, speed[:, None] + still
        return np.stack(columns, axis=-1), np.zeros(len(time_s))


def best_of(lesson: Lesson) -> IntArray:
    """The best action [N] of each row."""
    rows = np.arange(len(lesson.action))
    return np.asarray(lesson.action[rows, lesson.value.argmax(axis=1)])


def regret_of(lesson: Lesson) -> Array:
    """How much worse [N, K] each action is than the best of its row."""
    return np.asarray(lesson.value.max(axis=1, keepdims=True) - lesson.value, np.float64)
