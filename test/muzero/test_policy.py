"""The policy at run time: decides alike alone and among others, and refuses what does not fit."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from portnav_ros.muzero import ModelError
from portnav_ros.muzero.inference import NumpyModel, weights_of
from portnav_ros.muzero.model_file import load_model, save_model
from portnav_ros.muzero.policy import load_policy
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.sim.world import World
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
from portnav_ros.task.mirror import mirror_of
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.vessel import VesselParams

TASK = TaskParams(ObservationParams(frames=2), ActionParams(hold=2))


@pytest.fixture(scope='module')
def path(make_model):
    return make_model(TASK)


@pytest.fixture(scope='module')
def scenarios():
    return [load_scenario('crossing', seed) for seed in range(3)]


def load(path, **options):
    return load_policy(path, VesselParams(), LidarParams(), **options)


def sail(policy, scenarios, periods=6):
    """Sail in the world; returns setpoints [T, B, 2]."""
    world, everyone = World(scenarios), np.ones(len(scenarios), bool)
    observer = Observer(len(scenarios), world.lidar, ObservationParams())
    observer.reset(everyone, [scenario.path for scenario in scenarios])
    policy.reset(everyone)
    given = []
    for _ in range(periods):
        given.append(policy.act(observer.update(world.own, world.ranges, world.setpoint)))
        world.step(given[-1])
    return np.array(given)


@pytest.mark.parametrize('simulations', [0, 8])
def test_no_decision_depends_on_the_batch(path, scenarios, simulations):
    together = sail(load(path, simulations=simulations), scenarios)
    for b, scenario in enumerate(scenarios):
        alone = sail(load(path, simulations=simulations), [scenario])
        np.testing.assert_array_equal(alone[:, 0], together[:, b])


def test_a_policy_repeats_itself(path, scenarios):
    policy = load(path)
    first = sail(policy, scenarios)
    np.testing.assert_array_equal(first, sail(policy, scenarios))


@pytest.mark.parametrize('rule', ['pozero', 'puct', 'gumbel'])
def test_no_rule_draws_at_run_time(make_model, scenarios, rule):
    path = make_model(TASK, search={'simulations': 8, 'rule': rule, 'act': False})
    policy = load(path)
    first = sail(policy, scenarios[:1])
    np.testing.assert_array_equal(first, sail(policy, scenarios[:1]))


def test_the_card_says_how_many_simulations(path, scenarios):
    policy = load(path)
    sail(policy, scenarios[:1], 1)
    assert policy.simulations == policy.decision.visits.sum() == 8


def test_simulations_can_be_overridden(path, scenarios):
    policy = load(path, simulations=20)
    sail(policy, scenarios[:1], 1)
    assert policy.decision.visits.sum() == 20
    assert policy.decision.prior.sum() == pytest.approx(1.0, abs=1e-5)


def test_without_simulations_the_prior_decides(path, scenarios):
    seen = []
    policy = load(path, simulations=0)
    decide = policy._agent._decide
    policy._agent._decide = lambda features: seen.append(features.copy()) or decide(features)
    given = sail(policy, scenarios[:1], 1)
    networks = NumpyModel(weights_of(load_model(path).tensors, speeds=3), 0.99)
    logits, value = networks.predict(networks.represent(seen[0]))
    action = int(logits.argmax())
    heading_change, speed = TASK.actions.table()[action]
    assert given[0, 0] == pytest.approx((scenarios[0].start[2] + heading_change, speed))
    assert policy.decision.best.tolist() == [action]
    assert policy.decision.value == pytest.approx(value[0])
    assert policy.decision.prior[action] == policy.decision.prior.max()
    assert (policy.simulations, policy.decision.visits.sum()) == (0, 0)


def test_the_plan_can_be_drawn(path, scenarios):
    policy = load(path)
    sail(policy, scenarios[:1], 1)
    own = np.array([10.0, 20.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    track = policy.best_track(own, scenarios[0].path)
    assert len(track) == TASK.actions.hold * len(policy.decision.best) + 1
    assert track[0].tolist() == [10.0, 20.0]
    assert (np.hypot(*np.diff(track, axis=0).T) < 6.0).all()


def test_another_vessel_is_refused_or_warned_of(path):
    with pytest.raises(ModelError, match='trained for vessel shuttle, not cemt_va'):
        load_policy(path, load_vessel('cemt_va'), LidarParams())
    with pytest.warns(UserWarning, match='trained for vessel shuttle, not cemt_va'):
        load_policy(path, load_vessel('cemt_va'), LidarParams(), allow_mismatch=True)


def test_another_sensor_is_refused_even_then(path):
    with pytest.raises(ModelError, match='180 rays'):
        load_policy(path, VesselParams(), LidarParams(rays=90), allow_mismatch=True)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'algorithm': 'ppo'}, 'algorithm: ppo, expected muzero'),
        ({'search': {'simulation': 8}}, "unknown key 'simulation'; did you mean 'simulations'"),
        ({'search': {'simulations': -1}}, 'simulations = -1'),
        ({'task': TaskParams(ObservationParams(frames=3), TASK.actions)}, 'representation: layers of widths'),
        ({'task': TaskParams(TASK.observation, ActionParams(speed_mps=(1.0, 2.0)))}, 'its card'),
        ({'task': TaskParams(TASK.observation, ActionParams((0.0, 0.1)))}, 'its card'),
    ],
)
def test_a_card_that_does_not_fit_its_weights_is_refused(path, tmp_path, changes, reason):
    model = load_model(path)
    other = tmp_path / 'other.safetensors'
    save_model(other, model.tensors, dataclasses.replace(model.card, **changes))
    with pytest.raises(ModelError, match=reason):
        load(other)


@pytest.mark.parametrize(
    ('name', 'tensor'),
    [
        ('prediction.value.weight', None),
        ('value_atoms', np.zeros(99, np.float32)),
        ('reward_atoms', np.zeros(3, np.float32)),
        ('representation.norm.weight', np.zeros(5, np.float32)),
        ('dynamics.out.bias', np.zeros(5, np.float32)),
        ('prediction.body.0.linear.weight', np.zeros((16, 9), np.float32)),
        ('prediction.body.0.norm.bias', np.zeros(15, np.float32)),
    ],
)
def test_tensors_that_do_not_fit_each_other_are_refused(path, tmp_path, name, tensor):
    model = load_model(path)
    tensors = {key: value for key, value in model.tensors.items() if key != name}
    if tensor is not None:
        tensors[name] = tensor
    save_model(tmp_path / 'm.safetensors', tensors, model.card)
    with pytest.raises(ModelError, match=r'm\.safetensors: '):
        load(tmp_path / 'm.safetensors')


WATCHING = TaskParams(
    ObservationParams(layout='aligned', ages=(0,), sectors=12, tracks=2),
    ActionParams((-0.5, 0.0, 0.5), hold=2),
)


@pytest.fixture(scope='module')
def watching():
    """Tensors of a network that looks at tracks."""
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import Network, NetworkParams

    torch.manual_seed(0)
    params = NetworkParams(16, tracks=2, context_hidden=(12, 8), track_hidden=(8,))
    network = Network(WATCHING.observation.size, 3, len(WATCHING.actions.speed_mps), params)
    return {name: tensor.float().numpy() for name, tensor in network.state_dict().items()}


def test_a_policy_that_looks_at_tracks_sails(path, tmp_path, scenarios, watching):
    model = dataclasses.replace(load_model(path).card, task=WATCHING)
    save_model(tmp_path / 'm.safetensors', watching, model)
    assert np.isfinite(sail(load(tmp_path / 'm.safetensors'), scenarios)).all()


@pytest.mark.parametrize(
    ('name', 'tensor', 'reason'),
    [
        (
            'representation.tracks.shape',
            np.array([3.0, 12.0], np.float32),
            'tracks: made for 3, its card observes 2',
        ),
        ('representation.tracks.shape', None, 'its card'),
        ('representation.tracks.context.0.linear.weight', np.zeros((12, 9), np.float32), 'tracks.context'),
        ('representation.tracks.each.0.linear.weight', np.zeros((8, 9), np.float32), 'tracks.each'),
        ('representation.tracks.each.0.norm.bias', None, 'no tensor'),
    ],
)
def test_tracks_that_do_not_fit_are_refused(path, tmp_path, watching, name, tensor, reason):
    tensors = {key: value for key, value in watching.items() if key != name}
    if tensor is not None:
        tensors[name] = tensor
    save_model(tmp_path / 'm.safetensors', tensors, dataclasses.replace(load_model(path).card, task=WATCHING))
    with pytest.raises(ModelError, match=reason):
        load(tmp_path / 'm.safetensors')


def test_no_torch_at_run_time(path):
    code = (
        'import sys; from pathlib import Path; from portnav_ros.muzero.policy import load_policy; '
        'from portnav_ros.vessel import VesselParams; from portnav_ros.sim.scenario import LidarParams; '
        f'load_policy(Path({str(path)!r}), VesselParams(), LidarParams()); '
        'sys.exit("torch" in sys.modules)'
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0


def test_a_trained_network_sails(path, scenarios, tmp_path):
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import Network, NetworkParams

    torch.manual_seed(0)
    params = NetworkParams(alive=True)
    network = Network(TASK.observation.size, 9, 3, params)
    torch.nn.init.normal_(network.prediction.policy.weight)  # starts at zero
    tensors = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    card = dataclasses.replace(load_model(path).card, network=dataclasses.asdict(params))
    save_model(tmp_path / 'm.safetensors', tensors, card)
    policy, seen = load(tmp_path / 'm.safetensors', simulations=0), []
    decide = policy._agent._decide
    policy._agent._decide = lambda features: seen.append(features.copy()) or decide(features)
    sail(policy, scenarios[:1], 1)
    with torch.no_grad():
        logits = network.predict(network.represent(torch.from_numpy(seen[0]))).policy
    assert policy.decision.best[0] == int(logits.argmax())
    np.testing.assert_allclose(policy.decision.prior, torch.softmax(logits[0], 0).numpy(), atol=1e-5)


def test_it_decides_anew_at_every_call(path, scenarios):
    policy, calls = load(path), []
    decide = policy._agent._decide
    policy._agent._decide = lambda features: calls.append(len(features)) or decide(features)
    sail(policy, scenarios, periods=3)
    assert calls == [3, 3, 3]


def test_a_mirrored_scene_gets_the_mirrored_decision(make_model):
    task = TaskParams(ObservationParams(layout='aligned', ages=(0, 2), sectors=60), ActionParams(hold=2))
    policy = load(make_model(task), simulations=0)
    mirror = mirror_of(task.observation, task.actions)
    features = np.random.default_rng(5).standard_normal((1, task.observation.size)).astype(np.float32)
    decisions = []
    for scene in (features, mirror.features(features)):
        policy._decide(scene)
        decisions.append(policy.decision)
    as_is, mirrored = decisions
    np.testing.assert_allclose(as_is.prior, mirrored.prior[mirror.action], rtol=1e-5)
    assert np.ptp(as_is.prior) > 1e-3
    assert as_is.value == pytest.approx(mirrored.value)
