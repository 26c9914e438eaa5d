"""What a run was begun with, how far it has got, and several at a time."""

import json
import os
import select
import signal
import subprocess
import sys

import pytest
import yaml

from portnav_ros.evaluation import training_fleet
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.training_fleet import Crew, train_all
from portnav_ros.evaluation.training_runs import Place, Run, checked, merged, read_preset
from portnav_ros.training.run_directory import plain

VALUES = {'search': {'simulations': 8}, 'learner': {'hidden': (8, 8)}, 'schedule': {'steps': 100}}

# Stands for `python -m portnav_ros train`: a run of 100 steps that fails, is interrupted or ends well.
TRAIN = """#!/bin/sh
while [ "$1" != --out ]; do shift; done
mkdir -p "$2" && cd "$2" && touch config.yaml
case $PWD in
*broken*) echo no memory left; exit 3;;
*interrupted*) trap 'echo saved > saved; exit 130' INT; kill -INT $PPID;;
*orphaned*) trap 'echo ended > ../fifo; exit 130' INT; kill -KILL $PPID;;
esac
case $PWD in *ed) for k in $(seq 500); do sleep 0.02; done;; esac
echo '{"steps": 100}' > metrics.jsonl
echo '{"steps": 100, "validation": {}}' >> metrics.jsonl
echo run >> ../order
"""


ORPHANED = """
import sys
from pathlib import Path
from portnav_ros.evaluation.training_fleet import Crew, train_all
from portnav_ros.evaluation.training_runs import Run
sys.executable = sys.argv[1]
train_all([Run(Path(sys.argv[2]), 'orphaned', 'muzero', 0, {'schedule': {'steps': 100}})], Crew())
"""


@pytest.fixture
def trainer(tmp_path, monkeypatch):
    script = tmp_path / 'train'
    script.write_text(TRAIN)
    script.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(script))
    monkeypatch.setattr(training_fleet, 'POLL_S', 0.02)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield str(script)
    signal.signal(signal.SIGINT, before)


def make_run(root, name='muzero-0', values=VALUES):
    return Run(root, name, 'muzero', 0, values)


def begin(run, *lines, **changes):
    run.directory.path.mkdir(parents=True)
    config = plain(merged({'algorithm': run.algorithm, 'seed': run.seed, **run.values}, changes))
    run.directory.config.write_text(yaml.safe_dump(config))
    run.directory.metrics.write_text(''.join(json.dumps(line) + '\n' for line in lines))


def test_a_run_that_never_began(tmp_path):
    run = make_run(tmp_path)
    run.check()
    assert (run.steps_done(), run.finished()) == (0, False)


def test_a_run_is_finished_by_its_last_validation(tmp_path):
    last = {'steps': 104, 'reward': 0.0}
    begin(make_run(tmp_path), {'steps': 50, 'validation': {}}, last)
    assert (make_run(tmp_path).steps_done(), make_run(tmp_path).finished()) == (100, False)
    begin(make_run(tmp_path, 'b'), last, {'steps': 104, 'validation': {}})
    assert make_run(tmp_path, 'b').finished()


def test_a_run_begins_with_its_parameters_and_is_resumed_with_its_own(tmp_path):
    run = make_run(tmp_path)
    command = run.command()
    file = tmp_path / 'muzero-0.yaml'
    assert command[command.index('--config') + 1] == str(file)
    assert command[command.index('--seed') + 1] == '0'
    assert yaml.safe_load(file.read_text()) == plain(VALUES)
    begin(run)
    assert run.command() == ['--resume', '--out', str(tmp_path / 'muzero-0')]


def test_parameters_that_a_preset_leaves_out_may_be_anything(tmp_path):
    begin(make_run(tmp_path), replay={'capacity': 5})
    make_run(tmp_path).check()


