"""The moves of a simulated hull, which obeys in every way or fails in one."""

import numpy as np
import pytest

from portnav_ros.evaluation.driver.moves import NAMES, STEPS, check_moves, command_of, moves_left_out
from portnav_ros.evaluation.driver.record import DriverRecord, Expected, JointSample, Move, OdometrySample
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import RUDDER, SURGE, THRUST, YAW, YAW_RATE, Actuation, X, Y
from portnav_ros.vessel import move_actuators, move_hull

STEP_S = 0.05
NEUTRAL = Actuation(0.0, 0.0)


def sail(
    preset='workboat',
    rudder=1.0,
    thrust=1.0,
    neutral_s=1.0,
    obeys_enable=True,
    feedback=True,
    start_mps=0.0,
    noise=None,
    steps=STEPS,
):
    """Lead a hull through the moves; rudder, thrust: factors by which it takes commands wrongly."""
    vessel = load_vessel(preset)
    own, record, moves = np.zeros(7), DriverRecord(), []
    own[SURGE] = start_mps
    time_s, command, commanded_s, enabled = 0.0, NEUTRAL, -1e9, True
    for step in steps:
        enabled = enabled if step.enable is None else step.enable
        moves.append(Move(step.name, time_s, time_s + step.duration_s, command_of(step, vessel)))
        for _ in range(round(step.duration_s / STEP_S)):
            if not step.silent:
                command, commanded_s = command_of(step, vessel), time_s
            obeys = time_s - commanded_s <= neutral_s and (enabled or not obeys_enable)
            taken = command if obeys else NEUTRAL
            move_actuators(vessel.model(), own, rudder * taken.rudder_rad, thrust * taken.thrust_n, STEP_S)
            move_hull(vessel.model(), own, STEP_S)
            time_s += STEP_S
            record.odometry.append(sample(time_s, own, noise))
            if feedback:
                record.joints.append(JointSample(time_s, time_s, Actuation(own[RUDDER], own[THRUST])))
    found = check_moves(moves, record, Expected(vessel, LidarParams()))
    return {finding.check: finding for finding in found}


def sample(time_s, own, noise):
    surge_error, rate_error = noise.normal(0.0, (0.05, 0.01)) if noise else (0.0, 0.0)
    quaternion = 0.0, 0.0, float(np.sin(own[YAW] / 2.0)), float(np.cos(own[YAW] / 2.0))
    return OdometrySample(
        time_s,
        time_s,
        'map',
        'base_link',
        (own[X], own[Y]),
        quaternion,
        (own[SURGE] + surge_error, 0.0),
        own[YAW_RATE] + rate_error,
        np.ones((2, 6)),
    )


@pytest.mark.parametrize('feedback', [True, False])
@pytest.mark.parametrize(
    ('preset', 'start_mps'), [('workboat', 0.0), ('shuttle', 1.0), ('cemt_iv', 2.0), ('cemt_va', 2.0)]
)
def test_a_hull_that_obeys_passes(preset, start_mps, feedback):
    found = sail(preset, start_mps=start_mps, feedback=feedback)
    assert [finding.check for finding in found.values()] == list(NAMES)
    assert {finding.status for finding in found.values()} == {'ok'}, found


def test_the_noise_of_sensors_hides_no_effect_of_a_boat():
    found = sail(noise=np.random.default_rng(1))
    assert {finding.status for finding in found.values()} == {'ok'}, found


@pytest.mark.parametrize(
    ('check', 'fault', 'told'),
    [
        ('rudder', {'rudder': -1.0}, 'wrong way'),
        ('rudder', {'rudder': 0.0}, 'no clear effect'),
        ('thrust', {'thrust': -1.0}, 'astern'),
        ('thrust', {'thrust': 0.0}, 'no effect'),
        ('thrust', {'thrust': 0.0, 'start_mps': 1.0}, 'no effect'),
        ('neutral', {'neutral_s': 1e9}, 'did not move back'),
        ('neutral', {'neutral_s': 2.5}, '2.'),
        ('neutral', {'neutral_s': 1e9, 'feedback': False}, 'not seen'),
        ('disabled', {'obeys_enable': False}, 'did not move back'),
        ('disabled', {'obeys_enable': False, 'feedback': False}, 'not seen'),
    ],
)
def test_a_fault_is_found_and_mended(check, fault, told):
    finding = sail(**fault)[check]
    assert finding.status == 'fail', finding
    assert told in finding.found
    assert finding.mend


def test_no_effect_is_made_up_of_noise():
    generator = np.random.default_rng(2)
    found = sail(rudder=0.0, thrust=0.0, noise=generator)
    assert {found[check].status for check in ('rudder', 'thrust')} == {'fail'}, found
    assert {found[check].status for check in ('neutral', 'disabled')} == {'left out'}, found


def test_moves_that_were_not_made_are_left_out():
    found = sail(steps=STEPS[:2])
    assert {check: finding.status for check, finding in found.items()} == {
        'thrust': 'ok',
        'rudder': 'left out',
        'neutral': 'left out',
        'disabled': 'left out',
    }
    assert [finding.status for finding in moves_left_out('why')] == ['left out'] * len(NAMES)
