"""Taught self-play: who gets a lesson, who obeys it, and what the others do."""

import math

import numpy as np
import pytest

from portnav_ros.muzero.tutor import NOT_TAUGHT, REGRET_MAX, TeachingParams, Tutor
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.params import TaskParams

GRID = ActionParams(tuple(math.radians(a) for a in (-45.0, -20.0, 0.0, 20.0, 45.0)), (1.0, 5.0), 'path', 4)
TASK = TaskParams(ObservationParams(layout='aligned', ages=(0, 2), sectors=12), GRID)
AHEAD = 5  # no offset, full speed: the first action of every lesson
BATCH = 8
LOGITS = np.array([0.0, 1.0, -1.0, 2.0, 0.5, 0.0, 1.5, -0.5, 0.0, 1.0], np.float32)


class Opinion:
    """A network that thinks the same of everything."""

    def represent(self, features):
        return features

    def predict(self, latent):
        return np.tile(LOGITS, (len(latent), 1)), np.full(len(latent), 7.0, np.float32)


def sailing(batch=BATCH, seed=3, name='slow_head_on', **params):
    env = PortVectorEnv(batch, source=lambda rng: load_scenario(name, int(rng.integers(50))), task=TASK)
    features, _ = env.reset(seed=seed)
    return env, features, Tutor(env, TeachingParams(steps=1, **{'actions': 4, **params}))


def decisions(count, **params):
    """Decisions made again and again in one state."""
    _, features, tutor = sailing(**params)
    rng = np.random.default_rng(0)
    return [tutor.decide(Opinion(), features, rng) for _ in range(count)]


def frequencies(found):
    return np.bincount(np.concatenate([taught.action for taught in found]), minlength=GRID.count) / (
        BATCH * len(found)
    )


def test_followers_are_always_taught_and_others_by_share():
    found = decisions(60, share=0.5, follow=0.25)
    taught = np.array([item.lesson[:, 0] != NOT_TAUGHT for item in found])
    assert taught[:, :2].all()
    assert 0.4 < taught[:, 2:].mean() < 0.6
    assert (taught[:, 2:].mean(axis=0) < 1.0).all()


def test_a_lesson_is_whole_or_not_there():
    for item in decisions(5, share=0.5, follow=0.0):
        taught = item.lesson[:, 0] != NOT_TAUGHT
        assert (item.lesson[~taught] == NOT_TAUGHT).all()
        assert (item.regret[~taught] == 0.0).all()
        assert (item.lesson[taught, 0] == AHEAD).all()
        assert all(len(set(row)) == 4 and min(row) >= 0 for row in item.lesson[taught])
        assert (item.regret[taught].min(axis=1) == 0.0).all()
        assert (item.regret[taught].max(axis=1) > 0.0).all()
        assert item.regret.max() <= REGRET_MAX
        np.testing.assert_array_equal(item.value, 7.0)


def test_followers_do_what_the_teacher_says():
    for item in decisions(5, share=0.0, follow=1.0, random=1.0):
        row = np.arange(BATCH)
        at = (item.lesson == item.action[:, None]).argmax(axis=1)
        np.testing.assert_array_equal(item.lesson[row, at], item.action)
        np.testing.assert_array_equal(item.regret[row, at], 0.0)


def test_others_follow_their_policy_at_its_temperature():
    still = {'share': 0.0, 'follow': 0.0, 'random': 0.0}
    np.testing.assert_array_equal(frequencies(decisions(3, temperature=1e-3, **still))[LOGITS.argmax()], 1.0)
    expected = np.exp(LOGITS / 2.0) / np.exp(LOGITS / 2.0).sum()
    np.testing.assert_allclose(frequencies(decisions(500, temperature=2.0, **still)), expected, atol=0.03)


def test_a_share_of_their_decisions_is_random():
    found = frequencies(decisions(500, share=0.0, follow=0.0, random=0.5, temperature=1e-3))
    expected = np.full(GRID.count, 0.05)
    expected[LOGITS.argmax()] += 0.5
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_only_new_episodes_are_foreseen_anew():
    env, _, tutor = sailing()
    before = tutor.state_dict()['poses'].copy()
    which = np.arange(BATCH) == 5
    env.reset(seed=[99] * BATCH, options={'reset_mask': which})
    tutor.look(which)
    after = tutor.state_dict()['poses']
    np.testing.assert_array_equal(after[~which], before[~which])
    assert (after[which] != before[which]).any()


def test_a_restored_tutor_teaches_the_same():
    """In the middle of the episodes, where a tutor that had to look again would miss what is past."""
    env, _, tutor = sailing(follow=0.5)
    for _ in range(6):
        features, _, terminated, truncated, _ = env.step(np.full(BATCH, AHEAD))
        tutor.look(terminated | truncated)
    other_env, _, other = sailing(seed=8, follow=0.5)
    other_env.load_state_dict({name: array.copy() for name, array in env.state_dict().items()})
    other.load_state_dict({name: array.copy() for name, array in tutor.state_dict().items()})
    first, second = (each.decide(Opinion(), features, np.random.default_rng(1)) for each in (tutor, other))
    for name, a, b in zip(first._fields, first, second, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


def test_lessons_that_cannot_be_are_refused():
    with pytest.raises(ParamError, match='actions'):
        TeachingParams(actions=1)
    with pytest.raises(ParamError, match=r'teaching\.actions = 11: the task has 10 actions'):
        sailing(actions=11)
