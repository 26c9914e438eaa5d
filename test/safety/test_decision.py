"""Pass, slow down, stop and release."""

import math

import pytest

from portnav_ros.safety.decision import (
    Hold,
    Release,
    SetpointParams,
    Situation,
    decide,
    held,
    judge_setpoint,
)
from portnav_ros.types import Setpoint

PARAMS = SetpointParams(release_s=2.0)
SAIL = Setpoint(0.3, 4.0)


def run(*situations):
    """Setpoint and reason of each situation, one after the other."""
    state, found = Release(), []
    for situation in situations:
        state, setpoint, reason = decide(PARAMS, state, situation)
        found.append((setpoint, reason))
    return found


def at(time_s, reason='', setpoint=SAIL, limit_mps=math.inf, yaw_rad=1.0):
    return Situation(time_s, yaw_rad, setpoint, reason, limit_mps)


def test_the_first_setpoint_passes_at_once_and_untouched():
    (_, before), (setpoint, reason) = run(at(0.0, setpoint=None), at(0.1))
    assert before == 'no setpoint_raw yet'
    assert setpoint is SAIL
    assert reason == ''


def test_a_stop_keeps_the_heading_at_its_beginning():
    found = run(at(0.0), at(1.0, 'scan too old', yaw_rad=0.5), at(1.1, 'scan too old', yaw_rad=0.7))
    assert found[1:] == [(Setpoint(0.5, 0.0), 'scan too old')] * 2


def test_a_stop_ends_when_there_was_no_reason_for_a_while():
    found = run(at(0.0), at(1.0, 'fault'), at(1.1), at(3.0), at(3.1))
    assert [reason for _, reason in found] == ['', 'fault', 'fault', 'fault', '']
    assert found[-1][0] is SAIL


def test_a_reason_in_between_starts_the_wait_anew():
    found = run(at(0.0), at(1.0, 'fault'), at(1.1), at(2.0, 'another'), at(2.1), at(3.2), at(4.2))
    assert [reason for _, reason in found] == ['', 'fault', 'fault', 'another', 'another', 'another', '']


def test_a_clock_that_jumps_back_starts_the_wait_anew():
    found = run(at(100.0), at(101.0, 'fault'), at(101.1), at(0.0), at(1.9), at(2.0))
    assert [bool(reason) for _, reason in found] == [False, True, True, True, True, False]


def test_a_limit_slows_at_once_and_rises_after_a_while():
    found = run(at(0.0), at(1.0, limit_mps=2.5), at(2.0), at(2.9, limit_mps=3.0), at(3.1))
    assert [setpoint.speed_mps for setpoint, _ in found] == [4.0, 2.5, 2.5, 2.5, 4.0]
    assert found[1] == (Setpoint(0.3, 2.5), 'slowed: little room ahead')


def test_no_room_is_a_speed_of_zero_on_the_heading_asked_for():
    assert run(at(0.0, limit_mps=0.0)) == [(Setpoint(0.3, 0.0), 'no room to stop in')]


def test_a_limit_above_what_is_asked_for_changes_nothing():
    assert run(at(0.0, limit_mps=4.5)) == [(SAIL, '')]


@pytest.mark.parametrize(
    ('last', 'setpoint', 'sense'),
    [
        (None, Setpoint(3.0, 5.0), True),
        (SAIL, Setpoint(0.3 + 2.7, 5.0), True),
        (SAIL, Setpoint(0.3 - math.pi, 5.0), False),
        (Setpoint(3.1, 4.0), Setpoint(-3.1, 4.0), True),
        (SAIL, Setpoint(0.3 - math.pi, 0.0), True),
        (Setpoint(0.3, 0.0), Setpoint(0.3 - math.pi, 5.0), True),
        (SAIL, Setpoint(0.3, 12.1), False),
        (SAIL, Setpoint(0.3, -0.1), False),
        (SAIL, Setpoint(0.3, math.nan), False),
    ],
)
def test_what_makes_sense(last, setpoint, sense):
    assert (judge_setpoint(PARAMS, last, setpoint) == '') is sense


def test_without_a_wait_a_stop_ends_with_its_reason():
    assert held(Hold(cleared=True, reason='fault'), '', 5.0, 0.0) == Hold(cleared=True)
