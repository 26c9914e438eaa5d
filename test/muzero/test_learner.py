"""The learner: falls on a fixed batch, learns a three-step MDP, and comes back from a checkpoint."""

import functools
import io

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.atoms import AtomParams  # noqa: E402
from portnav_ros.muzero.inference import NumpyModel, weights_of  # noqa: E402
from portnav_ros.muzero.learner import Learner, LearnerParams  # noqa: E402
from portnav_ros.muzero.networks import Network, NetworkParams  # noqa: E402
from portnav_ros.muzero.replay import Replay, ReplayParams, Segment  # noqa: E402
from portnav_ros.muzero.targets import RUNNING, TERMINATED, TRUNCATED, TargetParams  # noqa: E402
from portnav_ros.params import ParamError  # noqa: E402
from portnav_ros.training.run_directory import TrainingError  # noqa: E402

DISCOUNT = 0.5
REWARDS = np.array([[1.0, 10.0], [-20.0, 3.0], [100.0, -100.0]])  # [step, action] of the chain


def chain(count, rng, end=TERMINATED, final_value=0.0):
    """`count` decisions on a chain of three states under random actions; state s is seen one-hot."""
    state = np.arange(count)[:, None] % 3
    action = rng.integers(2, size=(count, 1))
    ended = state == 2
    return Segment(
        features=np.eye(3, dtype=np.float32)[state],
        action=action.astype(np.int16),
        reward=REWARDS[state, action].astype(np.float32),
        end=np.where(ended, end, RUNNING).astype(np.uint8),
        value=np.zeros((count, 1), np.float32),
        policy=np.full((count, 1, 2), 0.5, np.float32),
        final_value=np.where(ended, final_value, 0.0).astype(np.float32),
        version=np.zeros((count, 1), np.int32),
        lesson=np.zeros((count, 1, 0), np.int8),
        regret=np.zeros((count, 1, 0), np.float16),
    )


def learner(alive=True, seed=0, **params):
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    atoms = AtomParams(41, -200.0, 200.0, 'linear')
    net = Network(3, 2, 1, NetworkParams(16, (32,), (32,), (32,), atoms, atoms, alive))
    return Learner(net, LearnerParams(batch=64, unroll=3, learning_rate=3e-3, **params))


def replay_of(segment):
    replay = Replay(ReplayParams(capacity=900, warmup=0), 1, 3, 2)
    replay.append(segment)
    return replay


@functools.cache
def taught(alive, end=TERMINATED, final_value=0.0, updates=250):
    segment = chain(900, np.random.default_rng(0), end, final_value)
    rng, made, replay = np.random.default_rng(1), learner(alive), replay_of(segment)
    for _ in range(updates):
        made.update(replay.sample(rng, 64, 3, TargetParams(discount=DISCOUNT, steps=10)))
    return NumpyModel(weights_of(made.arrays(), 1), DISCOUNT)


@pytest.mark.parametrize('alive', [True, False])
def test_three_step_chain_is_learned_with_each_reward_at_its_action(alive):
    model = taught(alive)
    mean = REWARDS.mean(1)
    expected_value = [
        mean[0] + DISCOUNT * (mean[1] + DISCOUNT * mean[2]),
        mean[1] + DISCOUNT * mean[2],
        mean[2],
    ]
    for state in range(3):
        latent = model.represent(np.eye(3, dtype=np.float32)[[state, state]])
        _, value = model.predict(latent)
        step = model.step(latent, np.array([0, 1]))
        np.testing.assert_allclose(step.reward, REWARDS[state], atol=6.0)
        np.testing.assert_allclose(value, expected_value[state], atol=12.0)
        if alive:
            np.testing.assert_allclose(step.discount, DISCOUNT * (state < 2), atol=0.05)


def test_the_unrolled_model_knows_the_rewards_to_come():
    model = taught(True)
    for actions in ([0, 0, 0], [1, 1, 1], [0, 1, 0]):
        latent = model.represent(np.eye(3, dtype=np.float32)[[0]])
        rewards, discounts = [], []
        for action in actions:
            step = model.step(latent, np.array([action]))
            latent = step.latent
            rewards.append(float(step.reward[0]))
            discounts.append(float(step.discount[0]))
        np.testing.assert_allclose(rewards, REWARDS[np.arange(3), actions], atol=10.0)
        np.testing.assert_allclose(discounts, [DISCOUNT, DISCOUNT, 0.0], atol=0.06)


def test_a_time_out_is_worth_more_than_its_reward():
    model = taught(True, TRUNCATED, final_value=150.0)
    latent = model.represent(np.eye(3, dtype=np.float32)[[2]])
    assert model.predict(latent)[1][0] == pytest.approx(REWARDS[2].mean() + DISCOUNT * 150.0, abs=12.0)
    assert model.step(latent, np.array([0])).discount[0] == pytest.approx(DISCOUNT, abs=0.03)


def test_every_loss_falls_on_a_fixed_batch():
    made = learner()
    sample = replay_of(chain(900, np.random.default_rng(0))).sample(
        np.random.default_rng(1), 64, 3, TargetParams(discount=DISCOUNT)
    )
    sample.policy[:] = [0.9, 0.1]
    losses = [made.update(sample) for _ in range(120)]
    for name in ('loss_policy', 'loss_value', 'loss_reward', 'loss_alive'):
        assert losses[-1][name] < 0.75 * losses[0][name], name


