import math

import numpy as np
import pytest

from portnav_ros.muzero import rules
from portnav_ros.muzero.rules import halving_table, mix_value, pozero_policy, q_width, regularise
from portnav_ros.muzero.search import SearchParams

WIDTH = 32


def row(values, kind=np.float32):
    out = np.zeros(WIDTH, kind)
    out[: len(values)] = values
    return out


def bisected(prior, gap, strength):
    """pi_bar [K, W] in float64, alpha [K, 1] between its bounds by bisection of its logarithm."""
    prior, gap, strength = (values.astype(float) for values in (prior, gap, strength[:, None]))
    low = np.max(strength * prior - gap, 1, keepdims=True)
    high = strength.copy()
    for _ in range(100):
        middle = np.sqrt(low * high)
        above = np.sum(strength * prior / (middle + gap), 1, keepdims=True) > 1.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return strength * prior / (high + gap)


def draw_prior(rng, actions):
    prior = [
        rng.dirichlet(np.full(actions, 0.3)) + 1e-12,
        np.exp(rng.normal(0.0, 5.0, actions)),
        10.0 ** rng.uniform(-12.0, 0.0, actions),
        np.where(np.arange(actions) == rng.integers(actions), 1.0, 1e-12),
        np.ones(actions),
    ][rng.integers(5)]
    return prior / prior.sum()


def draw_q(rng, actions):
    return [
        rng.random(actions),
        np.round(rng.random(actions)),
        np.zeros(actions),
        1e-6 * rng.random(actions),
        10.0 ** rng.uniform(-10.0, 0.0, actions),
    ][rng.integers(5)]


def test_solver_against_bisection():
    rng = np.random.default_rng(0)
    prior, gap = (np.zeros((3000, WIDTH), np.float32) for _ in range(2))
    strength, out = np.zeros(3000, np.float32), np.full((3000, WIDTH), np.nan, np.float32)
    for k in range(len(prior)):
        actions, visits = rng.choice([2, 3, 27]), rng.choice([1, 2, 8, 50, 800])
        strength[k] = rng.choice([0.01, 1.25, 100.0]) * math.sqrt(visits) / (actions + visits)
        q = draw_q(rng, actions)
        prior[k], gap[k] = row(draw_prior(rng, actions)), row(q.max() - q)
        regularise(prior[k], gap[k], strength[k], out[k])
    variation = 0.5 * np.abs(out - bisected(prior, gap, strength)).sum(1)
    assert (variation < 1e-5).all()  # false for NaN too
    assert not out[prior == 0.0].any()


def policy_of(prior, q, visits, raw_value=0.0, **params):
    rule = SearchParams(**params).compiled(len(prior))
    out, gap = np.zeros(WIDTH, np.float32), np.zeros(WIDTH, np.float32)
    pozero_policy(rule, row(prior), row(q), row(visits, np.int32), np.float32(raw_value), gap, out)
    return out[: len(prior)]


def test_policy_solves_its_equation_with_the_exact_lambda():
    prior, q, visits = np.array([0.5, 0.3, 0.2]), np.array([1.0, 3.0, 2.0]), [4, 3, 2]
    policy = policy_of(prior, q, visits, raw_value=1.5, c=2.0)
    strength = 2.0 * math.sqrt(9.0) / (3.0 + 9.0)
    alpha = strength * prior / policy + (q - 1.0) / 2.0  # q over its range [1, 3]
    np.testing.assert_allclose(alpha, alpha[0], rtol=1e-5)
    assert policy.sum() == pytest.approx(1.0)


def test_policy_without_visits_or_with_ties_is_the_prior():
    prior = np.array([0.6, 0.3, 0.1])
    np.testing.assert_allclose(policy_of(prior, np.zeros(3), np.zeros(3), 7.0), prior, rtol=1e-6)
    np.testing.assert_allclose(policy_of(prior, np.full(3, 7.0), [1, 2, 3], 7.0), prior, rtol=1e-5)


def test_policy_leans_to_q_with_more_visits():
    prior, q = np.array([0.6, 0.3, 0.1]), np.array([0.0, 0.5, 1.0])
    best = [policy_of(prior, q, np.full(3, n))[2] for n in (1, 4, 20, 100, 10_000)]
    assert best == sorted(best)
    assert best[0] > 0.1
    assert best[-1] > 0.95


