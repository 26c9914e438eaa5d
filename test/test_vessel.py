"""The vessel against closed forms."""

import dataclasses
import math

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.types import RUDDER, SURGE, THRUST, YAW, YAW_RATE, X, Y
from portnav_ros.vessel import VesselParams, move_actuators, move_hull

VESSEL = VesselParams()
DT = 0.05


def sail(own, seconds, vessel=VESSEL, dt=DT):
    model = vessel.model()
    for _ in range(round(seconds / dt)):
        move_hull(model, own, dt)
    return own


def test_the_default_is_the_preset_of_its_name():
    assert load_vessel(VESSEL.name) == VESSEL


def test_speed_from_rest_is_a_hyperbolic_tangent():
    own = np.zeros(7)
    own[THRUST] = VESSEL.thrust_max_n
    limit = VESSEL.speed_max_mps
    sail(own, 12.0)
    assert own[SURGE] == pytest.approx(
        limit * math.tanh(VESSEL.thrust_max_n * 12.0 / (VESSEL.mass_kg * limit)), rel=2e-3
    )


def test_coasting_speed_falls_hyperbolically():
    own = np.zeros(7)
    own[SURGE] = 5.0
    sail(own, 48.0)
    decay = VESSEL.drag_kg_per_m * 5.0 * 48.0 / VESSEL.mass_kg
    assert own[SURGE] == pytest.approx(5.0 / (1.0 + decay), rel=2e-3)


def test_astern_thrust_reaches_a_bounded_speed():
    own = np.zeros(7)
    own[THRUST] = VESSEL.thrust_min_n
    sail(own, 600.0)
    assert own[SURGE] == pytest.approx(-math.sqrt(-VESSEL.thrust_min_n / VESSEL.drag_kg_per_m), rel=1e-3)


def test_rudder_step_follows_nomoto():
    own = np.zeros(7)
    own[SURGE], own[THRUST] = 5.0, VESSEL.thrust_max_n
    own[RUDDER] = 0.1
    sail(own, 10.0, dt=0.01)
    gain = VESSEL.turn_gain * 5.0 / VESSEL.length_m
    lag = VESSEL.turn_lag * VESSEL.length_m / 5.0
    expected = gain * 0.1 * (10.0 - lag * (1.0 - math.exp(-10.0 / lag)))
    assert own[YAW] == pytest.approx(expected, rel=5e-3)


def test_steady_turn_has_the_radius_of_the_preset():
    own = np.zeros(7)
    own[SURGE], own[THRUST], own[RUDDER] = 5.0, VESSEL.thrust_max_n, VESSEL.rudder_max_rad
    sail(own, 60.0)
    assert own[SURGE] / own[YAW_RATE] == pytest.approx(
        VESSEL.length_m / (VESSEL.turn_gain * VESSEL.rudder_max_rad), rel=1e-3
    )


def test_vessel_at_rest_does_not_turn():
    own = np.zeros(7)
    own[RUDDER] = VESSEL.rudder_max_rad
    sail(own, 60.0)
    assert own[[X, Y, YAW]].tolist() == [0.0, 0.0, 0.0]


def test_port_and_starboard_are_mirror_images():
    port, starboard = np.zeros(7), np.zeros(7)
    for own, side in ((port, 1.0), (starboard, -1.0)):
        own[SURGE], own[RUDDER] = 4.0, side * 0.3
        sail(own, 30.0)
    np.testing.assert_allclose(port[[X, SURGE]], starboard[[X, SURGE]])
    np.testing.assert_allclose(port[[Y, YAW, YAW_RATE]], -starboard[[Y, YAW, YAW_RATE]])


def test_actuators_obey_rates_and_limits():
    own, model = np.zeros(7), VESSEL.model()
    move_actuators(model, own, 10.0, -1e9, 1.0)
    assert own[RUDDER] == pytest.approx(VESSEL.rudder_rate_radps)
    assert own[THRUST] == pytest.approx(-VESSEL.thrust_rate_nps)
    for _ in range(100):
        move_actuators(model, own, 10.0, -1e9, 1.0)
    assert own[RUDDER] == pytest.approx(VESSEL.rudder_max_rad)
    assert own[THRUST] == pytest.approx(VESSEL.thrust_min_n)


def test_printed_model_runs_away_astern():
    literal = dataclasses.replace(VESSEL, paper_literal=True)
    own = np.zeros(7)
    own[THRUST] = -VESSEL.thrust_max_n
    sail(own, 60.0, literal)
    assert own[SURGE] < -50.0


def test_printed_model_turns_at_rest_and_does_not_damp():
    literal = dataclasses.replace(VESSEL, paper_literal=True)
    own = np.zeros(7)
    own[RUDDER] = 0.1
    sail(own, 10.0, literal)
    assert own[YAW_RATE] == pytest.approx(0.1 * literal.paper_turn_gain * 10.0)


def test_a_hull_wider_than_long_is_refused():
    with pytest.raises(ParamError, match='beam_m'):
        VesselParams(length_m=5.0, beam_m=8.0)
