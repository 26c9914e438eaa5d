"""The runs behind the paper's figure and table: MuZero and PPO, several seeds each, on the same task."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from portnav_ros.evaluation.options import check_at_least
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.provenance import command_line
from portnav_ros.evaluation.training_fleet import Crew, train_all
from portnav_ros.evaluation.training_runs import Place, Run, Values, checked, merged, read_preset
from portnav_ros.params import override
from portnav_ros.training.scenarios import TESTBEDS
from portnav_ros.training.schedule import ScheduleParams

TITLES = {'muzero': 'MuZero', 'ppo': 'PPO'}


def add_arguments(parser: argparse.ArgumentParser, steps: int, out: str) -> None:
    """Declare the options that everything made of training runs has."""
    parser.add_argument(
        '--steps', type=int, default=steps, metavar='N', help='of a run (default: %(default)s)'
    )
    parser.add_argument(
        '--seeds', type=int, default=3, metavar='K', help='runs of each (default: %(default)s)'
    )
    worlds = parser.add_mutually_exclusive_group()
    worlds.add_argument('--difficulty', metavar='NAME', help='random ports; name or file')
    worlds.add_argument('--testbed', choices=TESTBEDS, help='small worlds instead')
    parser.add_argument(
        '--out', type=Path, default=Path(out), metavar='DIR', help='runs and results (default: %(default)s)'
    )
    parser.add_argument('--plot-only', action='store_true', help='train nothing: show what there is')
    parser.add_argument(
        '--jobs', type=int, default=1, metavar='J', help='runs at once (default: %(default)s)'
    )
    parser.add_argument('--device', default='cpu', metavar='NAME', help='cpu (default) or cuda')
    parser.add_argument('--threads', type=int, default=1, metavar='T', help="of a run's learner (default: 1)")


def add_algorithms(parser: argparse.ArgumentParser) -> None:
    """Declare which algorithms run, and by which recipe."""
    parser.add_argument(
        '--preset', default='paper', metavar='NAME|FILE', help="MuZero's (default: %(default)s)"
    )
    parser.add_argument(
        '--ppo-preset', default='ppo', metavar='NAME|FILE', help="PPO's (default: %(default)s)"
    )
    parser.add_argument('--only', choices=TITLES, help='run and show one of the two')


def place_of(arguments: argparse.Namespace, default: Place) -> Place:
    """Where the runs sail."""
    if arguments.testbed is not None:
        return Place(testbed=arguments.testbed)
    return Place(arguments.difficulty) if arguments.difficulty is not None else default


def seeds_of(arguments: argparse.Namespace) -> range:
    """The seeds 0, 1 ... of the runs.

    Raises:
        EvaluationError: there is none, or no step to sail.
    """
    if arguments.seeds < 1 or arguments.steps < 1:
        raise EvaluationError(f'--seeds {arguments.seeds} and --steps {arguments.steps} must be at least 1')
    return range(arguments.seeds)


def asked_for(values: Values, place: Place, steps: int) -> dict[str, Any]:
    """A preset's values with what the options set over them, and intervals that make a curve of a short run.

    Raises:
        ParamError: the schedule cannot be.
    """
    asked = merged(values, {'scenarios': place._asdict(), 'schedule': {'steps': steps}})
    schedule = override(ScheduleParams(), asked['schedule'], 'schedule').with_curves()
    return merged(asked, {'schedule': asdict(schedule)})


def paper_runs(arguments: argparse.Namespace) -> list[Run]:
    """Runs of both algorithms, seed by seed; PPO takes task and worlds of MuZero's preset.

    Raises:
        EvaluationError: a folder holds a run of other parameters.
        ParamError: a preset cannot be read.
    """
    place, seeds = place_of(arguments, Place()), seeds_of(arguments)
    muzero, ppo = read_preset(arguments.preset), read_preset(arguments.ppo_preset)
    same = {name: muzero.values[name] for name in ('task', 'scenarios') if name in muzero.values}
    values: dict[str, Values] = {
        'muzero': asked_for(muzero.values, place, arguments.steps),
        'ppo': asked_for(merged(ppo.values, same), place, arguments.steps),
    }
    runs = [
        Run(
            arguments.out,
            f'{algorithm}-{muzero.name}-{place.name}-{seed}',
            algorithm,
            seed,
            values[algorithm],
        )
        for seed in seeds
        for algorithm in TITLES
        if arguments.only in (None, algorithm)
    ]
    return list(checked(runs))


def check_training(runs: Sequence[Run], arguments: argparse.Namespace) -> None:
    """Refuse at once what `portnav train` would refuse of each run later: a library or the device is missing.

    Raises:
        EvaluationError: no run may work at a time, or no thread.
        ImportError: names the library.
        TrainingError: torch does not have the device.
    """
    check_at_least(arguments, jobs=1, threads=1)
    missing = () if arguments.plot_only else {run.algorithm for run in runs if not run.finished()}
    if missing:
        from portnav_ros.training.device import check_device  # torch, which loads slowly

        check_device(arguments.device)
    if 'ppo' in missing:
        importlib.import_module('portnav_ros.baselines.ppo')  # stable-baselines3


def sail(runs: Sequence[Run], arguments: argparse.Namespace) -> list[str]:
    """Train what is missing, unless only what there is was asked for; returns the runs that failed.

    Raises:
        KeyboardInterrupt: Ctrl-C, after all has been saved.
    """
    if arguments.plot_only:
        return []
    try:
        return train_all(runs, Crew(arguments.jobs, arguments.device, arguments.threads))
    except KeyboardInterrupt:
        print(f'go on with: {command_line()}')
        raise


def refuse(failed: Sequence[str], arguments: argparse.Namespace) -> None:
    """End with an error if a run failed.

    Raises:
        EvaluationError: one did.
    """
    if failed:
        raise EvaluationError(
            f'{", ".join(failed)}: not finished; the logs in {arguments.out} say why, '
            'and the same command goes on with what is missing'
        )
