"""`portnav reproduce table`: mean reward of MuZero and PPO over environment steps, beside the paper's."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from portnav_ros.evaluation.learning_curves import FIELDS, Curve, running
from portnav_ros.evaluation.markdown import markdown
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.reproduce_runs import (
    TITLES,
    add_algorithms,
    check_training,
    paper_runs,
    refuse,
    sail,
)
from portnav_ros.evaluation.reproduce_runs import add_arguments as add_run_arguments
from portnav_ros.evaluation.statistics import Sample, sample
from portnav_ros.evaluation.summary import write_json
from portnav_ros.evaluation.training_runs import Run
from portnav_ros.types import Array

EVERY = 500_000
REWARD = FIELDS.index('reward')
PAPER = {  # Herremans et al. (OMAE 2023), each 500,000 steps
    'muzero': (-1100, -900, -800, -760, -800, -200, 0, 150, 75, 210, 220),
    'ppo': (-1100, -680, -480, -470, -760, -940, -270, -570, -780, -1045, -1056),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options; runs are those of the figure."""
    add_run_arguments(parser, steps=5_000_000, out='portnav_out/reproduce')
    add_algorithms(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write table.md and table.json, and print the former.

    Raises:
        EvaluationError: the options or the folder do not fit, or a run failed; what there is was written.
        TrainingError, ImportError: nothing can be trained here.
        KeyboardInterrupt: Ctrl-C, after all has been saved.
    """
    runs = paper_runs(arguments)
    check_training(runs, arguments)
    failed = sail(runs, arguments)
    rows = table_rows(arguments.steps, {name: _curves(name, runs) for name in _names(runs)})
    text = _text(rows, _names(runs))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / 'table.md').write_text(text, encoding='utf-8')
    write_json(arguments.out / 'table.json', {'rows': {str(r['steps']): r for r in rows}, **provenance()})
    print(text)
    refuse(failed, arguments)
    return 0


def table_rows(steps: int, curves: Mapping[str, Sequence[Curve]]) -> list[dict[str, Any]]:
    """Rows at each 500,000 steps, and at the last step.

    Args:
        steps: of a run.
        curves: of each algorithm, a curve for a seed.

    Returns:
        ``steps``, and for each algorithm its mean reward over seeds that have got there: ``mean``,
        ``standard_deviation``, ``n`` and the ``paper``'s number, None where there is none.
    """
    marks = sorted({*range(0, steps + 1, EVERY), steps})
    rows: list[dict[str, Any]] = []
    for mark in marks:
        row: dict[str, Any] = {'steps': mark}
        for name, of_seeds in curves.items():
            reached = [value for curve in of_seeds if (value := reward_at(curve, mark)) is not None]
            paper = PAPER[name][mark // EVERY] if mark % EVERY == 0 and mark <= 10 * EVERY else None
            row[name] = {**sample(np.array(reached))._asdict(), 'paper': paper}
        rows.append(row)
    return rows


def reward_at(curve: Curve, steps: int) -> float | None:
    """Running mean of the reward by the line next to `steps`; at 0 the first line of the run.

    None where the run has not got that far.
    """
    if not len(curve.steps) or curve.steps[-1] < steps:
        return None
    next_to: Array = np.abs(curve.steps - steps)
    return float(curve.values[int(np.argmin(next_to)), REWARD])


def _names(runs: Sequence[Run]) -> list[str]:
    return [name for name in TITLES if any(run.algorithm == name for run in runs)]


def _curves(name: str, runs: Sequence[Run]) -> list[Curve]:
    return [running(run.metrics()) for run in runs if run.algorithm == name]


def _text(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> str:
    head = ['steps, millions']
    for name in names:
        head += [f'{TITLES[name]}, paper', f'{TITLES[name]}, here', 'seeds']
    cells = []
    for row in rows:
        line = [f'{row["steps"] / 1e6:g}']
        for name in names:
            got = row[name]
            line += [_number(got['paper']), _spread(got), str(got['n'] or '')]
        cells.append(line)
    return markdown(head, cells)


def _number(value: float | None) -> str:
    return '' if value is None else f'{value:.0f}'


def _spread(got: Mapping[str, Any]) -> str:
    return Sample(got['n'], got['mean'], got['standard_deviation']).text('.0f')
