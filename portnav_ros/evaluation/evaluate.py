"""`portnav evaluate`: success rate and other metrics of a planner over many episodes."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from portnav_ros.evaluation.planners import ALGORITHMS, PLANNERS, EvaluationError, ModelOptions, identify
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.statistics import paired_difference
from portnav_ros.evaluation.summary import summarise, table, write_csv, write_json
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
    parser.add_argument('--seed', type=int, default=0, metavar='S', help='first seed within the split')
    parser.add_argument(
        '--split', choices=SPLITS, default='test', help='tune on validation, report test (default)'
    )
    parser.add_argument('--against', choices=PLANNERS, help='sail the same episodes with a second planner')
    parser.add_argument('--model', type=Path, metavar='FILE', help='of a learned planner: its weights')
    parser.add_argument('--against-model', type=Path, metavar='FILE', help="the second planner's weights")
    parser.add_argument(
        '--simulations', type=int, metavar='N', help="of each search, in place of the model's own number"
    )
    parser.add_argument(
        '--allow-mismatch', action='store_true', help='sail another vessel than the model was trained for'
    )
    parser.add_argument('--through', choices=RUNNERS, default='process', help='where (default: %(default)s)')
    parser.add_argument(
        '--workers', type=int, default=2, metavar='P', help='processes (default: %(default)s)'
    )
    parser.add_argument('--batch', type=int, default=16, metavar='B', help='episodes at once in a process')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write a page with a gallery of failures')
    parser.add_argument('--episodes-csv', type=Path, metavar='FILE', help='write a row for each episode')


def run(arguments: argparse.Namespace) -> int:
    """Evaluate; a failure or Ctrl-C ends it early with the figures of the episodes that are done.

    Raises:
        EvaluationError: the options do not fit, or an episode could not be sailed.
        ModelError: a learned planner has no model; nothing is sailed then.
        Exception, KeyboardInterrupt: whatever else ended it early, after the figures are out.
    """
    trial = Trial(
        arguments.planner,
        arguments.difficulty,
        arguments.chart,
        arguments.scenario,
        arguments.route,
        _model_options(arguments),
    )
    rival = _rival(trial, arguments)
    for option in OUTPUTS:
        _check_output(option, getattr(arguments, option))
    sailed = _sail(trial, arguments)
    failure = sailed.cut_short
    if sailed.episodes:
        failure = _publish(trial, rival, sailed, arguments)
    if failure is not None:
        raise failure
    return 0


def _model_options(arguments: argparse.Namespace) -> ModelOptions:
    """Options of the learned planners; refused where there is none to use them."""
    options = ModelOptions(arguments.model, arguments.simulations, arguments.allow_mismatch)
    if options != ModelOptions() and not {arguments.planner, arguments.against} & set(ALGORITHMS):
        raise EvaluationError(
            f'--model, --simulations and --allow-mismatch are for {", ".join(ALGORITHMS)}, not for '
            f'{arguments.planner}; leave them out'
        )
    return options


def _rival(trial: Trial, arguments: argparse.Namespace) -> Trial | None:
    """The same with the second planner, if any, once it is known to have a model where it needs one."""
    if arguments.against_model and arguments.against not in ALGORITHMS:
        raise EvaluationError(f'--against-model needs --against, and one of {", ".join(ALGORITHMS)} there')
    if not arguments.against:
        return None
    model = replace(trial.model, file=arguments.against_model or trial.model.file)
    identify(arguments.against, model)
    return replace(trial, planner=arguments.against, model=model)


def _check_output(option: str, file: Path | None) -> None:
    """Refuse a file that cannot be written, while there are no figures to lose.

    Raises:
        EvaluationError: names the option and the mend.
    """
    if file is None:
        return
    name = f'--{option.replace("_", "-")} {file}'
    folder = next(parent for parent in file.absolute().parents if parent.exists())
    if file.is_dir():
        raise EvaluationError(f'{name}: is a folder; name a file in it')
    if not folder.is_dir():
        raise EvaluationError(f'{name}: {folder} is no folder; name another file')
    if not os.access(file if file.exists() else folder, os.W_OK):
        raise EvaluationError(f'{name}: may not be written; name another file')


def _publish(
    trial: Trial, rival: Trial | None, sailed: Sailed, arguments: argparse.Namespace
) -> BaseException | None:
    """Show and write the figures, with a rival's where asked for; returns what cut either short."""
    figures = _figures(trial, sailed, arguments)
    _show(trial, figures)
    failure = sailed.cut_short
    if rival is not None and failure is None:
        other = _sail(rival, arguments)
        figures['against'] = _compare(sailed, rival, other, arguments)
        failure = other.cut_short
    if arguments.json:
        write_json(arguments.json, figures)
    if arguments.report:
        from portnav_ros.evaluation.overview import write_overview  # matplotlib loads slowly

        failures = [result.log for result in sailed.episodes if result.log is not None]
        write_overview(arguments.report, figures, failures)
    if arguments.episodes_csv:
        write_csv(arguments.episodes_csv, sailed.episodes)
    return failure