def test_unvisited_actions_take_the_mixed_value():
    prior, visits = row([0.5, 0.25, 0.25]), row([3, 1, 0], np.int32)
    q = row([2.0, 5.0, -99.0])
    weighted = (0.5 * 2.0 + 0.25 * 5.0) / 0.75
    mixed = mix_value(prior, q, visits, np.float32(1.0))
    assert mixed == pytest.approx((1.0 + 4.0 * weighted) / 5.0)
    assert mix_value(prior, q, row([], np.int32), np.float32(1.5)) == 1.5


def test_mixed_value_of_actions_without_prior_is_finite():
    assert mix_value(row([0.0, 1.0]), row([3.0]), row([1], np.int32), np.float32(1.0)) == pytest.approx(2.0)


def test_a_collision_does_not_hide_a_path_error():
    """One action ends in a collision (-1000); of the others one is 20 better by its path."""
    prior, visits, q = np.full(4, 0.25), np.full(4, 10), np.array([-20.0, 0.0, -20.0, -1000.0])
    bare = policy_of(prior, q, visits)
    bounded = policy_of(prior, q, visits, q_ceiling=100.0)
    assert bounded[1] > bare[1] + 0.1
    assert bounded[3] < 0.1


def test_the_floor_keeps_noise_small():
    prior, visits, q = np.array([0.7, 0.2, 0.1]), [5, 5, 5], np.array([0.0, 0.1, 0.2])
    bare, floored = policy_of(prior, q, visits, 0.1), policy_of(prior, q, visits, 0.1, q_floor=100.0)
    assert np.abs(floored - prior).max() < 0.01
    assert bare[2] > 0.3


def test_width_is_bounded():
    rule = SearchParams(q_floor=5.0, q_ceiling=50.0).compiled(3)
    widths = [q_width(rule, np.float32(0.0), np.float32(high)) for high in (1.0, 20.0, 1000.0)]
    assert widths == [5.0, 20.0, 50.0]


@pytest.mark.parametrize('rule', ['pozero', 'puct', 'gumbel'])
def test_scores_do_not_depend_on_the_unit_of_reward(rule):
    """Plain min-max: q scaled and shifted gives the same scores."""
    rng = np.random.default_rng(0)
    prior, visits = row(rng.dirichlet(np.ones(9))), row(rng.integers(0, 4, 9), np.int32)
    compiled = SearchParams(rule=rule).compiled(9)
    q, scores = rng.random(9), []
    for scale, shift in ((1.0, 0.0), (256.0, -64.0)):
        out, gap = np.zeros(WIDTH, np.float32), np.zeros(WIDTH, np.float32)
        values, value = row(scale * q + shift), np.float32(scale * 0.5 + shift)
        if rule == 'pozero':
            pozero_policy(compiled, prior, values, visits, value, gap, out)
        elif rule == 'puct':
            rules.puct_scores(compiled, prior, values, visits, value, np.float32(20.0), out)
        else:
            rules.gumbel_values(compiled, prior, values, visits, value, out)
            rules.tilt(prior, out)
        scores.append(out[:9])
    np.testing.assert_allclose(scores[0], scores[1], atol=2e-5)


def test_follow_keeps_the_proportions():
    policy, visits = row([0.5, 0.3, 0.15, 0.05]), np.zeros(WIDTH, np.int32)
    for _ in range(1000):
        scores = policy.copy()
        rules.follow(scores, visits)
        visits[np.argmax(scores[:4])] += 1
    np.testing.assert_allclose(visits[:4] / 1000.0, policy[:4], atol=2e-3)


def test_sequential_halving_visits():
    table = halving_table(16, 50)
    assert table.shape == (17, 50)
    np.testing.assert_array_equal(table[1], np.arange(50))
    np.testing.assert_array_equal(table[4, :24], [*[0] * 4, *[1] * 4, *[2] * 4, *[3] * 4, *[4] * 4, *[5] * 4])
    np.testing.assert_array_equal(table[16, :32], [0] * 16 + [1] * 8 + [2] * 4 + [3] * 4)
