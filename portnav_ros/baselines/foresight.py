"""Two rungs of the ladder that know the vessels in sight, and nothing of those that are not.

With foresight, a planner knows where they will go: it tells how much of a difficulty the sensor's reach
leaves to be solved, between a planner that must guess (DWA) and one that knows all (the ceiling). It is also
what teaches the learned policy. By extrapolation it knows place, heading and speed, as a perfect tracker
would tell them: what lies between the two is what there is to know of where others mean to go.
"""

from __future__ import annotations

import math

import numpy as np

from portnav_ros.baselines.line_of_sight import steer_along
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import DECISION_S, World
from portnav_ros.task.actions import ActionParams, setpoints_of
from portnav_ros.task.policy import Observation
from portnav_ros.training.foresight import Foresight, ForesightParams
from portnav_ros.types import Array, BoolArray

OFFSETS_DEG = (-75.0, -45.0, -25.0, -10.0, 0.0, 10.0, 25.0, 45.0, 75.0)
ACTIONS = ActionParams(tuple(math.radians(offset) for offset in OFFSETS_DEG), reference='path', hold=4)


class ForesightPolicy:
    """Takes the best of 27 actions by rollouts in the future, every four seconds."""

    def __init__(
        self, params: ForesightParams | None = None, look_ahead: type[Foresight] = Foresight
    ) -> None:
        """Look ahead within the given bounds, by foresight or by extrapolation."""
        self._params = params or ForesightParams()
        self._look_ahead = look_ahead
        self._foresight: Foresight | None = None
        self._world: World
        self._table = ACTIONS.table()
        self._decision = np.zeros(0, np.int64)
        self._setpoints = np.zeros((0, 2))

    def reset(self, which: BoolArray) -> None:
        """Begin the episodes of the vessels [B] (bool)."""
        if len(which) != len(self._decision):
            self._decision = np.zeros(len(which), np.int64)
            self._setpoints = np.zeros((len(which), 2))
            self._foresight = None
        self._decision[which] = 0

    def prepare(self, b: int, scenario: Scenario) -> None:
        """Learn the scenario that vessel b is about to start."""
        if self._foresight is None:
            self._world = World([scenario] * len(self._decision))
            self._foresight = self._look_ahead(self._world, ACTIONS, self._params)
        self._world.reset(b, scenario)
        self._foresight.look(np.arange(len(self._decision)) == b)

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]."""
        due = np.flatnonzero(self._decision % ACTIONS.hold == 0)
        if len(due) and self._foresight is not None:
            every = np.tile(np.arange(ACTIONS.count), (len(due), 1))
            time_s = np.asarray(self._decision * DECISION_S, np.float64)
            value = self._foresight.value(observation, due, every, time_s)
            course = self._courses(observation)[due]
            self._setpoints[due] = setpoints_of(value.argmax(axis=1), course, self._table)
        self._decision += 1
        return self._setpoints.copy()

    def _courses(self, observation: Observation) -> Array:
        """Line-of-sight courses [B] in rad."""
        courses = np.empty((len(observation.own), 2))
        steer_along(
            observation.own,
            observation.path,
            observation.path_length,
            observation.progress,
            self._params.lookahead_m,
            courses,
        )
        return courses[:, 0]
