"""Local planner: dynamic window approach on the scan."""

from __future__ import annotations

from typing import Any

from portnav_ros.baselines.dwa import DynamicWindow
from portnav_ros.nodes.local_planner import LocalPlanner
from portnav_ros.nodes.planner_params import PlannerParams
from portnav_ros.nodes.runtime import run_node
from portnav_ros.task.policy import Policy

NAME = 'dwa_planner'
DEFAULTS = PlannerParams()


def make_policy(params: PlannerParams) -> Policy:
    """Return the planner for a vessel and its autopilot."""
    return DynamicWindow(params.vessel, params.autopilot)


def make_node(**options: Any) -> LocalPlanner:
    """Return the node."""
    return LocalPlanner(NAME, make_policy, DEFAULTS, **options)


def main() -> int:
    """Run the node."""
    return run_node(make_node)


if __name__ == '__main__':
    raise SystemExit(main())
