"""`portnav evaluate`: success rate and other metrics of a planner over many episodes."""

from __future__ import annotations

import argparse
import csv
import importlib
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from portnav_ros.evaluation.comparison import compare, sentence
from portnav_ros.evaluation.evaluate_checks import check_outputs, check_sailing
from portnav_ros.evaluation.metrics.table import METRICS
from portnav_ros.evaluation.options import check_at_least, model_options
from portnav_ros.evaluation.planners import (
    ALGORITHMS,
    NO_OPTIONS,
    PLANNERS,
    EvaluationError,
    ModelOptions,
    identify,
)
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.signals import terminable
from portnav_ros.evaluation.summary import summarise, table, write_json
from portnav_ros.evaluation.trial import SPLITS, EpisodeResult, Trial, split_seeds
from portnav_ros.types import Outcome

RUNNERS = {'process': 'evaluation.workers', 'ros': 'nodes.evaluate_ros'}
OUTPUTS = ('json', 'report', 'episodes_csv')
Runner = Callable[[Trial, Sequence[int], int, int, bool], Iterator[EpisodeResult]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--planner', required=True, choices=PLANNERS, help='who sails')
    parser.add_argument('--difficulty', default='paper', help='name or file (default: %(default)s)')
    parser.add_argument('--chart', type=Path, metavar='FILE', help='sail on a chart, not on random ports')
    parser.add_argument('--scenario', metavar='NAME', help='sail a named scenario, such as head_on')
    parser.add_argument(
        '--route', choices=('clearance', 'rrt_star'), help="global path, in place of the difficulty's choice"
    )
    parser.add_argument('--episodes', type=int, default=100, metavar='N', help='default: %(default)s')
    parser.add_argument(
        '--seed',
        type=int,
        default=0,
        metavar='S',
        help='first seed within the split (default: %(default)s)',
    )
    parser.add_argument(
        '--split', choices=SPLITS, default='test', help='tune on validation, report test (default: test)'
    )
    parser.add_argument('--against', choices=PLANNERS, help='sail the same episodes with a second planner')
    parser.add_argument('--model', type=Path, metavar='FILE', help='of a learned planner: its weights')
    parser.add_argument('--against-model', type=Path, metavar='FILE', help="the second planner's weights")
    parser.add_argument(
        '--simulations',
        type=int,
        metavar='N',
        help="of each search of muzero, in place of the model's own number; 0 follows the prior",
    )
    parser.add_argument(
        '--allow-mismatch', action='store_true', help='sail another vessel than the model was trained for'
    )
    parser.add_argument('--through', choices=RUNNERS, default='process', help='where (default: %(default)s)')
    parser.add_argument(
        '--workers',
        type=int,
        default=2,
        metavar='P',
        help='processes (default: %(default)s); not used through ros',
    )
    parser.add_argument(
        '--batch',
        type=int,
        default=16,
        metavar='B',
        help='episodes at once in a process (default: %(default)s); not used through ros',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write a page with a gallery of failures')
    parser.add_argument(
        '--episodes-csv', type=Path, metavar='FILE', help='write a row for each episode of each planner'
    )


def run(arguments: argparse.Namespace) -> int:
    """Evaluate; a failure, Ctrl-C or SIGTERM ends it early with the figures of the episodes that are done.

    Raises:
        EvaluationError: the options do not fit, or an episode could not be sailed.
        ModelError, ScenarioError, ChartError, ParamError: a planner or the first scenario cannot be made;
            nothing is sailed then.
        Exception, KeyboardInterrupt: whatever else ended it early, after the figures are out.
    """
    trial, rival = _trials(arguments)
    check_at_least(arguments, workers=1, batch=1)
    check_outputs({option: getattr(arguments, option) for option in OUTPUTS})
    check_sailing([trial, rival] if rival else [trial], _seeds(arguments)[0], arguments.through)
    with terminable():
        sailed = _sail(trial, arguments, keep_logs=arguments.report is not None)
        failure = sailed.cut_short
        if sailed.episodes:
            failure = _publish(trial, rival, sailed, arguments)
    if failure is not None:
        raise failure
    return 0


def _trials(arguments: argparse.Namespace) -> tuple[Trial, Trial | None]:
    """What is sailed, and the same with the second planner, if any."""
    if arguments.against_model and arguments.against not in ALGORITHMS:
        raise EvaluationError(f'--against-model needs --against, and one of {", ".join(ALGORITHMS)} there')
    planners = [name for name in (arguments.planner, arguments.against) if name]
    model = model_options(arguments, *planners)
    trial = Trial(
        arguments.planner,
        arguments.difficulty,
        arguments.chart,
        arguments.scenario,
        arguments.route,
        _used_by(arguments.planner, model),
    )
    if not arguments.against:
        return trial, None
    model = replace(model, file=arguments.against_model or model.file)
    return trial, replace(trial, planner=arguments.against, model=_used_by(arguments.against, model))


def _used_by(planner: str, options: ModelOptions) -> ModelOptions:
    """Those of the options of two planners that one of them uses."""
    if planner not in ALGORITHMS:
        return NO_OPTIONS
    return options if planner == 'muzero' else replace(options, simulations=None)


def _publish(
    trial: Trial, rival: Trial | None, sailed: Sailed, arguments: argparse.Namespace
) -> BaseException | None:
    """Show and write the figures, with a rival's where asked for; returns what cut either short."""
    figures = _figures(trial, sailed, arguments)
    _show(trial, figures)
    all_sailed = [sailed]
    if rival is not None and sailed.cut_short is None:
        other = _sail(rival, arguments, keep_logs=False)
        all_sailed.append(other)
        figures['against'] = _figures_against(sailed, rival, other, arguments)
        figures['complete'] = figures['against']['complete']
        print(sentence(figures) or f'no comparison: {rival.planner} was cut short')
    if arguments.json:
        write_json(arguments.json, figures)
    if arguments.report:
        from portnav_ros.evaluation.overview import write_overview  # matplotlib loads slowly

        failures = [result.log for result in sailed.episodes if result.log is not None]
        write_overview(arguments.report, figures, failures)
    if arguments.episodes_csv:
        _write_rows(arguments.episodes_csv, all_sailed)
    return all_sailed[-1].cut_short


class Sailed(NamedTuple):
    """Episodes in the order of their seeds.

    cut_short: what ended the evaluation early, if anything. model: that of a learned planner.
    """

    planner: str
    episodes: list[EpisodeResult]
    wall_s: float
    cut_short: BaseException | None
    model: dict[str, object] | None


def _seeds(arguments: argparse.Namespace) -> range:
    return split_seeds(arguments.split, arguments.seed, arguments.episodes)


def _sail(trial: Trial, arguments: argparse.Namespace, keep_logs: bool) -> Sailed:
    model, seeds = identify(trial.planner, trial.model), _seeds(arguments)
    module = importlib.import_module(f'portnav_ros.{RUNNERS[arguments.through]}')
    run_trial: Runner = module.run_trial
    episodes: list[EpisodeResult] = []
    cut_short: BaseException | None = None
    start = time.perf_counter()
    try:
        with tqdm(total=len(seeds), desc=trial.planner, unit='episode') as bar:
            for result in run_trial(trial, seeds, arguments.batch, arguments.workers, keep_logs):
                won = result.outcome == Outcome.SUCCESS
                episodes.append(result._replace(log=None) if won else result)
                share = np.mean([done.outcome == Outcome.SUCCESS for done in episodes])
                bar.set_postfix_str(f'success {share:.1%}', refresh=False)
                bar.update()
    except (KeyboardInterrupt, Exception) as error:  # hours of figures are worth more than the reason
        cut_short = error
        print(f'cut short after {len(episodes)} of {len(seeds)} episodes', file=sys.stderr)
    episodes.sort(key=lambda result: result.seed)
    return Sailed(trial.planner, episodes, time.perf_counter() - start, cut_short, model)


def _figures(trial: Trial, sailed: Sailed, arguments: argparse.Namespace) -> dict[str, Any]:
    return {
        'planner': trial.planner,
        'model': sailed.model,
        'difficulty': trial.difficulty,
        'chart': str(trial.chart) if trial.chart else None,
        'scenario': trial.scenario,
        'route': trial.route,
        'split': arguments.split,
        'seed': arguments.seed,
        'through': arguments.through,
        **summarise(sailed.episodes, sailed.wall_s),
        'complete': sailed.cut_short is None,
        'workers': arguments.workers,
        'batch': arguments.batch,
        **provenance(),
    }


def _figures_against(
    sailed: Sailed, rival: Trial, other: Sailed, arguments: argparse.Namespace
) -> dict[str, Any]:
    """Figures of the rival, compared only where it has sailed all: what ends first is no fair sample."""
    if not other.episodes:
        return {'planner': rival.planner, 'episodes': 0, 'complete': False}
    figures = _figures(rival, other, arguments)
    _show(rival, figures)
    if other.cut_short is None:
        figures['paired'] = compare(sailed.episodes, other.episodes)._asdict()
    return figures


def _show(trial: Trial, figures: dict[str, Any]) -> None:
    place = trial.scenario or trial.chart or trial.difficulty
    pace = f'{figures["wall_s"]:.0f} s, {figures["simulated_over_wall"]:.0f} times real time'
    end = '' if figures['complete'] else '; cut short, and those that end first are mostly collisions'
    print(f'{trial.planner} on {place}: {figures["episodes"]} episodes in {pace}{end}')
    print(table(figures))


def _write_rows(path: Path, all_sailed: Sequence[Sailed]) -> None:
    """Write a row for each episode: planner, model, seed, outcome and every metric."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(['planner', 'model', 'seed', 'outcome', *(metric.key for metric in METRICS)])
        for sailed in all_sailed:
            model = (sailed.model or {}).get('file', '')
            for result in sailed.episodes:
                cells = ('' if math.isnan(value) else repr(value) for value in result.values.values())
                writer.writerow([sailed.planner, model, result.seed, result.outcome.name.lower(), *cells])
