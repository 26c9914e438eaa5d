"""Lock-step through DDS sails the very track that the in-process world sails."""

import numpy as np
import pytest

from portnav_ros.baselines.dwa import DynamicWindow
from portnav_ros.muzero.policy import load_policy
from portnav_ros.nodes.dwa_planner import make_node as make_dwa
from portnav_ros.nodes.messages import path_message, read_odometry, read_stamp
from portnav_ros.nodes.muzero_planner import make_node as make_muzero
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.nodes.sim import Sim
from portnav_ros.sim.generator import load_scenario
from portnav_ros.sim.world import World
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
from portnav_ros.task.observation import ObservationParams, Observer

SECONDS = 40
SECOND_NS = 1_000_000_000


@pytest.fixture(scope='module')
def scenario():
    return load_scenario('crossing', 0)


@pytest.fixture(scope='module')
def model(make_model, scenario):
    task = TaskParams(ObservationParams(layout='aligned'), ActionParams(reference='path', hold=3))
    return make_model(task, vessel=scenario.vessel, lidar=scenario.lidar)


def through_ros(graph, scenario, make_planner=make_dwa, **parameters):
    """Track [T, 5] at whole seconds, by sim, planner and autopilot over DDS."""
    graph.listen('odom', lock_step=True)
    vessel = {'preset': scenario.vessel.name}
    graph.add(PidController, lock_step=True, **vessel)
    planner = vessel | parameters
    graph.add(SafetyMonitor, lock_step=True, **vessel)
    graph.add(make_planner, lock_step=True, **planner)
    sim = graph.add(Sim, scenario='crossing', lock_step=True)
    graph.publish('plan', path_message(scenario.path, 0))
    graph.until(lambda: sim.time_ns >= SECONDS * SECOND_NS, f'{SECONDS} s')
    graph.until(lambda: read_stamp(graph.heard['odom'][-1].header.stamp) >= SECONDS * SECOND_NS)
    rows = {read_stamp(message.header.stamp): read_odometry(message)[:5] for message in graph.heard['odom']}
    return np.array([rows[second * SECOND_NS] for second in range(SECONDS + 1)])


def in_process(scenario, policy):
    world = World([scenario])
    observer = Observer(1, scenario.lidar, ObservationParams())
    observer.reset(np.ones(1, bool), [scenario.path])
    policy.reset(np.ones(1, bool))
    track = [world.own[0, :5].copy()]
    for _ in range(SECONDS):
        world.step(policy.act(observer.update(world.own, world.ranges, world.setpoint)))
        track.append(world.own[0, :5].copy())
    return np.array(track)


def assert_same_track(found, expected):
    expected[:, 2] = found[:, 2] + np.remainder(expected[:, 2] - found[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    assert np.hypot(*(expected[-1, :2] - expected[0, :2])) > 30.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6)


def test_the_track_is_that_of_the_world_in_process(graph, scenario):
    policy = DynamicWindow(scenario.vessel, scenario.autopilot)
    assert_same_track(through_ros(graph, scenario), in_process(scenario, policy))


def test_a_learned_policys_track_is_too(graph, scenario, model):
    found = through_ros(graph, scenario, make_muzero, model=str(model))
    assert_same_track(found, in_process(scenario, load_policy(model, scenario.vessel, scenario.lidar)))


def test_the_same_seed_gives_the_same_track_bit_for_bit(graph, another_graph, scenario):
    np.testing.assert_array_equal(through_ros(graph, scenario), through_ros(another_graph, scenario))
