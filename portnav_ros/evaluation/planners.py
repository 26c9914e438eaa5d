"""The one table of local planners by name, as `portnav evaluate --planner` takes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from portnav_ros.baselines.dwa import DynamicWindow
from portnav_ros.baselines.line_of_sight import LineOfSight
from portnav_ros.baselines.space_time import SpaceTime
from portnav_ros.sim.scenario import Scenario
from portnav_ros.task.policy import Policy


class EvaluationError(ValueError):
    """An evaluation cannot be run; the message names the option and the mend."""


@runtime_checkable
class Privileged(Protocol):
    """A policy that is told what no sensor tells, to learn how solvable a scenario is."""

    def prepare(self, b: int, scenario: Scenario) -> None:
        """Look into the scenario that begins in slot b."""


def _dwa(scenario: Scenario) -> Policy:
    return DynamicWindow(scenario.vessel, scenario.autopilot)


def _line_of_sight(scenario: Scenario) -> Policy:
    return LineOfSight()


def _ceiling(scenario: Scenario) -> Policy:
    return SpaceTime()


def _muzero(scenario: Scenario) -> Policy:
    raise EvaluationError('planner muzero: no model is released yet; use dwa or line_of_sight')


PLANNERS: dict[str, Callable[[Scenario], Policy]] = {
    'dwa': _dwa,
    'line_of_sight': _line_of_sight,
    'ceiling': _ceiling,
    'muzero': _muzero,
}


def make_planner(name: str, scenario: Scenario) -> Policy:
    """Build a planner for the vessel, autopilot and sensor of a scenario.

    Raises:
        EvaluationError: no planner has this name.
    """
    if name not in PLANNERS:
        raise EvaluationError(f'no planner {name!r}; there are {", ".join(PLANNERS)}')
    return PLANNERS[name](scenario)
