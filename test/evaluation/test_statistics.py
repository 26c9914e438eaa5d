import numpy as np
import pytest

from portnav_ros.evaluation.statistics import paired_difference


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
