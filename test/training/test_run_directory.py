"""The folder of a run: what it refuses, and what a resumed run finds."""

import json

import pytest

from portnav_ros.training.run_directory import RunDirectory, TrainingError, flat, plain, read_metrics


@pytest.fixture
def run(tmp_path):
    created = RunDirectory.create(tmp_path / 'run', {'seed': 3, 'params': {'sizes': (1, 2)}})
    yield created
    created.close()


def test_configuration_comes_back_plain(run):
    assert run.read_config() == {'seed': 3, 'params': {'sizes': [1, 2]}}


def test_a_folder_that_holds_a_run_is_refused(run):
    with pytest.raises(TrainingError, match='--resume'):
        RunDirectory.create(run.path, {})


def test_a_folder_that_holds_something_else_is_refused(tmp_path):
    (tmp_path / 'thesis.txt').write_text('mine')
    with pytest.raises(TrainingError, match='not empty'):
        RunDirectory.create(tmp_path, {})


def test_resuming_nothing_is_refused(tmp_path):
    with pytest.raises(TrainingError, match='no run to resume'):
        RunDirectory.reopen(tmp_path / 'nowhere', 0)


def test_metrics_after_the_checkpoint_are_cut_off(run):
    for steps in (20, 40, 60):
        run.log({'steps': steps, 'success': 0.5, 'validation': {'success': 0.25}})
    again = RunDirectory.reopen(run.path, 40)
    again.log({'steps': 60, 'success': 1.0})
    again.close()
    assert [line['steps'] for line in read_metrics(run.metrics)] == [20, 40, 60]
    assert read_metrics(run.metrics)[-1] == {'steps': 60, 'success': 1.0}


def test_a_line_cut_short_by_a_kill_is_dropped(run):
    run.log({'steps': 20, 'reward': -1.5})
    with run.metrics.open('a') as file:
        file.write('{"steps": 40, "rew')
    assert read_metrics(run.metrics) == [{'steps': 20, 'reward': -1.5}]


def test_a_damaged_line_is_named(run):
    run.metrics.write_text('{"steps": 1}\nnonsense\n{"steps": 2}\n')
    with pytest.raises(TrainingError, match='line 2'):
        read_metrics(run.metrics)


def test_not_a_number_never_reaches_the_file(run):
    with pytest.raises(ValueError, match='not JSON compliant'):
        run.log({'steps': 1, 'loss': float('nan')})
    assert not run.metrics.exists() or not run.metrics.read_text()


def test_numbers_reach_tensorboard(run):
    pytest.importorskip('tensorboard')
    run.log({'steps': 20, 'validation': {'success': 0.25}, 'reward': None})
    assert list((run.path / 'events').glob('events.out.tfevents.*'))


def test_plain_and_flat():
    assert plain({'a': (1, (2,))}) == {'a': [1, [2]]}
    assert flat({'a': 1, 'b': {'c': 2, 'd': {'e': 3}}}) == {'a': 1, 'b/c': 2, 'b/d/e': 3}
    assert json.loads(json.dumps(plain({'p': (0.5,)}))) == {'p': [0.5]}
