"""States of a node: silent and deaf unless active, led by services, ended in good order."""

import os
import signal
import subprocess
import sys

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from portnav_ros.nodes.lifecycle import ManagedNode
from portnav_ros.nodes.messages import fill_odometry, new_joints, new_odometry, path_message, read_joints
from portnav_ros.nodes.pid_controller import PidController
from portnav_ros.nodes.sim import Sim
from portnav_ros.nodes.status_pipe import STATUS_FD
from portnav_ros.types import VesselState

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = (
    Transition.TRANSITION_CONFIGURE,
    Transition.TRANSITION_CLEANUP,
    Transition.TRANSITION_ACTIVATE,
    Transition.TRANSITION_DEACTIVATE,
)


def change(graph, transition, node='pid_controller'):
    """Ask a node for a transition; returns whether it succeeded."""
    return graph.call(ChangeState, f'{node}/change_state', transition=Transition(id=transition)).success


def odometry():
    message = new_odometry()
    fill_odometry(message, 0, VesselState(0.0, 0.0, 0.0, 3.0))
    return message


def test_a_node_listens_and_speaks_only_while_active(graph):
    graph.listen('cmd_actuators', 'diagnostics')
    node = graph.build(PidController, odom_age_s=60.0)
    graph.status('pid_controller', lambda status: status.message == 'unconfigured')
    assert change(graph, CONFIGURE)
    graph.publish('odom', odometry())
    graph.status('pid_controller', lambda status: status.message == 'inactive')
    assert change(graph, ACTIVATE)
    assert not graph.heard['cmd_actuators'], 'what came before does not count'
    graph.publish('odom', odometry())
    assert read_joints(graph.last('cmd_actuators')).thrust_n < 0.0
    assert node.state == 'active'


def test_the_autopilot_leaves_the_actuators_neutral(graph):
    graph.listen('cmd_actuators')
    graph.add(PidController, odom_age_s=60.0)
    graph.publish('odom', odometry())
    graph.last('cmd_actuators')
    assert change(graph, DEACTIVATE)
    graph.last('cmd_actuators', lambda message: read_joints(message) == (0.0, 0.0))


def test_a_node_can_be_configured_again(graph):
    graph.listen('cmd_actuators')
    node = graph.add(PidController, odom_age_s=60.0)
    assert change(graph, DEACTIVATE)
    assert change(graph, CLEANUP)
    graph.until(lambda: not graph.other.count_publishers('cmd_actuators'), 'the end of its publisher')
    for transition in (CONFIGURE, ACTIVATE):
        assert change(graph, transition)
    graph.publish('odom', odometry())
    graph.last('cmd_actuators')
    assert node.failure is None


def test_a_latched_topic_is_heard_before_the_start(graph):
    sim = graph.build(Sim, scenario='crossing', lock_step=True)
    sim.trigger_configure()
    graph.publish('plan', path_message(sim.scenario.path, 0))
    graph.until(lambda: sim._planned, 'the plan')
    sim.trigger_activate()
    graph.publish('cmd_actuators', new_joints())
    graph.until(lambda: sim.time_ns > 0, 'the first tick')


@pytest.mark.parametrize('transition', [CONFIGURE, CLEANUP, 77])
def test_a_transition_that_is_not_allowed_is_refused(graph, transition):
    node = graph.add(PidController)
    assert not change(graph, transition)
    state = graph.call(GetState, 'pid_controller/get_state').current_state.label
    assert (state, node.ended) == ('active', False)


class Failing(ManagedNode):
    def configure(self):
        raise ValueError('no chart')


def test_what_fails_a_transition_is_kept_and_ends_the_node(graph):
    node = graph.build(lambda **options: Failing('failing', **options))
    assert not change(graph, CONFIGURE, 'failing')
    assert (node.state, node.ended, str(node.failure)) == ('unconfigured', True, 'no chart')
    with pytest.raises(ValueError, match='no chart'):
        node.start()


class Slow(ManagedNode):
    def configure(self):
        self.stop()  # as the handler of a signal would
        raise AssertionError('not reached')


def test_a_signal_breaks_off_the_configuring(graph):
    node = graph.build(lambda **options: Slow('slow', **options))
    with pytest.raises(KeyboardInterrupt):
        node.start()
    assert node.ended


def launch(module, *parameters):
    """Start a node that waits for a manager; returns its process once its services stand."""
    reader, writer = os.pipe()
    words = [word for parameter in ('autostart:=false', *parameters) for word in ('-p', parameter)]
    process = subprocess.Popen(
        (sys.executable, '-m', f'portnav_ros.nodes.{module}', '--ros-args', *words),
        env=os.environ | {STATUS_FD: str(writer)},
        pass_fds=(writer,),
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writer)
    with os.fdopen(reader) as pipe:
        assert 'ready' in pipe.readline()
    return process


def end(process):
    """Wait for the end of a process; returns its exit code and what it said."""
    errors = process.communicate(timeout=60)[1]
    assert 'Traceback' not in errors
    return process.returncode, errors


def test_a_node_without_autostart_waits_and_ends_by_a_signal(graph, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.context.get_domain_id()))
    process = launch('pid_controller')
    state = graph.call(GetState, 'pid_controller/get_state').current_state.label
    process.send_signal(signal.SIGTERM)
    assert (state, end(process)[0]) == ('unconfigured', 0)


def test_a_configuring_that_fails_ends_the_process_with_its_reason(graph, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(graph.context.get_domain_id()))
    process = launch('global_planner', 'chart:=/nowhere.geojson')
    assert not change(graph, CONFIGURE, 'global_planner')
    code, errors = end(process)
    assert (code, '/nowhere.geojson' in errors) == (2, True), errors
