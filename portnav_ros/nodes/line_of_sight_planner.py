"""Local planner: follows the path by line of sight, blind to everything else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from portnav_ros.baselines.line_of_sight import LineOfSight
from portnav_ros.nodes.local_planner import LocalPlanner
from portnav_ros.nodes.planner_params import PlannerParams
from portnav_ros.nodes.runtime import run_node
from portnav_ros.params import Ranges
from portnav_ros.task.policy import Policy

NAME = 'line_of_sight_planner'


@dataclass(frozen=True)
class LineOfSightParams(PlannerParams):
    """Parameters of the follower, besides those of every local planner.

    speed_mps: surge speed asked for at all times.
    """

    speed_mps: float = 5.0
    ranges: ClassVar[Ranges] = {**PlannerParams.ranges, 'speed_mps': (0.1, 50.0)}


DEFAULTS = LineOfSightParams()


def make_policy(params: LineOfSightParams) -> Policy:
    """Return the follower, which looks as far ahead as the observation does."""
    return LineOfSight(params.observation.lookahead_m, params.speed_mps)


def make_node(**options: Any) -> LocalPlanner:
    """Return the node."""
    return LocalPlanner(NAME, make_policy, DEFAULTS, **options)


def main() -> int:
    """Run the node."""
    return run_node(make_node)


if __name__ == '__main__':
    raise SystemExit(main())
