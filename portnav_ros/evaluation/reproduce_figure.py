"""`portnav reproduce figure`: trains MuZero and PPO, measures the DWA, and draws the figure of the paper."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from tqdm import tqdm

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.learning_curves import (
    FIELDS,
    Across,
    Curve,
    across,
    all_steps,
    running,
    validated,
)
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.plots_training import Drawn, training_figure
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.reproduce_runs import (
    TITLES,
    add_algorithms,
    check_training,
    paper_runs,
    place_of,
    refuse,
    sail,
)
from portnav_ros.evaluation.reproduce_runs import add_arguments as add_run_arguments
from portnav_ros.evaluation.summary import summarise, write_json
from portnav_ros.evaluation.training_runs import Place, Run
from portnav_ros.evaluation.trial import Trial, split_seeds
from portnav_ros.evaluation.workers import run_trial
from portnav_ros.training.episode_statistics import WINDOW

BATCH = 16
AVERAGES = {  # of an evaluation, by the fields of a curve
    'e_x': 'mean_abs_e_x_m',
    'e_y': 'mean_abs_e_y_m',
    'e_psi': 'mean_abs_e_psi_rad',
    'success': 'success',
    'reward': 'mean_return',
    'length_s': 'mean_length_s',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_run_arguments(parser, steps=5_000_000, out='portnav_out/reproduce')
    add_algorithms(parser)
    parser.add_argument(
        '--dwa-episodes', type=int, default=200, metavar='N', help='validation worlds (default: %(default)s)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Write figure.png, figure.svg and figure.json.

    Raises:
        EvaluationError: the options or the folder do not fit, or a run failed; what there is was drawn.
        TrainingError, ImportError: nothing can be trained here.
        KeyboardInterrupt: Ctrl-C, after all has been saved.
    """
    runs = paper_runs(arguments)
    check_training(runs, arguments)
    place = place_of(arguments, Place())
    trial = place.trial('dwa', runs[0].values['scenarios'].get('validation_route', 'difficulty'))
    dwa = _measured_dwa(trial, place, arguments)
    failed = sail(runs, arguments)
    curves = [_read(name, runs) for name in TITLES if any(run.algorithm == name for run in runs)]
    figure = training_figure(
        [Drawn(TITLES[c.algorithm], list(c.runs.values()), c.mean, c.validation) for c in curves],
        None if dwa is None else {field: dwa[AVERAGES[field]] for field in FIELDS},
        _caption(curves, place, dwa),
    )
    arguments.out.mkdir(parents=True, exist_ok=True)
    plots.save_png(figure, arguments.out / 'figure.png')
    plots.save_svg(figure, arguments.out / 'figure.svg')
    numbers = {
        'place': place.name,
        'window': WINDOW,
        'algorithms': {c.algorithm: c.plain() for c in curves},
        'dwa': dwa,
        **provenance(),
    }
    write_json(arguments.out / 'figure.json', numbers)
    for name in ('png', 'svg', 'json'):
        print(arguments.out / f'figure.{name}')
    refuse(failed, arguments)
    return 0


class _Curves(NamedTuple):
    """One algorithm. runs: by seed, of those that have something to show. mean: of them, where all are."""

    algorithm: str
    runs: dict[int, Curve]
    mean: Across
    validation: Across

    def plain(self) -> dict[str, Any]:
        return {
            'runs': {str(seed): curve.plain() for seed, curve in self.runs.items()},
            'mean': self.mean.plain(),
            'validation': self.validation.plain(),
        }


def _read(algorithm: str, runs: Sequence[Run]) -> _Curves:
    lines = {run.seed: run.metrics() for run in runs if run.algorithm == algorithm}
    shown = {seed: curve for seed, rows in lines.items() if len((curve := running(rows)).steps)}
    checks = [curve for rows in lines.values() if len((curve := validated(rows)).steps)]
    return _Curves(algorithm, shown, _across(list(shown.values())), _across(checks))


def _across(curves: Sequence[Curve]) -> Across:
    return across(curves, all_steps(curves))


def _measured_dwa(trial: Trial, place: Place, arguments: argparse.Namespace) -> dict[str, Any] | None:
    """Figures of the DWA on the worlds that runs validate on; measured once, then read from a file."""
    episodes = arguments.dwa_episodes
    along = f'{trial.route}-' if trial.route else ''
    file = arguments.out / f'dwa-{place.name}-{along}{episodes}.json'
    if not file.exists() and not arguments.plot_only:
        if episodes < 1:
            raise EvaluationError(f'--dwa-episodes {episodes} must be at least 1')
        seeds = split_seeds('validation', 0, episodes)
        start_s = time.perf_counter()
        sailed = run_trial(trial, seeds, BATCH, arguments.jobs, False)
        results = list(tqdm(sailed, total=episodes, desc='DWA', unit='episode'))
        figures = summarise(results, time.perf_counter() - start_s)
        measured = {'planner': 'dwa', 'place': place.name, 'route': trial.route, 'split': 'validation'}
        write_json(file, {**measured, **figures, **provenance()})
    return json.loads(file.read_text(encoding='utf-8')) if file.exists() else None


def _caption(curves: Sequence[_Curves], place: Place, dwa: dict[str, Any] | None) -> str:
    parts = [f'{TITLES[c.algorithm]}: {len(c.runs)} seed{"s" * (len(c.runs) != 1)}' for c in curves]
    if dwa is not None:
        parts.append(f'DWA: {dwa["episodes"]} validation episodes')
    return (
        f'{place.name}; {"; ".join(parts)}.\nThin: running mean of {WINDOW} training episodes of one seed; '
        'bold and shade: mean and range of the seeds, where all are; dots: mean of the validations.'
    )
