from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.episodes import sail
from portnav_ros.evaluation.hull_clearance import with_clearance
from portnav_ros.evaluation.planners import (
    PLANNERS,
    EvaluationError,
    ModelOptions,
    Privileged,
    make_planner,
)
from portnav_ros.evaluation.trial import SEEDS_PER_SPLIT, SPLITS, Trial, judge, split_seeds
from portnav_ros.evaluation.workers import run_trial
from portnav_ros.muzero import ModelError
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import DECISION_S
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.agent import AgentPolicy
from portnav_ros.task.env import TaskParams
from portnav_ros.task.observation import Observation, ObservationParams
from portnav_ros.types import SURGE, YAW, Array, BoolArray, Outcome

TRIAL = Trial('line_of_sight', 'easy')
SEEDS = split_seeds('training', 40, 5)


@pytest.fixture(scope='module')
def scenarios() -> list[Scenario]:
    return [TRIAL.make_scenario(seed) for seed in SEEDS]


@pytest.fixture(scope='module')
def logs(scenarios) -> dict[int, EpisodeLog]:
    return {log.seed: log for log in sail(TRIAL.make_planner, scenarios, 1)}


def without_latency(values: dict[str, float]) -> dict[str, float]:
    return {key: value for key, value in values.items() if not key.startswith('latency')}


def assert_same(one: EpisodeLog, other: EpisodeLog) -> None:
    assert one.outcome == other.outcome
    for name in ('time_s', 'own', 'setpoint', 'command', 'range_min', 'clearance', 'path'):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    for track, same in zip(one.targets, other.targets, strict=True):
        np.testing.assert_array_equal(track.pose, same.pose)


def test_every_scenario_is_sailed_once(logs):
    assert sorted(logs) == list(SEEDS)
    assert all(log.outcome != Outcome.RUNNING for log in logs.values())


@pytest.mark.parametrize('batch', [2, 5, 8])
def test_no_log_depends_on_the_batch_or_the_order(scenarios, logs, batch):
    for log in sail(TRIAL.make_planner, scenarios[::-1], batch):
        assert_same(log, logs[log.seed])


def test_a_learned_policys_log_does_not_either(make_model, scenarios):
    task = TaskParams(actions=ActionParams(hold=2))
    file = make_model(task, vessel=scenarios[0].vessel, lidar=scenarios[0].lidar)
    trial = replace(TRIAL, planner='muzero', model=ModelOptions(file, simulations=4))
    short = [replace(scenario, time_limit_s=40.0 + 10.0 * b) for b, scenario in enumerate(scenarios[:4])]
    alone = {log.seed: log for log in sail(trial.make_planner, short, 1)}
    for log in sail(trial.make_planner, short[::-1], 3):
        assert_same(log, alone[log.seed])
        assert len(log.latency_s) == len(log) - 1  # a row for the end


def test_only_decisions_are_timed(scenarios):
    def make_policy(scenario):
        actions = ActionParams(hold=2)
        return AgentPolicy(ObservationParams(), actions, scenario.lidar, lambda seen: np.full(len(seen), 13))

    short = [replace(scenario, time_limit_s=40.0) for scenario in scenarios[:2]]
    for log in sail(make_policy, short, 2):
        assert len(log.latency_s) == len(log) // 2  # a row for the end, and each action is held once


def test_a_log_has_a_row_for_each_decision_and_one_for_the_end(logs):
    for log in logs.values():
        np.testing.assert_allclose(np.diff(log.time_s[:-1]), DECISION_S)
        assert 0.0 < log.time_s[-1] - log.time_s[-2] <= DECISION_S
        assert len(log.latency_s) == len(log) - 1
        assert log.clearance.min() >= 0.0


def test_the_worlds_clearances_are_those_of_the_polygons(logs):
    world = np.vstack([log.clearance for log in logs.values()])
    exact = np.vstack([with_clearance(replace(log, clearance=None)).clearance for log in logs.values()])
    near = exact < 50.0
    assert near.sum() > 100
    np.testing.assert_allclose(world[near], exact[near], atol=1e-9)


def test_workers_change_nothing(logs):
    results = sorted(run_trial(TRIAL, SEEDS, batch=2, workers=2), key=lambda result: result.seed)
    expected = [judge(logs[seed], TRIAL, keep_log=False) for seed in SEEDS]
    assert [result.outcome for result in results] == [result.outcome for result in expected]
    for result, wanted in zip(results, expected, strict=True):
        assert without_latency(result.values) == pytest.approx(without_latency(wanted.values), nan_ok=True)


def test_a_failing_worker_says_why():
    trial = Trial('line_of_sight', 'no_such_difficulty')
    with pytest.raises(EvaluationError, match='no_such_difficulty'):
        list(run_trial(trial, range(4), batch=2, workers=2))


class Insider:
    """Lies still, and notes what it is told."""

    def __init__(self) -> None:
        self.told: list[tuple[int, int]] = []

    def prepare(self, b: int, scenario: Scenario) -> None:
        self.told.append((b, scenario.seed))

    def reset(self, which: BoolArray) -> None:
        pass

    def act(self, observation: Observation) -> Array:
        return observation.own[:, [YAW, SURGE]] + np.array([0.0, 3.0])


def test_a_privileged_planner_is_told_each_scenario(scenarios):
    insider = Insider()
    seeds = [log.seed for log in sail(lambda scenario: insider, scenarios[:3], 2)]
    assert sorted(seeds) == sorted(seed for _, seed in insider.told)
    assert insider.told[0][0] == 0
    assert {b for b, _ in insider.told} == {0, 1}


def test_the_ceiling_knows_what_comes(scenarios):
    assert isinstance(make_planner('ceiling', scenarios[0]), Privileged)
    (log,) = sail(Trial('ceiling', 'easy').make_planner, scenarios[:1], 1)
    assert log.outcome == Outcome.SUCCESS


def test_no_scenarios_give_no_logs():
    assert list(sail(TRIAL.make_planner, [], 4)) == []


def test_a_batch_without_slots_is_refused(scenarios):
    with pytest.raises(EvaluationError, match='batch = 0'):
        list(sail(TRIAL.make_planner, scenarios, 0))


def test_splits_share_no_seed():
    seeds = [set(split_seeds(split, SEEDS_PER_SPLIT - 3, 3)) for split in SPLITS]
    assert len(set.union(*seeds)) == 9
    assert split_seeds('training', 5, 2) == range(5, 7)


@pytest.mark.parametrize(('first', 'episodes'), [(-1, 1), (SEEDS_PER_SPLIT - 1, 2)])
def test_seeds_outside_a_split_are_refused(first, episodes):
    with pytest.raises(EvaluationError, match='a split has the seeds 0 to 999999'):
        split_seeds('test', first, episodes)


@pytest.mark.parametrize('episodes', [0, -3])
def test_an_evaluation_without_episodes_is_refused(episodes):
    with pytest.raises(EvaluationError, match=f'--episodes {episodes} must be at least 1'):
        split_seeds('test', 0, episodes)


def test_unknown_and_missing_planners(scenarios):
    with pytest.raises(EvaluationError, match='dwa'):
        make_planner('no_such', scenarios[0])
    with pytest.raises(ModelError, match='no such model'):
        make_planner('muzero', scenarios[0], ModelOptions(Path('/nowhere.safetensors')))
    assert 'ceiling' in PLANNERS


def test_chart_and_scenario_exclude_each_other(tmp_path):
    with pytest.raises(EvaluationError, match='exclude'):
        Trial('dwa', 'easy', chart=tmp_path / 'port.geojson', scenario='head_on')
