"""Progress along the plan, thrust one way on end, and publishers where one belongs."""

import pytest

from portnav_ros.safety.braking import ThrustBound, stopping_time_s
from portnav_ros.safety.progress import Advance, ProgressWatch
from portnav_ros.safety.rivals import GHOST_S, RivalWatch
from portnav_ros.vessel import VesselParams

GOAL = (100.0, 200.0)


def sail(watch, times, progress_m):
    return [watch.sail(float(time), progress_m(time)) for time in times]


@pytest.fixture
def watch():
    watch = ProgressWatch(60.0)
    watch.begin(GOAL, 50.0)
    return watch


def test_a_vessel_that_gets_on_is_let_sail(watch):
    assert set(sail(watch, range(600), lambda time: 0.2 * time)) == {Advance.SAIL_ON}


def test_a_stuck_vessel_gets_another_plan_once_and_is_given_up(watch):
    found = sail(watch, range(125), lambda time: 5.0)
    assert found.index(Advance.PLAN_ANEW) == 61
    assert found.index(Advance.GIVE_UP) == 122
    assert found.count(Advance.PLAN_ANEW) == 1


def test_to_and_fro_is_no_progress(watch):
    assert Advance.GIVE_UP in sail(watch, range(150), lambda time: 8.0 * (time % 2))


def test_time_at_rest_does_not_count(watch):
    sail(watch, range(50), lambda time: 0.0)
    watch.rest()
    assert set(sail(watch, range(1000, 1010), lambda time: 0.0)) == {Advance.SAIL_ON}


@pytest.mark.parametrize(('goal', 'again'), [((110.0, 210.0), False), ((500.0, 200.0), True)])
def test_only_another_goal_is_worth_another_plan(watch, goal, again):
    sail(watch, range(62), lambda time: 0.0)
    watch.begin(goal, 50.0)
    found = sail(watch, range(62, 125), lambda time: 0.0)
    assert (Advance.PLAN_ANEW in found) is again
    assert (Advance.GIVE_UP in found) is not again


def test_astern_thrust_is_bounded_on_end_and_allowed_again_after():
    bound = ThrustBound(2.0, VesselParams())
    assert [bound.apply(-5.0, 0.75, False) for _ in range(4)] == [-5.0, -5.0, 0.0, 0.0]
    assert bound.reached
    assert bound.apply(3.0, 0.75, False) == 3.0
    assert bound.apply(-5.0, 0.75, False) == -5.0


def test_thrust_ahead_is_bounded_only_during_a_stop():
    bound = ThrustBound(2.0, VesselParams())
    assert [bound.apply(5.0, 0.75, False) for _ in range(9)] == [5.0] * 9
    assert [bound.apply(5.0, 0.75, True) for _ in range(4)] == [5.0, 5.0, 0.0, 0.0]
    assert bound.apply(5.0, 0.75, False) == 5.0


def test_the_other_way_is_counted_anew():
    bound = ThrustBound(2.0, VesselParams())
    thrusts = (-5.0, -5.0, 5.0, 5.0, -5.0, -5.0, 0.0, -5.0, -5.0)
    assert [bound.apply(thrust, 0.75, True) for thrust in thrusts] == list(thrusts)
    assert bound.apply(-5.0, 0.75, True) == 0.0


def test_the_bound_leaves_time_for_a_stop_from_full_speed():
    vessel = VesselParams()
    bound = ThrustBound(0.0, vessel)
    seconds = int(stopping_time_s(vessel)) + 1
    assert [bound.apply(-1.0, 1.0, True) for _ in range(seconds)] == [-1.0] * seconds
    assert 0.0 in [bound.apply(-1.0, 1.0, True) for _ in range(seconds)]


def test_a_single_publisher_has_no_rival():
    assert RivalWatch('setpoint').note(['/safety_monitor'], 0.0) == ''


def test_rivals_are_named_at_once():
    told = RivalWatch('setpoint').note(['/safety_monitor', '/joystick'], 0.0)
    assert told == '2 publishers on setpoint: /joystick and /safety_monitor'


def test_a_publisher_that_was_killed_and_is_back_has_no_rival_but_a_second_one_has():
    watch, twice = RivalWatch('setpoint'), ['/safety_monitor', '/safety_monitor']
    assert watch.note(twice, 0.0) == ''
    assert watch.note(twice, GHOST_S - 1.0) == ''
    assert watch.note(twice, GHOST_S + 1.0) == '2 publishers on setpoint: 2 nodes named /safety_monitor'
    assert watch.note(twice[:1], GHOST_S + 2.0) == ''
    assert watch.note(twice, GHOST_S + 3.0) == ''
