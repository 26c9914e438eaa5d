"""Lock-step through DDS sails the very track that the in-process world sails."""

import numpy as np
import pytest

from portnav_ros.nodes.dwa_planner import make_node as make_dwa
from portnav_ros.nodes.dwa_planner import make_policy
from portnav_ros.nodes.messages import path_message, read_odometry, read_stamp
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.sim import Sim
from portnav_ros.sim.generator import load_scenario
from portnav_ros.sim.world import World
from portnav_ros.task.observation import ObservationParams, Observer

SECONDS = 40
SECOND_NS = 1_000_000_000
SETPOINT_TOPIC = ('--ros-args', '-r', 'setpoint_raw:=setpoint')


@pytest.fixture(scope='module')
def scenario():
    return load_scenario('crossing', 0)


def through_ros(graph, scenario):
    """Track [T, 5] at whole seconds, by sim, planner and autopilot over DDS."""
    graph.listen('odom', lock_step=True)
    vessel = {'preset': scenario.vessel.name}
    graph.add(PidController, lock_step=True, **vessel)
    graph.add(lambda **options: make_dwa(cli_args=SETPOINT_TOPIC, **options), lock_step=True, **vessel)
    sim = graph.add(Sim, scenario='crossing', lock_step=True)
    graph.publish('plan', path_message(scenario.path, 0))
    graph.until(lambda: sim.time_ns >= SECONDS * SECOND_NS, f'{SECONDS} s')
    graph.until(lambda: read_stamp(graph.heard['odom'][-1].header.stamp) >= SECONDS * SECOND_NS)
    rows = {read_stamp(message.header.stamp): read_odometry(message)[:5] for message in graph.heard['odom']}
    return np.array([rows[second * SECOND_NS] for second in range(SECONDS + 1)])


def in_process(scenario):
    world = World([scenario])
    policy = make_policy(type('Params', (), {'vessel': scenario.vessel, 'autopilot': scenario.autopilot}))
    observer = Observer(1, scenario.lidar, ObservationParams())
    observer.reset(np.ones(1, bool), [scenario.path])
    track = [world.own[0, :5].copy()]
    for _ in range(SECONDS):
        world.step(policy.act(observer.update(world.own, world.ranges, world.setpoint)))
        track.append(world.own[0, :5].copy())
    return np.array(track)


def test_the_track_is_that_of_the_world_in_process(graph, scenario):
    expected, found = in_process(scenario), through_ros(graph, scenario)
    expected[:, 2] = found[:, 2] + np.remainder(expected[:, 2] - found[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    assert np.hypot(*(expected[-1, :2] - expected[0, :2])) > 30.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6)


def test_the_same_seed_gives_the_same_track_bit_for_bit(graph, another_graph, scenario):
    np.testing.assert_array_equal(through_ros(graph, scenario), through_ros(another_graph, scenario))
