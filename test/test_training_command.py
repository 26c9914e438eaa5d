"""`portnav train`: presets, options over them, and what a resumed run takes from its folder."""

import dataclasses
import re

import pytest
import yaml

from portnav_ros import cli, training_command
from portnav_ros.params import ParamError, override, read_yaml
from portnav_ros.resources import config_path
from portnav_ros.training.run_directory import RunDirectory
from portnav_ros.training_command import assignment, assignments

torch = pytest.importorskip('torch')

from portnav_ros.muzero import train  # noqa: E402


@pytest.fixture
def trained(monkeypatch):
    """What the algorithm would be called with."""
    calls = []
    monkeypatch.setattr(train, 'train', lambda params, job: calls.append((params, job)))
    return calls


@pytest.mark.parametrize('preset', ['paper', 'best', 'rehearse', 'scans'])
def test_presets_hold_known_keys(preset):
    file = config_path('train', f'{preset}.yaml')
    override(train.Params(), read_yaml(file), str(file))


def test_paper_preset_is_the_papers_recipe(trained, tmp_path):
    assert cli.main(['train', '--preset', 'paper', '--out', str(tmp_path / 'run')]) == 0
    params = trained[0][0]
    assert params.selfplay.environments == 25
    assert (params.task.actions.count, params.task.actions.hold) == (27, 1)
    assert params.search.rule == 'pozero'
    assert params.search.act
    assert params.search.search
    assert params.search.learn
    assert (params.targets.discount, params.targets.returns) == (0.997, 'n_step')
    assert (params.network.value.count, params.network.value.spacing) == (81, 'h')
    assert not params.network.alive
    assert params.scenarios.difficulty == 'paper'


@pytest.mark.parametrize(
    ('key', 'reason'),
    [
        ('task.observation.tracks=4', r'network\.tracks = 8, but task\.observation\.tracks = 4'),
        ('network.tracks=3', r'network\.tracks = 3'),
        (
            'task.observation.sectors=60',
            r'network\.scan_shape = \(4, 90\), but the observation has \(4, 60\)',
        ),
    ],
)
def test_networks_that_do_not_fit_the_observation_are_refused(trained, tmp_path, capsys, key, reason):
    assert cli.main(['train', '--set', key, '--out', str(tmp_path / 'run')]) == 2
    assert re.search(reason, capsys.readouterr().err)
    assert not trained


def test_what_only_fits_together_is_set_together(trained, tmp_path):
    keys = ['task.observation.tracks=0', 'network.tracks=0', 'network.represent_hidden=[384, 256]']
    cli.main(['train', *(word for key in keys for word in ('--set', key)), '--out', str(tmp_path / 'run')])
    params = trained[0][0]
    assert (params.task.observation.tracks, params.network.tracks) == (0, 0)
    assert params.network.represent_hidden == (384, 256)
    assert params.task.observation.sectors == 90


def test_of_one_key_set_twice_the_last_counts():
    items = ['a.b=1', 'a.c.d=2', 'a.b=3', 'a.c={e: 4, g: 6}', 'a.c.g=7', 'f=5']
    assert assignments(items) == {'a': {'b': 3, 'c': {'d': 2, 'e': 4, 'g': 7}}, 'f': 5}


def test_options_go_over_the_preset(trained, tmp_path):
    options = ['--testbed', 'head_on', '--steps', '1000', '--seed', '7', '--set', 'search.simulations=3']
    cli.main(['train', '--preset', 'best', *options, '--threads', '2', '--out', str(tmp_path / 'run')])
    params, job = trained[0]
    assert params.scenarios.testbed == 'head_on'
    assert params.schedule.steps == 1000
    assert params.search.simulations == 3
    assert (job.seed, job.threads, job.resume) == (7, 2, False)
    assert job.provenance['version']


