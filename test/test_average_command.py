"""`portnav average`: the mean of models that are alike, with a card that tells of all of them."""

import numpy as np
import pytest

from portnav_ros import cli
from portnav_ros.muzero.model_file import load_model
from portnav_ros.muzero.policy import load_policy
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.params import ActionParams, TaskParams
from portnav_ros.vessel import VesselParams


def average(*words):
    return cli.main(['average', *map(str, words)])


@pytest.fixture(scope='module')
def models(make_model):
    return [make_model(seed=seed, training={'steps': 100 * seed}) for seed in (1, 2, 3)]


def test_the_mean_can_be_sailed_and_says_what_it_is_of(models, tmp_path, capsys):
    out = tmp_path / 'mean.safetensors'
    assert average(*models, '--out', out, '--set', 'search.c=5.0', '--set', 'search.simulations=4') == 0
    assert str(out) in capsys.readouterr().out
    mean, parts = load_model(out), [load_model(file) for file in models]
    for name, tensor in mean.tensors.items():
        np.testing.assert_allclose(tensor, sum(part.tensors[name] for part in parts) / 3.0, atol=1e-6)
    assert [part['sha256'] for part in mean.card.training['mean_of']] == [part.sha256 for part in parts]
    assert [part['steps'] for part in mean.card.training['mean_of']] == [100, 200, 300]
    assert {'command', 'version', 'git_commit'} <= mean.card.training.keys()
    assert (mean.card.search['c'], mean.card.search['simulations']) == (5.0, 4)
    assert not mean.card.evaluation
    assert load_policy(out, VesselParams(), LidarParams())


def test_without_changes_the_search_is_that_of_the_first(models, tmp_path):
    average(*models[:2], '--out', tmp_path / 'mean.safetensors')
    assert load_model(tmp_path / 'mean.safetensors').card.search['simulations'] == 8


def test_a_planner_that_does_not_search_has_a_mean_too(make_ppo_model, tmp_path):
    model = make_ppo_model()
    assert average(model, model, '--out', tmp_path / 'mean.safetensors') == 0
    mean, first = load_model(tmp_path / 'mean.safetensors'), load_model(model)
    assert not mean.card.search
    for name, tensor in mean.tensors.items():
        np.testing.assert_array_equal(tensor, first.tensors[name])


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        ({'vessel': VesselParams(length_m=30.0)}, 'vessel: not as in'),
        ({'lidar': LidarParams(range_max_m=100.0)}, 'lidar: not as in'),
        ({'task': TaskParams(actions=ActionParams(hold=2))}, 'task: not as in'),
        ({'network': {'latent': 7}, 'discount': 0.5}, 'discount, network: not as in'),
    ],
)
def test_models_that_are_not_alike_have_no_mean(models, make_model, tmp_path, capsys, fields, message):
    out = tmp_path / 'mean.safetensors'
    assert average(models[0], make_model(**fields), '--out', out) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ([], 'a mean takes at least two'),
        (['nothing.safetensors'], 'no such model'),
        (['SECOND', '--set', 'learner.batch=3'], 'only search'),
        (['SECOND', '--set', 'search.sims=3'], 'sims'),
        (['SECOND', '--set', 'search.c=-1'], 'search'),
    ],
)
def test_what_cannot_be_averaged_is_refused(models, tmp_path, capsys, words, message):
    out = tmp_path / 'mean.safetensors'
    words = [models[1] if word == 'SECOND' else word for word in words]
    assert average(models[0], *words, '--out', out) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_model_is_not_overwritten(models, capsys):
    assert average(*models, '--out', models[0]) == 2
    assert 'there is a model already' in capsys.readouterr().err
