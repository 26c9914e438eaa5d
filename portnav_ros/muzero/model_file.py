"""A model on disk: weights as safetensors, and beside them a JSON card of the same stem.

Neither holds code: nothing a user loads is unpickled, and torch is not needed. The card says what the
weights were trained for, so that a vessel, a sensor or a version that they do not fit is refused.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from portnav_ros import __version__
from portnav_ros.muzero import ModelError
from portnav_ros.params import ParamError, override
from portnav_ros.resources import share_directory
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.params import TaskParams
from portnav_ros.types import Array32
from portnav_ros.vessel import VesselParams

SCHEMA = 1
CONFIGURATION = ('algorithm', 'task', 'vessel', 'lidar', 'discount', 'network', 'search')
CONFIGURATION_HASH = 'configuration_sha256'
SHOWN = 2  # differences between vessels that a message names
P = TypeVar('P')


@dataclass(frozen=True)
class Card:
    """What a model is, in values that JSON knows.

    task, vessel, lidar: what it was trained on. discount: of one decision. network: sizes of its layers.
    search: parameters of the search at run time, empty for a model that does not search. training:
    how it came about: scenarios, steps, seed, the model it began with, command. evaluation: split, episodes,
    success with its interval, other endings. version, git_commit: of the code that trained it.
    """

    algorithm: Literal['muzero', 'ppo']
    task: TaskParams
    vessel: VesselParams
    lidar: LidarParams
    discount: float
    network: Mapping[str, Any]
    search: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)
    evaluation: Mapping[str, Any] = field(default_factory=dict)
    version: str = __version__
    git_commit: str = 'unknown'


@dataclass(frozen=True)
class Model:
    """Weights by name, float32, and their card. sha256: of the weights' file."""

    tensors: Mapping[str, Array32]
    card: Card
    path: Path
    sha256: str

    @property
    def label(self) -> str:
        """File name and the hash's first digits."""
        return f'{self.path.name} {self.sha256[:12]}'

    @property
    def identity(self) -> dict[str, str]:
        """File name and hash, as diagnostics tell them."""
        return {'model': self.path.name, 'model_sha256': self.sha256}


def save_model(path: Path, tensors: Mapping[str, Array32], card: Card) -> None:
    """Write weights and card, each in one piece; the same input gives the same bytes.

    Args:
        path: of the weights; ends in .safetensors.
        tensors: float32 arrays by name.
        card: what they are.

    Raises:
        ModelError: another suffix, or weights that are not finite float32.
    """
    _check_suffix(path)
    _check_weights(path, tensors)
    document = _as_json(dataclasses.asdict(card))
    fingerprint = configuration_hash(document)
    weights = save(
        {name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()},
        {CONFIGURATION_HASH: fingerprint},
    )
    document = {
        'schema': SCHEMA,
        'sha256': hashlib.sha256(weights).hexdigest(),
        CONFIGURATION_HASH: fingerprint,
        **document,
        'tensors': {name: list(tensors[name].shape) for name in sorted(tensors)},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, weights)
    _write(card_path(path), (json.dumps(document, indent=1, allow_nan=False) + '\n').encode())


def load_model(path: Path) -> Model:
    """Read and check weights and card.

    Raises:
        ModelError: a file is missing, damaged, of another version, or does not belong to the other.
    """
    _check_suffix(path)
    if not path.is_file():
        raise ModelError(f'{path}: no such model; train one with `portnav train`, or name another file')
    document = _read_document(card_path(path))
    digest = file_hash(path)
    if digest != document['sha256']:
        raise ModelError(
            f'{path}: sha256 {digest[:12]}... is not the {str(document["sha256"])[:12]}... of '
            f'{card_path(path).name}; one of both is damaged or of another model: copy them again together'
        )
    fingerprint, tensors = _read_weights(path)
    if not fingerprint == document[CONFIGURATION_HASH] == configuration_hash(document):
        raise ModelError(
            f'{card_path(path)}: {CONFIGURATION_HASH}: the configuration ({", ".join(CONFIGURATION)}) is not '
            'the one the weights were saved with; copy the card again'
        )
    _check_weights(path, tensors)
    shapes = {name: list(tensor.shape) for name, tensor in tensors.items()}
    if shapes != document['tensors']:
        raise ModelError(f'{card_path(path)}: tensors: not those of {path.name}; copy both again together')
    return Model(tensors, _read_card(document, card_path(path)), path, digest)


def released_model(algorithm: str) -> Path:
    """Where the model of an algorithm lies that comes with the package, if one does."""
    return share_directory() / 'models' / f'{algorithm}.safetensors'


def card_path(path: Path) -> Path:
    """Where the card of a weights file lies."""
    return path.with_suffix('.json')


def file_hash(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def configuration_hash(document: Mapping[str, Any]) -> str:
    """SHA-256 of the keys of a card that decide how the weights must be used."""
    chosen = {key: document[key] for key in CONFIGURATION}
    return hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).hexdigest()


