"""Curves from lines of metrics, and what seeds have in common."""

import json

import numpy as np
import pytest

from portnav_ros.evaluation.learning_curves import FIELDS, Curve, across, all_steps, running, validated


def line(steps, reward, **more):
    return {'steps': steps, **dict.fromkeys(FIELDS, 0.5), 'reward': reward, **more}


def curve(steps, reward):
    values = np.zeros((len(steps), len(FIELDS)))
    values[:, FIELDS.index('reward')] = reward
    return Curve(np.array(steps, float), values)


def rewards(values):
    return values[:, FIELDS.index('reward')]


def test_running_means_and_validations_are_told_apart():
    checks = {**dict.fromkeys(FIELDS, 0.25), 'reward': 7.0}
    lines = [line(10, None), line(20, -3.0), {'steps': 20, 'validation': checks}, line(30, -2.0)]
    assert running(lines).steps.tolist() == [20, 30]
    assert rewards(running(lines).values).tolist() == [-3.0, -2.0]
    assert validated(lines).steps.tolist() == [20]
    assert rewards(validated(lines).values).tolist() == [7.0]


def test_a_run_without_lines_is_an_empty_curve():
    empty = running([])
    assert empty.values.shape == (0, len(FIELDS))
    assert np.isnan(empty.at(np.array([0.0, 5.0]))).all()


def test_a_curve_ends_where_its_run_ends():
    got = rewards(curve([10, 20], [0.0, 4.0]).at(np.array([5.0, 10.0, 15.0, 20.0, 25.0])))
    np.testing.assert_allclose(got, [np.nan, 0.0, 2.0, 4.0, np.nan])


def test_mean_and_spread_of_seeds():
    curves = [curve([0, 10], [0.0, 2.0]), curve([0, 10, 20], [4.0, 4.0, 9.0])]
    result = across(curves, all_steps(curves))
    assert result.steps.tolist() == [0, 10, 20]
    assert result.reached.tolist() == [2, 2, 1]
    np.testing.assert_allclose(rewards(result.mean), [2.0, 3.0, 9.0])
    np.testing.assert_allclose(
        rewards(result.spread), [np.std([0, 4], ddof=1), np.std([2, 4], ddof=1), np.nan]
    )
    np.testing.assert_allclose(rewards(result.low), [0.0, 2.0, 9.0])
    np.testing.assert_allclose(rewards(result.high), [4.0, 4.0, 9.0])


def test_steps_that_no_seed_has_reached_are_left_out():
    result = across([curve([10, 20], [1.0, 1.0])], np.array([0.0, 10.0, 30.0]))
    assert result.steps.tolist() == [10.0]


def test_no_seed_at_all_is_drawn_as_nothing():
    assert across([], all_steps([])).mean.shape == (0, len(FIELDS))


def test_what_is_not_known_is_null_in_json():
    plain = across([curve([10], [1.0])], np.array([10.0])).plain()
    assert plain['standard_deviation']['reward'] == [None]
    assert plain['mean']['reward'] == [1.0]
    assert 'NaN' not in json.dumps(plain)


@pytest.mark.parametrize('order', [1, -1])
def test_the_order_of_seeds_does_not_matter(order):
    curves = [curve([0, 10], [0.0, 2.0]), curve([5, 15], [4.0, 4.0])][::order]
    result = across(curves, np.array([5.0, 10.0]))
    np.testing.assert_allclose(rewards(result.mean), [2.5, 3.0])
