"""`portnav reproduce ablation`: MuZero in variations, several seeds each, compared seed by seed."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from portnav_ros.evaluation.learning_curves import FIELDS, Curve, running, validated
from portnav_ros.evaluation.markdown import markdown
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.reproduce_runs import add_arguments as add_run_arguments
from portnav_ros.evaluation.reproduce_runs import asked_for, check_training, place_of, refuse, sail, seeds_of
from portnav_ros.evaluation.statistics import SeedDifference, sample, seed_difference
from portnav_ros.evaluation.summary import write_json
from portnav_ros.evaluation.training_runs import Place, Preset, Run, Values, checked, merged, read_preset
from portnav_ros.params import read_yaml
from portnav_ros.resources import config_path
from portnav_ros.types import Array

SUCCESS = FIELDS.index('success')
HEAD = (
    'cell',
    'seeds',
    'success at the end, %',
    'less the reference',
    'mean success over the run, %',
    'less the reference',
)


@dataclass(frozen=True)
class Cells:
    """What is compared: parameters of every cell by name, and which of them the others are held against."""

    reference: str
    cells: Mapping[str, Values]

    def __post_init__(self) -> None:
        """Refuse a reference that is no cell.

        Raises:
            EvaluationError: it is none.
        """
        if self.reference not in self.cells:
            raise EvaluationError(f'reference: {self.reference!r} is none of {", ".join(self.cells)}')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_run_arguments(parser, steps=600_000, out='portnav_out/ablation')
    parser.add_argument(
        '--preset', default='best', metavar='NAME|FILE', help='to vary (default: %(default)s)'
    )
    parser.add_argument(
        '--cells', type=Path, metavar='FILE', help='other cells than config/reproduce/ablation.yaml'
    )
    parser.add_argument('--only', nargs='+', metavar='CELL', help='these cells, and the reference')


def run(arguments: argparse.Namespace) -> int:
    """Write ablation.md and ablation.json, and print the former.

    Raises:
        EvaluationError: options, file or folder do not fit, or a run failed; what there is was written.
        TrainingError, ImportError: nothing can be trained here.
        KeyboardInterrupt: Ctrl-C, after all has been saved.
    """
    cells = _chosen(read_cells(arguments.cells or config_path('reproduce', 'ablation.yaml')), arguments.only)
    runs = ablation_runs(cells, read_preset(arguments.preset), arguments)
    by_seed = [run for of_seed in zip(*runs.values(), strict=True) for run in of_seed]
    check_training(by_seed, arguments)
    failed = sail(by_seed, arguments)
    scores = {name: _scores(of_cell, arguments.steps) for name, of_cell in runs.items()}
    rows = {name: compare(scores[name], scores[cells.reference]) for name in cells.cells}
    text = markdown(HEAD, [_line(name, row, name == cells.reference) for name, row in rows.items()])
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / 'ablation.md').write_text(text, encoding='utf-8')
    figures = {name: {key: value._asdict() for key, value in row.items()} for name, row in rows.items()}
    place = place_of(arguments, Place(testbed='head_on'))
    numbers = {'place': place.name, 'steps': arguments.steps, 'reference': cells.reference, 'cells': figures}
    write_json(arguments.out / 'ablation.json', {**numbers, **provenance()})
    print(text)
    refuse(failed, arguments)
    return 0


def read_cells(file: Path) -> Cells:
    """Read the keys ``reference``, ``all`` and ``cells`` of a YAML file.

    Raises:
        EvaluationError: a key is missing or holds something else.
        ParamError: it cannot be read.
    """
    content = read_yaml(file)
    shared, cells = content.pop('all', {}), content.pop('cells', None)
    reference = content.pop('reference', None)
    if content or not isinstance(shared, dict) or not isinstance(cells, dict):
        raise EvaluationError(f'{file}: expected the keys reference, all and cells, the last two mappings')
    for name, values in cells.items():
        if not isinstance(values, dict):
            raise EvaluationError(f'{file}: cells: {name}: expected a mapping of parameters, got {values!r}')
    try:
        return Cells(reference, {str(name): merged(shared, values) for name, values in cells.items()})
    except EvaluationError as error:
        raise EvaluationError(f'{file}: {error}') from None


def ablation_runs(cells: Cells, preset: Preset, arguments: argparse.Namespace) -> dict[str, list[Run]]:
    """Runs of each cell, by seed.

    Raises:
        EvaluationError: a folder holds a run of other parameters.
    """
    place, seeds = place_of(arguments, Place(testbed='head_on')), seeds_of(arguments)
    runs = {}
    for name, values in cells.cells.items():
        parameters = asked_for(merged(preset.values, values), place, arguments.steps)
        runs[name] = [Run(arguments.out, f'{name}-{seed}', 'muzero', seed, parameters) for seed in seeds]
        checked(runs[name])
    return runs


class Score(NamedTuple):
    """Of one run that has ended. final: success of its last validation; area: mean success over its steps."""

    final: float
    area: float


def score_of(training: Curve, validation: Curve, steps: int) -> Score:
    """Score a run of so many steps.

    Args:
        training: running means; the share of steps before the first line counts as that line.
        validation: of which the last counts.
        steps: of the run.
    """
    success = training.values[:, SUCCESS]
    marks = np.concatenate([[0.0], np.minimum(training.steps, steps)])
    area = np.trapezoid(np.concatenate([success[:1], success]), marks) / steps
    return Score(float(validation.values[-1, SUCCESS]), float(area))


def compare(cell: Mapping[int, Score], reference: Mapping[int, Score]) -> dict[str, Any]:
    """A cell's scores by seed, and their differences to the reference's over the seeds that both have.

    Returns:
        ``final`` and ``area`` (Sample), ``final_difference`` and ``area_difference`` (SeedDifference).
    """
    row: dict[str, Any] = {}
    both = sorted(cell.keys() & reference.keys())
    for k, field in enumerate(Score._fields):
        row[field] = sample(np.array([score[k] for score in cell.values()]))
        row[f'{field}_difference'] = seed_difference(_column(cell, both, k), _column(reference, both, k))
    return row


def _column(scores: Mapping[int, Score], seeds: Sequence[int], k: int) -> Array:
    return np.array([scores[seed][k] for seed in seeds])


def _scores(runs: Sequence[Run], steps: int) -> dict[int, Score]:
    """Scores by seed of the runs that have ended; a part of a run cannot be held against a whole one."""
    return {
        run.seed: score_of(running(lines), validated(lines), steps)
        for run in runs
        if run.finished() and len(running(lines := run.metrics()).steps)
    }


def _chosen(cells: Cells, names: Sequence[str] | None) -> Cells:
    unknown = set(names or ()) - set(cells.cells)
    if unknown:
        raise EvaluationError(
            f'--only {" ".join(sorted(unknown))}: there are the cells {", ".join(cells.cells)}'
        )
    kept = set(names or cells.cells) | {cells.reference}
    return Cells(cells.reference, {name: values for name, values in cells.cells.items() if name in kept})


def _line(name: str, row: Mapping[str, Any], is_reference: bool) -> list[str]:
    line = [name, str(row['final'].n)]
    for field in Score._fields:
        difference: SeedDifference = row[f'{field}_difference']
        line += [row[field].text('.1f', 100.0), 'reference' if is_reference else _verdict(difference)]
    return line


def _verdict(difference: SeedDifference) -> str:
    if difference.mean is None:
        return ''
    text = f'{100.0 * difference.mean:+.1f}'
    if difference.low is not None and difference.high is not None:
        text += f' ({100.0 * difference.low:+.1f} to {100.0 * difference.high:+.1f})'
    return text if difference.resolved else f'{text}, not resolved'
