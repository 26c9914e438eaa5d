"""Returns: closed forms, ends of episodes, and reward t belongs to action t."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from portnav_ros.muzero.targets import RUNNING, TERMINATED, TRUNCATED, History, TargetParams, make_targets
from portnav_ros.params import ParamError

GAMMA = 0.9


def history(reward, end=None, value=None, final_value=None):
    def row(values, kind):
        return np.array([values], kind)

    zeros = [0.0] * len(reward)
    return History(
        row(reward, np.float32),
        row(end or [RUNNING] * len(reward), np.uint8),
        row(value or zeros, np.float32),
        row(final_value or zeros, np.float32),
    )


def targets(stored, first=0, unroll=1, newest=None, hold=1, **params):
    last = stored.reward.shape[1] - 1 if newest is None else newest
    where = np.array([0]), np.array([first])
    return make_targets(stored, last, *where, unroll, TargetParams(discount=GAMMA, **params), hold)


BOTH = pytest.mark.parametrize(
    'params', [{'returns': 'n_step', 'steps': 3}, {'returns': 'td_lambda', 'trace': 0.6}]
)


def test_n_step_return_is_three_rewards_and_the_root_value_behind_them():
    stored = history([1, 2, 3, 4, 5], value=[10, 20, 30, 40, 50])
    expected = 1 + GAMMA * 2 + GAMMA**2 * 3 + GAMMA**3 * 40
    assert targets(stored, steps=3).value[0, 0] == pytest.approx(expected)


def test_a_decision_that_is_held_has_the_power_of_the_discount():
    stored = history([1, 2, 3], value=[10, 20, 30])
    assert targets(stored, steps=1, hold=4).value[0, 0] == pytest.approx(1 + GAMMA**4 * 20)


def test_without_future_the_newest_root_value_stands():
    stored = history([1, 2, 3], value=[10, 20, 30])
    assert targets(stored, first=1, steps=50).value[0].tolist() == pytest.approx([2 + GAMMA * 30, 30])


@given(st.lists(st.floats(-10, 10), min_size=4, max_size=12), st.floats(0.0, 1.0))
def test_td_lambda_is_the_weighted_mean_of_n_step_returns(numbers, trace):
    count = len(numbers)
    value = numbers[::-1]
    stored = history(numbers, value=value)
    n_step = [sum(GAMMA**i * numbers[i] for i in range(n)) + GAMMA**n * value[n] for n in range(1, count)]
    weights = [(1 - trace) * trace ** (n - 1) for n in range(1, count - 1)] + [trace ** (count - 2)]
    found = targets(stored, returns='td_lambda', trace=trace).value[0, 0]
    assert found == pytest.approx(float(np.dot(weights, n_step)), rel=1e-4, abs=1e-3)


@BOTH
def test_nothing_is_added_behind_a_terminal(params):
    stored = history(
        [-1, -1000, 7, 7, 7], [RUNNING, TERMINATED, RUNNING, RUNNING, RUNNING], [99] * 5, [99] * 5
    )
    found = targets(stored, first=1, **params)
    assert found.value[0].tolist() == [-1000, 0]
    assert found.going_on[0].tolist() == [0]
    assert found.live[0].tolist() == [1, 0]
    assert found.absorbed[0].tolist() == [0, 1]


@BOTH
def test_a_time_out_bootstraps_from_what_was_seen_last(params):
    stored = history([-1, -2, 7, 7], [RUNNING, TRUNCATED, RUNNING, RUNNING], [99] * 4, [0, 500, 0, 0])
    found = targets(stored, first=1, unroll=2, **params)
    assert found.value[0].tolist() == pytest.approx([-2 + GAMMA * 500, 0, 0])
    assert found.going_on[0].tolist() == [1, 1]
    assert found.live[0].tolist() == [1, 0, 0]
    assert found.absorbed[0].tolist() == [0, 0, 0]


@BOTH
def test_an_absorbing_state_earns_nothing_and_the_next_episode_does_not_leak(params):
    stored = history([1, 2, 50, 60], [RUNNING, TERMINATED, RUNNING, RUNNING], [9] * 4)
    found = targets(stored, unroll=3, **params)
    assert found.reward[0].tolist() == [1, 2, 0]
    assert found.value[0, 1:].tolist() == [2, 0, 0]
    assert found.live[0].tolist() == [1, 1, 0, 0]


def test_reward_of_a_decision_belongs_to_its_action():
    stored = history([10, 20, 30, 40])
    assert targets(stored, first=1, unroll=2).reward[0].tolist() == [20, 30]


@BOTH
def test_the_ring_wraps_around(params):
    straight = history([1, 2, 3, 4], value=[5, 6, 7, 8])
    turned = History(*(np.roll(array, 2, axis=1) for array in straight))
    wrapped = targets(turned, first=6, unroll=2, newest=9, **params)
    plain = targets(straight, unroll=2, **params)
    for a, b in zip(wrapped, plain, strict=True):
        np.testing.assert_array_equal(a, b)


def test_unknown_returns_are_refused():
    with pytest.raises(ParamError, match='td_lambda'):
        TargetParams(returns='monte_carlo')
