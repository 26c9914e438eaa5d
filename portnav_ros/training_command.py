"""`portnav train`: a learning algorithm on random ports or a test bed, in a folder of its own.

The algorithm's module is imported only after the number of torch's threads is set. BLAS has one thread
(cli.py): self-play multiplies small matrices, which several make slower.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from portnav_ros.evaluation.provenance import provenance
from portnav_ros.params import ParamError, override, parse_yaml, read_yaml
from portnav_ros.resources import config_path
from portnav_ros.training.job import Job
from portnav_ros.training.run_directory import RunDirectory, TrainingError
from portnav_ros.training.scenarios import TESTBEDS

ALGORITHMS = {'muzero': 'muzero.train', 'ppo': 'baselines.ppo'}
PRESETS = {'muzero': 'best', 'ppo': 'ppo'}  # where neither --preset nor --config is given
FIXED = (
    'algorithm',
    'preset',
    'config',
    'difficulty',
    'testbed',
    'seed',
    'set',
    'start_from',
)  # by a run's own files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--algorithm', choices=ALGORITHMS, help='default: muzero')
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        '--preset', metavar='NAME', help='parameters in config/train: best, rehearse, scans, paper or ppo'
    )
    source.add_argument('--config', type=Path, metavar='FILE', help='YAML of parameters, over the defaults')
    worlds = parser.add_mutually_exclusive_group()
    worlds.add_argument('--difficulty', metavar='NAME', help='random ports; name or file (default: paper)')
    worlds.add_argument('--testbed', choices=TESTBEDS, help='small worlds instead, learned in minutes')
    parser.add_argument('--from', dest='start_from', type=Path, metavar='FILE', help='begin with this model')
    parser.add_argument('--set', action='append', metavar='KEY=VALUE', help='such as search.simulations=8')
    parser.add_argument('--steps', type=int, metavar='N', help='environment steps in all')
    parser.add_argument('--seed', type=int, metavar='S', help='of everything random (default: 0)')
    parser.add_argument('--out', type=Path, metavar='DIR', help='of the run (default: below portnav_out/)')
    parser.add_argument('--resume', action='store_true', help='go on with the run in --out')
    parser.add_argument('--device', default='cpu', metavar='NAME', help='cpu (default) or cuda')
    parser.add_argument('--threads', type=int, default=1, metavar='T', help="of the learner's (default: 1)")


def run(arguments: argparse.Namespace) -> int:
    """Train.

    Raises:
        ParamError, TrainingError, ScenarioError: the options, the device or the folder do not fit.
        KeyboardInterrupt: Ctrl-C, after the run was saved.
    """
    os.environ.setdefault('OMP_NUM_THREADS', str(arguments.threads))
    config = _resumed(arguments) if arguments.resume else _begun(arguments)
    module = importlib.import_module(f'portnav_ros.{ALGORITHMS[config.algorithm]}')
    from portnav_ros.training.device import check_device  # torch

    check_device(arguments.device)
    params = override(module.Params(), config.values, config.source)
    if config.worlds:
        params = override(params, {'scenarios': config.worlds}, 'command line')
    if arguments.steps is not None:
        params = override(params, {'schedule': {'steps': arguments.steps}}, '--steps')
        if not arguments.resume:
            params = dataclasses.replace(params, schedule=params.schedule.with_curves())
    if arguments.start_from is not None:
        params = override(params, {'start_from': str(arguments.start_from.resolve())}, '--from')
    if arguments.set:
        params = override(params, assignments(arguments.set), '--set')
    job = Job(
        out=config.out,
        seed=config.seed,
        resume=arguments.resume,
        device=arguments.device,
        threads=arguments.threads,
        provenance=provenance(),
    )
    print(f'training in {config.out}')
    module.train(params, job)
    return 0


@dataclasses.dataclass(frozen=True)
class _Config:
    """What is trained, and where. values: parameters as their source has them."""

    algorithm: str
    seed: int
    out: Path
    values: Mapping[str, Any]
    source: str
    worlds: Mapping[str, str] = dataclasses.field(default_factory=dict)


def _begun(arguments: argparse.Namespace) -> _Config:
    algorithm = arguments.algorithm or 'muzero'
    name = arguments.preset or PRESETS[algorithm]
    file = arguments.config or config_path('train', f'{name}.yaml')
    worlds = {}
    if arguments.testbed is not None:
        worlds = {'testbed': arguments.testbed}
    elif arguments.difficulty is not None:
        worlds = {'difficulty': arguments.difficulty, 'testbed': ''}
    seed = arguments.seed or 0
    place = Path(arguments.testbed or arguments.difficulty or 'paper').stem
    out = arguments.out or Path('portnav_out', 'train', f'{algorithm}-{file.stem}-{place}-{seed}')
    return _Config(algorithm, seed, out, read_yaml(file), str(file), worlds)


def _resumed(arguments: argparse.Namespace) -> _Config:
    given = [f'--{name}' for name in FIXED if getattr(arguments, name) is not None]
    if given:
        raise TrainingError(f'--resume goes on with the parameters of the run; leave out {", ".join(given)}')
    if arguments.out is None:
        raise TrainingError('--resume needs --out, the folder of the run')
    directory = RunDirectory(arguments.out)
    config = directory.read_config()
    algorithm, seed = config.pop('algorithm', None), config.pop('seed', 0)
    if algorithm not in ALGORITHMS:
        raise ParamError(
            f'{directory.config}: algorithm: {algorithm!r} is not one of {", ".join(ALGORITHMS)}'
        )
    values = {key: value for key, value in config.items() if key not in provenance()}
    return _Config(algorithm, seed, arguments.out, values, str(directory.config))


def assignments(items: Sequence[str]) -> dict[str, Any]:
    """Turn several of what `assignment` takes into one mapping, since some parameters only fit together.

    Raises:
        ParamError: as `assignment`.
    """
    merged: dict[str, Any] = {}
    for item in items:
        _merge(merged, assignment(item))
    return merged


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


def assignment(item: str) -> dict[str, Any]:
    """Turn ``search.simulations=8`` into nested mappings; the value is read as YAML.

    Raises:
        ParamError: there is no ``=`` in it, or no YAML behind it.
    """
    key, equals, text = item.partition('=')
    if not equals or not key:
        raise ParamError(f'--set {item}: expected KEY=VALUE, such as search.simulations=8')
    try:
        value: Any = parse_yaml(text)
    except yaml.YAMLError as error:
        raise ParamError(f'--set {item}: the value is not YAML') from error
    for part in reversed(key.split('.')):
        value = {part: value}
    return dict(value)
