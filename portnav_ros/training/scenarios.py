"""Where a run's scenarios come from: random ports of a difficulty, or a test bed.

Training draws from seeds below VALIDATION_SEED, validation from there on; no world is in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.sim.difficulty import Difficulty, load_difficulty
from portnav_ros.sim.generator import ScenarioPool, make_scenario
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.env import ScenarioSource

VALIDATION_SEED = 1_000_000  # the first of the validation worlds
TESTBEDS = {  # name: the scenario of config/scenarios; walls_only is a difficulty
    'one_buoy': 'one_buoy',
    'buoy_field': 'buoy_field',
    'head_on': 'slow_head_on',
    'crossing': 'half_crossing',
    'walls_only': '',
}
PORTLESS_DRAWS = 256  # variations of a test bed that is a named scenario
Ready = Callable[[int, int], None]


@dataclass(frozen=True)
class ScenarioParams:
    """Which worlds.

    testbed: one of TESTBEDS in place of the difficulty, or none. ports: how many the training pool
    holds. route: who lays the global paths in training. validation_route: in validation; difficulty
    is as the difficulty says, where RRT* takes 0.3 s a path.
    """

    difficulty: str = 'paper'
    testbed: Literal['', 'one_buoy', 'buoy_field', 'head_on', 'crossing', 'walls_only'] = ''
    ports: int = 64
    route: Literal['clearance', 'rrt_star'] = 'clearance'
    validation_route: Literal['difficulty', 'clearance', 'rrt_star'] = 'difficulty'
    validation_episodes: int = 200
    ranges: ClassVar[Ranges] = {'ports': (1, 10_000), 'validation_episodes': (1, VALIDATION_SEED)}

    def __post_init__(self) -> None:
        """Refuse a pool without ports and an unknown test bed."""
        check_ranges(self)
        if self.testbed not in ('', *TESTBEDS):
            raise ParamError(f'testbed = {self.testbed!r} is none of {", ".join(TESTBEDS)}')


def training_source(params: ScenarioParams, seed: int, ready: Ready | None = None) -> ScenarioSource:
    """Prepare what training draws scenarios from.

    Args:
        params: which worlds.
        seed: of the run; chooses the ports.
        ready: called with the number of ports prepared and the number asked for.

    Raises:
        ParamError: the seed would reach into the validation worlds.
        ScenarioError: a port cannot be made.
    """
    if (seed + 1) * max(params.ports, PORTLESS_DRAWS) > VALIDATION_SEED:
        raise ParamError(f'seed = {seed} with {params.ports} ports reaches into the validation worlds')
    difficulty = _difficulty(params)
    if difficulty is not None:
        return ScenarioPool(replace(difficulty, route=params.route), params.ports, seed, progress=ready).draw
    first = seed * PORTLESS_DRAWS
    worlds = [load_scenario(TESTBEDS[params.testbed], first + k) for k in range(PORTLESS_DRAWS)]

    def draw(rng: np.random.Generator) -> Scenario:
        return worlds[int(rng.integers(len(worlds)))]

    return draw


def validation_scenarios(params: ScenarioParams, ready: Ready | None = None) -> list[Scenario]:
    """Make the scenarios that every validation of a run sails, the same for every seed of the run.

    Raises:
        ScenarioError: one cannot be made.
    """
    difficulty = _difficulty(params)
    if difficulty is not None and params.validation_route != 'difficulty':
        difficulty = replace(difficulty, route=params.validation_route)
    scenarios = []
    for k in range(params.validation_episodes):
        seed = VALIDATION_SEED + k
        made = (
            make_scenario(difficulty, seed) if difficulty else load_scenario(TESTBEDS[params.testbed], seed)
        )
        scenarios.append(made)
        if ready is not None:
            ready(k + 1, params.validation_episodes)
    return scenarios


def _difficulty(params: ScenarioParams) -> Difficulty | None:
    """The random ports to draw from, unless the worlds are those of a named scenario."""
    if params.testbed and TESTBEDS[params.testbed]:
        return None
    return load_difficulty(params.testbed or params.difficulty)
