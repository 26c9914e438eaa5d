"""Rehearsed self-play: who rehearses, what is tried, and what it would have earned."""

import math
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

pytest.importorskip('torch')

from portnav_ros.muzero.inference import numpy_model
from portnav_ros.muzero.losses import WORTH_OF_REGRET
from portnav_ros.muzero.networks import Network, NetworkParams
from portnav_ros.muzero.rehearsal import Rehearsal, RehearsalParams, Rollouts, stakes, tried
from portnav_ros.muzero.tutor import NOT_TAUGHT, REGRET_MAX
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.params import TaskParams
from portnav_ros.types import Outcome

GRID = ActionParams(tuple(math.radians(a) for a in (-45.0, -20.0, 0.0, 20.0, 45.0)), (1.0, 5.0), 'path', 4)
TASK = TaskParams(ObservationParams(layout='aligned', ages=(0, 2), sectors=12, tracks=3), GRID)
BATCH, DISCOUNT = 8, 0.99


def source(rng):
    return load_scenario('slow_head_on', int(rng.integers(50)))


def networks(seed=0):
    """Networks that were never trained, but think something of every action."""
    import torch

    torch.manual_seed(seed)
    network = Network(TASK.observation.size, 5, 2, NetworkParams(8, (16,), (16,), (16,), alive=True))
    for head in (network.prediction.policy, network.prediction.value, network.dynamics.reward):
        torch.nn.init.normal_(head.weight, std=0.2)
    arrays = {name: tensor.detach().numpy() for name, tensor in network.state_dict().items()}
    return numpy_model(arrays, 2, DISCOUNT)


def sailing(decisions=0, action=5, draw=source):
    """Vessels on their way, and what they see."""
    env = PortVectorEnv(BATCH, source=draw, task=TASK)
    features, _ = env.reset(seed=3)
    for _ in range(decisions):
        features, *_ = env.step(np.full(BATCH, action))
    return env, features


def rehearsing(env, **params):
    return Rehearsal(env, RehearsalParams(steps=1, **{'actions': 4, 'decisions': 3, **params}), DISCOUNT)


def sailed_on(env, vessel, action, model, decisions):
    """The oracle of a rollout: one decision after the other in a world of the vessel's own."""
    alone = PortVectorEnv(1, source=source, task=TASK, autoreset_mode=AutoresetMode.DISABLED)
    alone.copy(env, np.array([vessel]))
    total, weight = 0.0, 1.0
    for _ in range(decisions + 1):
        features, reward, terminated, truncated, _ = alone.step(np.array([action]))
        total += weight * reward[0]
        if terminated[0]:
            return total
        weight *= DISCOUNT
        if truncated[0]:
            break
        action = int(model.predict(model.represent(features))[0].argmax())
    return total + weight * model.predict(model.represent(features))[1][0]


@pytest.mark.parametrize(('before', 'decisions'), [(0, 0), (6, 4), (20, 40)])
def test_an_action_earns_what_comes_of_it(before, decisions):
    """At the start, on the way, and into the vessel that comes."""
    env, _ = sailing(before)
    model, vessels = networks(), np.array([5, 0, 2])
    actions = np.array([[5, 0], [1, 9], [4, 5]])
    params = RehearsalParams(actions=2, decisions=decisions)
    earned = Rollouts(env, 3, params, DISCOUNT).earned(model, vessels, actions)
    for n, k in np.ndindex(3, 2):
        expected = sailed_on(env, vessels[n], actions[n, k], model, decisions)
        assert earned[n, k] == pytest.approx(expected, rel=1e-4, abs=1e-2)


def test_time_that_runs_out_in_a_rehearsal_ends_it_with_what_the_network_thinks():
    """After six decisions of forty."""
    env, _ = sailing(20, 0, lambda rng: replace(source(rng), time_limit_s=104.0))
    model, vessels = networks(), np.arange(BATCH)
    actions = np.tile(np.array([[5, 0]]), (BATCH, 1))
    params = RehearsalParams(actions=2, decisions=40)
    rollouts = Rollouts(env, BATCH, params, DISCOUNT)
    earned = rollouts.earned(model, vessels, actions)
    outcome = rollouts._copies.world.outcome
    assert (outcome == Outcome.TIMEOUT).sum() > BATCH  # of the copies, two to a vessel
    for n, k in np.ndindex(BATCH, 2):
        expected = sailed_on(env, vessels[n], actions[n, k], model, 40)
        assert earned[n, k] == pytest.approx(expected, rel=1e-4, abs=1e-2)


def test_an_end_counts_and_nothing_behind_it():
    """Full speed ahead into a quay or the vessel that comes, with a policy that never turns."""
    env, _ = sailing(20)
    model = networks()
    model.weights.predict_out.weight[:, : GRID.count] = 0.0
    model.weights.predict_out.bias[: GRID.count] = np.arange(GRID.count) == 5
    params = RehearsalParams(actions=2, decisions=200)
    earned = Rollouts(env, BATCH, params, DISCOUNT).earned(model, np.arange(BATCH), np.full((BATCH, 2), 5))
    assert (earned < -200.0).all()
    np.testing.assert_array_equal(earned[:, 0], earned[:, 1])


