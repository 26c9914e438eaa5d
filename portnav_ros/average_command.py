"""`portnav average`: one model whose weights are the mean of several models' weights.

Policies that went on from each other lie close enough in the space of weights for their mean to be a policy
too, which makes fewer of the mistakes that each of them makes by chance (Wortsman et al., Model soups, 2022).
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from portnav_ros.evaluation.provenance import provenance
from portnav_ros.muzero import ModelError
from portnav_ros.muzero.model_file import Model, card_path, load_model, save_model
from portnav_ros.muzero.search import SearchParams
from portnav_ros.params import ParamError, override
from portnav_ros.training_command import assignments
from portnav_ros.types import Array32

SAME = ('algorithm', 'task', 'vessel', 'lidar', 'discount', 'network')  # of the cards that are averaged


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('models', nargs='+', type=Path, metavar='MODEL', help='two or more .safetensors')
    parser.add_argument('--out', type=Path, required=True, metavar='FILE', help='a .safetensors to write')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='KEY=VALUE',
        help='of the search at run time, such as search.c=5.0 (default: those of the first)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the mean.

    Raises:
        ModelError: fewer than two models, models that do not fit each other, or a file that is there.
        ParamError: --set names something else than a parameter of the search.
    """
    if arguments.out.exists():
        raise ModelError(f'{arguments.out}: there is a model already; choose another --out')
    models = [load_model(file) for file in arguments.models]
    changes = assignments(arguments.set)
    if others := sorted(changes.keys() - {'search'}):
        raise ParamError(f'--set {others[0]}: only search.* can be set for weights that are there')
    tensors, told = mean_of(models), provenance()
    card = dataclasses.replace(
        models[0].card,
        search=_search(models[0], changes.get('search', {})),
        training={**told, 'mean_of': [{'sha256': model.sha256, **model.card.training} for model in models]},
        evaluation={},
        git_commit=str(told.get('git_commit', 'unknown')),
    )
    save_model(arguments.out, tensors, card)
    print(f'{arguments.out}: the mean of {len(models)} models; judge it with `portnav evaluate --model`')
    return 0


def mean_of(models: Sequence[Model]) -> dict[str, Array32]:
    """Mean weights by name, float32.

    Raises:
        ModelError: fewer than two models, or they do not fit each other.
    """
    if len(models) < 2:
        raise ModelError(f'{len(models)} model: a mean takes at least two')
    first = models[0]
    for other in models[1:]:
        _check_alike(first, other)
    means = {}
    for name in first.tensors:
        total = np.sum([model.tensors[name] for model in models], axis=0, dtype=np.float64)
        means[name] = np.asarray(total / len(models), np.float32)
    return means


def _search(model: Model, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of the search of a card, with changes; none for a model that does not search."""
    if not model.card.search and not changes:
        return {}
    params = override(SearchParams(), model.card.search, f'{card_path(model.path)}: search')
    return dataclasses.asdict(override(params, changes, '--set search'))


def _check_alike(first: Model, other: Model) -> None:
    different = [key for key in SAME if getattr(first.card, key) != getattr(other.card, key)]
    shapes = [{name: tensor.shape for name, tensor in model.tensors.items()} for model in (first, other)]
    if different or shapes[0] != shapes[1]:
        what = ', '.join(different) or 'weights'
        raise ModelError(f'{other.path}: {what}: not as in {first.path}; a mean takes models that are alike')
