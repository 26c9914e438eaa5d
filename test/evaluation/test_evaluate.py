import argparse
import csv
import json
from collections.abc import Iterator, Sequence

import pytest

from portnav_ros.evaluation import evaluate, workers
from portnav_ros.evaluation.metrics.table import METRICS
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import EpisodeResult, Trial
from portnav_ros.sim.scenario import ScenarioError
from portnav_ros.types import Outcome

KEYS = {
    'planner',
    'difficulty',
    'episodes',
    'seed',
    'success',
    'success_low',
    'success_high',
    'collision_quay',
    'collision_buoy',
    'collision_vessel',
    'timeout',
    'mean_return',
    'mean_length_s',
    'mean_abs_e_x_m',
    'mean_abs_e_y_m',
    'mean_abs_e_psi_rad',
    'command',
    'version',
    'git_commit',
    'workers',
    'wall_s',
    'complete',
}


def arguments(words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    evaluate.add_arguments(parser)
    return parser.parse_args(words.split())


def fake_result(trial: Trial, seed: int) -> EpisodeResult:
    wins = seed % (2 if trial.planner == 'dwa' else 4) != 0
    outcome = Outcome.SUCCESS if wins else Outcome.COLLISION_VESSEL
    return EpisodeResult(seed, outcome, {metric.key: float(seed % 10) for metric in METRICS})


@pytest.fixture
def fake_runner(monkeypatch):
    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        return (fake_result(trial, seed) for seed in reversed(seeds))

    monkeypatch.setattr(workers, 'run_trial', run_trial)


def test_real_episodes_end_in_json_and_csv(tmp_path, capsys):
    figures, rows, page = tmp_path / 'out' / 'figures.json', tmp_path / 'rows.csv', tmp_path / 'page.html'
    words = '--planner line_of_sight --difficulty easy --episodes 2 --seed 40 --workers 1 --split training'
    code = evaluate.run(arguments(f'{words} --json {figures} --episodes-csv {rows} --report {page}'))
    assert code == 0
    values = json.loads(figures.read_text())
    assert set(values) >= KEYS
    assert values['episodes'] == 2
    assert values['success_low'] <= values['success'] <= values['success_high']
    with rows.open() as file:
        table = list(csv.DictReader(file))
    assert [row['seed'] for row in table] == ['40', '41']
    assert float(table[0]['length_s']) > 0.0
    failures = sum(row['outcome'] != 'success' for row in table)
    assert page.read_text().count('<figure>') == failures
    assert 'line_of_sight on easy: 2 episodes' in capsys.readouterr().out


def test_episodes_come_in_the_order_of_their_seeds(fake_runner, tmp_path):
    rows = tmp_path / 'rows.csv'
    words = '--planner dwa --episodes 5 --split validation'
    assert evaluate.run(arguments(f'{words} --episodes-csv {rows}')) == 0
    with rows.open() as file:
        assert [int(row['seed']) for row in csv.DictReader(file)] == list(range(1_000_000, 1_000_005))


def test_two_planners_are_compared_pair_by_pair(fake_runner, tmp_path, capsys):
    figures = tmp_path / 'figures.json'
    words = '--planner dwa --against line_of_sight --episodes 40'
    assert evaluate.run(arguments(f'{words} --json {figures}')) == 0
    against = json.loads(figures.read_text())['against']
    assert against['planner'] == 'line_of_sight'
    assert against['paired']['difference'] == pytest.approx(-0.25)
    assert (against['paired']['only_first'], against['paired']['only_second']) == (0, 10)
    assert 'McNemar' in capsys.readouterr().out


@pytest.mark.parametrize(
    'failure', [KeyboardInterrupt(), EvaluationError('a worker died'), ScenarioError('no')]
)
def test_an_evaluation_cut_short_keeps_what_is_done(monkeypatch, tmp_path, capsys, failure):
    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        yield fake_result(trial, seeds[0])
        yield fake_result(trial, seeds[1])
        raise failure

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    figures = tmp_path / 'figures.json'
    with pytest.raises(type(failure)):
        evaluate.run(arguments(f'--planner dwa --episodes 9 --json {figures}'))
    values = json.loads(figures.read_text())
    assert (values['episodes'], values['complete']) == (2, False)
    assert 'cut short after 2 of 9' in capsys.readouterr().err


def test_a_rival_that_cannot_sail_is_an_error_after_the_figures(monkeypatch, tmp_path):
    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        if trial.planner == 'muzero':
            raise EvaluationError('no model')
        return iter([fake_result(trial, seed) for seed in seeds])

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    figures = tmp_path / 'figures.json'
    with pytest.raises(EvaluationError, match='no model'):
        evaluate.run(arguments(f'--planner dwa --against muzero --episodes 3 --json {figures}'))
    values = json.loads(figures.read_text())
    assert (values['episodes'], values['against']['episodes']) == (3, 0)


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('--workers 0', 'workers = 0'),
        ('--scenario head_on --route rrt_star', '--route and --scenario'),
    ],
)
def test_options_that_do_not_fit_are_refused(words, reason):
    with pytest.raises(EvaluationError, match=reason):
        evaluate.run(arguments(f'--planner dwa --episodes 1 {words}'))


def test_unknown_figures_become_null(fake_runner, monkeypatch, tmp_path):
    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        yield EpisodeResult(
            seeds[0], Outcome.TIMEOUT, {metric.key: float('nan') for metric in METRICS} | {'length_s': 900.0}
        )

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    figures = tmp_path / 'figures.json'
    evaluate.run(arguments(f'--planner dwa --episodes 1 --json {figures}'))
    values = json.loads(figures.read_text())
    assert values['mean_path_over_plan'] is None
    assert values['mean_length_s'] == 900.0
