"""What `portnav evaluate` refuses before it sails: files it cannot write, and what cannot be sailed."""

from __future__ import annotations

import importlib
import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import Trial

NODES = 'portnav_ros.nodes.table'  # a layer above: only where it is asked for


def check_outputs(files: Mapping[str, Path | None]) -> None:
    """Refuse files that cannot be written, or one for two things, while there are no figures to lose.

    Args:
        files: by the names of their options.

    Raises:
        EvaluationError: names the option and the mend.
    """
    given = [(option, file) for option, file in files.items() if file is not None]
    for option, file in given:
        _check_output(_shown(option, file), file)
    for one, other in itertools.combinations(given, 2):
        if one[1].resolve() == other[1].resolve():
            raise EvaluationError(f'{_shown(*one)} and {_shown(*other)}: one file for both; name another')


def _shown(option: str, file: Path) -> str:
    return f'--{option.replace("_", "-")} {file}'


def _check_output(name: str, file: Path) -> None:
    folder = next(parent for parent in file.absolute().parents if parent.exists())
    if file.is_dir():
        raise EvaluationError(f'{name}: is a folder; name a file in it')
    if not folder.is_dir():
        raise EvaluationError(f'{name}: {folder} is no folder; name another file')
    if not os.access(file if file.exists() else folder, os.W_OK):
        raise EvaluationError(f'{name}: may not be written; name another file')


def check_sailing(trials: Sequence[Trial], seed: int, through: str) -> None:
    """Make the first scenario and every planner for it, before one of them has sailed for hours.

    Args:
        trials: the same scenarios, each with its planner.
        seed: world seed of the first.
        through: `process` or `ros`.

    Raises:
        EvaluationError: no node has the name of a planner, or the nodes lay no such path.
        ModelError, ScenarioError, ChartError, ParamError: a planner or the scenario cannot be made.
    """
    if through == 'ros':
        _check_nodes(trials)
    scenario = trials[0].make_scenario(seed)
    for trial in trials:
        trial.make_planner(scenario)


def _check_nodes(trials: Sequence[Trial]) -> None:
    known = importlib.import_module(NODES).LOCAL_PLANNERS
    for trial in trials:
        if trial.planner not in known:
            raise EvaluationError(
                f'--through ros: {trial.planner} is no node; there are {", ".join(known)}: name one of them'
            )
    if trials[0].route == 'clearance':
        raise EvaluationError('--through ros: the nodes plan with RRT*; leave out --route clearance')
