"""Scenarios of training and validation, and the validation that sails them."""

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.params import TaskParams
from portnav_ros.training.scenarios import (
    TESTBEDS,
    VALIDATION_SEED,
    ScenarioParams,
    training_source,
    validation_scenarios,
)
from portnav_ros.training.validation import Validation

STRAIGHT = 14  # heading kept, 5 m/s


@pytest.mark.parametrize('testbed', TESTBEDS)
def test_testbeds_vary_with_the_draw_and_share_no_world_with_validation(testbed):
    params = ScenarioParams(testbed=testbed, ports=2, validation_episodes=3)
    draw, rng = training_source(params, seed=1), np.random.default_rng(0)
    drawn = [draw(rng) for _ in range(12)]
    assert len({(s.seed, s.harbour.buoys.tobytes(), s.traffic.progress.tobytes(), s.goal) for s in drawn}) > 1
    assert all(scenario.seed >= VALIDATION_SEED for scenario in validation_scenarios(params))
    assert all(scenario.path is not None for scenario in drawn)


def test_a_draw_depends_on_the_generator_alone():
    draw = training_source(ScenarioParams(testbed='one_buoy'), seed=0)
    first, second = np.random.default_rng(4), np.random.default_rng(4)
    assert [draw(first).seed for _ in range(5)] == [draw(second).seed for _ in range(5)]


def test_a_seed_that_reaches_validation_worlds_is_refused():
    with pytest.raises(ParamError, match='validation'):
        training_source(ScenarioParams(testbed='one_buoy'), seed=4000)


def test_unknown_testbed_is_refused():
    with pytest.raises(ParamError, match='one_buoy'):
        ScenarioParams(testbed='two_buoys')


def test_validation_does_not_depend_on_the_batch():
    scenarios = validation_scenarios(ScenarioParams(testbed='one_buoy', validation_episodes=12))
    results = [
        Validation(scenarios, TaskParams(), batch).run(lambda features: np.full(len(features), STRAIGHT))
        for batch in (12, 5, 1)
    ]
    assert results[0] == results[1] == results[2]
    assert 0.0 < results[0]['success'] < 1.0
    assert results[0]['success'] + results[0]['collision_buoy'] == 1.0
    low, high = results[0]['interval']
    assert low < results[0]['success'] < high


def test_validation_repeats_itself():
    validation = Validation(
        validation_scenarios(ScenarioParams(testbed='head_on', validation_episodes=4)), TaskParams(), 3
    )
    first = validation.run(lambda features: np.full(len(features), STRAIGHT))
    assert first == validation.run(lambda features: np.full(len(features), STRAIGHT))


@pytest.mark.parametrize('offset', [0.0, 0.17, -0.36, 0.46])
def test_the_field_of_buoys_is_not_passed_blindly(offset):
    """A constant course offset keeps a constant distance from the path: 100 m x tan(offset)."""
    scenarios = validation_scenarios(ScenarioParams(testbed='buoy_field', validation_episodes=100))
    task = TaskParams(actions=ActionParams((offset,), (5.0,), reference='path', hold=4))
    result = Validation(scenarios, task).run(lambda features: np.zeros(len(features), int))
    assert result['success'] < 0.5
    assert result['collision_buoy'] > 0.5
