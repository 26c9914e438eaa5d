"""Actions: a grid of heading changes and speeds, the paper's 27 by default."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.types import YAW, Array, IntArray

COURSE = 2  # column of the path errors: heading minus line-of-sight course


@dataclass(frozen=True)
class ActionParams:
    """The action grid; action number = heading index * speeds + speed index.

    reference: what a heading change is counted from, the vessel's heading (as the paper has it) or
    the line-of-sight course of its path. hold: decision periods that an action lasts.
    """

    heading_change_rad: tuple[float, ...] = tuple(math.radians(-30.0 + 7.5 * k) for k in range(9))
    speed_mps: tuple[float, ...] = (1.0, 2.5, 5.0)
    reference: Literal['heading', 'path'] = 'heading'
    hold: int = 1
    ranges: ClassVar[Ranges] = {'hold': (1, 60)}

    def __post_init__(self) -> None:
        """Refuse an empty grid."""
        if not self.heading_change_rad or not self.speed_mps:
            raise ParamError('heading_change_rad and speed_mps need at least one value each')
        if self.reference not in ('heading', 'path'):
            raise ParamError(f'reference = {self.reference!r} must be heading or path')
        check_ranges(self)

    @property
    def count(self) -> int:
        """Number of actions A."""
        return len(self.heading_change_rad) * len(self.speed_mps)

    def table(self) -> Array:
        """Heading change in rad and speed in m/s of each action [A, 2]."""
        heading, speed = np.meshgrid(self.heading_change_rad, self.speed_mps, indexing='ij')
        return np.column_stack([heading.ravel(), speed.ravel()])

    def reference_rad(self, own: Array, errors: Array) -> Array:
        """Map heading [B] that changes are counted from.

        Args:
            own: [B, 7] state rows.
            errors: [B, 3] path errors, of which the last is heading minus line-of-sight course.
        """
        if self.reference == 'heading':
            return np.asarray(own[:, YAW])
        return np.asarray(own[:, YAW] - errors[:, COURSE])


def setpoints_of(actions: IntArray, reference_rad: Array, table: Array) -> Array:
    """Setpoints [B, 2] of actions [B], counted from headings [B]."""
    chosen = table[actions]
    return np.column_stack([reference_rad + chosen[:, 0], chosen[:, 1]])
