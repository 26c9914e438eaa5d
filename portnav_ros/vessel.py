"""Own-ship dynamics: the 3-DOF model of Herremans et al. (OMAE 2023), with its gaps closed.

Printed in the paper (heading from north, degrees)::

    F_drag = 1/2 rho s^2 c_d A      a = (u_thrust - F_drag) / m
    s += a dt    theta_dot += u_heading T dt    theta += theta_dot dt
    x += sin(theta) s dt            y += cos(theta) s dt

Here the state is ENU and radians. Drag opposes the motion (s|s|), so that astern thrust cannot run
away, and yaw is a first-order Nomoto model whose gain and time constant scale with speed, so that a
vessel at rest does not turn and a step of the rudder does not ring (Fossen 2011, section 7.2.4)::

    r_dot = (K (s / L) delta - r) |s| / (tau L)

``paper_literal`` runs the printed equations instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from numba import njit

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.types import RUDDER, SURGE, THRUST, YAW, YAW_RATE, Array, X, Y

MIN_DAMPING_SPEED_MPS = 0.5


@dataclass(frozen=True)
class VesselParams:
    """A vessel preset, as in config/vessels/*.yaml; by default its ``shuttle``.

    The steady turn at full rudder has the radius ``length_m / (turn_gain * rudder_max_rad)``.

    name: of the preset. length_m: of the hull. beam_m: of the hull, at most its length. mass_kg: of the
    vessel. drag_kg_per_m: k = 1/2 rho c_d A, so that the drag is k s|s|. thrust_max_n: full ahead.
    thrust_min_n: full astern; 0 for a vessel without reverse thrust. thrust_rate_nps: how fast thrust
    changes. rudder_max_rad: largest angle to either side. rudder_rate_radps: how fast the rudder turns.
    turn_gain: K, steady yaw rate = K (s / L) rudder. turn_lag: tau, time constant in hull lengths sailed.
    paper_literal: run the equations as the paper prints them. paper_turn_gain: T of the printed equations,
    in 1/s^2.
    """

    name: str = 'shuttle'
    length_m: float = 20.0
    beam_m: float = 5.0
    mass_kg: float = 90.0e3
    drag_kg_per_m: float = 1500.0
    thrust_max_n: float = 37.5e3
    thrust_min_n: float = -15.0e3
    thrust_rate_nps: float = 3.75e3
    rudder_max_rad: float = 0.6108652381980153
    rudder_rate_radps: float = 0.08726646259971647
    turn_gain: float = 1.09
    turn_lag: float = 0.7
    paper_literal: bool = False
    paper_turn_gain: float = 0.01
    ranges: ClassVar[Ranges] = {
        'length_m': (1.0, 500.0),
        'beam_m': (0.3, 80.0),
        'mass_kg': (10.0, 1e9),
        'drag_kg_per_m': (1e-3, 1e8),
        'thrust_max_n': (1.0, 1e9),
        'thrust_min_n': (-1e9, 0.0),
        'thrust_rate_nps': (1e-3, 1e9),
        'rudder_max_rad': (0.01, 1.6),
        'rudder_rate_radps': (1e-3, 10.0),
        'turn_gain': (1e-3, 100.0),
        'turn_lag': (1e-3, 100.0),
        'paper_turn_gain': (1e-6, 100.0),
    }

    def __post_init__(self) -> None:
        """Refuse values that are not a vessel."""
        check_ranges(self)
        if self.beam_m > self.length_m:
            raise ParamError(f'beam_m = {self.beam_m} exceeds length_m = {self.length_m}')

    @property
    def speed_max_mps(self) -> float:
        """Steady speed at full thrust, sqrt(u / k)."""
        return math.sqrt(self.thrust_max_n / self.drag_kg_per_m)

    def model(self) -> VesselModel:
        """Return the constants that the kernels read."""
        return VesselModel(
            self.length_m,
            self.beam_m,
            self.mass_kg,
            self.drag_kg_per_m,
            self.thrust_max_n,
            self.thrust_min_n,
            self.thrust_rate_nps,
            self.rudder_max_rad,
            self.rudder_rate_radps,
            self.paper_turn_gain if self.paper_literal else self.turn_gain,
            self.turn_lag,
            self.paper_literal,
        )


class VesselModel(NamedTuple):
    """VesselParams as scalars for compiled code."""

    length_m: float
    beam_m: float
    mass_kg: float
    drag_kg_per_m: float
    thrust_max_n: float
    thrust_min_n: float
    thrust_rate_nps: float
    rudder_max_rad: float
    rudder_rate_radps: float
    turn_gain: float
    turn_lag: float
    paper_literal: bool


@njit(cache=True)
def move_actuators(model: VesselModel, own: Array, rudder_rad: float, thrust_n: float, dt_s: float) -> None:
    """Move rudder and thrust of a state row [7] towards their commands, within rates and limits."""
    rudder = min(max(rudder_rad, -model.rudder_max_rad), model.rudder_max_rad)
    thrust = min(max(thrust_n, model.thrust_min_n), model.thrust_max_n)
    rudder_step = model.rudder_rate_radps * dt_s
    thrust_step = model.thrust_rate_nps * dt_s
    own[RUDDER] += min(max(rudder - own[RUDDER], -rudder_step), rudder_step)
    own[THRUST] += min(max(thrust - own[THRUST], -thrust_step), thrust_step)


@njit(cache=True)
def move_hull(model: VesselModel, own: Array, dt_s: float) -> None:
    """Advance a state row [7] by dt (0.25 s or less) under its present rudder and thrust."""
    surge = own[SURGE]
    if model.paper_literal:
        drag = model.drag_kg_per_m * surge * surge
        own[YAW_RATE] += own[RUDDER] * model.turn_gain * dt_s
    else:
        drag = model.drag_kg_per_m * surge * abs(surge)
        steady = model.turn_gain * surge / model.length_m * own[RUDDER]
        rate = max(abs(surge), MIN_DAMPING_SPEED_MPS) / (model.turn_lag * model.length_m)
        own[YAW_RATE] += (steady - own[YAW_RATE]) * min(rate * dt_s, 1.0)
    own[SURGE] = surge + (own[THRUST] - drag) / model.mass_kg * dt_s
    middle = own[YAW] + 0.5 * own[YAW_RATE] * dt_s
    mean = 0.5 * (surge + own[SURGE])
    own[X] += math.cos(middle) * mean * dt_s
    own[Y] += math.sin(middle) * mean * dt_s
    own[YAW] += own[YAW_RATE] * dt_s
