"""The adapter of the local planners: one setpoint for each decision, a stop where something is missing."""

import math

import numpy as np
import pytest

from portnav_ros.nodes.local_planner import LocalPlanner, PlannerParams
from portnav_ros.nodes.messages import (
    fill_joints,
    fill_odometry,
    fill_scan,
    new_joints,
    new_odometry,
    new_scan,
    path_message,
    read_setpoint,
    read_stamp,
    read_values,
)
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation, VesselState

SECOND_NS = 1_000_000_000
PATH = np.column_stack([np.arange(0.0, 1000.0, 10.0), np.zeros(100)])
SAIL = (0.25, 4.0)


class Constant:
    """A policy that remembers what it has seen and always asks for the same."""

    def __init__(self):
        self.seen = []
        self.resets = 0
        self.setpoint = SAIL

    def reset(self, which):
        self.resets += 1

    def act(self, observation):
        self.seen.append(observation._replace(own=observation.own.copy(), ranges=observation.ranges.copy()))
        return np.array([self.setpoint])


class Stack:
    """A local planner, its policy, and a driver that feeds it; time is what the odometry tells."""

    def __init__(self, graph, clock, **parameters):
        self.policy, self._graph, self._clock = Constant(), graph, clock
        graph.listen('setpoint_raw', 'navigation_state', 'diagnostics', 'goal_pose')
        self.node = graph.add(
            lambda **options: LocalPlanner('planner', lambda params: self.policy, PlannerParams(), **options),
            **parameters,
        )
        self.node.steady_s = clock
        self.policy.seen.clear()

    def plan(self, path=PATH):
        self._graph.publish('plan', path_message(path, 0))

    def pass_to(self, time_ns):
        self._clock.now_s = 100.0 + time_ns / SECOND_NS

    def odom(self, time_ns, x=0.0, yaw=0.1):
        self.pass_to(time_ns)
        message = new_odometry()
        fill_odometry(message, time_ns, VesselState(x, 0.0, yaw, 3.0))
        self._graph.publish('odom', message)

    def scan(self, time_ns, value=100.0, rays=180, **fields):
        message = new_scan(LidarParams(rays=rays), 0.1)
        for name, field in fields.items():
            setattr(message, name, field)
        fill_scan(message, time_ns, np.full(rays, value, np.float32))
        self._graph.publish('scan', message)

    def joints(self, time_ns, actuation=Actuation(0.2, 1000.0)):  # noqa: B008 - immutable
        message = new_joints()
        fill_joints(message, time_ns, actuation)
        self._graph.publish('joint_states', message)

    def settle(self, time_ns):
        """Plan, sensors and odometry of one moment, in the order in which nothing is decided early."""
        self.plan()
        self._graph.until(lambda: self.node._path is not None, 'the plan')
        self.moment(time_ns)

    def moment(self, time_ns, **pose):
        """Scan and odometry of one moment, both taken in."""
        self.pass_to(time_ns)
        self.scan(time_ns)
        self._graph.until(lambda: self.node._scan_ns == time_ns, 'the scan')
        self.odom(time_ns, **pose)
        self._graph.until(lambda: self.node._time_ns == time_ns, 'the odometry')

    def sail_to_the_goal(self):
        """From the first second to the third."""
        self.settle(SECOND_NS)
        for k, x_m in enumerate((350.0, 700.0), 2):
            self.moment(k * SECOND_NS, x=x_m)
            self.answer(k * SECOND_NS)
        self.moment(4 * SECOND_NS, x=950.0)
        self.stopped('goal reached')

    def silence(self, length_s):
        """Let time pass in which nobody speaks."""
        self._clock.now_s += length_s

    def answer(self, time_ns, **wanted):
        message = self._graph.last('setpoint_raw', lambda m: read_stamp(m.header.stamp) == time_ns)
        return read_setpoint(message)

    def stopped(self, reason):
        self._graph.last('navigation_state', lambda state: state.message == f'stop: {reason}')
        return read_setpoint(self._graph.last('setpoint_raw', lambda m: m.twist.twist.linear.x == 0.0))


@pytest.fixture
def stack(graph, clock):
    return Stack(graph, clock)


@pytest.fixture
def patient(graph, clock):
    """A planner whose sensors may be late."""
    return Stack(graph, clock, age_s=60.0)


def test_a_decision_gets_the_policys_setpoint(patient):
    patient.settle(SECOND_NS)
    assert patient.answer(SECOND_NS) == pytest.approx(SAIL)
    seen = patient.policy.seen[-1]
    assert seen.own[0, :4] == pytest.approx((0.0, 0.0, 0.1, 3.0))
    assert (seen.ranges == 100.0).all()
    np.testing.assert_array_equal(seen.path[0, : seen.path_length[0]], PATH)


