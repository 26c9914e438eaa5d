"""The one table of local planners by name, as `portnav evaluate --planner` takes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

from portnav_ros.baselines import ppo_policy
from portnav_ros.baselines.dwa import DynamicWindow
from portnav_ros.baselines.foresight import ForesightPolicy
from portnav_ros.baselines.line_of_sight import LineOfSight
from portnav_ros.baselines.space_time import SpaceTime
from portnav_ros.muzero.model_file import Model, load_model, released_model
from portnav_ros.muzero.policy import load_policy
from portnav_ros.sim.scenario import Scenario
from portnav_ros.task.policy import Policy
from portnav_ros.training.foresight import Extrapolation


class EvaluationError(ValueError):
    """An evaluation cannot be run; the message names the option and the mend."""


@runtime_checkable
class Privileged(Protocol):
    """A policy that is told what no sensor tells, to learn how solvable a scenario is."""

    def prepare(self, b: int, scenario: Scenario) -> None:
        """Look into the scenario that begins in slot b."""


@dataclass(frozen=True)
class ModelOptions:
    """What the learned planners sail with; the others need none of it.

    file: the model, the released one where None. simulations: of each search, in place of the model's own
    number. allow_mismatch: only warn where the model was trained for another vessel.
    """

    file: Path | None = None
    simulations: int | None = None
    allow_mismatch: bool = False


NO_OPTIONS = ModelOptions()


def _dwa(scenario: Scenario, options: ModelOptions) -> Policy:
    return DynamicWindow(scenario.vessel, scenario.autopilot)


def _line_of_sight(scenario: Scenario, options: ModelOptions) -> Policy:
    return LineOfSight()


def _ceiling(scenario: Scenario, options: ModelOptions) -> Policy:
    return SpaceTime()


def _foresight(scenario: Scenario, options: ModelOptions) -> Policy:
    return ForesightPolicy()


def _extrapolation(scenario: Scenario, options: ModelOptions) -> Policy:
    return ForesightPolicy(look_ahead=Extrapolation)


def _muzero(scenario: Scenario, options: ModelOptions) -> Policy:
    file = options.file or released_model('muzero')
    return load_policy(file, scenario.vessel, scenario.lidar, options.simulations, options.allow_mismatch)


def _prior(scenario: Scenario, options: ModelOptions) -> Policy:
    return _muzero(scenario, replace(options, simulations=0))


def _ppo(scenario: Scenario, options: ModelOptions) -> Policy:
    file = options.file or released_model('ppo')
    return ppo_policy.load_policy(file, scenario.vessel, scenario.lidar, options.allow_mismatch)


PLANNERS: dict[str, Callable[[Scenario, ModelOptions], Policy]] = {
    'dwa': _dwa,
    'line_of_sight': _line_of_sight,
    'extrapolation': _extrapolation,  # knows place and velocity of what is in sight
    'foresight': _foresight,  # knows the future of what is in sight
    'ceiling': _ceiling,
    'muzero': _muzero,
    'prior': _prior,  # MuZero's policy network without the search
    'ppo': _ppo,
}
WITHOUT_NODE = ('extrapolation', 'foresight', 'ceiling', 'prior')  # sailed by evaluations alone
ALGORITHMS = {'muzero': 'muzero', 'prior': 'muzero', 'ppo': 'ppo'}  # of the learned ones


def make_planner(name: str, scenario: Scenario, options: ModelOptions = NO_OPTIONS) -> Policy:
    """Build a planner for the vessel, autopilot and sensor of a scenario.

    Raises:
        EvaluationError: no planner has this name.
        ModelError: its model is missing or does not fit.
    """
    if name not in PLANNERS:
        raise EvaluationError(f'no planner {name!r}; there are {", ".join(PLANNERS)}')
    return PLANNERS[name](scenario, options)


def model_of(name: str, options: ModelOptions) -> Model | None:
    """The model that a planner sails with; None for one that learns nothing.

    Raises:
        ModelError: there is no model.
    """
    return load_model(options.file or released_model(ALGORITHMS[name])) if name in ALGORITHMS else None


def identify(name: str, options: ModelOptions) -> dict[str, object] | None:
    """What tells the model that a planner sails with from others; None for one that learns nothing.

    Raises:
        ModelError: there is no model.
    """
    model = model_of(name, options)
    if model is None:
        return None
    simulations = model.card.search.get('simulations') if options.simulations is None else options.simulations
    return {
        'file': str(model.path),
        'sha256': model.sha256,
        'simulations': simulations if name == 'muzero' else 0,
        'training': dict(model.card.training),
    }
