"""Random search with halving for the weights of the dynamic window, on validation worlds only.

    python -m portnav_ros.baselines.tune --difficulty paper --episodes 400 --candidates 32

All candidates sail an eighth of the episodes; the better quarter of them sails three eighths, and the
better quarter of those sails all. The first candidate is the configuration that is in force.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from portnav_ros.baselines.dwa import DwaParams, DynamicWindow, load_dwa_params
from portnav_ros.sim.generator import load_difficulty, make_scenario
from portnav_ros.sim.scenario import Scenario, ScenarioError
from portnav_ros.sim.world import World
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.types import Outcome

FIRST_SEED = 1_000_000  # of the validation worlds
SHARES = (0.125, 0.375, 1.0)
KEEP = 0.25
CHOICES: dict[str, tuple[float, ...]] = {
    'goal_ahead_m': (200.0, 300.0, 400.0, 500.0, 600.0, 800.0),
    'room_m': (15.0, 30.0, 50.0, 75.0, 100.0),
    'clearance_weight': (0.0, 0.1, 0.2, 0.4, 0.8, 1.6),
    'room_weight': (0.0, 0.05, 0.1, 0.2, 0.4, 0.8),
    'speed_weight': (0.05, 0.1, 0.2, 0.4, 0.8),
}


class Trial(NamedTuple):
    """Success rate of a candidate over a number of episodes."""

    success: float
    episodes: int
    params: DwaParams


def draw(base: DwaParams, rng: np.random.Generator) -> DwaParams:
    """Draw a candidate; the heading's weight is 1, since only the ratios of the weights count."""
    chosen = {name: float(rng.choice(values)) for name, values in CHOICES.items()}
    return replace(base, heading_weight=1.0, **chosen)


def success_rate(params: DwaParams, scenarios: Sequence[Scenario]) -> float:
    """Sail every scenario with DWA, all at once."""
    world = World(scenarios)
    everyone = np.ones(world.batch, dtype=bool)
    observer = Observer(world.batch, world.lidar, ObservationParams())
    observer.reset(everyone, [_path(scenario) for scenario in scenarios])
    policy = DynamicWindow(world.vessel, world.autopilot, params)
    while (world.outcome == Outcome.RUNNING).any():
        world.step(policy.act(observer.update(world.own, world.ranges, world.setpoint)))
    return float((world.outcome == Outcome.SUCCESS).mean())


def halve(candidates: Sequence[DwaParams], scenarios: Sequence[Scenario]) -> list[Trial]:
    """Sail ever more episodes with ever fewer candidates; return the last round, best first."""
    trials: list[Trial] = []
    for share in SHARES:
        some = scenarios[: max(round(share * len(scenarios)), 1)]
        trials = [
            Trial(success_rate(params, some), len(some), params)
            for params in tqdm(candidates, f'{len(some)} episodes')
        ]
        trials.sort(key=lambda trial: -trial.success)
        _show(trials)
        candidates = [trial.params for trial in trials[: max(round(KEEP * len(trials)), 1)]]
    return trials


def _path(scenario: Scenario) -> np.ndarray:
    if scenario.path is None:
        raise ScenarioError(f'{scenario.name}: seed {scenario.seed} has no path to follow')
    return scenario.path


def _show(trials: Sequence[Trial]) -> None:
    for trial in trials:
        values = '  '.join(f'{name} {value:g}' for name, value in asdict(trial.params).items())
        print(f'{100.0 * trial.success:5.1f} % of {trial.episodes}  {values}', flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of every round."""
    parser = argparse.ArgumentParser(prog='python -m portnav_ros.baselines.tune', description=__doc__)
    parser.add_argument('--difficulty', default='paper', help='name or YAML file')
    parser.add_argument('--episodes', type=int, default=400, help='validation worlds of the last round')
    parser.add_argument('--candidates', type=int, default=32)
    parser.add_argument('--seed', type=int, default=0, help='of the candidates')
    given = parser.parse_args(arguments)
    difficulty, base = load_difficulty(given.difficulty), load_dwa_params()
    seeds = range(FIRST_SEED, FIRST_SEED + given.episodes)
    scenarios = [make_scenario(difficulty, seed) for seed in tqdm(seeds, 'worlds')]
    rng = np.random.default_rng(given.seed)
    halve([base, *(draw(base, rng) for _ in range(given.candidates - 1))], scenarios)


if __name__ == '__main__':
    main()