def test_between_decisions_nothing_is_decided(graph, patient):
    patient.settle(SECOND_NS)
    patient.answer(SECOND_NS)
    for tenth in range(1, 11):
        patient.scan(SECOND_NS + tenth * SECOND_NS // 10)
        patient.odom(SECOND_NS + tenth * SECOND_NS // 10)
    patient.answer(2 * SECOND_NS)
    graph.until(lambda: patient.node._time_ns == 2 * SECOND_NS)
    assert {read_stamp(m.header.stamp) for m in graph.heard['setpoint_raw']} == {SECOND_NS, 2 * SECOND_NS}


def test_a_new_plan_is_answered_at_once(patient):
    patient.settle(SECOND_NS)
    patient.answer(SECOND_NS)
    count, resets = len(patient.policy.seen), patient.policy.resets
    patient.plan(PATH + 5.0)
    patient._graph.until(lambda: len(patient.policy.seen) > count, 'another decision')
    assert patient.policy.resets == resets + 1


def test_without_a_plan_the_vessel_is_stopped(patient):
    patient.scan(0)
    patient._graph.until(lambda: patient.node._scan_ns == 0)
    patient.odom(0, yaw=0.7)
    assert patient.stopped('no plan') == pytest.approx((0.7, 0.0))
    assert not patient.policy.seen


def test_without_a_scan_the_vessel_is_stopped(stack):
    stack.plan()
    stack.odom(SECOND_NS)
    stack.stopped('no scan yet')


def test_an_old_scan_stops_the_vessel_before_the_next_decision(stack):
    stack.settle(SECOND_NS)
    stack.answer(SECOND_NS)
    stack.odom(SECOND_NS + 600_000_000)
    stack.stopped('scan too old')


def test_a_silent_driver_stops_the_vessel_and_the_stop_is_repeated(graph, stack):
    stack.settle(SECOND_NS)
    stack.answer(SECOND_NS)
    stack.silence(0.6)
    stack.stopped('odom too old')
    count = len(graph.heard['setpoint_raw'])
    graph.until(lambda: len(graph.heard['setpoint_raw']) > count + 3, 'more stops')


@pytest.mark.parametrize(
    ('scan', 'reason'),
    [
        ({'value': math.nan}, 'only NaN'),
        ({'rays': 90}, '90 rays, expected 180'),
        ({'value': -3.0}, 'below 0'),
        ({'angle_min': 0.0}, 'angle_min 0.0000'),
        ({'angle_increment': -math.pi / 90}, 'angle_increment -0.0349'),
    ],
)
def test_a_bad_scan_is_refused_and_the_vessel_stopped(graph, stack, scan, reason):
    stack.plan()
    graph.until(lambda: stack.node._path is not None)
    stack.scan(SECOND_NS, **scan)
    stack.odom(SECOND_NS)
    stack.stopped('no scan yet')
    graph.until(lambda: 'scan' in stack.node.vitals.reasons)
    assert reason in stack.node.vitals.reasons['scan']
    stack.odom(SECOND_NS + 600_000_000)
    graph.until(lambda: stack.node._time_ns > SECOND_NS)
    stack.moment(2 * SECOND_NS)
    assert stack.answer(2 * SECOND_NS) == pytest.approx(SAIL)


def test_a_scan_from_the_future_cannot_pass_for_fresh_for_ever(graph, stack):
    stack.settle(SECOND_NS)
    stack.answer(SECOND_NS)
    stack.scan(3600 * SECOND_NS)
    graph.until(lambda: 'scan' in stack.node.vitals.reasons)
    stack.odom(SECOND_NS + 600_000_000)
    stack.stopped('scan too old')


def test_at_the_goal_the_vessel_is_stopped(patient):
    patient.sail_to_the_goal()


def test_a_vessel_that_has_arrived_does_not_set_off_by_itself(graph, patient):
    patient.sail_to_the_goal()
    patient.moment(5 * SECOND_NS, x=800.0)
    assert patient.answer(5 * SECOND_NS).speed_mps == 0.0
    patient.plan(PATH + np.array([0.0, 50.0]))
    graph.until(lambda: patient.node._path[0, 1] == 50.0, 'the other plan')
    patient.moment(6 * SECOND_NS, x=800.0)
    assert patient.answer(6 * SECOND_NS) == pytest.approx(SAIL)


def test_a_path_that_ends_where_it_begins_is_sailed(graph, patient):
    patient.plan(np.array([[0.0, 0.0], [500.0, 0.0], [500.0, 20.0], [0.0, 20.0]]))
    graph.until(lambda: patient.node._path is not None, 'the plan')
    patient.moment(0)
    assert patient.answer(0) == pytest.approx(SAIL)


def test_feedback_that_is_too_old_is_none(graph, stack):
    stack.joints(SECOND_NS)
    graph.until(lambda: stack.node._joints_ns == SECOND_NS)
    stack.settle(SECOND_NS)
    stack.answer(SECOND_NS)
    assert stack.policy.seen[-1].own[0, 5:7] == pytest.approx((0.2, 1000.0))
    stack.moment(2 * SECOND_NS)
    stack.answer(2 * SECOND_NS)
    assert stack.policy.seen[-1].own[0, 5:7] == pytest.approx((0.0, 0.0))
    assert graph.status('planner', lambda status: 'joint_states too old' in status.message)


def test_a_policy_that_gives_nonsense_stops_the_vessel(patient):
    patient.policy.setpoint = (math.nan, 1.0)
    patient.settle(SECOND_NS)
    patient.stopped('the policy gave a setpoint that is not finite')


def test_the_state_tells_progress_and_errors(graph, patient):
    patient.settle(SECOND_NS)
    values = read_values(graph.last('navigation_state', lambda state: state.message == 'sailing'))
    assert values['goal'] == '990.00 0.00'
    assert float(values['progress']) == 0.0
    assert float(values['e_psi_rad']) == pytest.approx(0.1, abs=1e-3)


def test_a_plan_of_any_spacing_is_followed_by_its_length(graph, patient):
    patient.plan(np.array([[-100.0, 0.0], [900.0, 0.0]]))
    graph.until(lambda: patient.node._path is not None, 'the plan')
    patient.moment(0)
    patient.answer(0)
    state = graph.last('navigation_state', lambda state: 'progress' in read_values(state))
    assert float(read_values(state)['progress']) == pytest.approx(0.1, abs=1e-3)


def test_a_clock_that_jumps_back_begins_anew(patient):
    patient.settle(5 * SECOND_NS)
    patient.answer(5 * SECOND_NS)
    patient.odom(0)
    patient._graph.until(lambda: patient.node._time_ns == 0)
    patient.scan(0)
    assert patient.answer(0) == pytest.approx(SAIL)


def test_in_lock_step_a_decision_waits_for_all_of_its_stamp(graph, clock):
    stack = Stack(graph, clock, lock_step=True)
    stack.odom(0)
    stack.scan(0)
    stack.joints(0)
    stack.plan()
    assert stack.answer(0) == pytest.approx(SAIL)
    assert stack.policy.seen[-1].own[0, 5:7] == pytest.approx((0.2, 1000.0))
    stack.odom(SECOND_NS)
    stack.joints(SECOND_NS)
    graph.until(lambda: stack.node._joints_ns == stack.node._time_ns == SECOND_NS)
    assert len(stack.policy.seen) == 1
    stack.scan(SECOND_NS)
    stack.answer(SECOND_NS)


def test_in_lock_step_a_bad_scan_is_answered_with_a_stop(graph, clock):
    stack = Stack(graph, clock, lock_step=True)
    stack.plan()
    stack.odom(0)
    stack.joints(0)
    stack.scan(0, value=math.nan)
    assert stack.answer(0).speed_mps == 0.0


def test_after_a_stop_the_policy_begins_anew(graph, clock):
    stack = Stack(graph, clock, lock_step=True, release_s=0.0)
    stack.plan()
    for second, value in enumerate((100.0, 100.0, math.nan, 100.0)):
        resets = stack.policy.resets
        stack.odom(second * SECOND_NS)
        stack.joints(second * SECOND_NS)
        stack.scan(second * SECOND_NS, value=value)
        stack.answer(second * SECOND_NS)
        assert second == 0 or stack.policy.resets == resets + (second == 3)


def test_after_a_stop_it_waits_before_it_sails_again(graph, stack):
    stack.settle(SECOND_NS)
    stack.answer(SECOND_NS)
    stack.odom(SECOND_NS + 600_000_000)
    stack.stopped('scan too old')
    count = len(stack.policy.seen)
    for tenth in range(17, 38):
        assert len(stack.policy.seen) == count
        stack.moment(tenth * SECOND_NS // 10)
        stack.node._watch()
    assert stack.answer(3_700_000_000) == pytest.approx(SAIL)


def test_odometry_whose_stamp_stands_still_is_too_old(graph, stack):
    stack.settle(SECOND_NS)
    stack.moment(SECOND_NS + 100_000_000)
    for _ in range(7):
        stack.silence(0.1)
        message = new_odometry()
        fill_odometry(message, SECOND_NS + 100_000_000, VesselState(0.0, 0.0, 0.1, 3.0))
        graph.publish('odom', message)
    stack.stopped('odom too old')


def test_a_vessel_that_gets_no_further_is_given_another_plan_once_and_then_stopped(graph, clock):
    stack = Stack(graph, clock, lock_step=False, age_s=60.0, stuck_s=3.0, period_s=1.0)
    stack.settle(SECOND_NS)
    for second in range(2, 6):
        stack.moment(second * SECOND_NS)
    goal = graph.last('goal_pose').pose.position
    assert (goal.x, goal.y) == (990.0, 0.0)
    for second in range(6, 11):
        stack.moment(second * SECOND_NS)
    stack.stopped('stuck: no progress along the plan')
    assert len(graph.heard['goal_pose']) == 1
    stack.plan(PATH + 1.0)
    graph.last(
        'navigation_state', lambda state: state.message == 'sailing' and '991' in state.values[2].value
    )


def test_a_vessel_that_gets_further_is_not_stuck(graph, clock):
    stack = Stack(graph, clock, lock_step=False, age_s=60.0, stuck_s=3.0, period_s=1.0)
    stack.settle(SECOND_NS)
    for second in range(2, 12):
        stack.moment(second * SECOND_NS, x=5.0 * second)
    assert stack.answer(11 * SECOND_NS) == pytest.approx(SAIL)
    assert not graph.heard['goal_pose']
