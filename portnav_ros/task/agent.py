"""A policy from an agent that numbers its actions, as the environment trains it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams, setpoints_of
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.task.policy import Observation
from portnav_ros.types import Array, Array32, BoolArray, IntArray


class AgentPolicy:
    """Observes as the agent was trained to, asks it where a decision is due, and holds its setpoints.

    Each vessel decides at its reset and every `ActionParams.hold` periods from there. decided: [B] (bool),
    which of them have done so in the last call.
    """

    def __init__(
        self,
        observation: ObservationParams,
        actions: ActionParams,
        lidar: LidarParams,
        decide: Callable[[Array32], IntArray],
    ) -> None:
        """Prepare for any number of vessels, which the first reset tells.

        Args:
            observation: what the agent sees.
            actions: what its action numbers mean.
            lidar: the sensor.
            decide: actions [K] for the features [K, F] of those vessels that are due.

        Raises:
            ParamError: the observation cannot be made from this sensor.
        """
        self._observation, self._actions, self._lidar = observation, actions, lidar
        self._decide = decide
        self._table = actions.table()
        self._allocate(1)

    def tracks(self, b: int) -> Array:
        """What is known of the things around vessel b; see `Observer.tracks`."""
        return self._observer.tracks(b)

    def reset(self, which: BoolArray) -> None:
        """Forget the vessels [B]; their paths are taken from the next observation."""
        if len(which) != len(self._fresh):
            self._allocate(len(which))
        self._fresh |= which

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]."""
        self._begin(observation)
        self.decided = due = self._period == 0
        own, deciding = observation.own, bool(due.any())
        features = self._observer.update(own, observation.ranges, self._setpoints, None, deciding).features
        if deciding:
            reference_rad = self._actions.reference_rad(own, self._observer.errors)
            chosen = self._decide(features[due])
            self._setpoints[due] = setpoints_of(chosen, reference_rad[due], self._table)
        self._period += 1
        self._period %= self._actions.hold
        return self._setpoints.copy()

    def _allocate(self, batch: int) -> None:
        self._observer = Observer(batch, self._lidar, self._observation)
        self._fresh = np.ones(batch, dtype=bool)
        self._period = np.zeros(batch, np.int64)
        self._setpoints = np.zeros((batch, 2))
        self.decided = np.zeros(batch, dtype=bool)

    def _begin(self, observation: Observation) -> None:
        if not self._fresh.any():
            return
        paths = [observation.path[b, : observation.path_length[b]] for b in np.flatnonzero(self._fresh)]
        self._observer.reset(self._fresh, paths)
        self._period[self._fresh] = 0
        self._fresh[:] = False
