"""Both loops on the vessel they steer."""

import math

import numpy as np
import pytest

from portnav_ros.control.autopilot import AutopilotParams, steer
from portnav_ros.types import RUDDER, SURGE, YAW
from portnav_ros.vessel import VesselParams, move_actuators, move_hull

DT = 0.05
SMALL = VesselParams()
LARGE = VesselParams(
    length_m=110.0,
    beam_m=11.4,
    mass_kg=3.95e6,
    drag_kg_per_m=4988.0,
    thrust_max_n=125e3,
    thrust_min_n=-50e3,
    thrust_rate_nps=12.5e3,
)


def run(vessel, own, yaw, speed, seconds, **changes):
    memory, model, gains = np.zeros(2), vessel.model(), AutopilotParams(**changes).gains()
    log = []
    for _ in range(round(seconds / DT)):
        rudder, thrust = steer(gains, model, memory, own, yaw, speed, DT)
        move_actuators(model, own, rudder, thrust, DT)
        move_hull(model, own, DT)
        log.append(own.copy())
    return np.array(log)


@pytest.mark.parametrize('vessel', [SMALL, LARGE], ids=['shuttle', 'barge'])
@pytest.mark.parametrize('speed', [1.0, 2.5, 5.0])
def test_heading_step_settles_with_little_overshoot(vessel, speed):
    own = np.zeros(7)
    own[SURGE] = speed
    log = run(vessel, own, math.radians(30.0), speed, 15.0 * vessel.length_m / speed)
    assert log[-1, YAW] == pytest.approx(math.radians(30.0), abs=math.radians(0.5))
    assert log[:, YAW].max() < math.radians(30.0 * 1.1)


@pytest.mark.parametrize('vessel', [SMALL, LARGE], ids=['shuttle', 'barge'])
def test_speed_step_settles(vessel):
    own = np.zeros(7)
    log = run(vessel, own, 0.0, 2.5, 400.0)
    assert log[-1, SURGE] == pytest.approx(2.5, abs=0.05)
    assert log[:, SURGE].max() < 2.5 * 1.15


def test_heading_takes_the_short_way_round():
    own = np.zeros(7)
    own[SURGE], own[YAW] = 5.0, math.radians(170.0)
    log = run(SMALL, own, math.radians(-170.0), 5.0, 60.0)
    assert log[-1, YAW] == pytest.approx(math.radians(190.0), abs=0.01)


def test_a_long_saturation_of_the_thrust_leaves_no_windup():
    log = run(LARGE, np.zeros(7), 0.0, 4.5, 600.0, speed_integral_limit=1.0)
    assert log[:, SURGE].max() < 4.5 * 1.02


def test_a_long_saturation_of_the_rudder_leaves_no_windup():
    own = np.zeros(7)
    own[SURGE] = 5.0
    log = run(SMALL, own, math.radians(170.0), 5.0, 60.0, heading_ki=0.02, heading_integral_limit=1.0)
    assert log[:, YAW].max() < math.radians(170.0 * 1.05)


def test_rudder_reverses_with_sternway():
    own = np.zeros(7)
    own[SURGE] = -1.0
    rudder, _ = steer(AutopilotParams().gains(), SMALL.model(), np.zeros(2), own, 0.3, -1.0, DT)
    assert rudder < 0.0
    own[RUDDER] = rudder
    move_hull(SMALL.model(), own, DT)
    assert own[YAW] > 0.0
