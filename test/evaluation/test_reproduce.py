"""The commands of `portnav reproduce` on runs that are there already."""

import argparse
import json
import subprocess
import sys

import numpy as np
import pytest
import yaml

from portnav_ros.evaluation import reproduce, reproduce_figure, reproduce_runs
from portnav_ros.evaluation.learning_curves import FIELDS, Curve
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.reproduce_ablation import ablation_runs, compare, read_cells, score_of
from portnav_ros.evaluation.reproduce_pictures import sail_subject
from portnav_ros.evaluation.reproduce_table import reward_at, table_rows
from portnav_ros.evaluation.training_runs import merged, read_preset
from portnav_ros.evaluation.trial import Trial
from portnav_ros.muzero import ModelError
from portnav_ros.params import ParamError
from portnav_ros.resources import config_path
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.training.run_directory import TrainingError, plain
from portnav_ros.types import SURGE

CELLS = """
reference: a
all: {search: {rule: pozero}}
cells:
  a: {}
  b: {search: {simulations: 8}}
"""


# Stands for `portnav` where the library of its first word is not installed.
WITHOUT = """
import sys
from portnav_ros import cli

class Nowhere:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, Nowhere())
sys.exit(cli.main(sys.argv[2:]))
"""


def command(*words):
    parser = argparse.ArgumentParser()
    reproduce.add_arguments(parser)
    return reproduce.run(parser.parse_args(list(map(str, words))))


def runs_of(*words):
    parser = argparse.ArgumentParser()
    reproduce_figure.add_arguments(parser)
    return reproduce_runs.paper_runs(parser.parse_args(list(map(str, words))))


def curve(steps, **columns):
    values = np.zeros((len(steps), len(FIELDS)))
    for name, column in columns.items():
        values[:, FIELDS.index(name)] = column
    return Curve(np.array(steps, float), values)


def leave(run, curve_, validation=None):
    """Leave the folder of a run with a curve in it."""
    run.directory.path.mkdir(parents=True, exist_ok=True)
    config = {'algorithm': run.algorithm, 'seed': run.seed, **plain(run.values)}
    run.directory.config.write_text(yaml.safe_dump(config))
    rows = zip(curve_.steps, curve_.values, strict=True)
    lines = [{'steps': int(steps), **dict(zip(FIELDS, row, strict=True))} for steps, row in rows]
    if validation is not None:
        checks = {**dict.fromkeys(FIELDS, 0.0), 'success': validation}
        lines.append({'steps': int(curve_.steps[-1]), 'validation': checks})
    run.directory.metrics.write_text(''.join(json.dumps(line) + '\n' for line in lines))


def test_both_algorithms_sail_the_same_task(tmp_path):
    preset = tmp_path / 'mine.yaml'
    preset.write_text('{task: {actions: {hold: 4}}, scenarios: {ports: 7}, learner: {unroll: 3}}')
    runs = runs_of('--preset', preset, '--difficulty', 'easy', '--steps', 1000, '--out', tmp_path)
    assert [run.name for run in runs[:2]] == ['muzero-mine-easy-0', 'ppo-mine-easy-0']
    assert [run.seed for run in runs] == [0, 0, 1, 1, 2, 2]
    muzero, ppo = runs[0].values, runs[1].values
    assert muzero['task'] == ppo['task'] == {'actions': {'hold': 4}}
    assert muzero['scenarios'] == ppo['scenarios'] == {'ports': 7, 'difficulty': 'easy', 'testbed': ''}
    assert 'rollout' in ppo['learner']
    assert 'unroll' not in ppo['learner']
    assert {run.steps for run in runs} == {1000}


def test_a_short_run_still_makes_a_curve(tmp_path):
    every = {'steps': 200_000, 'log_every': 10_000, 'validate_every': 25_000, 'save_every': 10_000}
    runs = runs_of('--preset', 'best', '--steps', 200_000, '--out', tmp_path)
    assert all(run.values['schedule'] == every for run in runs)
    file = tmp_path / 'cells.yaml'
    file.write_text(CELLS)
    assert ablation_run(tmp_path, 'b', 0, read_cells(file)).values['schedule']['log_every'] == 5


def test_a_run_of_the_presets_length_has_its_intervals(tmp_path):
    every = {'steps': 5_000_000, 'log_every': 20_000, 'validate_every': 250_000, 'save_every': 250_000}
    assert all(run.values['schedule'] == every for run in runs_of('--out', tmp_path))


