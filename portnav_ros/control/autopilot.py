"""Heading and speed to rudder and thrust: two PID loops with limits and anti-windup.

Gains are those of a vessel of unit length at unit speed: the derivative gain is multiplied by
L / s, so that one set holds for a workboat and a barge and at every speed. With the Nomoto model of
vessel.py the closed loop is tau e'' + (1 + K kd) e' + K kp e = 0 in hull lengths sailed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from numba import njit

from portnav_ros.geometry import wrap_angle
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import SURGE, YAW, YAW_RATE, Array
from portnav_ros.vessel import VesselModel

HEADING_INTEGRAL, SPEED_INTEGRAL = range(2)
PID_SIZE = 2
MIN_SCHEDULE_SPEED_MPS = 1.0


@dataclass(frozen=True)
class AutopilotParams:
    """Gains of the two loops.

    heading_kp: rad of rudder for each rad of error. heading_ki: rad of rudder for each rad s of error.
    heading_kd: rad of rudder for each rad that the heading turns in a hull length sailed.
    heading_integral_limit: rad of rudder that the integral gives at most. speed_kp: in 1/s, times the mass.
    speed_ki: in 1/s^2, times the mass. speed_integral_limit: share of full thrust that the integral gives
    at most.
    """

    heading_kp: float = 1.2
    heading_ki: float = 0.0
    heading_kd: float = 1.0
    heading_integral_limit: float = 0.07
    speed_kp: float = 0.2
    speed_ki: float = 0.005
    speed_integral_limit: float = 0.2
    ranges: ClassVar[Ranges] = {
        'heading_kp': (0.0, 100.0),
        'heading_ki': (0.0, 100.0),
        'heading_kd': (0.0, 100.0),
        'heading_integral_limit': (0.0, 1.0),
        'speed_kp': (0.0, 100.0),
        'speed_ki': (0.0, 100.0),
        'speed_integral_limit': (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        """Refuse negative or absurd gains."""
        check_ranges(self)

    def gains(self) -> Gains:
        """Return the constants that the kernels read."""
        return Gains(
            self.heading_kp,
            self.heading_ki,
            self.heading_kd,
            self.heading_integral_limit,
            self.speed_kp,
            self.speed_ki,
            self.speed_integral_limit,
        )


class Gains(NamedTuple):
    """AutopilotParams as scalars for compiled code."""

    heading_kp: float
    heading_ki: float
    heading_kd: float
    heading_integral_limit: float
    speed_kp: float
    speed_ki: float
    speed_integral_limit: float


@njit(cache=True)
def steer(
    gains: Gains,
    model: VesselModel,
    memory: Array,
    own: Array,
    yaw_rad: float,
    speed_mps: float,
    dt_s: float,
) -> tuple[float, float]:
    """One step of both loops.

    Args:
        gains: PID gains.
        model: the vessel's limits, length, mass and drag.
        memory: [2] integrals, in rad of rudder and N; changed in place.
        own: [7] state row.
        yaw_rad: desired heading.
        speed_mps: desired surge speed.
        dt_s: time since the last step.

    Returns:
        Rudder in rad and thrust in N, within the vessel's limits.
    """
    error = wrap_angle(yaw_rad - own[YAW])
    schedule = model.length_m / max(abs(own[SURGE]), MIN_SCHEDULE_SPEED_MPS)
    raw = gains.heading_kp * error - gains.heading_kd * schedule * own[YAW_RATE]
    if abs(raw) < model.rudder_max_rad:
        grown = memory[HEADING_INTEGRAL] + gains.heading_ki * error * dt_s
        limit = gains.heading_integral_limit
        memory[HEADING_INTEGRAL] = min(max(grown, -limit), limit)
    rudder = raw + memory[HEADING_INTEGRAL]
    if own[SURGE] < 0.0 and not model.paper_literal:
        rudder = -rudder
    rudder = min(max(rudder, -model.rudder_max_rad), model.rudder_max_rad)

    lack = speed_mps - own[SURGE]
    thrust = model.drag_kg_per_m * speed_mps * abs(speed_mps) + gains.speed_kp * model.mass_kg * lack
    if model.thrust_min_n < thrust < model.thrust_max_n:
        grown = memory[SPEED_INTEGRAL] + gains.speed_ki * model.mass_kg * lack * dt_s
        limit = gains.speed_integral_limit * model.thrust_max_n
        memory[SPEED_INTEGRAL] = min(max(grown, -limit), limit)
    thrust += memory[SPEED_INTEGRAL]
    return rudder, min(max(thrust, model.thrust_min_n), model.thrust_max_n)