def test_diagnosis_tells_ends_from_the_rest():
    made, replay = learner(), replay_of(chain(900, np.random.default_rng(0)))
    rng = np.random.default_rng(1)
    before = made.diagnose(replay.sample(rng, 256, 3, TargetParams(discount=DISCOUNT)))
    assert before['reward_error_end'] == pytest.approx(100.0, abs=5.0)
    assert before['reward_error_going_on'] < 15.0
    assert before['policy_lag'] == 0.0
    assert before['target_entropy'] == pytest.approx(np.log(2.0), abs=1e-4)
    assert before['clipped_rewards'] == 0.0
    for _ in range(200):
        made.update(replay.sample(rng, 64, 3, TargetParams(discount=DISCOUNT)))
    after = made.diagnose(replay.sample(rng, 256, 3, TargetParams(discount=DISCOUNT)))
    assert after['reward_error_end'] < 30.0
    assert after['end_foreseen'] > 0.9 > 0.1 > after['end_feared']
    assert after['policy_lag'] == 200.0


def test_targets_beyond_the_atoms_are_counted():
    segment = chain(900, np.random.default_rng(0))
    segment.reward[:] *= 10.0
    found = learner().diagnose(
        replay_of(segment).sample(np.random.default_rng(1), 512, 3, TargetParams(discount=DISCOUNT))
    )
    assert found['clipped_rewards'] == pytest.approx(0.5, abs=0.1)  # half the steps earn more than 200


def test_the_rate_falls_linearly():
    made = learner(last_rate=1e-3)
    made.set_progress(0.5)
    assert made.state_dict()['optimiser']['param_groups'][0]['lr'] == pytest.approx(2e-3)


@pytest.mark.parametrize('average', [0, 4])
def test_a_restored_learner_goes_on_to_the_bit(average):
    first, second = learner(average=average), learner(seed=9, average=average)
    replay, rng = replay_of(chain(900, np.random.default_rng(0))), np.random.default_rng(1)
    samples = [replay.sample(rng, 64, 3, TargetParams()) for _ in range(6)]
    for sample in samples[:3]:
        first.update(sample)
    buffer = io.BytesIO()
    torch.save(first.state_dict(), buffer)
    buffer.seek(0)
    second.load_state_dict(torch.load(buffer, weights_only=True))
    for sample in samples[3:]:
        assert first.update(sample) == second.update(sample)
    assert first.updates == second.updates == 6
    for name, array in first.arrays().items():
        np.testing.assert_array_equal(array, second.arrays()[name], err_msg=name)
        np.testing.assert_array_equal(first.mean_arrays()[name], second.mean_arrays()[name], err_msg=name)


@pytest.mark.parametrize('average', [0, 1, 4])
def test_the_mean_of_the_weights_runs_over_so_many_updates(average):
    made, other = learner(average=average), learner(seed=9)
    made.load_arrays(other.arrays())  # and begins at those that it is given
    replay, rng = replay_of(chain(900, np.random.default_rng(0))), np.random.default_rng(1)
    expected = made.arrays()
    for _ in range(5):
        made.update(replay.sample(rng, 64, 3, TargetParams()))
        share = 1.0 / max(average, 1)
        expected = {name: old + share * (made.arrays()[name] - old) for name, old in expected.items()}
    for name, array in made.mean_arrays().items():
        np.testing.assert_allclose(array, expected[name], rtol=1e-4, atol=1e-6, err_msg=name)


def test_a_loss_that_is_not_finite_ends_the_run():
    made = learner()
    sample = replay_of(chain(900, np.random.default_rng(0))).sample(
        np.random.default_rng(1), 8, 3, TargetParams()
    )
    sample.features[0] = np.nan
    with pytest.raises(TrainingError, match='not finite'):
        made.update(sample)


def test_bfloat16_learns_nearly_the_same():
    sample = replay_of(chain(900, np.random.default_rng(0))).sample(
        np.random.default_rng(1), 64, 3, TargetParams(discount=DISCOUNT)
    )
    sample.policy[:] = [0.9, 0.1]
    exact, rough = learner(), learner(precision='bfloat16')
    before = exact.arrays()
    first = exact.update(sample), rough.update(sample)
    assert first[1]['loss'] == pytest.approx(first[0]['loss'], rel=0.01)
    assert first[1]['gradient_norm'] == pytest.approx(first[0]['gradient_norm'], rel=0.05)
    assert all(tensor.dtype == torch.float32 for tensor in rough.network.parameters())
    moved = np.concatenate([(exact.arrays()[name] - before[name]).ravel() for name in before])
    rounded = np.concatenate([(rough.arrays()[name] - before[name]).ravel() for name in before])
    assert np.corrcoef(moved, rounded)[0, 1] > 0.9
    last = [rough.update(sample) for _ in range(120)][-1]
    assert last['loss'] < 0.6 * first[1]['loss']


def test_another_precision_is_refused():
    with pytest.raises(ParamError, match='bfloat16'):
        LearnerParams(precision='float16')