def test_to_rehearse_leaves_the_world_as_it_was():
    env, features = sailing(5)
    before = {name: array.copy() for name, array in env.state_dict().items()}
    rehearsing(env, share=1.0).decide(networks(), features, np.random.default_rng(0))
    for name, array in env.state_dict().items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)


def test_a_share_rehearses_and_its_lessons_are_whole():
    env, features = sailing(5, np.arange(BATCH))
    found = rehearsing(env, share=0.5).decide(networks(), features, np.random.default_rng(0))
    told = found.lesson[:, 0] != NOT_TAUGHT
    assert told.sum() == BATCH // 2
    assert (found.lesson[~told] == NOT_TAUGHT).all()
    assert (found.regret[~told] == 0.0).all()
    assert all(len(set(row)) == 4 and min(row) >= 0 for row in found.lesson[told])
    assert (found.regret[told].min(axis=1) == 0.0).all()
    assert (found.regret[told].max(axis=1) > 0.0).all()
    assert found.regret.max() <= REGRET_MAX


def test_regrets_are_in_the_units_of_a_lesson():
    env, features = sailing(20)
    model, rng = networks(), np.random.default_rng(0)
    found = rehearsing(env, share=1.0, decisions=8).decide(model, features, rng)
    earned = np.array(
        [[sailed_on(env, b, action, model, 8) for action in found.lesson[b]] for b in range(BATCH)]
    )
    expected = (earned.max(axis=1, keepdims=True) - earned) / WORTH_OF_REGRET
    np.testing.assert_allclose(found.regret, np.minimum(expected, REGRET_MAX), rtol=2e-3, atol=0.1)


def test_threads_share_the_work_and_change_nothing_but_the_last_bits():
    env, features = sailing(5)
    model = networks()
    one, three = (
        rehearsing(env, share=0.875, threads=threads).decide(model, features, np.random.default_rng(0))
        for threads in (1, 3)
    )
    np.testing.assert_array_equal(one.action, three.action)
    np.testing.assert_array_equal(one.lesson, three.lesson)
    np.testing.assert_allclose(one.regret, three.regret, rtol=1e-2, atol=0.1)


def test_those_with_most_at_stake_rehearse_beside_some_that_are_drawn():
    env, features = sailing(5, np.arange(BATCH))
    model, rng = networks(), np.random.default_rng(0)
    latent = model.represent(features)
    most = np.argsort(-stakes(model, latent, model.predict(latent)[0]))[:2]
    surely = rehearsing(env, share=0.25, chance=0.0)
    often = np.zeros(BATCH)
    for _ in range(20):
        found = surely.decide(model, features, rng)
        np.testing.assert_array_equal(np.flatnonzero(found.lesson[:, 0] != NOT_TAUGHT), np.sort(most))
        drawn = rehearsing(env, share=0.25, chance=1.0, decisions=0).decide(model, features, rng)
        often += drawn.lesson[:, 0] != NOT_TAUGHT
    assert (often > 0).all()


def test_stakes_are_the_spread_of_what_actions_are_thought_to_be_worth():
    model, rng = networks(), np.random.default_rng(0)
    latent = rng.normal(size=(5, 8)).astype(np.float32)
    logits = rng.normal(size=(5, 10)).astype(np.float32)
    after = model.step(np.repeat(latent, 10, axis=0), np.tile(np.arange(10), 5))
    worth = (after.reward + after.discount * after.value).reshape(5, 10)
    weight = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    mean = (weight * worth).sum(axis=1)
    spread = np.sqrt((weight * worth**2).sum(axis=1) - mean**2)
    np.testing.assert_allclose(stakes(model, latent, logits), spread, rtol=1e-2)


def test_the_likeliest_action_is_always_tried_and_no_action_twice():
    rng = np.random.default_rng(0)
    logits = np.array([[0.0, 5.0, 0.0, -9.0], [0.0, 0.0, 0.0, 0.0]])
    draws = np.array([tried(logits, 3, rng) for _ in range(200)])
    assert (draws[:, 0, 0] == 1).all()
    assert all(len(set(row)) == 3 for draw in draws for row in draw)
    counts = np.bincount(draws[:, 0].ravel(), minlength=4)
    assert counts[0] > 150 > 10 > counts[3]


def test_rehearsals_that_cannot_be_are_refused():
    with pytest.raises(ParamError, match='actions'):
        RehearsalParams(actions=1)
    env, _ = sailing()
    with pytest.raises(ParamError, match=r'rehearsal\.actions = 11: the task has 10 actions'):
        rehearsing(env, actions=11)
