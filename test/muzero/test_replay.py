"""The ring: what is kept, what is drawn, and what comes back from a checkpoint."""

import itertools

import numpy as np
import pytest

from portnav_ros.muzero.replay import Replay, ReplayParams, Sample, Segment, half_mirrored
from portnav_ros.muzero.targets import TargetParams, Targets
from portnav_ros.params import ParamError
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.mirror import mirror_of
from portnav_ros.task.observation import ObservationParams

BATCH, FEATURES, ACTIONS = 3, 4, 5
TARGETS = TargetParams()


def segment(first, count):
    """Decisions that carry their own number: feature and reward are t + b / 10, the action t."""
    t, b = np.meshgrid(np.arange(first, first + count), np.arange(BATCH), indexing='ij')
    number = (t + b / 10.0).astype(np.float32)
    return Segment(
        features=np.repeat(number[..., None], FEATURES, -1),
        action=(t % ACTIONS).astype(np.int16),
        reward=number,
        end=np.zeros_like(t, np.uint8),
        value=-number,
        policy=np.full((count, BATCH, ACTIONS), 0.2, np.float32),
        final_value=np.zeros_like(number),
        version=t.astype(np.int32),
        lesson=np.zeros((count, BATCH, 0), np.int8),
        regret=np.zeros((count, BATCH, 0), np.float16),
    )


def filled(sizes):
    replay = Replay(ReplayParams(capacity=100, precision='float32', warmup=0), BATCH, FEATURES, ACTIONS)
    for count in sizes:
        replay.append(segment(replay.written, count))
    return replay


def told(share, every):
    """Sequences of a replay in which every so manieth decision of the first environment has a lesson."""
    params = ReplayParams(capacity=300, precision='float32', warmup=0, lessons=share)
    replay = Replay(params, BATCH, FEATURES, ACTIONS, lessons=2)
    lesson = np.full((90, BATCH, 2), -1, np.int8)
    lesson[::every, 0] = (0, 1)
    replay.append(segment(0, 90)._replace(lesson=lesson, regret=np.zeros_like(lesson, np.float16)))
    return replay.sample(np.random.default_rng(0), 200, 4, TARGETS).lesson[:, 0, 0] >= 0


def test_a_share_of_the_sequences_begins_with_a_lesson():
    rare = told(0.0, 5).mean()
    assert rare < 0.15
    assert 0.5 <= told(0.5, 5).mean() < 0.5 + rare
    assert told(1.0, 5).all()
    halves = told(0.5, 5).reshape(2, 100).mean(axis=1)
    assert (abs(halves - 0.53) < 0.15).all()  # in the mirrored half as in the other


def test_where_lessons_are_too_rare_the_others_are_drawn_as_ever():
    assert 0.0 < told(1.0, 45).mean() < 0.5
    assert not told(1.0, 1000)[1:].all()


def test_memory_is_flat_and_the_oldest_go():
    replay = filled([20] * 5)
    assert replay.rows == 33
    assert len(replay) == 99
    assert replay.oldest == 67
    kept = replay.segment(replay.oldest, replay.written)
    np.testing.assert_array_equal(kept.version[:, 0], np.arange(67, 100))


def test_a_sequence_holds_together():
    replay = filled([20, 20])
    sample = replay.sample(np.random.default_rng(0), 200, 4, TARGETS)
    first = sample.version
    assert first.min() >= replay.oldest
    assert first.max() <= replay.written - 5
    np.testing.assert_array_equal(np.floor(sample.features[:, 0] + 0.01), first)
    np.testing.assert_array_equal(sample.action, (first[:, None] + np.arange(4)) % ACTIONS)
    np.testing.assert_allclose(
        sample.targets.reward - sample.features[:, :1], [[0, 1, 2, 3]] * 200, atol=1e-4
    )


def test_every_decision_that_can_begin_a_sequence_is_drawn():
    replay = filled([40])
    sample = replay.sample(np.random.default_rng(0), 3000, 2, TARGETS)
    drawn = {
        (int(t), round(float(f[0] - t), 1)) for t, f in zip(sample.version, sample.features, strict=True)
    }
    assert drawn == {(t, b / 10) for t in range(replay.oldest, 38) for b in range(BATCH)}


