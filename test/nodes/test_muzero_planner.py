"""The learned planner as a node: needs a fitting model, and shows what its search has found."""

import math

import numpy as np
import pytest

from portnav_ros.muzero import ModelError
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
from portnav_ros.nodes.muzero_planner import make_node
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
from portnav_ros.types import Actuation, VesselState

SECOND_NS = 1_000_000_000
PATH = np.column_stack([np.arange(0.0, 1000.0, 10.0), np.zeros(100)])
TASK = TaskParams(actions=ActionParams(hold=2))


class Driver:
    """A planner in lock-step, and a driver that feeds it second by second."""

    def __init__(self, graph, **parameters):
        self.graph = graph
        graph.listen('setpoint_raw', 'diagnostics', 'markers')
        self.node = graph.add(make_node, lock_step=True, **parameters)
        graph.publish('plan', path_message(PATH, 0))

    def sail(self, second, yaw=0.1):
        """Send one decision's messages; returns the setpoint."""
        time_ns = second * SECOND_NS
        odometry, scan, joints = new_odometry(), new_scan(LidarParams(), 0.1), new_joints()
        fill_odometry(odometry, time_ns, VesselState(5.0 * second, 0.0, yaw, 3.0))
        fill_scan(scan, time_ns, np.full(180, 100.0, np.float32))
        fill_joints(joints, time_ns, Actuation(0.0, 0.0))
        for topic, message in (('odom', odometry), ('scan', scan), ('joint_states', joints)):
            self.graph.publish(topic, message)
        answer = self.graph.last('setpoint_raw', lambda m: read_stamp(m.header.stamp) == time_ns)
        return read_setpoint(answer)


@pytest.fixture(scope='module')
def path(make_model):
    return str(make_model(TASK))


def test_each_second_it_decides_on_one_of_the_actions(graph, path):
    driver = Driver(graph, model=path)
    for second, yaw_rad in enumerate((0.1, 0.2, 0.3)):
        possible = TASK.actions.table() + np.array([yaw_rad, 0.0])
        assert min(np.abs(possible - driver.sail(second, yaw_rad)).max(axis=1)) < 1e-6


def test_diagnostics_tell_what_the_search_found(graph, path):
    driver = Driver(graph, model=path, simulations=12)
    driver.sail(0)
    _, text, values = graph.status('muzero_planner', lambda status: 'visits' in read_values(status))
    assert text == 'ok'
    assert (values['model'], len(values['model_sha256'])) == ('muzero.safetensors', 64)
    assert values['simulations'] == '12'
    visits = [int(part.split(':')[1]) for part in values['visits'].split()]
    assert visits == sorted(visits, reverse=True)
    assert 0 < sum(visits) <= 12
    assert math.isfinite(float(values['value']))
    assert 0.0 < float(values['decision_p50_ms']) <= float(values['decision_p99_ms'])


def test_each_decision_is_timed_and_drawn(graph, path):
    driver = Driver(graph, model=path)
    graph.until(lambda: driver.node._markers.get_subscription_count())
    for second in range(4):
        driver.sail(second)
    graph.until(lambda: len(graph.heard['markers']) == 4)
    assert len(driver.node._decisions_s) == 4
    marker, tracks = graph.heard['markers'][0].markers
    assert (tracks.ns, tracks.header.frame_id, len(tracks.points)) == ('tracks', 'map', 0)
    assert (marker.ns, marker.header.frame_id) == ('rollout', 'map')
    assert (marker.points[0].x, marker.points[0].y) == (0.0, 0.0)
    assert len(marker.points) > TASK.actions.hold


def test_the_prior_alone_can_sail(graph, path):
    Driver(graph, model=path, simulations=0).sail(0)
    _, _, values = graph.status('muzero_planner', lambda status: 'prior' in read_values(status))
    shares = [float(part.split(':')[1]) for part in values['prior'].split()]
    assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize(
    ('parameters', 'error', 'reason'),
    [
        ({'model': '/nowhere/m.safetensors'}, ModelError, r'/nowhere/m\.safetensors: no such model'),
        ({'preset': 'cemt_va'}, ModelError, 'trained for vessel shuttle, not cemt_va'),
        ({'lidar.rays': 60}, ModelError, 'trained with 180 rays'),
        ({'simulations': -2}, ParamError, 'simulations = -2'),
    ],
)
def test_what_does_not_fit_is_refused_at_start(graph, path, parameters, error, reason):
    with pytest.raises(error, match=reason):
        graph.add(make_node, **({'model': path} | parameters))


def test_another_vessel_can_be_allowed_and_stays_a_warning(graph, path):
    with pytest.warns(UserWarning, match='trained for vessel shuttle'):
        driver = Driver(graph, model=path, preset='cemt_va', allow_mismatch=True)
    driver.sail(0)
    _, text, _ = graph.status('muzero_planner', lambda status: 'visits' in read_values(status))
    assert 'trained for vessel shuttle, not cemt_va' in text
