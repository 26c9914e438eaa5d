"""The formulas of docs/vessel.md: from what is measured in manoeuvres back to the preset that sailed them."""

import math

import numpy as np
import pytest

from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.types import RUDDER, SURGE, YAW, YAW_RATE, X, Y
from portnav_ros.vessel import move_actuators, move_hull

STEP_S = 0.02


class Trial:
    """A vessel under way, with every state it passes through."""

    def __init__(self, vessel, speed_mps):
        self.vessel, self.own, self.track = vessel, np.zeros(7), []
        self.own[SURGE] = speed_mps

    def sail(self, rudder_rad, thrust_n, until, limit_s=2000.0):
        """Hold a command until a condition on the state; returns the time it took."""
        for step in range(round(limit_s / STEP_S)):
            if until(self.own):
                return step * STEP_S
            move_actuators(self.vessel.model(), self.own, rudder_rad, thrust_n, STEP_S)
            move_hull(self.vessel.model(), self.own, STEP_S)
            self.track.append(self.own.copy())
        raise AssertionError('the condition never held')


def keeping(vessel, speed_mps):
    """Thrust that keeps a speed."""
    return vessel.drag_kg_per_m * speed_mps**2


@pytest.fixture(params=['workboat', 'cemt_iv'])
def vessel(request):
    return load_vessel(request.param)


def test_coasting_tells_the_mass_from_the_drag(vessel):
    trial = Trial(vessel, 4.0)
    half_s = trial.sail(0.0, 0.0, lambda own: own[SURGE] <= 2.0)
    assert vessel.mass_kg == pytest.approx(vessel.drag_kg_per_m * 4.0 * half_s, rel=0.02)


def test_full_speed_tells_the_thrust(vessel):
    trial = Trial(vessel, 4.0)
    trial.sail(0.0, vessel.thrust_max_n, lambda own: own[SURGE] > 0.999 * vessel.speed_max_mps)
    assert vessel.thrust_max_n == pytest.approx(vessel.drag_kg_per_m * trial.own[SURGE] ** 2, rel=0.01)


def test_the_turning_circle_tells_the_gain(vessel):
    trial, rudder_rad = Trial(vessel, 3.0), 0.4
    thrust_n = keeping(vessel, 3.0)
    trial.sail(rudder_rad, thrust_n, lambda own: own[YAW] > 2.0 * math.pi)
    begin = len(trial.track)
    trial.sail(rudder_rad, thrust_n, lambda own: own[YAW] > 3.0 * math.pi)
    across = np.subtract(trial.track[-1], trial.track[begin])[[X, Y]]
    diameter_m = math.hypot(*across)
    assert vessel.turn_gain == pytest.approx(2.0 * vessel.length_m / (diameter_m * rudder_rad), rel=0.02)


def test_the_zigzag_tells_the_lag(vessel):
    trial, rudder_rad, speed_mps = Trial(vessel, 3.0), 0.15, 3.0
    thrust_n = keeping(vessel, speed_mps)
    steady = vessel.turn_gain * speed_mps / vessel.length_m * rudder_rad
    trial.sail(rudder_rad, thrust_n, lambda own: own[YAW_RATE] > 0.99 * steady)
    rate_radps, yaw_rad = trial.own[YAW_RATE], trial.own[YAW]
    trial.own[RUDDER] = -rudder_rad  # the time of the rudder's own way is taken off
    trial.sail(-rudder_rad, thrust_n, lambda own: own[YAW_RATE] < 0.0)
    lag_s = (trial.own[YAW] - yaw_rad) / (0.307 * rate_radps)
    assert vessel.turn_lag == pytest.approx(lag_s * speed_mps / vessel.length_m, rel=0.05)
