"""Whole runs: killed and resumed to the bit, interrupted, extended; and what the files tell."""

import dataclasses
import itertools
import json
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.control.autopilot import AutopilotParams  # noqa: E402
from portnav_ros.muzero import ModelError  # noqa: E402
from portnav_ros.muzero import train as module  # noqa: E402
from portnav_ros.muzero.atoms import AtomParams  # noqa: E402
from portnav_ros.muzero.checkpoint import STATE, read_arrays, write_arrays  # noqa: E402
from portnav_ros.muzero.learner import LearnerParams  # noqa: E402
from portnav_ros.muzero.loop import Loop, Params  # noqa: E402
from portnav_ros.muzero.model_file import load_model  # noqa: E402
from portnav_ros.muzero.networks import NetworkParams  # noqa: E402
from portnav_ros.muzero.rehearsal import RehearsalParams  # noqa: E402
from portnav_ros.muzero.replay import ReplayParams  # noqa: E402
from portnav_ros.muzero.search import RULES, SearchParams  # noqa: E402
from portnav_ros.muzero.selfplay import SelfPlayParams  # noqa: E402
from portnav_ros.muzero.train import Run, train  # noqa: E402
from portnav_ros.muzero.tutor import TeachingParams  # noqa: E402
from portnav_ros.task.actions import ActionParams  # noqa: E402
from portnav_ros.task.env import TaskParams  # noqa: E402
from portnav_ros.training.job import Job  # noqa: E402
from portnav_ros.training.run_directory import WALL_CLOCK, TrainingError, read_metrics  # noqa: E402
from portnav_ros.training.scenarios import ScenarioParams  # noqa: E402
from portnav_ros.training.schedule import ScheduleParams  # noqa: E402

ITERATION = 4 * 10 * 8  # environment steps: environments, decisions, seconds
ATOMS = AtomParams(21, -1500.0, 1500.0, 'linear')


def network(represent=16, value=ATOMS, reward=ATOMS):
    return NetworkParams(8, (represent,), (16,), (16,), value, reward, alive=True)


def params(iterations=9, rule='pozero'):
    """Three iterations to a checkpoint; updates from the second iteration on."""
    return Params(
        task=TaskParams(actions=ActionParams(hold=8)),
        scenarios=ScenarioParams(testbed='one_buoy', validation_episodes=3),
        network=network(),
        search=SearchParams(simulations=4, rule=rule),
        selfplay=SelfPlayParams(environments=4, segment=10),
        replay=ReplayParams(capacity=200, warmup=40, samples_per_step=0.1),
        learner=LearnerParams(batch=16, unroll=3, average=3),
        schedule=ScheduleParams(iterations * ITERATION, ITERATION, 3 * ITERATION, 3 * ITERATION),
    )


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from test_train import params
from portnav_ros.muzero import selfplay, train
from portnav_ros.training.job import Job

play, calls = selfplay.SelfPlay.play, []

def play_and_die(self, *arguments, **options):
    calls.append(1)
    if len(calls) == {call}:
        os.kill(os.getpid(), signal.SIGKILL)
    return play(self, *arguments, **options)

selfplay.SelfPlay.play = play_and_die
train.train(params(), Job(Path({out!r}), seed=5))
"""


def run_until_killed(out, call):
    """Train in a process of its own, which is killed as it begins the segment of that number."""
    folder = __file__.rpartition('/')[0]
    script = KILLED.format(folder=folder, out=str(out), call=call)
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stderr


def last_checkpoint(out):
    folder = out / 'checkpoint'
    state = json.loads((folder / STATE).read_text())
    arrays = read_arrays(folder / state['arrays'])
    tensors = torch.load(folder / state['tensors'], weights_only=True)
    replay = [read_arrays(folder / f'replay-{first}-{end}.npz') for first, end in state['replay']]
    return state, arrays, tensors, replay


def assert_same(first, second, where=''):
    """Equal to the bit, through nested containers."""
    assert type(first) is type(second), where
    if isinstance(first, dict):
        assert first.keys() == second.keys(), where
        for key in first:
            assert_same(first[key], second[key], f'{where}/{key}')
    elif isinstance(first, (list, tuple)):
        assert len(first) == len(second), where
        for i, pair in enumerate(zip(first, second, strict=True)):
            assert_same(*pair, f'{where}/{i}')
    elif isinstance(first, (np.ndarray, torch.Tensor)):
        np.testing.assert_array_equal(np.asarray(first), np.asarray(second), err_msg=where)
    else:
        assert first == second, where


def without_clock(lines):
    return [{key: value for key, value in line.items() if key not in WALL_CLOCK} for line in lines]


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A run of three checkpoints that nothing interrupts."""
    out = tmp_path_factory.mktemp('runs') / 'whole'
    train(params(), Job(out, seed=5))
    return out


