"""What an evaluation sails: a planner, and the scenario of each seed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

from portnav_ros.charts import read_chart
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.metrics.table import measure
from portnav_ros.evaluation.planners import NO_OPTIONS, EvaluationError, ModelOptions, make_planner
from portnav_ros.harbour import Harbour
from portnav_ros.sim.difficulty import Difficulty, load_difficulty
from portnav_ros.sim.generator import chart_scenario, make_scenario
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.policy import Policy
from portnav_ros.types import Outcome

Split = Literal['training', 'validation', 'test']
SEEDS_PER_SPLIT = 1_000_000
SPLITS: dict[Split, int] = {'training': 0, 'validation': SEEDS_PER_SPLIT, 'test': 2 * SEEDS_PER_SPLIT}


def split_seeds(split: Split, first: int, episodes: int) -> range:
    """World seeds of ``first``, ``first + 1`` ... within a split; splits share no world.

    Raises:
        EvaluationError: no episode is asked for, or a seed would fall into another split.
    """
    if episodes < 1:
        raise EvaluationError(f'--episodes {episodes} must be at least 1')
    if first < 0 or first + episodes > SEEDS_PER_SPLIT:
        raise EvaluationError(
            f'--seed {first} with --episodes {episodes}: a split has the seeds 0 to {SEEDS_PER_SPLIT - 1}'
        )
    base = SPLITS[split] + first
    return range(base, base + episodes)


@dataclass(frozen=True)
class Trial:
    """A planner on random ports of a difficulty, on a chart, or in a named scenario.

    route: who lays the global path; None leaves it to the difficulty. model: of a learned planner.
    """

    planner: str
    difficulty: str
    chart: Path | None = None
    scenario: str | None = None
    route: Literal['clearance', 'rrt_star'] | None = None
    model: ModelOptions = NO_OPTIONS

    def __post_init__(self) -> None:
        """Refuse two sources of scenarios, or of the path."""
        if self.chart is not None and self.scenario is not None:
            raise EvaluationError('--chart and --scenario exclude each other')
        if self.route is not None and self.scenario is not None:
            raise EvaluationError('--route and --scenario exclude each other: a named scenario has its path')

    @cached_property
    def _harbour(self) -> Harbour | None:
        return None if self.chart is None else read_chart(self.chart)

    @cached_property
    def _difficulty(self) -> Difficulty:
        difficulty = load_difficulty(self.difficulty)
        return difficulty if self.route is None else replace(difficulty, route=self.route)

    def make_scenario(self, seed: int) -> Scenario:
        """Make the scenario of a world seed, with its path."""
        if self.scenario is not None:
            return load_scenario(self.scenario, seed)
        if self._harbour is not None:
            return chart_scenario(self._harbour, self._difficulty, seed)
        return make_scenario(self._difficulty, seed)

    def make_planner(self, scenario: Scenario) -> Policy:
        """Build the planner for the scenarios' vessel."""
        return make_planner(self.planner, scenario, self.model)

    def scenarios(self, seeds: Iterator[int]) -> Iterator[Scenario]:
        """Make scenarios one by one."""
        return (self.make_scenario(seed) for seed in seeds)


class EpisodeResult(NamedTuple):
    """How one episode ended, and its metrics by key. log: None unless asked for."""

    seed: int
    outcome: Outcome
    values: dict[str, float]
    log: EpisodeLog | None = None


def judge(log: EpisodeLog, trial: Trial, keep_log: bool) -> EpisodeResult:
    """Measure a finished episode."""
    kept = None
    if keep_log:
        metadata = {'options': json.dumps(asdict(trial), default=str), **log.metadata}
        kept = replace(log, planner=trial.planner, difficulty=trial.difficulty, metadata=metadata)
    return EpisodeResult(log.seed, log.outcome, measure(log), kept)
