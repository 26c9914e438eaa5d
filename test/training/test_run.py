"""What runs of every algorithm do alike, of one that learns nothing."""

import json

import pytest

from portnav_ros.sim.generator import find_scenario
from portnav_ros.training.job import Job
from portnav_ros.training.run import TrainingRun
from portnav_ros.training.run_directory import RunDirectory, TrainingError
from portnav_ros.training.scenarios import ScenarioParams
from portnav_ros.training.schedule import ScheduleParams

SCHEDULE = ScheduleParams(steps=100, log_every=20, validate_every=30, save_every=50)
SUCCESSES = (0.1, 0.5, 0.4, 0.5)


class Idle(TrainingRun):
    """Ten steps at a time; writes down what it is told to do."""

    algorithm, title = 'idle', 'Idle'

    def __init__(self, job, schedule=SCHEDULE):
        super().__init__(job, schedule)
        self.sailed, self.done, self.kept = 0, [], []
        self.successes = iter(SUCCESSES)
        if job.resume:
            self.files = RunDirectory.reopen(job.out, -1)
        self.begin({'schedule': {'steps': schedule.steps}})

    @property
    def steps(self):
        return self.sailed

    def learn(self):
        self.sailed += 10

    def summary(self):
        return {'success': None}

    def log(self):
        self.done.append(('log', self.steps))

    def validate(self):
        self.done.append(('validate', self.steps))
        return {'success': next(self.successes), 'reward': 0.0}

    def keep(self, validation):
        self.kept.append((self.steps, validation['success']))

    def save(self):
        self.done.append(('save', self.steps))


def test_lines_validations_and_checkpoints_come_in_time_and_at_the_end(tmp_path):
    run = Idle(Job(tmp_path / 'run'))
    run.go_on()
    run.close()
    at = {what: [steps for name, steps in run.done if name == what] for what in ('log', 'validate', 'save')}
    assert at == {'log': [20, 40, 60, 80, 100], 'validate': [30, 60, 90, 100], 'save': [50, 100]}
    assert [name for name, steps in run.done if steps == 100] == ['log', 'validate', 'save']
    lines = [json.loads(line) for line in run.files.metrics.read_text().splitlines()]
    assert [line['validation']['success'] for line in lines] == list(SUCCESSES)


def test_a_model_is_kept_where_none_was_better(tmp_path):
    run = Idle(Job(tmp_path / 'run'))
    run.go_on()
    run.close()
    assert run.kept == [(30, 0.1), (60, 0.5)]
    assert run.best == {'success': 0.5, 'reward': 0.0}


def test_a_model_tells_the_command_by_which_its_run_was_begun(tmp_path):
    example = find_scenario('paper', 0, 'head_on', None)
    for resume, command in ((False, 'begin'), (True, 'resume')):
        run = Idle(Job(tmp_path / 'run', resume=resume, provenance={'command': command, 'version': '1'}))
        run.close()
        facts = run.facts(ScenarioParams(), example)
        assert (facts['command'], facts['version'], facts['seed']) == ('begin', '1', 0)


def test_a_folder_with_a_run_and_one_without_are_refused(tmp_path):
    Idle(Job(tmp_path / 'run')).close()
    with pytest.raises(TrainingError, match='holds a run already'):
        Idle(Job(tmp_path / 'run'))
    with pytest.raises(TrainingError, match='holds no run to resume'):
        Idle(Job(tmp_path / 'none', resume=True))
