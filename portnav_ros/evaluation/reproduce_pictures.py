"""`portnav reproduce pictures`: three named scenarios sailed by a planner, drawn with what the sensor saw."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.episode_log import EpisodeLog, ScanLog
from portnav_ros.evaluation.episodes import sail
from portnav_ros.evaluation.metrics.table import measure
from portnav_ros.evaluation.options import model_options
from portnav_ros.evaluation.planners import (
    PLANNERS,
    ModelOptions,
    identify,
    model_of,
)
from portnav_ros.evaluation.plots_scan import encounter_figure
from portnav_ros.evaluation.provenance import provenance
from portnav_ros.evaluation.report import headline
from portnav_ros.evaluation.summary import write_json
from portnav_ros.evaluation.trial import Trial, split_seeds
from portnav_ros.sim.difficulty import load_vessel
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import World
from portnav_ros.vessel import VesselParams


class Subject(NamedTuple):
    """A picture: the scenario, and which column of the clearances tells the encounter."""

    scenario: str
    title: str
    column: int


def _subjects(encounter: str) -> dict[str, Subject]:
    """The paper's three, by file name; encounter: the scenario with other vessels."""
    return {
        'free_path': Subject('no_traffic', 'A free path', 0),
        'evading_vessels': Subject(encounter, 'Evading another vessel', 2),
        'evading_a_buoy': Subject('buoy', 'Evading buoys that are not on the chart', 1),
    }


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument('--planner', default='muzero', choices=PLANNERS, help='default: %(default)s')
    parser.add_argument('--model', type=Path, metavar='FILE', help='of a learned planner: its weights')
    parser.add_argument(
        '--simulations', type=int, metavar='N', help="in place of the model's own number; 0 follows the prior"
    )
    parser.add_argument(
        '--allow-mismatch', action='store_true', help='sail another vessel than the model was trained for'
    )
    parser.add_argument(
        '--vessel',
        metavar='NAME',
        help="preset or file; default: the model's own, and the scenarios' where there is no model or "
        '--allow-mismatch is given',
    )
    parser.add_argument(
        '--encounter', default='head_on', metavar='NAME', help='scenario with vessels (default: %(default)s)'
    )
    parser.add_argument(
        '--seed', type=int, default=0, metavar='S', help='within the split test (default: %(default)s)'
    )
    parser.add_argument(
        '--out', type=Path, default=Path('portnav_out/pictures'), metavar='DIR', help='default: %(default)s'
    )


def run(arguments: argparse.Namespace) -> int:
    """Write a PNG and an SVG for each subject, and pictures.json with how they ended.

    Raises:
        EvaluationError: options do not fit.
        ModelError: a learned planner has no model, or it does not fit.
        ParamError, ScenarioError: vessel or encounter cannot be made; nothing is sailed then.
    """
    options = model_options(arguments, arguments.planner)
    model = identify(arguments.planner, options)
    seed = split_seeds('test', arguments.seed, 1)[0]
    vessel, subjects = _vessel(arguments, options), _subjects(arguments.encounter)
    trials = {
        name: Trial(arguments.planner, 'paper', scenario=subject.scenario, model=options)
        for name, subject in subjects.items()
    }
    for trial in trials.values():
        trial.make_planner(_scenario(trial, seed, vessel))  # all can be sailed, before one is
    arguments.out.mkdir(parents=True, exist_ok=True)
    episodes: dict[str, Any] = {}
    for name, subject in subjects.items():
        log = sail_subject(trials[name], seed, vessel)
        figure = encounter_figure(log, subject.title, subject.column)
        plots.save_png(figure, arguments.out / f'{name}.png')
        plots.save_svg(figure, arguments.out / f'{name}.svg')
        endings = {'vessel': log.vessel.name, 'outcome': log.outcome.name.lower()}
        episodes[name] = {'scenario': subject.scenario, **endings, **measure(log)}
        print(f'{arguments.out / name}.png: {headline(log)}')
    numbers = {'planner': arguments.planner, 'model': model, 'seed': seed, 'episodes': episodes}
    write_json(arguments.out / 'pictures.json', {**numbers, **provenance()})
    return 0


def _vessel(arguments: argparse.Namespace, options: ModelOptions) -> VesselParams | None:
    """Who sails; None for the scenarios' own."""
    if arguments.vessel is not None:
        return load_vessel(arguments.vessel)
    model = None if options.allow_mismatch else model_of(arguments.planner, options)
    return None if model is None else model.card.vessel


def sail_subject(trial: Trial, seed: int, vessel: VesselParams | None = None) -> EpisodeLog:
    """The log of one episode, with its scans; vessel: who sails, the scenario's own where None."""
    scenario = _scenario(trial, seed, vessel)
    log = next(sail(trial.make_planner, [scenario], batch=1))
    return replace(log, planner=trial.planner, scans=scans_of(scenario, log))


def _scenario(trial: Trial, seed: int, vessel: VesselParams | None) -> Scenario:
    scenario = trial.make_scenario(seed)
    return scenario if vessel is None else replace(scenario, vessel=vessel)


def scans_of(scenario: Scenario, log: EpisodeLog) -> ScanLog:
    """What the sensor saw at each row of a log, by sailing its setpoints once more."""
    world = World([scenario])
    ranges = [world.ranges[0].copy()]
    for setpoint in log.setpoint[:-1]:
        world.step(setpoint[None])
        ranges.append(world.ranges[0].copy())
    spacing_rad = 2.0 * np.pi / world.lidar.rays
    return ScanLog(log.time_s, np.array(ranges, np.float32), -np.pi, spacing_rad)
