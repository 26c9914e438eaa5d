"""Floor of the ladder: follow the path by line of sight, blind to everything else."""

from __future__ import annotations

import numpy as np
from numba import njit

from portnav_ros.geometry import wrap_angle
from portnav_ros.task.path_errors import path_errors
from portnav_ros.task.policy import Observation
from portnav_ros.types import YAW, Array, BoolArray, IntArray


class LineOfSight:
    """Steers for the line-of-sight point of the path at constant speed (Fossen 2011, section 10.3)."""

    def __init__(self, lookahead_m: float = 100.0, speed_mps: float = 5.0) -> None:
        """Follow the path.

        Args:
            lookahead_m: distance along the tangent from the closest path point to the point steered for.
            speed_mps: surge speed asked for at all times.
        """
        self.lookahead_m = lookahead_m
        self.speed_mps = speed_mps

    def reset(self, which: BoolArray) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]."""
        setpoints = np.empty((len(observation.own), 2))
        setpoints[:, 1] = self.speed_mps
        steer_along(
            observation.own,
            observation.path,
            observation.path_length,
            observation.progress,
            self.lookahead_m,
            setpoints,
        )
        return setpoints


@njit(cache=True, nogil=True)
def steer_along(
    own: Array, path: Array, count: IntArray, progress: Array, lookahead_m: float, setpoints: Array
) -> None:
    """Write the line-of-sight courses [B] in rad into the first column of setpoints [B, 2]."""
    for b in range(len(own)):
        errors = path_errors(own[b], path[b], count[b], progress[b], lookahead_m)
        setpoints[b, 0] = wrap_angle(own[b, YAW] - errors[2])
