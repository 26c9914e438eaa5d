"""The paper's reward by named terms: -|e| each step, +1000 at the goal, -1000 at a collision.

The paper gives no scale for e. Path errors over 50 m and pi reproduce its path cost of about 0.6 a
step (220 mean reward at 70 % success over 300 steps).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import Array, IntArray, Outcome

TERMS = ('e_x', 'e_y', 'e_psi', 'goal', 'collision')


@dataclass(frozen=True)
class RewardParams:
    """Scales of the path errors and the terminal rewards."""

    position_scale_m: float = 50.0
    heading_scale_rad: float = math.pi
    goal: float = 1000.0
    collision: float = -1000.0
    ranges: ClassVar[Ranges] = {
        'position_scale_m': (1e-3, 1e6),
        'heading_scale_rad': (1e-3, 1e3),
        'goal': (0.0, 1e9),
        'collision': (-1e9, 0.0),
    }

    def __post_init__(self) -> None:
        """Refuse zero scales."""
        check_ranges(self)


def reward_terms(params: RewardParams, errors: Array, outcome: IntArray) -> Array:
    """Reward by term [B, 5], in the order of TERMS.

    Args:
        params: scales.
        errors: [B, 3] e_x, e_y in m, e_psi in rad, after the step.
        outcome: [B] types.Outcome after the step.
    """
    scales = (params.position_scale_m, params.position_scale_m, params.heading_scale_rad)
    collided = (outcome >= Outcome.COLLISION_QUAY) & (outcome <= Outcome.COLLISION_VESSEL)
    ends = np.column_stack([params.goal * (outcome == Outcome.SUCCESS), params.collision * collided])
    return np.hstack([-np.abs(errors) / scales, ends])
