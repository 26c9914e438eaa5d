"""The PPO baseline at run time: torch is not needed, and what does not fit is refused."""

import subprocess
import sys

import numpy as np
import pytest

from portnav_ros.baselines.ppo_policy import likeliest, load_policy, policy_layers
from portnav_ros.muzero import ModelError
from portnav_ros.muzero.model_file import load_model, released_model, save_model
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.sim.world import World
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.types import YAW
from portnav_ros.vessel import VesselParams

TASK = TaskParams(ObservationParams(frames=2), ActionParams(hold=3))


@pytest.fixture(scope='module')
def path(make_ppo_model):
    return make_ppo_model(TASK)


def load(path, **options):
    return load_policy(path, VesselParams(), LidarParams(), **options)


def test_likeliest_action_of_a_network_by_hand():
    layers = [
        (np.array([[2.0, 0.0], [0.0, -1.0]], np.float32), np.array([0.0, 0.5], np.float32)),
        (np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]], np.float32), np.zeros(3, np.float32)),
    ]
    features = np.array([[1.0, 0.0], [0.0, -1.0], [-1.0, 1.0]], np.float32)
    # hidden: (tanh 2, tanh .5), (0, tanh 1.5), (tanh -2, tanh -.5)
    np.testing.assert_array_equal(likeliest(layers, features), [0, 1, 2])


def test_policy_takes_the_likeliest_action_and_holds_it(path):
    scenarios = [load_scenario('crossing', seed) for seed in range(3)]
    paths, everyone = [scenario.path for scenario in scenarios], np.ones(3, bool)
    world, policy = World(scenarios), load(path)
    seen_by_all, seen_by_agent = (
        Observer(3, world.lidar, params) for params in (ObservationParams(), TASK.observation)
    )
    for observer in (seen_by_all, seen_by_agent):
        observer.reset(everyone, paths)
    policy.reset(everyone)
    frame = world.own, world.ranges, world.setpoint
    given = policy.act(seen_by_all.update(*frame))
    actions = likeliest(policy_layers(load_model(path).tensors), seen_by_agent.update(*frame).features)
    chosen = TASK.actions.table()[actions]
    np.testing.assert_allclose(given, np.column_stack([world.own[:, YAW] + chosen[:, 0], chosen[:, 1]]))
    world.step(given)
    held = policy.act(seen_by_all.update(world.own, world.ranges, world.setpoint))
    np.testing.assert_array_equal(held, given)


def test_another_vessel_is_refused_or_warned_of(path):
    with pytest.raises(ModelError, match='trained for vessel shuttle, not cemt_va'):
        load_policy(path, load_vessel('cemt_va'), LidarParams())
    with pytest.warns(UserWarning, match='trained for vessel shuttle, not cemt_va'):
        policy = load_policy(path, load_vessel('cemt_va'), LidarParams(), allow_mismatch=True)
    assert 'not cemt_va' in policy.misfit


def test_another_sensor_is_refused_even_then(path):
    with pytest.raises(ModelError, match='180 rays'):
        load_policy(path, VesselParams(), LidarParams(rays=90), allow_mismatch=True)


def test_no_model_is_released_and_that_is_said():
    with pytest.raises(ModelError, match=r'models/ppo\.safetensors: no such model; train one'):
        load(released_model('ppo'))


def test_a_muzero_model_is_refused(make_model):
    with pytest.raises(ModelError, match='algorithm: muzero, expected ppo'):
        load(make_model(TASK))


@pytest.mark.parametrize(
    ('name', 'tensor'),
    [
        ('policy.0.weight', None),
        ('policy.1.bias', None),
        ('policy.2.weight', None),
        ('policy.1.weight', np.zeros((6, 9), np.float32)),
        ('policy.2.bias', np.zeros(9, np.float32)),
    ],
)
def test_weights_that_do_not_fit_the_card_are_refused(path, tmp_path, name, tensor):
    model = load_model(path)
    tensors = {key: value for key, value in model.tensors.items() if key != name}
    if tensor is not None:
        tensors[name] = tensor
    save_model(tmp_path / 'm.safetensors', tensors, model.card)
    with pytest.raises(ModelError, match=r'm\.safetensors: (no tensor|policy: layers)'):
        load(tmp_path / 'm.safetensors')


def test_no_torch_at_run_time(path):
    code = (
        'import sys; from pathlib import Path; from portnav_ros.baselines.ppo_policy import load_policy; '
        'from portnav_ros.vessel import VesselParams; from portnav_ros.sim.scenario import LidarParams; '
        f'load_policy(Path({str(path)!r}), VesselParams(), LidarParams()); '
        'sys.exit("torch" in sys.modules)'
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