def test_one_of_the_two(tmp_path):
    runs = runs_of('--only', 'ppo', '--seeds', 2, '--testbed', 'head_on', '--out', tmp_path)
    assert [run.name for run in runs] == ['ppo-paper-head_on-0', 'ppo-paper-head_on-1']


def test_the_figure_shows_runs_that_have_only_begun(tmp_path, capsys):
    options = ('--seeds', 2, '--steps', 1000, '--out', tmp_path)
    leave(runs_of(*options)[0], curve([100, 200], reward=[-5.0, -3.0], success=[0.0, 0.5]))
    assert command('figure', '--plot-only', *options) == 0
    assert 'figure.png' in capsys.readouterr().out
    assert (tmp_path / 'figure.png').stat().st_size > 10_000
    assert '<svg' in (tmp_path / 'figure.svg').read_text()
    numbers = json.loads((tmp_path / 'figure.json').read_text())
    muzero = numbers['algorithms']['muzero']
    assert muzero['runs']['0']['reward'] == [-5.0, -3.0]
    assert muzero['mean']['mean']['success'] == [0.0, 0.5]
    assert muzero['mean']['seeds'] == [1, 1]
    assert numbers['algorithms']['ppo']['runs'] == {}
    assert numbers['dwa'] is None
    assert {'command', 'version', 'git_commit'} <= set(numbers)


def measured_dwa(*words, route='difficulty'):
    parser = argparse.ArgumentParser()
    reproduce_figure.add_arguments(parser)
    arguments = parser.parse_args(list(map(str, words)))
    place = reproduce_runs.place_of(arguments, None)
    return reproduce_figure._measured_dwa(place.trial('dwa', route), place, arguments)


def test_the_dwa_is_measured_once(tmp_path):
    words = '--testbed', 'one_buoy', '--dwa-episodes', 1, '--out', tmp_path
    first = measured_dwa(*words)
    assert (first['episodes'], first['split'], first['success']) == (1, 'validation', 1.0)
    assert set(reproduce_figure.AVERAGES.values()) <= set(first)
    (tmp_path / 'dwa-one_buoy-1.json').write_text(json.dumps({'episodes': 7}))
    assert measured_dwa(*words) == {'episodes': 7}


def test_the_dwa_sails_the_paths_that_the_runs_validate_on(tmp_path, monkeypatch):
    measured = []
    monkeypatch.setattr(reproduce_figure, '_measured_dwa', lambda trial, *_: measured.append(trial))
    options = ('--plot-only', '--seeds', 1, '--out', tmp_path)
    for words in (('--preset', 'best'), ('--preset', 'paper'), ('--preset', 'best', '--testbed', 'head_on')):
        command('figure', *words, *options)
    assert [(trial.route, trial.scenario) for trial in measured] == [
        ('clearance', None),
        (None, None),
        (None, 'slow_head_on'),
    ]


def test_each_route_of_the_dwa_has_its_file(tmp_path):
    words = '--difficulty', 'paper', '--dwa-episodes', 3, '--out', tmp_path, '--plot-only'
    (tmp_path / 'dwa-paper-3.json').write_text('{"episodes": 1}')
    assert measured_dwa(*words) == {'episodes': 1}
    assert measured_dwa(*words, route='clearance') is None
    (tmp_path / 'dwa-paper-clearance-3.json').write_text('{"episodes": 2}')
    assert measured_dwa(*words, route='clearance') == {'episodes': 2}


def test_rows_of_the_table():
    whole, half = (
        curve([20_000, 500_000, 1_000_000], reward=[-9.0, -5.0, 3.0]),
        curve([20_000], reward=[-7.0]),
    )
    rows = table_rows(1_000_000, {'muzero': [whole, half]})
    assert [row['steps'] for row in rows] == [0, 500_000, 1_000_000]
    assert [row['muzero']['n'] for row in rows] == [2, 1, 1]
    assert [row['muzero']['mean'] for row in rows] == [-8.0, -5.0, 3.0]
    assert [row['muzero']['paper'] for row in rows] == [-1100, -900, -800]
    assert rows[0]['muzero']['standard_deviation'] == pytest.approx(np.sqrt(2.0))


def test_the_paper_has_no_number_beyond_its_own_or_between():
    rows = table_rows(5_700_000, {'ppo': []})
    assert [row['ppo']['paper'] for row in rows[-3:]] == [-1056, None, None]
    assert [row['steps'] for row in rows[-3:]] == [5_000_000, 5_500_000, 5_700_000]


def test_the_table_takes_the_nearest_line():
    assert reward_at(curve([20, 490, 520, 600], reward=[1.0, 2.0, 3.0, 4.0]), 500) == 2.0
    assert reward_at(curve([20, 490], reward=[1.0, 2.0]), 500) is None
    assert reward_at(curve([], reward=[]), 0) is None


