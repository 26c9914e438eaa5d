"""Ten thousand spoilt messages on every topic of every node: none dies, and a good one is still obeyed."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from portnav_ros.charts import write_geojson
from portnav_ros.evaluation.bags import read_bag
from portnav_ros.nodes import dwa_planner, line_of_sight_planner, muzero_planner, ppo_planner
from portnav_ros.nodes.bag_recorder import BagRecorder
from portnav_ros.nodes.faults.fuzz import Fuzzer, good
from portnav_ros.nodes.global_planner import GlobalPlanner
from portnav_ros.nodes.messages import SECOND_NS
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.safety_monitor import SafetyMonitor
from portnav_ros.nodes.sim import Sim
from portnav_ros.nodes.table import NAMES
from portnav_ros.nodes.topics import TOPICS
from portnav_ros.sim.generator import load_scenario

COUNT = 10_000
TICK_NS = 50_000_000
STRANGE_NS = (-(2**31) * SECOND_NS, -1, 0, 1, 10**12, (2**31 - 1) * SECOND_NS)
LATER_NS = 10**15  # by a clock that nobody has heard before
SETTLE = 100  # good messages on end, 5 s of the driver's time
MAKERS = {
    'sim': Sim,
    'global_planner': GlobalPlanner,
    'muzero_planner': muzero_planner.make_node,
    'dwa_planner': dwa_planner.make_node,
    'ppo_planner': ppo_planner.make_node,
    'line_of_sight_planner': line_of_sight_planner.make_node,
    'safety_monitor': SafetyMonitor,
    'pid_controller': PidController,
    'bag_recorder': BagRecorder,
}
ANSWERS = {
    **dict.fromkeys((name for name in NAMES if name.endswith('_planner')), 'setpoint_raw'),
    'sim': 'joint_states',
    'global_planner': 'plan',
    'safety_monitor': 'setpoint',
    'pid_controller': 'cmd_actuators',
}


def test_every_node_is_fuzzed():
    assert set(MAKERS) == set(NAMES)


class Fed:
    """A node that is handed messages as its executor would, at the time of its driver."""

    def __init__(self, node):
        self.node = node
        self.node.steady_s = lambda: self.time_ns / SECOND_NS
        self.time_ns = TICK_NS
        self.inputs = [(each.topic_name.lstrip('/'), each) for each in node.subscriptions]
        self.inputs = [(topic, each) for topic, each in self.inputs if topic in TOPICS]

    @property
    def later_ns(self):
        """When to be good again; the sim is asked, whose own time it is."""
        return getattr(self.node, 'time_ns', LATER_NS)

    def tick(self):
        """Let a recorder file what it has."""
        getattr(self.node, 'tick', lambda: 0)()

    def good(self):
        """Hear what is right, on every topic."""
        for topic, subscription in self.inputs:
            message = good(topic, self.time_ns)
            subscription.callback(serialize_message(message) if subscription.raw else message)
        self.time_ns += TICK_NS

    def fuzz(self, fuzzer, rng):
        """Hear a spoilt message on every topic; most are stamped as they should be."""
        stamp_ns = STRANGE_NS[rng.integers(len(STRANGE_NS))] if rng.random() < 0.2 else self.time_ns
        for topic, subscription in self.inputs:
            spoilt = fuzzer.data if subscription.raw else fuzzer.message
            subscription.callback(spoilt(topic, stamp_ns))
        self.time_ns += TICK_NS


def survives(graph, name, accept=lambda message: True, **parameters):
    """Fuzz a node, then wait for an answer to good messages at a later time; returns the node."""
    fed = Fed(graph.add(MAKERS[name], **parameters))
    rng = np.random.default_rng(7)
    fuzzer = Fuzzer(rng)
    for number in range(COUNT):
        if number % 8 == 0:
            fed.good()
            fed.tick()
        fed.fuzz(fuzzer, rng)
    assert fed.node.active
    assert fed.node.vitals.refused.total() > COUNT / 10
    if name in ANSWERS:
        graph.listen(ANSWERS[name])
        fed.time_ns = fed.later_ns
        for _ in range(SETTLE):
            fed.good()
        graph.last(ANSWERS[name], accept)
    return fed.node


def sails(message):
    """Whether a setpoint asks for speed."""
    return message.twist.twist.linear.x > 0.0


@pytest.mark.parametrize('name', ['line_of_sight_planner', 'dwa_planner'])
def test_local_planners(graph, name):
    survives(graph, name, sails)


def test_the_learned_planners(graph, another_graph, make_model, make_ppo_model):
    survives(graph, 'muzero_planner', sails, model=str(make_model()), simulations=0)
    survives(another_graph, 'ppo_planner', sails, model=str(make_ppo_model()))


@pytest.mark.parametrize('name', ['line_of_sight_planner', 'safety_monitor'])
def test_what_is_read_as_bytes(graph, name):
    node = survives(graph, name, sails, lock_step=True)
    assert any(each.raw for each in node.subscriptions)


def test_the_safety_monitor(graph):
    survives(graph, 'safety_monitor', sails)


def test_the_pid_controller(graph):
    survives(graph, 'pid_controller', lambda command: command.effort[1] > 0.0)


def test_the_sim(graph):
    survives(
        graph, 'sim', lambda joints: joints.effort[1] > 0.0, scenario='rough_canal', hold_until_plan=False
    )


def test_the_global_planner(graph, tmp_path):
    write_geojson(load_scenario('rough_canal').harbour, tmp_path / 'chart.geojson')
    parameters = {'chart': str(tmp_path / 'chart.geojson'), 'rrt_star.iterations': 10}
    survives(graph, 'global_planner', lambda plan: len(plan.poses) > 1, **parameters)


def test_the_recorder(graph, tmp_path):
    node = survives(graph, 'bag_recorder', bag=str(tmp_path / 'bag'))
    while node.tick():
        pass
    node.destroy_node()
    bag = read_bag(tmp_path / 'bag')
    assert len(bag.messages['/odom']) > COUNT / 10
    assert 'unreadable on /odom' in bag.lost
