import argparse
import csv
import hashlib
import json
import os
import signal
from collections.abc import Iterator, Sequence

import pytest

from portnav_ros.evaluation import evaluate, evaluate_checks, workers
from portnav_ros.evaluation.metrics.table import METRICS
from portnav_ros.evaluation.planners import EvaluationError, ModelOptions
from portnav_ros.evaluation.trial import EpisodeResult, Trial
from portnav_ros.muzero import ModelError
from portnav_ros.params import ParamError
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
    assert {(row['planner'], row['model']) for row in table} == {('line_of_sight', '')}
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
    said = capsys.readouterr()
    assert 'cut short after 2 of 9' in said.err
    assert '2 episodes in' in said.out
    assert 'cut short, and those that end first are mostly collisions' in said.out


@pytest.fixture
def cut_after(monkeypatch):
    """End a planner's episodes early, by Ctrl-C."""

    def install(planner: str, done: int) -> None:
        def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
            whole = trial.planner != planner
            yield from (fake_result(trial, seed) for seed in (seeds if whole else seeds[:done]))
            if not whole:
                raise KeyboardInterrupt

        monkeypatch.setattr(workers, 'run_trial', run_trial)

    return install


@pytest.mark.parametrize(
    ('planner', 'done', 'ours', 'theirs', 'warning'),
    [
        ('dwa', 3, 3, None, 'Cut short after 3 episodes: those that end first are mostly collisions.'),
        ('line_of_sight', 3, 9, 3, 'line_of_sight was cut short after 3 episodes: no comparison.'),
        ('line_of_sight', 0, 9, 0, 'line_of_sight was cut short after 0 episodes: no comparison.'),
    ],
)
def test_planners_are_not_compared_where_one_was_cut_short(
    cut_after, tmp_path, capsys, planner, done, ours, theirs, warning
):
    cut_after(planner, done)
    figures, page = tmp_path / 'figures.json', tmp_path / 'page.html'
    words = f'--planner dwa --against line_of_sight --episodes 9 --json {figures} --report {page}'
    with pytest.raises(KeyboardInterrupt):
        evaluate.run(arguments(words))
    values, text = json.loads(figures.read_text()), page.read_text()
    against = values.get('against', {})
    assert (values['episodes'], against.get('episodes'), values['complete']) == (ours, theirs, False)
    assert not against.get('complete')
    assert 'paired' not in against
    assert 'difference on' not in capsys.readouterr().out + text
    assert f'<p class="warning">{warning}</p>' in text
    assert ('success so far' in text, '95 % interval' in text) == (ours < 9, ours == 9)


def test_a_complete_comparison_is_on_the_page(fake_runner, tmp_path):
    page = tmp_path / 'page.html'
    words = '--planner dwa --against line_of_sight --episodes 40'
    assert evaluate.run(arguments(f'{words} --report {page}')) == 0
    text = page.read_text()
    assert 'dwa on difficulty paper: 50.0% success (95 % interval' in text
    assert 'line_of_sight: 75.0% success (95 % interval' in text
    assert 'difference on 40 same episodes: -25.0% (95 % interval' in text
    assert 'only dwa 0, only line_of_sight 10' in text
    assert 'class="warning"' not in text


def test_rows_of_both_planners_say_whose_they_are(fake_runner, make_model, tmp_path):
    rows, model = tmp_path / 'rows.csv', make_model(vessel=load_vessel('cemt_va'))
    words = f'--planner dwa --against prior --model {model} --episodes 2 --split training'
    assert evaluate.run(arguments(f'{words} --episodes-csv {rows}')) == 0
    with rows.open() as file:
        table = [(row['planner'], row['model'], row['seed']) for row in csv.DictReader(file)]
    assert table == [(*who, seed) for who in (('dwa', ''), ('prior', str(model))) for seed in '01']


def test_two_models_of_one_planner_are_told_apart(fake_runner, make_model, capsys):
    models = [make_model(seed=seed, vessel=load_vessel('cemt_va')) for seed in (0, 1)]
    words = f'--planner muzero --model {models[0]} --against muzero --against-model {models[1]}'
    assert evaluate.run(arguments(f'{words} --episodes 4')) == 0
    assert 'only the first 0, only the second 0' in capsys.readouterr().out