def test_the_table_is_markdown_with_blanks(tmp_path, capsys):
    options = ('--seeds', 1, '--steps', 600_000, '--out', tmp_path)
    leave(runs_of(*options)[0], curve([20_000, 500_000], reward=[-1000.4, 20.0]))
    assert command('table', '--plot-only', *options) == 0
    lines = (tmp_path / 'table.md').read_text().splitlines()
    assert lines[2:] == [
        '| 0 | -1100 | -1000 | 1 | -1100 |  |  |',
        '| 0.5 | -900 | 20 | 1 | -680 |  |  |',
        '| 0.6 |  |  |  |  |  |  |',
    ]
    assert lines[3] in capsys.readouterr().out
    assert json.loads((tmp_path / 'table.json').read_text())['rows']['500000']['muzero']['mean'] == 20.0


def test_a_score_is_the_area_below_the_success():
    training = curve([50, 100], success=[0.0, 1.0])
    score = score_of(training, curve([50, 100], success=[0.1, 0.9]), 100)
    assert score == (0.9, pytest.approx(0.25))
    assert score_of(curve([100], success=[0.4]), training, 100).area == pytest.approx(0.4)


def test_cells_are_compared_over_the_seeds_that_both_have():
    reference = {0: (0.5, 0.1), 1: (0.6, 0.1), 2: (0.7, 0.1)}
    row = compare({1: (0.9, 0.3), 2: (1.0, 0.4), 5: (0.0, 0.0)}, reference)
    assert row['final'].n == 3
    assert row['final_difference'].n == 2
    assert row['final_difference'].mean == pytest.approx(0.3)
    assert row['area_difference'].mean == pytest.approx(0.25)


def test_the_ablation_says_what_is_not_resolved(tmp_path, capsys):
    file = tmp_path / 'cells.yaml'
    file.write_text(CELLS)
    options = ['ablation', '--plot-only', '--cells', file, '--steps', 100, '--out', tmp_path / 'out']
    assert command(*options) == 0  # nothing there yet
    assert '| b | 0 |  |  |  |  |' in capsys.readouterr().out
    values = read_cells(file)
    for name, finals, level in (('a', (0.5, 0.6, 0.7), 0.2), ('b', (0.8, 0.91, 0.99), 0.2)):
        for seed, final in enumerate(finals):
            run = ablation_run(tmp_path / 'out', name, seed, values)
            area = level + (0.01 * seed if name == 'b' else 0.0)
            leave(run, curve([50, 100], success=[area, area]), validation=final)
    assert command(*options) == 0
    lines = (tmp_path / 'out' / 'ablation.md').read_text().splitlines()
    assert lines[2] == '| a | 3 | 60.0 ± 10.0 | reference | 20.0 ± 0.0 | reference |'
    assert lines[3].startswith('| b | 3 | 90.0 ± 9.5 | +30.0 (+')
    assert 'not resolved' not in lines[3].split('|')[4]
    assert 'not resolved' in lines[3].split('|')[6]
    assert json.loads((tmp_path / 'out' / 'ablation.json').read_text())['cells']['b']['final']['n'] == 3


def ablation_run(out, name, seed, cells):
    arguments = argparse.Namespace(out=out, steps=100, seeds=3, difficulty=None, testbed=None)
    return ablation_runs(cells, read_preset('best'), arguments)[name][seed]


def test_the_cells_that_come_with_the_package():
    cells = read_cells(config_path('reproduce', 'ablation.yaml'))
    rules = {(v['search']['rule'], v['search']['simulations']) for v in cells.cells.values()}
    assert rules == {(rule, n) for rule in ('pozero', 'puct', 'gumbel') for n in (8, 25, 50)}
    assert cells.cells['atoms-h']['network']['value'] == {'count': 101, 'spacing': 'h'}
    assert cells.cells['discount-0.99']['targets']['discount'] == 0.99


@pytest.mark.parametrize('preset', ['best', 'rehearse'])
def test_every_cell_plays_by_its_search(preset):
    values = read_preset(preset).values
    for cell in read_cells(config_path('reproduce', 'ablation.yaml')).cells.values():
        asked = merged(values, cell)
        assert asked['teaching']['steps'] == asked['rehearsal']['steps'] == 0


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('reference: c\ncells: {a: {}}', "'c' is none of a"),
        ('reference: a\ncells: {a: 3}', 'cells: a'),
        ('reference: a\ncells: {a: {}}\nextra: 1', 'expected the keys'),
        ('reference: a', 'expected the keys'),
    ],
)
def test_a_mistake_in_the_cells_is_named(tmp_path, text, words):
    file = tmp_path / 'cells.yaml'
    file.write_text(text)
    with pytest.raises(EvaluationError, match=words) as failure:
        read_cells(file)
    assert str(file) in str(failure.value)


