"""Spread over seeds and paired differences: closed forms."""

import numpy as np
import pytest

from portnav_ros.evaluation.statistics import sample, seed_difference

T_95 = {1: 12.7062, 2: 4.30265}  # Student's t by degrees of freedom


def test_sample():
    assert sample(np.array([1.0, 3.0])) == (2, 2.0, pytest.approx(np.sqrt(2.0)))
    assert sample(np.array([5.0])) == (1, 5.0, None)
    assert sample(np.zeros(0)) == (0, None, None)


def test_sample_as_text():
    assert sample(np.array([0.1, 0.3])).text('.1f', 100.0) == '20.0 ± 14.1'
    assert sample(np.array([0.1])).text('.1f', 100.0) == '10.0'
    assert sample(np.zeros(0)).text('.1f') == ''


def test_interval_of_a_paired_difference():
    result = seed_difference(np.array([2.0, 4.0, 6.0]), np.array([1.0, 2.0, 3.0]))
    half = T_95[2] / np.sqrt(3.0)
    assert (result.n, result.mean) == (3, 2.0)
    assert (result.low, result.high) == (
        pytest.approx(2.0 - half, abs=1e-4),
        pytest.approx(2.0 + half, abs=1e-4),
    )
    assert not result.resolved


def test_pairs_take_out_what_seeds_share():
    seeds = np.array([0.0, 50.0, 100.0])
    assert seed_difference(seeds + np.array([1.0, 1.1, 0.9]), seeds).resolved


def test_swapping_turns_the_sign():
    first, second = np.array([3.0, 3.5, 3.2]), np.array([1.0, 1.2, 1.3])
    one, other = seed_difference(first, second), seed_difference(second, first)
    assert (one.low, one.high) == (pytest.approx(-other.high), pytest.approx(-other.low))
    assert one.resolved
    assert other.resolved


@pytest.mark.parametrize(
    ('first', 'second'), [([1.0], [0.0]), ([], []), ([1.0, 1.0], [1.0, 1.0]), ([0.3, 0.15], [0.2, 0.05])]
)
def test_too_little_to_tell_is_not_resolved(first, second):
    assert not seed_difference(np.array(first), np.array(second)).resolved
