"""Sails the episodes of an evaluation through the whole graph; every figure comes from the bag."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from portnav_ros.evaluation.bag_episode import LOST, read_episode
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import EpisodeResult, Trial, judge
from portnav_ros.nodes.bringup import sail
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.preparation import BAG, read_configuration
from portnav_ros.nodes.supervisor import Report
from portnav_ros.types import Outcome

INTERRUPTED = (130, 143)  # by SIGINT or SIGTERM


def run_trial(
    trial: Trial, seeds: Sequence[int], batch: int, workers: int, keep_logs: bool = False
) -> Iterator[EpisodeResult]:
    """Yield the result of each seed, one graph after the other in lock-step.

    Args:
        trial: planner and source of scenarios.
        seeds: world seeds.
        batch: unused: a graph sails one vessel.
        workers: unused: a graph is a handful of processes already.
        keep_logs: attach each episode's log.

    Raises:
        EvaluationError: a graph ended before its episode did, or its bag is not whole.
        KeyboardInterrupt: Ctrl-C or SIGTERM.
    """
    if trial.route == 'clearance':
        raise EvaluationError('--through ros: the nodes plan with RRT*; leave out --route clearance')
    configuration = read_configuration(None) | {'safety_monitor': {'zones': False}}
    for seed in seeds:
        options = GraphOptions(
            planner=trial.planner,
            difficulty=trial.difficulty,
            scenario=trial.scenario,
            chart=trial.chart,
            seed=seed,
            mode='lock_step',
            model=trial.model.file,
            simulations=trial.model.simulations,
            allow_mismatch=trial.model.allow_mismatch,
        )
        with tempfile.TemporaryDirectory(prefix='portnav_') as folder:
            result = sail(options, configuration, Path(folder), _ignore, _say_nothing)
            if result.code in INTERRUPTED:
                raise KeyboardInterrupt
            if result.outcome is Outcome.RUNNING:
                raise EvaluationError(f'--through ros, seed {seed}: {result.message}')
            log = replace(read_episode(Path(folder) / BAG), wall_s=result.wall_s)
            if log.outcome is not result.outcome:
                lost = log.metadata.get(LOST, 'the end was not recorded')
                raise EvaluationError(f'--through ros, seed {seed}: the bag is not whole: {lost}')
        yield judge(log, trial, keep_logs)


def _ignore(report: Report) -> None:
    """Nothing to show: the evaluation has its own progress bar."""


def _say_nothing(line: str) -> None:
    """What goes wrong is in the result."""