@pytest.mark.parametrize('call', [2, 5])
def test_a_killed_run_goes_on_to_the_bit(whole, tmp_path, call):
    out = tmp_path / 'killed'
    run_until_killed(out, call)
    train(params(), Job(out, seed=5, resume=True))
    assert_same(last_checkpoint(whole), last_checkpoint(out))
    assert without_clock(read_metrics(out / 'metrics.jsonl')) == without_clock(
        read_metrics(whole / 'metrics.jsonl')
    )
    assert (out / 'best.safetensors').read_bytes() == (whole / 'best.safetensors').read_bytes()


def test_ctrl_c_saves_and_the_run_goes_on_to_the_bit(whole, tmp_path, monkeypatch):
    out, iterate, calls = tmp_path / 'interrupted', Loop.iterate, []

    def iterate_and_interrupt(self, worker):
        calls.append(1)
        if len(calls) == 5:
            signal.raise_signal(signal.SIGINT)
        iterate(self, worker)

    monkeypatch.setattr(Loop, 'iterate', iterate_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        train(params(), Job(out, seed=5))
    assert json.loads((out / 'checkpoint' / STATE).read_text())['counters']['steps'] == 5 * ITERATION
    train(params(), Job(out, seed=5, resume=True))
    assert_same(last_checkpoint(whole)[1:3], last_checkpoint(out)[1:3])


def test_metrics_tell_what_a_figure_needs(whole):
    lines = read_metrics(whole / 'metrics.jsonl')
    logs = [line for line in lines if 'validation' not in line]
    assert [line['steps'] for line in logs] == [ITERATION * k for k in range(1, 10)]
    last = logs[-1]
    outcomes = ('success', 'collision_quay', 'collision_buoy', 'collision_vessel', 'timeout')
    assert last['episodes'] > 0
    assert sum(last[name] for name in outcomes) == pytest.approx(1.0)
    assert {'reward', 'length_s', 'e_x', 'e_y', 'e_psi', 'decisions', 'updates', 'steps_per_s'} <= last.keys()
    assert {'loss', 'gradient_norm', 'policy_lag', 'target_entropy', 'clipped_values'} <= last[
        'losses'
    ].keys()
    validations = [line for line in lines if 'validation' in line]
    assert [line['steps'] for line in validations] == [ITERATION * k for k in (3, 6, 9)]
    assert validations[-1]['validation']['episodes'] == 3
    assert {'success', 'interval', 'prior'} <= validations[-1]['validation'].keys()


def test_updates_keep_to_the_rate(whole):
    lines = [line for line in read_metrics(whole / 'metrics.jsonl') if 'updates' in line]
    for before, line in itertools.pairwise(lines):
        learned_from = max(before['steps'] - 40 * 8, 0)  # the segment before, since the warm-up
        assert line['updates'] == int(0.1 * learned_from / 16)


def test_the_best_model_can_be_read_and_says_what_it_is(whole):
    model = load_model(whole / 'best.safetensors')
    assert model.card.algorithm == 'muzero'
    assert model.card.task == params().task
    assert model.card.discount == pytest.approx(0.997**8)
    assert model.card.evaluation['split'] == 'validation'
    assert model.card.training['autopilot'] == dataclasses.asdict(AutopilotParams())


def test_the_model_has_the_mean_of_the_weights(tmp_path):
    run = Run(params(), Job(tmp_path / 'run', seed=6))
    run.go_on()
    run.keep({'success': 0.5})
    run.close()
    mean, last = run.loop.learner.mean_arrays(), run.loop.learner.arrays()
    kept = load_model(tmp_path / 'run' / 'best.safetensors').tensors
    assert_same(dict(kept), mean)
    assert any((mean[name] != last[name]).any() for name in mean)
    observation = np.ones((1, params().task.observation.size), np.float32)
    judged, sailing = run.loop.export_mean().begin(observation), run.loop.model.begin(observation)
    assert (judged.latent != sailing.latent).any()


def test_a_finished_run_has_nothing_left_to_do(whole):
    before = last_checkpoint(whole)
    train(params(), Job(whole, seed=5, resume=True))
    assert_same(before, last_checkpoint(whole))


def test_a_checkpoint_with_the_arrays_of_another_run_is_refused_by_name(whole, tmp_path):
    out = tmp_path / 'foreign'
    shutil.copytree(whole, out)
    state, arrays, *_ = last_checkpoint(out)
    write_arrays(out / 'checkpoint' / state['arrays'], {'features': arrays['features']})
    with pytest.raises(TrainingError, match=r'checkpoint: .* another run .*KeyError'):
        train(params(), Job(out, seed=5, resume=True))


def test_a_folder_in_use_is_refused(whole):
    with pytest.raises(TrainingError, match='--resume'):
        train(params(), Job(whole, seed=5))


def test_a_rehearsal_needs_a_policy_to_go_on_from(whole, tmp_path):
    rehearsing = dataclasses.replace(params(), rehearsal=RehearsalParams(ITERATION, actions=4))
    with pytest.raises(TrainingError, match=r'--from FILE; `portnav train --preset best`'):
        Run(rehearsing, Job(tmp_path / 'run'))
    assert not (tmp_path / 'run').exists()
    with pytest.raises(TrainingError, match='no run to resume'):  # which is not asked for a policy
        Run(rehearsing, Job(tmp_path / 'run', resume=True))
    task = TaskParams(actions=ActionParams(hold=8, reference='path'))  # as the teacher needs it
    taught = dataclasses.replace(rehearsing, task=task, teaching=TeachingParams(ITERATION, actions=4))
    Run(taught, Job(tmp_path / 'taught')).close()
    begun = dataclasses.replace(rehearsing, start_from=str(whole / 'best.safetensors'))
    Run(begun, Job(tmp_path / 'begun')).close()


@pytest.mark.parametrize('rule', RULES)
def test_a_validation_explores_nothing_whatever_the_rule(tmp_path, rule):
    run = Run(params(rule=rule), Job(tmp_path / 'run', seed=5))
    run.close()
    features = np.random.default_rng(0).standard_normal((3, run.params.task.observation.size))
    first, second = (
        run.search.run(run.loop.model, features.astype(np.float32), np.random.default_rng(seed), None, 0.0)
        for seed in (0, 1)
    )
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize('rule', ['puct', 'gumbel'])
def test_other_rules_train_too_and_speed_of_threads_does_not_matter(rule):
    loops = [Loop(params(rule=rule), seed=1) for _ in range(2)]
    with ThreadPoolExecutor(1) as worker:
        for _ in range(3):
            loops[0].iterate(worker)
    for _ in range(3):  # the same, one after the other
        segment = loops[1].selfplay.play(loops[1].model, loops[1].learner.updates)
        loops[1].learner.set_progress(loops[1].steps / loops[1].params.schedule.steps)
        loops[1].learn()
        loops[1].replay.append(segment)
        loops[1].model = loops[1].export()
    assert_same(loops[0].learner.state_dict(), loops[1].learner.state_dict())
    assert loops[0].learner.updates > 0


@pytest.mark.parametrize(
    ('lessons', 'resume', 'words'),
    [
        ({'teaching': TeachingParams(ITERATION)}, False, f': --set teaching.steps={9 * ITERATION}'),
        (
            {'teaching': TeachingParams(ITERATION), 'rehearsal': RehearsalParams(ITERATION, actions=12)},
            True,
            f'new run with --set rehearsal.steps={8 * ITERATION}',
        ),
    ],
)
def test_a_run_that_outlasts_its_lessons_says_so(tmp_path, monkeypatch, lessons, resume, words):
    monkeypatch.setattr(module, 'Run', lambda *_: SimpleNamespace(go_on=lambda: None, close=lambda: None))
    with pytest.warns(UserWarning, match='a search decides') as said:
        train(dataclasses.replace(params(), **lessons), Job(tmp_path, resume=resume))
    assert str(said[0].message).endswith(words)


@pytest.mark.parametrize('steps', [0, 9 * ITERATION, 20 * ITERATION])
def test_a_run_of_one_kind_warns_of_nothing(tmp_path, monkeypatch, steps, recwarn):
    monkeypatch.setattr(module, 'Run', lambda *_: SimpleNamespace(go_on=lambda: None, close=lambda: None))
    train(dataclasses.replace(params(), teaching=TeachingParams(steps)), Job(tmp_path))
    assert not recwarn.list


def test_a_run_begins_with_the_weights_of_a_model(whole, tmp_path):
    model = whole / 'best.safetensors'
    run = Run(dataclasses.replace(params(), start_from=str(model)), Job(tmp_path / 'run', seed=6))
    run.close()
    given = load_model(model)
    for name, tensor in run.loop.learner.arrays().items():
        np.testing.assert_array_equal(tensor, given.tensors[name])
    origin = run.card({}).training['start_from']
    assert origin['sha256'] == given.sha256
    assert origin['steps'] == given.card.training['steps']


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'network': network(represent=32)}, 'other networks'),
        ({'network': network(value=AtomParams(21, -1500.0, 900.0))}, r'other atoms .* network\.value'),
        ({'network': network(reward=AtomParams(21, -1500.0, 1500.0, 'h'))}, r'atoms .* network\.reward'),
        ({'network': network(value=AtomParams(31, -1500.0, 1500.0, 'linear'))}, r'atoms .* network\.value'),
        ({'task': TaskParams(actions=ActionParams(hold=4))}, 'other observations or actions'),
        ({'start_from': 'nothing.safetensors'}, 'no such model'),
    ],
)
def test_a_model_that_does_not_fit_the_run_is_refused(whole, tmp_path, change, message):
    fitting = dataclasses.replace(params(), start_from=str(whole / 'best.safetensors'))
    with pytest.raises(ModelError, match=message):
        Run(dataclasses.replace(fitting, **change), Job(tmp_path / 'run', seed=6))
    assert not (tmp_path / 'run').exists()
