"""Running means over the last episodes."""

import itertools

import numpy as np
import pytest

from portnav_ros.training.episode_statistics import EpisodeStatistics, wilson_interval
from portnav_ros.training.schedule import due
from portnav_ros.types import Outcome


def infos(outcome, errors):
    return {'outcome': np.array(outcome), 'errors': np.array(errors, float)}


def test_nothing_is_known_before_the_first_episode():
    assert set(EpisodeStatistics(2, 1.0).summary().values()) == {None}


def test_means_of_an_episode():
    statistics = EpisodeStatistics(2, 4.0)
    no, first = np.array([False, False]), np.array([True, False])
    statistics.update(np.array([-1.0, -5.0]), no, infos([0, 0], [[1, -2, 0.5], [9, 9, 9]]))
    statistics.update(
        np.array([1000.0, -5.0]), first, infos([Outcome.SUCCESS, 0], [[-3, 4, -0.1], [9, 9, 9]])
    )
    summary = statistics.summary()
    assert statistics.episodes == 1
    assert summary['success'] == 1.0
    assert summary['reward'] == 999.0
    assert summary['length_s'] == 8.0
    assert [summary['e_x'], summary['e_y'], summary['e_psi']] == pytest.approx([2.0, 3.0, 0.3])


def play(statistics, rng, decisions):
    for _ in range(decisions):
        ended = rng.random(3) < 0.3
        outcome = np.where(ended, rng.integers(1, 6, 3), 0)
        statistics.update(rng.normal(size=3), ended, infos(outcome, rng.normal(size=(3, 3))))


def test_only_the_last_episodes_count():
    statistics = EpisodeStatistics(3, 1.0, window=5)
    play(statistics, np.random.default_rng(0), 100)
    everyone = np.ones(3, dtype=bool)
    for _ in range(2):
        statistics.update(np.zeros(3), everyone, infos([Outcome.TIMEOUT] * 3, np.zeros((3, 3))))
    assert statistics.summary()['timeout'] == 1.0


def test_a_restored_copy_goes_on_alike():
    first, second = EpisodeStatistics(3, 1.0, window=7), EpisodeStatistics(3, 1.0, window=7)
    play(first, np.random.default_rng(1), 50)
    second.load_state_dict(first.state_dict())
    for statistics in (first, second):
        play(statistics, np.random.default_rng(2), 20)
    assert first.summary() == second.summary()
    assert first.episodes == second.episodes


def test_due_at_each_multiple_once():
    pairs = itertools.pairwise([0, 90, 180, 300, 301, 600])
    assert [due(a, b, 100) for a, b in pairs] == [False, True, True, False, True]
    assert not due(0, 1000, 0)


def test_wilson_of_the_papers_figures():
    assert wilson_interval(55, 100) == pytest.approx((0.4524, 0.6439), abs=5e-4)
    assert wilson_interval(70, 100) == pytest.approx((0.6042, 0.7811), abs=5e-4)


def test_wilson_at_the_ends():
    low, high = wilson_interval(0, 10)
    assert (low, high) == (0.0, pytest.approx(0.2775, abs=1e-4))
    low, high = wilson_interval(10, 10)
    assert (low, high) == (pytest.approx(0.7225, abs=1e-4), 1.0)
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_wilson_mirrors_and_narrows():
    low, high = wilson_interval(300, 1000)
    other_low, other_high = wilson_interval(700, 1000)
    assert (low, high) == (pytest.approx(1.0 - other_high), pytest.approx(1.0 - other_low))
    assert high - low < wilson_interval(30, 100)[1] - wilson_interval(30, 100)[0]


def test_wilson_covers_the_truth_about_as_often_as_it_says():
    draws = np.random.default_rng(1).binomial(60, 0.55, 2000)
    covered = [low <= 0.55 <= high for low, high in (wilson_interval(int(k), 60) for k in draws)]
    assert 0.93 < np.mean(covered) < 0.97