class Sailed(NamedTuple):
    """Episodes in the order of their seeds.

    cut_short: what ended the evaluation early, if anything. model: that of a learned planner.
    """

    episodes: list[EpisodeResult]
    wall_s: float
    cut_short: BaseException | None
    model: dict[str, object] | None


def _sail(trial: Trial, arguments: argparse.Namespace) -> Sailed:
    model = identify(trial.planner, trial.model)
    seeds = split_seeds(arguments.split, arguments.seed, arguments.episodes)
    module = importlib.import_module(f'portnav_ros.{RUNNERS[arguments.through]}')
    run_trial: Runner = module.run_trial
    episodes: list[EpisodeResult] = []
    keep = arguments.report is not None
    cut_short: BaseException | None = None
    start = time.perf_counter()
    try:
        with tqdm(total=len(seeds), desc=trial.planner, unit='episode') as bar:
            for result in run_trial(trial, seeds, arguments.batch, arguments.workers, keep):
                won = result.outcome == Outcome.SUCCESS
                episodes.append(result._replace(log=None) if won else result)
                share = np.mean([done.outcome == Outcome.SUCCESS for done in episodes])
                bar.set_postfix_str(f'success {share:.1%}', refresh=False)
                bar.update()
    except (KeyboardInterrupt, Exception) as error:  # hours of figures are worth more than the reason
        cut_short = error
        print(f'cut short after {len(episodes)} of {len(seeds)} episodes', file=sys.stderr)
    episodes.sort(key=lambda result: result.seed)
    return Sailed(episodes, time.perf_counter() - start, cut_short, model)


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


def _show(trial: Trial, figures: dict[str, Any]) -> None:
    place = trial.scenario or trial.chart or trial.difficulty
    speed = f'{figures["simulated_over_wall"]:.0f} times real time'
    print(f'{trial.planner} on {place}: {figures["episodes"]} episodes in {figures["wall_s"]:.0f} s, {speed}')
    print(table(figures))


def _compare(sailed: Sailed, rival: Trial, other: Sailed, arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare success with the rival's on the same seeds, episode by episode."""
    theirs = {result.seed: result.outcome == Outcome.SUCCESS for result in other.episodes}
    if not theirs:
        return {'planner': rival.planner, 'episodes': 0}
    figures = _figures(rival, other, arguments)
    _show(rival, figures)
    ours = [result for result in sailed.episodes if result.seed in theirs]
    first = np.array([result.outcome == Outcome.SUCCESS for result in ours])
    result = paired_difference(first, np.array([theirs[result.seed] for result in ours]))
    print(
        f'difference on {len(ours)} same episodes: {result.difference:+.1%} '
        f'(95 % interval {result.low:+.1%} to {result.high:+.1%}, McNemar p = {result.p_value:.2g}; '
        f'only {arguments.planner} {result.only_first}, only {rival.planner} {result.only_second})'
    )
    return {**figures, 'paired': result._asdict()}