def vessel_misfit(model: Model, vessel: VesselParams) -> str:
    """How a vessel differs from the one trained with; empty where it does not, whatever its name."""
    trained = dataclasses.asdict(model.card.vessel)
    differences = [
        f'{key} {value} instead of {trained[key]}'
        for key, value in dataclasses.asdict(vessel).items()
        if key != 'name' and not math.isclose(value, trained[key], rel_tol=1e-9)
    ]
    if not differences:
        return ''
    more = f' and {len(differences) - SHOWN} more' if len(differences) > SHOWN else ''
    return (
        f'{model.path}: trained for vessel {model.card.vessel.name}, not {vessel.name} '
        f'({", ".join(differences[:SHOWN])}{more}); use a model trained for it or another planner, such as '
        '--planner dwa, or sail all the same with --allow-mismatch (of a node: allow_mismatch:=true)'
    )


def check_vessel(model: Model, vessel: VesselParams, allow_mismatch: bool) -> str:
    """Refuse a vessel that differs from the one trained with, or warn and return the difference.

    Raises:
        ModelError: it differs, and that is not allowed.
    """
    misfit = vessel_misfit(model, vessel)
    if misfit and not allow_mismatch:
        raise ModelError(misfit)
    if misfit:
        warnings.warn(misfit, stacklevel=3)
    return misfit


def check_sensor(model: Model, lidar: LidarParams) -> None:
    """Refuse a sensor that sees otherwise than the one trained with; noise and drop-outs may differ.

    Raises:
        ModelError: another number of rays or another range.
    """
    trained = model.card.lidar
    if (lidar.rays, lidar.range_max_m) != (trained.rays, trained.range_max_m):
        raise ModelError(
            f'{model.path}: lidar: trained with {trained.rays} rays over {trained.range_max_m} m, not '
            f'{lidar.rays} over {lidar.range_max_m} m; use a model trained with this sensor'
        )


def _as_json(value: Any) -> Any:
    """Lists for tuples, and words for the numbers that JSON lacks."""
    if isinstance(value, Mapping):
        return {key: _as_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_as_json(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _from_json(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _from_json(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_from_json(item) for item in value]
    return float(value) if value in ('inf', '-inf', 'nan') else value


def _check_suffix(path: Path) -> None:
    if path.suffix != '.safetensors':
        raise ModelError(f'{path}: a model ends in .safetensors')


def _check_weights(path: Path, tensors: Mapping[str, Array32]) -> None:
    if not tensors:
        raise ModelError(f'{path}: holds no weights; save the model again')
    for name, tensor in tensors.items():
        if tensor.dtype != np.float32:
            raise ModelError(f'{path}: {name}: {tensor.dtype}, expected float32; save the model again')
        if not np.isfinite(tensor).all():
            raise ModelError(f'{path}: {name}: a weight is not finite; training has diverged, take another')


def _write(path: Path, data: bytes) -> None:
    part = path.with_name(path.name + '.part')
    with part.open('wb') as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def _read_document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ModelError(f'{path}: no card to the model ({error.strerror}); copy both files') from error
    except ValueError as error:
        raise ModelError(f'{path}: not valid JSON: {error}; copy the card again') from error
    schema = document.get('schema') if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise ModelError(f'{path}: schema {schema!r}: this version of portnav_ros reads {SCHEMA}')
    expected = {'schema', 'sha256', CONFIGURATION_HASH, 'tensors', *_card_keys()}
    if wrong := sorted(expected ^ set(document)):
        what = 'missing' if wrong[0] in expected else 'unknown'
        raise ModelError(f'{path}: {what} key {wrong[0]!r}; copy the card again')
    return document


def _read_weights(path: Path) -> tuple[str, dict[str, Array32]]:
    """Return the hash that the file carries, and its tensors."""
    try:
        with safe_open(path, framework='numpy') as file:
            fingerprint = (file.metadata() or {}).get(CONFIGURATION_HASH, '')
            return fingerprint, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ModelError(f'{path}: not a safetensors file: {error}; copy it again') from error


def _read_card(document: Mapping[str, Any], path: Path) -> Card:
    values = {key: _from_json(document[key]) for key in _card_keys()}
    values['task'] = _read_params(TaskParams(), document, 'task', path)
    values['vessel'] = _read_params(VesselParams(), document, 'vessel', path)
    values['lidar'] = _read_params(LidarParams(), document, 'lidar', path)
    return Card(**values)


def _read_params(default: P, document: Mapping[str, Any], key: str, path: Path) -> P:
    try:
        return override(default, document[key], f'{path}: {key}')
    except ParamError as error:
        raise ModelError(f'{error}; this model needs another version of portnav_ros') from error


def _card_keys() -> list[str]:
    return [item.name for item in dataclasses.fields(Card)]