def test_a_short_run_of_a_long_preset_still_makes_curves(trained, tmp_path):
    """And its whole length is taught; what --set says is done to the letter."""
    short = ['train', '--preset', 'best', '--testbed', 'one_buoy', '--steps', '300000']
    cli.main([*short, '--out', str(tmp_path / 'run')])
    params = trained[0][0]
    schedule = params.schedule
    assert (schedule.log_every, schedule.validate_every, schedule.save_every) == (15_000, 37_500, 15_000)
    assert params.teaching.steps >= schedule.steps
    cli.main([*short, '--set', 'schedule.log_every=100000', '--out', str(tmp_path / 'run')])
    assert trained[1][0].schedule.log_every == 100_000


def test_a_long_run_has_the_intervals_of_its_preset(trained, tmp_path):
    cli.main(['train', '--preset', 'paper', '--steps', '40000000', '--out', str(tmp_path / 'run')])
    assert trained[0][0].schedule == dataclasses.replace(train.Params().schedule, steps=40_000_000)


def test_a_resumed_run_has_the_parameters_of_its_folder(trained, tmp_path):
    params = dataclasses.replace(train.Params(), validate_prior=False)
    config = {'algorithm': 'muzero', 'seed': 4, 'version': '0', **dataclasses.asdict(params)}
    RunDirectory.create(tmp_path / 'run', config).close()
    assert cli.main(['train', '--resume', '--out', str(tmp_path / 'run')]) == 0
    assert trained[0][0] == params
    assert (trained[0][1].seed, trained[0][1].resume) == (4, True)
    cli.main(['train', '--resume', '--out', str(tmp_path / 'run'), '--steps', '99'])
    assert trained[1][0].schedule.steps == 99


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--resume'], 'needs --out'),
        (['--resume', '--out', '.', '--seed', '3'], 'leave out --seed'),
        (['--resume', '--out', 'nowhere'], 'no run to resume'),
        (['--set', 'search.simulatoins=3'], "did you mean 'simulations'"),
        (['--set', 'search'], 'expected KEY=VALUE'),
        (['--preset', 'bets'], 'bets.yaml'),
        (['--steps', '0'], 'steps'),
    ],
)
def test_mistakes_are_explained(trained, capsys, tmp_path, monkeypatch, options, message):
    monkeypatch.chdir(tmp_path)
    assert cli.main(['train', *options]) == 2
    assert message in capsys.readouterr().err
    assert not trained


@pytest.mark.parametrize('algorithm', training_command.ALGORITHMS)
@pytest.mark.parametrize('device', ['cuda', 'nonsense'])
def test_a_device_that_is_not_there_leaves_no_folder(monkeypatch, capsys, tmp_path, algorithm, device):
    monkeypatch.setattr(torch.backends.cuda, 'is_built', lambda: False)
    out = tmp_path / 'run'
    assert cli.main(['train', '--algorithm', algorithm, '--device', device, '--out', str(out)]) == 2
    assert f'portnav: error: --device {device}: ' in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize('algorithm', training_command.ALGORITHMS)
def test_a_mistake_leaves_no_folder(capsys, tmp_path, algorithm):
    out = tmp_path / 'run'
    assert cli.main(['train', '--algorithm', algorithm, '--difficulty', 'hard', '--out', str(out)]) == 2
    assert 'hard.yaml: no such file' in capsys.readouterr().err
    assert not out.exists()


def test_the_second_part_of_the_recipe_needs_the_first(capsys, tmp_path):
    assert cli.main(['train', '--preset', 'rehearse', '--out', str(tmp_path / 'run')]) == 2
    assert '--from FILE; `portnav train --preset best`' in capsys.readouterr().err


def test_assignment_reads_yaml():
    assert assignment('learner.learning_rate=2e-4') == {'learner': {'learning_rate': 2e-4}}
    assert assignment('network.represent_hidden=[64, 64]') == {'network': {'represent_hidden': [64, 64]}}
    with pytest.raises(ParamError, match='YAML'):
        assignment('a=[')


def test_every_algorithm_has_a_preset():
    for algorithm, preset in training_command.PRESETS.items():
        assert algorithm in training_command.ALGORITHMS
        assert yaml.safe_load(config_path('train', f'{preset}.yaml').read_text(encoding='utf-8'))
