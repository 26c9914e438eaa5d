"""The PPO baseline as a node: needs a fitting model, and names it."""

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
)
from portnav_ros.nodes.ppo_planner import make_node
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams
from portnav_ros.types import Actuation, VesselState


@pytest.fixture(scope='module')
def path(make_ppo_model):
    return str(make_ppo_model())


def decide(graph, **parameters):
    """Give a planner what one decision needs; returns the setpoint."""
    graph.listen('setpoint_raw', 'diagnostics')
    graph.add(make_node, lock_step=True, **parameters)
    odometry, scan, joints = new_odometry(), new_scan(LidarParams(), 0.1), new_joints()
    fill_odometry(odometry, 0, VesselState(0.0, 0.0, 0.1, 3.0))
    fill_scan(scan, 0, np.full(180, 100.0, np.float32))
    fill_joints(joints, 0, Actuation(0.0, 0.0))
    route = np.column_stack([np.arange(0.0, 1000.0, 10.0), np.zeros(100)])
    messages = {'plan': path_message(route, 0), 'odom': odometry, 'scan': scan, 'joint_states': joints}
    for topic, message in messages.items():
        graph.publish(topic, message)
    return read_setpoint(graph.last('setpoint_raw'))


def test_decides_by_its_model_and_names_it(graph, path):
    setpoint = decide(graph, model=path)
    possible = ActionParams().table() + np.array([0.1, 0.0])
    assert min(np.abs(possible - setpoint).max(axis=1)) < 1e-6
    _, _, values = graph.status('ppo_planner', lambda status: status.message == 'ok')
    assert (values['model'], len(values['model_sha256'])) == ('ppo.safetensors', 64)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'model': ''}, r'models/ppo\.safetensors: no such model'),
        ({'preset': 'cemt_va'}, 'trained for vessel shuttle, not cemt_va'),
        ({'lidar.rays': 60}, 'trained with 180 rays'),
    ],
)
def test_what_does_not_fit_is_refused_at_start(graph, path, parameters, reason):
    with pytest.raises(ModelError, match=reason):
        graph.add(make_node, **({'model': path} | parameters))


def test_another_vessel_can_be_allowed_and_stays_a_warning(graph, path):
    with pytest.warns(UserWarning, match='trained for vessel shuttle'):
        decide(graph, model=path, preset='cemt_va', allow_mismatch=True)
    graph.status('ppo_planner', lambda status: 'trained for vessel shuttle, not cemt_va' in status.message)
