import argparse
import csv
import hashlib
import json
from collections.abc import Iterator, Sequence

import pytest

from portnav_ros.evaluation import evaluate, workers
from portnav_ros.evaluation.metrics.table import METRICS
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import EpisodeResult, Trial
from portnav_ros.muzero import ModelError
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import ScenarioError
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
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
        if trial.planner == 'line_of_sight':
            raise EvaluationError('blind')
        return iter([fake_result(trial, seed) for seed in seeds])

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    figures = tmp_path / 'figures.json'
    with pytest.raises(EvaluationError, match='blind'):
        evaluate.run(arguments(f'--planner dwa --against line_of_sight --episodes 3 --json {figures}'))
    values = json.loads(figures.read_text())
    assert (values['episodes'], values['against']['episodes']) == (3, 0)


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('--workers 0', 'workers = 0'),
        ('--scenario head_on --route rrt_star', '--route and --scenario'),
        ('--model m.safetensors', '--model, --simulations and --allow-mismatch are for muzero'),
        ('--simulations 8 --against line_of_sight', '--model, --simulations and --allow-mismatch'),
        ('--against-model m.safetensors', '--against-model needs --against'),
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


def test_a_learned_planners_model_is_told(fake_runner, make_model, tmp_path):
    model, rival, figures = make_model(), make_model(seed=1), tmp_path / 'figures.json'
    words = f'--planner muzero --model {model} --against prior --against-model {rival}'
    evaluate.run(arguments(f'{words} --episodes 4 --json {figures}'))
    values = json.loads(figures.read_text())
    ours, theirs = values['model'], values['against']['model']
    assert (ours['file'], theirs['file']) == (str(model), str(rival))
    assert ours['sha256'] == hashlib.sha256(model.read_bytes()).hexdigest() != theirs['sha256']
    assert (ours['simulations'], theirs['simulations']) == (8, 0)
    assert ours['training'] == {'steps': 0}


def test_models_are_looked_for_before_anything_is_sailed(monkeypatch, tmp_path):
    monkeypatch.setattr(workers, 'run_trial', lambda *_: pytest.fail('sailed'))
    words = f'--planner dwa --against muzero --model {tmp_path / "none.safetensors"}'
    with pytest.raises(ModelError, match='no such model'):
        evaluate.run(arguments(words))


@pytest.mark.parametrize('option', ['--json', '--report', '--episodes-csv'])
@pytest.mark.parametrize(
    ('file', 'reason'),
    [
        ('folder', 'is a folder; name a file in it'),
        ('file/below', '/file is no folder'),
        ('locked', 'may not be written'),
        ('shut/new/file', 'may not be written'),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_is_sailed(
    monkeypatch, tmp_path, option, file, reason
):
    monkeypatch.setattr(workers, 'run_trial', lambda *_: pytest.fail('sailed'))
    closed = (tmp_path / 'locked', tmp_path / 'shut')
    monkeypatch.setattr(evaluate.os, 'access', lambda path, _: path not in closed)  # root may write anywhere
    for folder in ('folder', 'shut'):
        (tmp_path / folder).mkdir()
    for name in ('file', 'locked'):
        (tmp_path / name).touch()
    with pytest.raises(EvaluationError, match=f'^{option} .*{reason}'):
        evaluate.run(arguments(f'--planner dwa --episodes 1 {option} {tmp_path / file}'))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder', 'locked', 'shut']
    assert not list((tmp_path / 'shut').iterdir())


def test_ppo_sails_by_its_model(make_ppo_model, tmp_path):
    figures = tmp_path / 'figures.json'
    file = make_ppo_model(vessel=load_vessel('cemt_iv'))
    words = f'--planner ppo --model {file} --scenario no_traffic --episodes 2 --workers 1'
    evaluate.run(arguments(f'{words} --json {figures}'))
    values = json.loads(figures.read_text())
    assert values['episodes'] == 2
    assert values['model']['sha256'] == hashlib.sha256(file.read_bytes()).hexdigest()


def test_search_and_prior_sail_the_same_episodes(make_model, tmp_path):
    figures = tmp_path / 'figures.json'
    file = make_model(TaskParams(actions=ActionParams(hold=8)), vessel=load_vessel('cemt_iv'))
    words = f'--planner muzero --model {file} --simulations 4 --against prior --scenario no_traffic'
    evaluate.run(arguments(f'{words} --episodes 2 --workers 1 --json {figures}'))
    values = json.loads(figures.read_text())
    assert values['episodes'] == values['against']['episodes'] == 2
    assert values['model']['simulations'] == 4
    assert values['against']['paired']['difference'] == values['success'] - values['against']['success']