@pytest.mark.parametrize(
    'words',
    [
        ('table', '--seeds', 0),
        ('table', '--steps', 0),
        ('figure', '--dwa-episodes', 0),
        ('ablation', '--only', 'puct-9000'),
        ('pictures', '--planner', 'dwa', '--simulations', 3),
        ('pictures', '--planner', 'prior', '--simulations', 3),
        ('pictures', '--simulations', -1),
        ('figure', '--jobs', 0),
        ('ablation', '--threads', 0),
    ],
)
def test_options_that_do_not_fit_are_refused(tmp_path, words):
    with pytest.raises(EvaluationError, match='--'):
        command(*words, '--out', tmp_path)


@pytest.mark.parametrize('part', ['figure', 'table', 'ablation'])
def test_a_device_that_is_not_there_is_refused_before_anything_else(tmp_path, part):
    pytest.importorskip('torch')
    with pytest.raises(TrainingError, match='--device nonsense'):
        command(part, '--device', 'nonsense', '--out', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('library', ['torch', 'stable_baselines3'])
def test_a_missing_library_is_named_before_anything_else(tmp_path, library):
    words = [sys.executable, '-c', WITHOUT, library, 'reproduce', 'figure', '--out', str(tmp_path / 'out')]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (2, '')
    assert ended.stderr == f"portnav: error: {library} is missing: pip install 'portnav_ros[train]'\n"
    assert not (tmp_path / 'out').exists()


def test_what_is_finished_needs_nothing_to_train_with(tmp_path):
    options = ('--seeds', 1, '--steps', 100, '--out', tmp_path, '--device', 'nonsense')
    for run in runs_of(*options):
        leave(run, curve([100], reward=[1.0]), validation=0.5)
    assert command('table', *options) == 0


def test_scans_of_an_episode_are_those_that_were_seen():
    log = sail_subject(Trial('line_of_sight', 'paper', scenario='one_buoy'), seed=3)
    assert len(log.scans.ranges) == len(log) > 100
    np.testing.assert_array_equal(log.scans.ranges.min(axis=1), log.range_min.astype(np.float32))
    assert np.ptp(log.own[:, SURGE]) > 1.0


def test_pictures_show_the_vessel_that_the_model_was_trained_for(tmp_path, make_model):
    options = ('pictures', '--planner', 'prior', '--model', make_model(vessel=load_vessel('cemt_va')))
    assert command(*options, '--out', tmp_path) == 0
    episodes = json.loads((tmp_path / 'pictures.json').read_text())['episodes']
    assert {episode['vessel'] for episode in episodes.values()} == {'cemt_va'}
    with pytest.warns(UserWarning, match='trained for vessel cemt_va, not cemt_iv'):
        assert command(*options, '--allow-mismatch', '--out', tmp_path) == 0
    with pytest.raises(ModelError, match='trained for vessel cemt_va, not shuttle'):
        command(*options, '--vessel', 'shuttle', '--out', tmp_path)


@pytest.mark.parametrize('option', ['--encounter', '--vessel'])
def test_pictures_begin_with_none_where_one_cannot_be_sailed(tmp_path, option):
    with pytest.raises(ParamError, match=r'nope\.yaml: no such file'):
        command('pictures', '--planner', 'line_of_sight', option, 'nope', '--out', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()


def test_pictures(tmp_path, capsys):
    options = ('--planner', 'line_of_sight', '--vessel', 'cemt_va', '--encounter', 'slow_head_on')
    assert command('pictures', *options, '--out', tmp_path) == 0
    said = capsys.readouterr().out
    numbers = json.loads((tmp_path / 'pictures.json').read_text())
    for name in ('free_path', 'evading_vessels', 'evading_a_buoy'):
        assert (tmp_path / f'{name}.png').stat().st_size > 10_000
        assert (tmp_path / f'{name}.svg').exists()
        assert f'{name}.png: The line_of_sight planner' in said
    assert numbers['episodes']['free_path']['outcome'] == 'success'
    assert numbers['episodes']['free_path']['vessel'] == 'cemt_va'
    assert numbers['episodes']['evading_vessels']['outcome'] == 'collision_vessel'
    assert numbers['seed'] == 2_000_000
