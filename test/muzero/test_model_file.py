"""A model and its card: what is written is read, and what does not fit is refused with a reason."""

import dataclasses
import json
import math

import numpy as np
import pytest

from portnav_ros.muzero import ModelError
from portnav_ros.muzero.model_file import (
    Card,
    card_path,
    check_sensor,
    load_model,
    save_model,
    vessel_misfit,
)
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.env import TaskParams
from portnav_ros.task.reward import RewardParams
from portnav_ros.vessel import VesselParams

WEIGHTS = {
    'b.weight': np.arange(6, dtype=np.float32).reshape(2, 3),
    'a.bias': np.array([math.pi, -1e-30], np.float32),
}
CARD = Card(
    algorithm='muzero',
    task=TaskParams(actions=ActionParams((-0.1, 0.0, math.pi / 7), (1.5,)), reward=RewardParams(goal=10.0)),
    vessel=VesselParams(name='tug', length_m=31.0),
    lidar=LidarParams(rays=90, range_max_m=123.0),
    discount=0.988,
    network={'latent': 32, 'represent_hidden': [128, 64]},
    search={'simulations': 50, 'q_ceiling': math.inf},
    training={'difficulty': 'paper', 'steps': 5_000_000, 'seed': 3},
    evaluation={'success': 0.85},
    version='9.9.9',
    git_commit='abc',
)


@pytest.fixture
def path(tmp_path):
    file = tmp_path / 'deep' / 'model.safetensors'
    save_model(file, WEIGHTS, CARD)
    return file


def edit_card(path, **changes):
    document = json.loads(card_path(path).read_text())
    card_path(path).write_text(json.dumps(document | changes))


def test_what_is_saved_is_loaded(path):
    model = load_model(path)
    assert model.card == CARD
    assert set(model.tensors) == set(WEIGHTS)
    for name, tensor in WEIGHTS.items():
        np.testing.assert_array_equal(model.tensors[name], tensor)
    assert model.label.startswith('model.safetensors ')


def test_saving_again_gives_the_same_bytes(path, tmp_path):
    again = tmp_path / 'again.safetensors'
    model = load_model(path)
    save_model(again, model.tensors, model.card)
    assert again.read_bytes() == path.read_bytes()
    assert card_path(again).read_bytes() == card_path(path).read_bytes()
    assert sorted(file.name for file in path.parent.iterdir()) == ['model.json', 'model.safetensors']


def test_a_new_evaluation_leaves_the_weights_alone(path):
    before = path.read_bytes()
    model = load_model(path)
    save_model(path, model.tensors, dataclasses.replace(model.card, evaluation={'success': 0.9}))
    assert path.read_bytes() == before
    assert load_model(path).card.evaluation == {'success': 0.9}


def test_a_slice_of_an_array_is_saved_as_it_reads(tmp_path):
    wide = np.arange(12, dtype=np.float32).reshape(3, 4)
    save_model(tmp_path / 'm.safetensors', {'w': wide.T[1:]}, CARD)
    np.testing.assert_array_equal(load_model(tmp_path / 'm.safetensors').tensors['w'], wide.T[1:])


def remove(path):
    path.unlink()


def remove_card(path):
    card_path(path).unlink()


def break_card(path):
    card_path(path).write_text('{')


def list_card(path):
    card_path(path).write_text('[1]')


def flip_a_bit(path):
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


def truncate(path):
    import hashlib

    path.write_bytes(path.read_bytes()[:20])
    edit_card(path, sha256=hashlib.sha256(path.read_bytes()).hexdigest())


def swap_weights(path):
    other = path.with_name('other.safetensors')
    save_model(other, WEIGHTS, dataclasses.replace(CARD, network={'latent': 16}))
    path.write_bytes(other.read_bytes())
    edit_card(path, sha256=json.loads(card_path(other).read_text())['sha256'])


