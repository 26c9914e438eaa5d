"""PPO from stable-baselines3 on the batched environment."""

import copy
import dataclasses
import io

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.env import PortVectorEnv

torch = pytest.importorskip('torch')
pytest.importorskip('stable_baselines3')

from portnav_ros.baselines.ppo_agent import PpoAgent, PpoParams  # noqa: E402 - needs the extra `train`
from portnav_ros.baselines.ppo_env import PortVecEnv  # noqa: E402

SMALL = PpoParams(environments=3, rollout=8, batch=12, epochs=2, hidden=(16,))
STRAIGHT = 14  # heading kept, 5 m/s


def ports(time_limit_s=900.0, count=3):
    scenario = dataclasses.replace(load_scenario('no_traffic'), time_limit_s=time_limit_s)
    return PortVectorEnv(count, source=lambda _: scenario)


def wrapped(env, reward_scale=0.01, listen=lambda *_: None):
    return PortVecEnv(env, reward_scale, listen)


def test_adapter_shows_the_environment_with_scaled_rewards():
    plain, adapter = ports(), wrapped(ports(), 0.01)
    first, _ = plain.reset()
    np.testing.assert_array_equal(adapter.reset(), first)
    for action in (0, STRAIGHT, 26):
        features, rewards, *_ = plain.step(np.full(3, action))
        seen, scaled, ended, _ = adapter.step(np.full(3, action))
        np.testing.assert_array_equal(seen, features)
        np.testing.assert_allclose(scaled, 0.01 * rewards, rtol=1e-6)
        assert not ended.any()


def test_adapter_hands_on_the_last_observation_and_marks_a_time_out():
    plain, adapter = ports(time_limit_s=3.0), wrapped(ports(time_limit_s=3.0))
    plain.reset()
    adapter.reset()
    for _ in range(3):
        *_, infos = plain.step(np.full(3, STRAIGHT))
        _, _, ended, rows = adapter.step(np.full(3, STRAIGHT))
    assert ended.all()
    for b, row in enumerate(rows):
        assert row['TimeLimit.truncated']
        np.testing.assert_array_equal(row['terminal_observation'], infos['final_obs'][b])


def test_a_collision_is_no_time_out(canal):
    scenario = canal(start=(60.0, 120.0, np.pi / 2.0))  # close to the quay, heading for it
    adapter = wrapped(PortVectorEnv(1, source=lambda _: scenario))
    adapter.reset()
    ended = np.zeros(1, bool)
    while not ended[0]:
        _, reward, ended, rows = adapter.step(np.array([STRAIGHT]))
    assert reward[0] < -9.0
    assert not rows[0]['TimeLimit.truncated']


def test_listener_hears_raw_rewards():
    heard = []
    adapter = wrapped(ports(), 0.01, lambda reward, ended, infos: heard.append((reward, ended, infos)))
    adapter.reset()
    _, scaled, *_ = adapter.step(np.full(3, STRAIGHT))
    (reward, ended, infos), *_ = heard
    np.testing.assert_allclose(0.01 * reward, scaled, rtol=1e-6)
    np.testing.assert_allclose(reward, infos['reward_terms'].sum(axis=1))
    assert not ended.any()


def test_a_time_out_adds_the_value_of_the_last_observation_to_the_last_reward():
    env = ports(time_limit_s=float(SMALL.rollout))
    heard = []
    adapter = wrapped(env, SMALL.reward_scale, lambda reward, ended, infos: heard.append((reward, infos)))
    agent = PpoAgent(SMALL, adapter, 0, 'cpu')
    before = copy.deepcopy(agent.algorithm.policy)  # rewards are stored before learning
    agent.improve()
    reward, infos = heard[-1]
    with torch.no_grad():
        value = before.predict_values(torch.tensor(infos['final_obs'])).numpy()[:, 0]
    expected = SMALL.reward_scale * reward + SMALL.discount * value
    np.testing.assert_allclose(agent.algorithm.rollout_buffer.rewards[-1], expected, atol=1e-5)
    assert np.abs(value).min() > 1e-3  # else it would be the same without


def test_state_survives_a_file_without_pickle_and_learning_goes_on_bit_for_bit():
    envs = [ports(), ports()]
    agent, twin = (PpoAgent(SMALL, wrapped(env), seed, 'cpu') for seed, env in enumerate(envs))
    agent.improve()
    file = io.BytesIO()
    torch.save(agent.state_dict(), file)
    world = envs[0].state_dict()
    losses = agent.improve()

    file.seek(0)
    twin.load_state_dict(torch.load(file, weights_only=True))
    envs[1].load_state_dict(world)
    assert twin.decisions == SMALL.environments * SMALL.rollout
    assert twin.improve() == losses
    for name, tensor in agent.tensors().items():
        np.testing.assert_array_equal(twin.tensors()[name], tensor)


def test_exported_tensors_are_the_policy():
    agent = PpoAgent(SMALL, wrapped(ports()), 0, 'cpu')
    tensors = agent.tensors()
    features = np.random.default_rng(0).normal(size=(5, tensors['policy.0.weight'].shape[1]))
    hidden = np.tanh(features @ tensors['policy.0.weight'].T + tensors['policy.0.bias'])
    logits = hidden @ tensors['policy.1.weight'].T + tensors['policy.1.bias']
    with torch.no_grad():
        distribution = agent.algorithm.policy.get_distribution(torch.tensor(features, dtype=torch.float32))
    expected = distribution.distribution.logits.numpy()
    np.testing.assert_allclose(
        logits - logits.mean(1, keepdims=True), expected - expected.mean(1, keepdims=True), atol=1e-5
    )


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'batch': 7}, 'does not divide'),
        ({'hidden': ()}, 'at least one layer'),
        ({'discount': 1.5}, 'discount'),
    ],
)
def test_impossible_parameters_are_refused(changes, message):
    with pytest.raises(ParamError, match=message):
        dataclasses.replace(SMALL, **changes)
