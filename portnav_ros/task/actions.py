"""The paper's 27 actions: 9 heading changes times 3 speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from portnav_ros.params import ParamError
from portnav_ros.types import YAW, Array, IntArray


@dataclass(frozen=True)
class ActionParams:
    """The action grid; action number = heading index * speeds + speed index."""

    heading_change_rad: tuple[float, ...] = tuple(math.radians(-30.0 + 7.5 * k) for k in range(9))
    speed_mps: tuple[float, ...] = (1.0, 2.5, 5.0)

    def __post_init__(self) -> None:
        """Refuse an empty grid."""
        if not self.heading_change_rad or not self.speed_mps:
            raise ParamError('heading_change_rad and speed_mps need at least one value each')

    @property
    def count(self) -> int:
        """Number of actions A."""
        return len(self.heading_change_rad) * len(self.speed_mps)

    def table(self) -> Array:
        """Heading change in rad and speed in m/s of each action [A, 2]."""
        heading, speed = np.meshgrid(self.heading_change_rad, self.speed_mps, indexing='ij')
        return np.column_stack([heading.ravel(), speed.ravel()])


def setpoints_of(actions: IntArray, own: Array, table: Array) -> Array:
    """Setpoints [B, 2] of actions [B] for state rows [B, 7], counted from the present heading."""
    chosen = table[actions]
    return np.column_stack([own[:, YAW] + chosen[:, 0], chosen[:, 1]])