@pytest.mark.parametrize(
    ('damage', 'reason'),
    [
        (remove, r'model\.safetensors: no such model; train one'),
        (remove_card, r'model\.json: no card to the model'),
        (break_card, r'model\.json: not valid JSON'),
        (list_card, r'model\.json: schema None'),
        (flip_a_bit, r'model\.safetensors: sha256 \w{12}\.\.\. is not the \w{12}\.\.\. of model\.json'),
        (truncate, r'model\.safetensors: not a safetensors file'),
        (swap_weights, r'model\.json: configuration_sha256: .* copy the card again'),
        (lambda path: edit_card(path, schema=2), r'model\.json: schema 2: this version .* reads 1'),
        (lambda path: edit_card(path, extra=1), r"model\.json: unknown key 'extra'"),
        (lambda path: edit_card(path, search={'simulations': 8}), 'configuration_sha256'),
        (lambda path: edit_card(path, tensors={'w': [1]}), r'model\.json: tensors: not those of'),
    ],
)
def test_damage_is_refused_by_name(path, damage, reason):
    damage(path)
    with pytest.raises(ModelError, match=reason):
        load_model(path)


def test_a_card_that_lacks_a_key_is_refused(path):
    document = json.loads(card_path(path).read_text())
    del document['lidar']
    card_path(path).write_text(json.dumps(document))
    with pytest.raises(ModelError, match="missing key 'lidar'"):
        load_model(path)


@pytest.mark.parametrize(
    ('weights', 'name', 'reason'),
    [
        ({'w': np.array([1.0, np.nan], np.float32)}, 'm.safetensors', 'w: a weight is not finite'),
        ({'w': np.array([1.0])}, 'm.safetensors', 'w: float64, expected float32'),
        ({}, 'm.safetensors', 'holds no weights'),
        (WEIGHTS, 'm.pt', r'm\.pt: a model ends in \.safetensors'),
    ],
)
def test_what_cannot_be_released_is_not_written(tmp_path, weights, name, reason):
    with pytest.raises(ModelError, match=reason):
        save_model(tmp_path / name, weights, CARD)
    assert not list(tmp_path.iterdir())


def test_an_action_grid_that_this_version_cannot_read_is_refused(tmp_path):
    from portnav_ros.muzero import model_file

    path = tmp_path / 'm.safetensors'
    save_model(path, WEIGHTS, CARD)
    document = json.loads(card_path(path).read_text())
    document['task']['actions']['warp_factor'] = 9
    fingerprint = model_file.configuration_hash(document)
    weights = model_file.save(dict(WEIGHTS), {model_file.CONFIGURATION_HASH: fingerprint})
    path.write_bytes(weights)
    digest = model_file.hashlib.sha256(weights).hexdigest()
    edit_card(path, task=document['task'], sha256=digest, configuration_sha256=fingerprint)
    with pytest.raises(ModelError, match=r"m\.json: task: actions: unknown key 'warp_factor'"):
        load_model(path)


def test_a_vessel_of_another_name_and_the_same_numbers_fits(path):
    model = load_model(path)
    assert vessel_misfit(model, dataclasses.replace(CARD.vessel, name='tug II')) == ''


def test_another_vessel_is_told_with_its_numbers(path):
    reason = vessel_misfit(load_model(path), load_vessel('cemt_va'))
    assert 'model.safetensors: trained for vessel tug, not cemt_va (length_m 110.0 instead of 31.0' in reason
    assert ' and 5 more); ' in reason
    assert '--planner dwa' in reason
    assert '--allow-mismatch (of a node: allow_mismatch:=true)' in reason


def test_another_sensor_is_refused(path):
    model = load_model(path)
    check_sensor(model, dataclasses.replace(CARD.lidar, noise_m=0.5, drop_out=0.1))
    with pytest.raises(ModelError, match=r'trained with 90 rays over 123\.0 m, not 180 over 400\.0 m'):
        check_sensor(model, LidarParams())
