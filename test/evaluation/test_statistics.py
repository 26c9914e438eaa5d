import numpy as np
import pytest

from portnav_ros.evaluation.statistics import paired_difference, wilson_interval


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


def test_paired_difference_of_equal_columns_is_nil():
    column = np.array([True, False] * 20)
    result = paired_difference(column, column)
    assert (result.difference, result.p_value) == (0.0, 1.0)
    assert result.low < 0.0 < result.high


def test_paired_difference_by_hand():
    first = np.array([True] * 15 + [False] * 5 + [True] * 80)
    second = np.array([False] * 15 + [True] * 5 + [True] * 80)
    result = paired_difference(first, second)
    assert result.difference == pytest.approx(0.10)
    assert (result.only_first, result.only_second) == (15, 5)
    assert result.p_value == pytest.approx(0.04139, abs=1e-4)
    assert result.low == pytest.approx(0.0117, abs=2e-3)


def test_columns_of_different_episodes_are_refused():
    with pytest.raises(ValueError, match='paired episodes'):
        paired_difference(np.ones(3, bool), np.ones(4, bool))
