"""The simulated driver: what it publishes and when, what it refuses, and how it waits."""

import math

import pytest
from std_srvs.srv import SetBool, Trigger

from portnav_ros.nodes.messages import (
    fill_joints,
    new_joints,
    path_message,
    read_joints,
    read_odometry,
    read_stamp,
    read_values,
)
from portnav_ros.nodes.sim import Sim
from portnav_ros.nodes.topics import TOPICS
from portnav_ros.sim.generator import load_scenario
from portnav_ros.types import Actuation

TICK_NS = 50_000_000
AHEAD = Actuation(0.1, 5e4)


@pytest.fixture(scope='module')
def scenario():
    return load_scenario('crossing', 0)


def command(time_ns, actuation=AHEAD):
    message = new_joints()
    fill_joints(message, time_ns, actuation)
    return message


def stamps(messages):
    return [read_stamp(message.header.stamp) for message in messages]


def sail(graph, ticks, scenario, lock_step=True, **parameters):
    """Answer a sim in lock-step for a number of ticks, as the stack would."""
    graph.listen('odom', 'scan', 'joint_states', 'targets', 'episode', 'diagnostics', lock_step=lock_step)
    sim = graph.add(Sim, scenario='crossing', lock_step=lock_step, **parameters)
    graph.publish('plan', path_message(scenario.path, 0))
    for tick in range(ticks):
        graph.until(lambda tick=tick: tick * TICK_NS in stamps(graph.heard['odom']), f'odom of tick {tick}')
        graph.publish('cmd_actuators', command(tick * TICK_NS))
    return sim


def test_topics_come_at_the_rates_of_the_table(graph, scenario):
    ticks = 40
    sail(graph, ticks, scenario)
    graph.until(lambda: ticks * TICK_NS in stamps(graph.heard['odom']))
    graph.until(lambda: ticks * TICK_NS in stamps(graph.heard['targets']))
    seconds = ticks * TICK_NS * 1e-9
    for name in ('odom', 'scan', 'joint_states'):
        count = len(set(stamps(graph.heard[name])))
        assert count == seconds * TOPICS[name].rate_hz + 1, name
        assert all(message.header.frame_id == TOPICS[name].frame for message in graph.heard[name])
    tracks = {message.child_frame_id for message in graph.heard['targets']}
    assert tracks == {f'target/{number}' for number in range(len(scenario.traffic))}


def test_the_vessel_obeys_the_command_of_the_same_stamp(graph, scenario):
    sim = sail(graph, 30, scenario)
    graph.until(lambda: sim.time_ns == 30 * TICK_NS)
    feedback = read_joints(graph.last('joint_states', lambda m: read_stamp(m.header.stamp) == sim.time_ns))
    assert 0.0 < feedback.rudder_rad <= AHEAD.rudder_rad
    assert feedback.thrust_n > 0.0
    assert read_odometry(graph.heard['odom'][-1]).yaw_rad == pytest.approx(
        math.remainder(sim.world.own[0, 2], math.tau), abs=1e-12
    )


def test_the_world_stands_until_there_is_a_plan(graph, scenario):
    graph.listen('odom', 'goal_pose', 'diagnostics')
    sim = graph.add(Sim, scenario='crossing', lock_step=True)
    graph.publish('cmd_actuators', command(0))
    graph.until(lambda: len(graph.heard['odom']) > 3)
    graph.last('goal_pose')
    assert set(stamps(graph.heard['odom'])) == {0}
    assert sim.held
    graph.publish('plan', path_message(scenario.path, 0))
    graph.until(lambda: sim.time_ns == TICK_NS)


def test_what_got_no_answer_is_sent_again(graph, scenario):
    sail(graph, 3, scenario)
    graph.until(lambda: stamps(graph.heard['odom']).count(3 * TICK_NS) > 2)


def test_a_bad_command_is_refused_and_counted(graph, scenario):
    sim = sail(graph, 1, scenario)
    graph.until(lambda: sim.time_ns == TICK_NS)
    graph.publish('cmd_actuators', command(TICK_NS, Actuation(math.nan, 0.0)))
    graph.publish('cmd_actuators', command(20 * TICK_NS))
    _, _, values = graph.status('sim', lambda status: 'future' in status.message)
    assert values['refused_cmd_actuators'] == '2'
    assert sim.time_ns == TICK_NS


def test_patience_with_the_planner_ends(graph):
    sim = graph.add(Sim, scenario='crossing', lock_step=True, plan_timeout_s=0.3)
    graph.until(lambda: sim.exit_code == 4)


def test_services_reset_step_and_disable(graph, scenario):
    sim = sail(graph, 25, scenario)
    graph.until(lambda: sim.time_ns == 25 * TICK_NS)
    assert graph.call(SetBool, 'sim/enable', data=False).success
    thrust_n = sim.world.own[0, 6]
    assert graph.call(Trigger, 'sim/step').success
    assert sim.time_ns == 26 * TICK_NS
    assert sim.world.own[0, 6] < thrust_n
    assert graph.call(Trigger, 'sim/reset').success
    assert sim.time_ns == 0
    assert sim.world.own[0, :3] == pytest.approx(scenario.start)


def test_a_step_by_hand_in_real_time_sets_the_world_going(graph):
    sim = graph.add(Sim, scenario='crossing')
    assert graph.call(Trigger, 'sim/step').success
    graph.until(lambda: sim.time_ns > 2 * TICK_NS)


def test_without_commands_the_actuators_go_neutral(graph, scenario):
    graph.listen('diagnostics')
    sim = graph.add(Sim, scenario='crossing', rate=20.0, hold_until_plan=False)
    graph.publish('cmd_actuators', command(0))
    graph.until(lambda: sim.world.own[0, 6] > 0.0, 'thrust')
    graph.until(lambda: sim.world.own[0, 6] == 0.0, 'neutral')
    graph.status('sim', lambda status: 'neutral' in status.message and status.level == b'\x02')


def test_the_end_is_told(graph):
    graph.listen('episode', 'diagnostics')
    sim = graph.add(Sim, scenario='crossing', rate=1000.0, hold_until_plan=False, neutral_s=60.0)
    for second in range(60):
        if not sim.running:
            break
        graph.publish('cmd_actuators', command(min(second * 20 * TICK_NS, sim.time_ns), Actuation(0.6, 1e6)))
        graph.until(lambda second=second: sim.time_ns > second * 20 * TICK_NS or not sim.running)
    graph.until(lambda: not sim.running, 'the end of the episode')
    values = read_values(graph.last('episode', lambda status: status.message != 'RUNNING'))
    assert values['outcome'].startswith(('COLLISION', 'TIMEOUT'))
    assert values['scenario'] == 'crossing'
    stood = sim.world.own[0].copy()
    ended_ns = sim.time_ns
    graph.until(lambda: sim.time_ns > ended_ns, 'odometry after the end')
    assert (sim.world.own[0] == stood).all()