def test_sigterm_keeps_what_is_done(monkeypatch, tmp_path):
    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        yield fake_result(trial, seeds[0])
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            yield fake_result(trial, seeds[1])
        finally:
            os.kill(os.getpid(), signal.SIGTERM)  # `timeout` sends it to the process and to its group

    def before(*_: object) -> None:
        pytest.fail('not taken')

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    figures, previous = tmp_path / 'figures.json', signal.signal(signal.SIGTERM, before)
    try:
        with pytest.raises(KeyboardInterrupt):
            evaluate.run(arguments(f'--planner dwa --episodes 9 --json {figures}'))
        assert signal.getsignal(signal.SIGTERM) is before
    finally:
        signal.signal(signal.SIGTERM, previous)
    values = json.loads(figures.read_text())
    assert (values['episodes'], values['complete']) == (1, False)


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
    assert (values['episodes'], values['complete']) == (3, False)
    assert values['against'] == {'planner': 'line_of_sight', 'episodes': 0, 'complete': False}


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('--workers 0', '--workers 0 must be at least 1'),
        ('--batch 0', '--batch 0 must be at least 1'),
        ('--seed -1', '--seed -1'),
        ('--against muzero --simulations -1', '--simulations -1 must be at least 0'),
        ('--against prior --simulations 5', '--simulations is for muzero; leave it out for dwa and prior'),
        ('--against prior --through ros', '--through ros: prior is no node; there are muzero, dwa'),
        ('--through ros --route clearance', '--through ros: the nodes plan with RRT'),
        ('--scenario head_on --route rrt_star', '--route and --scenario'),
        ('--model m.safetensors', '--model, --simulations and --allow-mismatch are for muzero'),
        ('--simulations 8 --against line_of_sight', '--model, --simulations and --allow-mismatch'),
        ('--against-model m.safetensors', '--against-model needs --against'),
    ],
)
def test_options_that_do_not_fit_are_refused(words, reason, capsys):
    with pytest.raises(EvaluationError, match=reason):
        evaluate.run(arguments(f'--planner dwa --episodes 1 {words}'))
    assert capsys.readouterr() == ('', '')


def test_what_cannot_be_sailed_is_refused_before_anything_is(monkeypatch, make_model, make_ppo_model, capsys):
    monkeypatch.setattr(workers, 'run_trial', lambda *_: pytest.fail('sailed'))
    other, ppo = make_model(vessel=load_vessel('cemt_iv')), make_ppo_model(vessel=load_vessel('cemt_va'))
    for words, error, reason in (
        ('--difficulty nope', ParamError, 'nope.yaml: no such file'),
        ('--scenario nope', ParamError, 'nope.yaml: no such file'),
        (f'--against muzero --model {other}', ModelError, 'trained for vessel cemt_iv, not cemt_va'),
        (f'--against muzero --model {ppo}', ModelError, 'algorithm: ppo, expected muzero'),
    ):
        with pytest.raises(error, match=reason):
            evaluate.run(arguments(f'--planner dwa --episodes 3 {words}'))
    assert capsys.readouterr() == ('', '')


def test_each_planner_gets_the_options_that_it_uses(monkeypatch, make_model):
    sailed = {}

    def run_trial(trial: Trial, seeds: Sequence[int], *_: object) -> Iterator[EpisodeResult]:
        sailed[trial.planner] = trial.model
        yield from (fake_result(trial, seed) for seed in seeds)

    monkeypatch.setattr(workers, 'run_trial', run_trial)
    model = make_model(vessel=load_vessel('cemt_va'))
    words = f'--planner dwa --against muzero --model {model} --simulations 4 --episodes 1'
    assert evaluate.run(arguments(words)) == 0
    assert sailed == {'dwa': ModelOptions(), 'muzero': ModelOptions(model, 4)}


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
    vessel, figures = load_vessel('cemt_va'), tmp_path / 'figures.json'
    model, rival = make_model(vessel=vessel), make_model(seed=1, vessel=vessel)
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
    monkeypatch.setattr(
        evaluate_checks.os, 'access', lambda path, _: path not in closed
    )  # root may write anywhere
    for folder in ('folder', 'shut'):
        (tmp_path / folder).mkdir()
    for name in ('file', 'locked'):
        (tmp_path / name).touch()
    with pytest.raises(EvaluationError, match=f'^{option} .*{reason}'):
        evaluate.run(arguments(f'--planner dwa --episodes 1 {option} {tmp_path / file}'))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder', 'locked', 'shut']
    assert not list((tmp_path / 'shut').iterdir())


def test_one_file_for_two_outputs_is_refused(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EvaluationError, match=r'^--json x and --episodes-csv .*/x: one file for both'):
        evaluate.run(arguments(f'--planner dwa --episodes 1 --json x --episodes-csv {tmp_path / "x"}'))


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
