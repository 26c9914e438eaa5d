"""`portnav train --algorithm ppo`, from the first step to a model that sails."""

import dataclasses
import shutil
import signal

import numpy as np
import pytest

from portnav_ros.baselines.ppo_policy import likeliest, load_policy, policy_layers
from portnav_ros.muzero.model_file import load_model
from portnav_ros.params import override
from portnav_ros.training.job import Job
from portnav_ros.training.run_directory import WALL_CLOCK, TrainingError, read_metrics

torch = pytest.importorskip('torch')
pytest.importorskip('stable_baselines3')

from portnav_ros.baselines import ppo  # noqa: E402 - needs the extra `train`

TINY = override(
    ppo.Params(),
    {
        'task': {'actions': {'hold': 4, 'reference': 'path'}},
        'scenarios': {
            'difficulty': 'easy',
            'ports': 1,
            'validation_route': 'clearance',
            'validation_episodes': 3,
        },
        'learner': {'environments': 4, 'rollout': 16, 'batch': 32, 'epochs': 1, 'hidden': [16, 8]},
        'schedule': {'steps': 1024, 'log_every': 512, 'validate_every': 1024, 'save_every': 512},
    },
    'test',
)


def longer(steps):
    return dataclasses.replace(TINY, schedule=dataclasses.replace(TINY.schedule, steps=steps))


def checkpoint(out):
    return torch.load(out / 'checkpoint' / ppo.CHECKPOINT, weights_only=True)


def metrics(out):
    """Lines without the fields that tell of the clock."""
    lines = read_metrics(out / 'metrics.jsonl')
    return [{key: line[key] for key in line if key not in WALL_CLOCK} for line in lines]


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    else:
        np.testing.assert_array_equal(one, other)


@pytest.fixture(scope='module')
def finished(tmp_path_factory):
    """A run of 1,024 steps."""
    out = tmp_path_factory.mktemp('ppo') / 'run'
    ppo.train(TINY, Job(out, seed=3, provenance={'git_commit': 'abc'}))
    return out


def test_metrics_have_a_line_each_log_every_steps_and_a_validation(finished):
    lines = read_metrics(finished / 'metrics.jsonl')
    assert [line['steps'] for line in lines if 'losses' in line] == [512, 1024]
    assert [line['decisions'] for line in lines if 'losses' in line] == [128, 256]
    assert [line['updates'] for line in lines if 'losses' in line] == [4, 8]
    assert [line['validation']['episodes'] for line in lines if 'validation' in line] == [3]


def test_best_model_sails_as_the_validation_did(finished):
    model = load_model(finished / 'best.safetensors')
    assert model.card.algorithm == 'ppo'
    assert model.card.task == TINY.task
    assert (model.card.training['steps'], model.card.git_commit) == (1024, 'abc')
    assert model.card.discount == pytest.approx(TINY.learner.discount**4)
    scenarios = ppo.validation_scenarios(TINY.scenarios)
    again = ppo.Validation(scenarios, TINY.task).run(
        lambda features: likeliest(policy_layers(model.tensors), features)
    )
    assert again['reward'] == pytest.approx(model.card.evaluation['reward'])
    assert load_policy(model.path, model.card.vessel, model.card.lidar).misfit == ''


def test_resumed_run_is_bit_for_bit_the_uninterrupted_one(finished, tmp_path):
    ppo.train(longer(1536), Job(finished, seed=3, resume=True))
    ppo.train(longer(1536), Job(tmp_path / 'whole', seed=3))
    one, other = (checkpoint(out)['agent'] for out in (finished, tmp_path / 'whole'))
    assert one['decisions'] == other['decisions'] == 384
    for part in ('policy', 'features', 'starts', 'torch_generator'):
        assert_same(one[part], other[part])
    assert_same(one['optimizer']['state'], other['optimizer']['state'])
    assert metrics(finished) == metrics(tmp_path / 'whole')
    assert [line['steps'] for line in metrics(finished) if 'losses' in line] == [512, 1024, 1536]


def test_a_second_run_in_the_folder_is_refused(finished):
    with pytest.raises(TrainingError, match='--resume'):
        ppo.train(TINY, Job(finished))


def test_nothing_to_resume_is_said(tmp_path):
    with pytest.raises(TrainingError, match='no run to resume'):
        ppo.train(TINY, Job(tmp_path, resume=True))


def test_a_damaged_checkpoint_is_named(finished, tmp_path):
    shutil.copytree(finished, tmp_path / 'run')
    file = tmp_path / 'run/checkpoint' / ppo.CHECKPOINT
    file.write_bytes(file.read_bytes()[:-1000])
    with pytest.raises(TrainingError, match=r'ppo\.pt: damaged .* --out'):
        ppo.train(TINY, Job(tmp_path / 'run', resume=True))


def test_a_checkpoint_is_read_without_the_device_of_its_run(finished):
    state = ppo._read_checkpoint(Job(finished, device='cuda'))
    assert {tensor.device.type for tensor in (state['arrays'], *state['agent']['policy'].values())} == {'cpu'}


def test_interrupt_saves_between_updates_and_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    improve = ppo.PpoAgent.improve

    def interrupted(agent):
        signal.raise_signal(signal.SIGINT)
        return improve(agent)

    monkeypatch.setattr(ppo.PpoAgent, 'improve', interrupted)
    with pytest.raises(KeyboardInterrupt):
        ppo.train(TINY, Job(tmp_path / 'run'))
    assert '--resume' in capsys.readouterr().out
    assert checkpoint(tmp_path / 'run')['agent']['decisions'] == 64