def test_features_of_all_positions():
    replay = filled([20])
    one = replay.window(np.array([1]), np.array([5]), 3, TARGETS)
    all_of_them = replay.window(np.array([1]), np.array([5]), 3, TARGETS, all_features=True)
    assert all_of_them.features.shape == (1, 4, FEATURES)
    np.testing.assert_array_equal(all_of_them.features[:, 0], one.features)
    np.testing.assert_allclose(all_of_them.features[0, :, 0], [5.1, 6.1, 7.1, 8.1], rtol=1e-6)


@pytest.mark.parametrize('cuts', [[0, 40], [0, 7, 29, 40], [5, 30, 40]])
def test_a_restored_ring_draws_the_same(cuts):
    replay, copy = filled([20, 20]), filled([])
    cuts = [max(cut, replay.oldest) for cut in cuts]
    parts = [(a, replay.segment(a, b)) for a, b in itertools.pairwise(cuts)]
    copy.restore(replay.written, parts)
    samples = [ring.sample(np.random.default_rng(3), 64, 3, TARGETS) for ring in (replay, copy)]
    np.testing.assert_array_equal(samples[0].features, samples[1].features)
    np.testing.assert_array_equal(samples[0].targets.value, samples[1].targets.value)


def test_a_ring_with_a_hole_at_its_end_is_refused():
    replay, copy = filled([40]), filled([])
    with pytest.raises(ValueError, match='instead of 40'):
        copy.restore(40, [(7, replay.segment(7, 30))])


def test_too_few_decisions_are_refused():
    with pytest.raises(ValueError, match='sequence of 6'):
        filled([5]).sample(np.random.default_rng(0), 1, 5, TARGETS)


def test_parameters_that_never_learn_are_refused():
    with pytest.raises(ParamError, match='warmup'):
        ReplayParams(capacity=1000, warmup=2000)


OBSERVATION = ObservationParams(layout='aligned', ages=(0, 3), sectors=12)
GRID = ActionParams((-0.4, 0.0, 0.4), (2.0, 5.0))


def lessons(count=5, unroll=2):
    """A sample of random numbers; every other position has no lesson."""
    rng = np.random.default_rng(0)
    shape = count, unroll + 1
    lesson = rng.permuted(np.tile(np.arange(GRID.count), (*shape, 1)), axis=-1)[..., :3]
    lesson[:, ::2] = -1
    blank = np.zeros(shape, np.float32)
    return Sample(
        features=rng.normal(size=(count, OBSERVATION.size)).astype(np.float16),
        action=rng.integers(GRID.count, size=(count, unroll)),
        policy=rng.dirichlet(np.ones(GRID.count), shape).astype(np.float32),
        targets=Targets(blank[:, 1:], blank, blank[:, 1:], blank, blank),
        version=np.zeros(count, np.int32),
        lesson=lesson,
        regret=rng.uniform(0.0, 100.0, lesson.shape).astype(np.float32),
    )


def test_the_first_half_is_mirrored_and_twice_is_as_before():
    mirror, sample = mirror_of(OBSERVATION, GRID), lessons()
    once = half_mirrored(sample, mirror)
    twice = half_mirrored(once, mirror)
    for name in ('features', 'action', 'policy', 'lesson', 'regret'):
        before, after = getattr(sample, name), getattr(once, name)
        assert after.dtype == before.dtype
        np.testing.assert_array_equal(after[2:], before[2:], err_msg=name)
        np.testing.assert_array_equal(getattr(twice, name), before, err_msg=name)
    assert (once.features[:2] != sample.features[:2]).any(axis=1).all()


def test_what_is_said_of_an_action_is_said_of_its_mirror_image():
    mirror, sample = mirror_of(OBSERVATION, GRID), lessons()
    once = half_mirrored(sample, mirror)
    table = GRID.table()
    turned = table * [-1.0, 1.0]
    np.testing.assert_array_equal(table[once.action[:2]], turned[sample.action[:2]])
    np.testing.assert_array_equal(once.policy[:2][..., mirror.action], sample.policy[:2])
    valued = sample.lesson[:2] >= 0
    np.testing.assert_array_equal(once.lesson[:2] >= 0, valued)
    np.testing.assert_array_equal(table[once.lesson[:2][valued]], turned[sample.lesson[:2][valued]])
    np.testing.assert_array_equal(once.regret, sample.regret)