def test_a_parameter_younger_than_the_run_may_only_be_off(tmp_path):
    begin(make_run(tmp_path))
    make_run(tmp_path, values={**VALUES, 'rehearsal': {'steps': 0}}).check()
    with pytest.raises(EvaluationError, match='rehearsal/steps = None, not 7'):
        make_run(tmp_path, values={**VALUES, 'rehearsal': {'steps': 7}}).check()


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'search': {'simulations': 25}}, 'search/simulations = 25, not 8'),
        ({'schedule': {'steps': 900}}, 'schedule/steps = 900, not 100'),
        ({'algorithm': 'ppo'}, "algorithm = 'ppo', not 'muzero'"),
        ({'learner': {'hidden': (8, 16)}}, 'learner/hidden'),
    ],
)
def test_a_run_of_other_parameters_is_refused(tmp_path, changes, words):
    begin(make_run(tmp_path), **changes)
    with pytest.raises(EvaluationError, match=words) as failure:
        checked([make_run(tmp_path)])
    assert 'muzero-0' in str(failure.value)
    assert '--out' in str(failure.value)


def test_a_run_that_wrote_at_other_intervals_is_the_same_run(tmp_path):
    schedule = {'steps': 100, 'log_every': 5, 'validate_every': 12, 'save_every': 5}
    run = make_run(tmp_path, values={**VALUES, 'schedule': schedule})
    begin(run, schedule={'log_every': 200_000, 'validate_every': 2_500_000, 'save_every': 1_000_000})
    assert checked([run]) == [run]


def test_merged_leaves_both_as_they_were():
    low, high = {'a': {'b': 1, 'c': 2}, 'd': 3}, {'a': {'c': 4}, 'e': {}}
    assert merged(low, high) == {'a': {'b': 1, 'c': 4}, 'd': 3, 'e': {}}
    assert low == {'a': {'b': 1, 'c': 2}, 'd': 3}
    assert merged(low, low) == low


def test_a_preset_is_a_name_or_a_file(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('search: {simulations: 3}')
    assert read_preset(str(file)) == ('mine', {'search': {'simulations': 3}})
    assert read_preset('paper').values['selfplay']['environments'] == 25


@pytest.mark.parametrize(
    ('place', 'difficulty', 'scenario'),
    [
        (Place(), 'paper', None),
        (Place('easy'), 'easy', None),
        (Place(testbed='head_on'), 'paper', 'slow_head_on'),
        (Place(testbed='walls_only'), 'walls_only', None),
    ],
)
def test_a_trial_sails_the_worlds_of_a_runs_validation(place, difficulty, scenario):
    trial = place.trial('dwa', 'difficulty')
    assert (trial.difficulty, trial.scenario) == (difficulty, scenario)


@pytest.mark.parametrize('jobs', [1, 2])
def test_all_runs_are_trained_once(tmp_path, trainer, jobs):
    runs = [make_run(tmp_path / 'runs', name) for name in ('a', 'b', 'c')]
    assert train_all(runs, Crew(jobs)) == []
    assert all(run.finished() for run in runs)
    assert train_all(runs, Crew(jobs)) == []
    assert (tmp_path / 'runs' / 'order').read_text() == 'run\n' * 3


def test_a_run_that_fails_does_not_stop_the_others(tmp_path, trainer, capsys):
    runs = [make_run(tmp_path / 'runs', name) for name in ('broken', 'b')]
    assert train_all(runs, Crew()) == ['broken']
    assert runs[1].finished()
    assert 'no memory left' in runs[0].log.read_text()
    assert 'ended with code 3' in capsys.readouterr().out


def test_ctrl_c_lets_every_run_save(tmp_path, trainer):
    run = make_run(tmp_path, 'interrupted')
    with pytest.raises(KeyboardInterrupt):
        train_all([run], Crew())
    assert (run.directory.path / 'saved').read_text() == 'saved\n'
    assert run.command()[0] == '--resume'


def test_a_run_ends_with_its_command(tmp_path, trainer, monkeypatch):
    monkeypatch.undo()
    os.mkfifo(tmp_path / 'fifo')
    fifo = os.open(tmp_path / 'fifo', os.O_RDWR)
    ended = subprocess.run([sys.executable, '-c', ORPHANED, trainer, str(tmp_path)], capture_output=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    assert select.select([fifo], [], [], 20.0)[0]
    assert os.read(fifo, 100) == b'ended\n'
    os.close(fifo)


def test_no_run_at_a_time_is_refused(tmp_path):
    with pytest.raises(EvaluationError, match='--jobs 0'):
        train_all([make_run(tmp_path)], Crew(jobs=0))
