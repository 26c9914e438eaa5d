"""What every node shares: parameters, refused messages, QoS mismatches, signals and exit codes."""

import math
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, field

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.nodes.messages import (
    fill_odometry,
    new_joints,
    new_odometry,
    path_message,
    read_joints,
    read_odometry,
    read_values,
)
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import PortNode
from portnav_ros.nodes.status_pipe import STATUS_FD
from portnav_ros.nodes.topics import TOPICS
from portnav_ros.params import ParamError
from portnav_ros.vessel import VesselParams


@dataclass(frozen=True)
class ProbeParams(NodeParams):
    """Parameters of a test. age_s: of what comes."""

    preset: str = 'shuttle'
    age_s: float = 1.5
    count: int = 3
    names: tuple[str, ...] = ('a',)
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)


def probe(**options):
    return PortNode('probe', ProbeParams(), **options)


def test_parameters_override_the_dataclass(graph):
    node = graph.add(probe, age_s=50, names=['b', 'c'], **{'autopilot.heading_kp': 2})
    assert node.params == ProbeParams(age_s=50.0, names=('b', 'c'), autopilot=AutopilotParams(heading_kp=2.0))
    assert node.get_parameter('age_s').value == 50.0
    assert node.get_parameter('autopilot.heading_kd').value == AutopilotParams().heading_kd


def test_a_preset_names_the_vessel_to_start_from(graph):
    node = graph.add(probe, preset='workboat', **{'vessel.beam_m': 1.5})
    assert (node.params.vessel.name, node.params.vessel.beam_m) == ('workboat', 1.5)


def test_a_parameter_is_described_and_stays(graph):
    node = graph.add(probe)
    descriptor = node.describe_parameter('age_s')
    assert (descriptor.type, descriptor.description) == (ParameterType.PARAMETER_DOUBLE, 'of what comes [s]')
    assert not node.set_parameters([Parameter('age_s', value=2.0)])[0].successful


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'agee_s': 1.0}, "unknown key 'agee_s'; did you mean 'age_s'"),
        ({'age_s': 'soon'}, 'age_s: expected float'),
        ({'count': 1.5}, 'count: expected int'),
        ({'autopilot.heading_kp': -1.0}, 'heading_kp = -1.0 is outside'),
        ({'autopilot.gain': 1.0}, "autopilot: unknown key 'gain'"),
        ({'preset': 'raft'}, 'raft'),
    ],
)
def test_a_wrong_parameter_is_an_error(graph, parameters, reason):
    with pytest.raises(ParamError, match=reason):
        graph.add(probe, **parameters)


def test_ros_own_parameters_are_left_alone(graph):
    node = graph.add(probe, use_sim_time=True)
    assert node.get_parameter('use_sim_time').value


def test_a_refused_message_is_counted_and_told(graph):
    node = graph.add(probe)
    taken = []
    node.subscribe('cmd_actuators', lambda message: taken.append(read_joints(message)))
    graph.listen('diagnostics')
    bad = new_joints()
    bad.name = ['rudder', 'mast']
    graph.publish('cmd_actuators', bad)
    _, text, values = graph.status('probe', lambda status: status.level == b'\x01')
    assert 'mast' in text
    assert (values['refused_cmd_actuators'], taken) == ('1', [])
    graph.publish('cmd_actuators', new_joints())
    graph.until(lambda: taken, 'a good message after a bad one')


def test_diagnostics_tell_of_inputs_and_callbacks_since_activation(graph):
    node = graph.add(probe)
    node.subscribe('odom', read_odometry)
    node.subscribe('scan', lambda message: None)
    node.subscribe('plan', lambda message: None, always=True)
    graph.listen('diagnostics')
    message = new_odometry()
    fill_odometry(message, 7, np.zeros(7))
    graph.publish('plan', path_message(np.zeros((0, 2)), 0))
    graph.publish('odom', message)
    _, _, values = graph.status('probe', lambda status: 'odom_behind_s' in read_values(status))
    assert float(values['odom_age_s']) < math.inf == float(values['scan_age_s'])
    assert (values['state'], values['overruns'], 'loop_p95_ms' in values) == ('active', '0', True)
    node.trigger_deactivate()
    node.trigger_activate()
    graph.heard['diagnostics'].clear()
    _, _, values = graph.status('probe', lambda status: True)
    assert (values['odom_age_s'], values['plan_age_s'] == 'inf') == ('inf', False)


def test_an_incompatible_qos_is_an_error_in_the_diagnostics(graph):
    node = graph.add(probe, **{'qos_overrides./cmd_actuators.subscription.reliability': 'reliable'})
    node.subscribe('cmd_actuators', lambda message: None)
    graph.listen('diagnostics')
    weak = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = graph.other.create_publisher(TOPICS['cmd_actuators'].type, 'cmd_actuators', weak)
    named = (
        'cmd_actuators: probe does not hear other: incompatible QoS (RELIABILITY); let the publisher offer'
    )
    graph.status('probe', lambda status: status.level == b'\x02' and named in status.message)
    graph.other.destroy_publisher(publisher)
    graph.heard['diagnostics'].clear()
    graph.status('probe', lambda status: status.level == b'\x00')


def start(module, *parameters):
    """Start a node as a process; returns it and the end of its status pipe."""
    reader, writer = os.pipe()
    arguments = [part for parameter in parameters for part in ('-p', parameter)]
    process = subprocess.Popen(
        (sys.executable, '-m', f'portnav_ros.nodes.{module}', '--ros-args', *arguments),
        env=os.environ | {'ROS_DOMAIN_ID': '30', STATUS_FD: str(writer)},
        pass_fds=(writer,),
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writer)
    return process, reader


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_in_good_order(number):
    process, reader = start('pid_controller')
    with os.fdopen(reader) as pipe:
        assert 'ready' in pipe.readline()
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    assert 'Traceback' not in errors


def test_a_parameter_file_that_is_not_there_is_told_without_a_traceback():
    result = subprocess.run(
        (sys.executable, '-m', 'portnav_ros.nodes.sim', '--ros-args', '--params-file', '/nowhere.yaml'),
        capture_output=True,
        text=True,
    )
    assert (result.returncode, '/nowhere.yaml' in result.stderr) == (2, True), result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.parametrize(
    ('module', 'parameter', 'code', 'reason'),
    [
        ('pid_controller', 'vesel:=shuttle', 2, "unknown key 'vesel'; did you mean 'vessel'"),
        ('sim', 'chart:=/nowhere.geojson', 2, 'nowhere.geojson'),
        ('muzero_planner', 'model:=/nowhere.safetensors', 3, 'no such model'),
    ],
)
def test_a_node_that_cannot_run_says_why(module, parameter, code, reason):
    process, reader = start(module, parameter)
    _, errors = process.communicate(timeout=60)
    os.close(reader)
    assert (process.returncode, reason in errors) == (code, True), errors
    assert 'Traceback' not in errors
