"""Local planner: the learned policy. It refuses to start without a model and falls back to nothing."""

from __future__ import annotations

from typing import Any

from portnav_ros.muzero.policy import load_policy
from portnav_ros.nodes.local_planner import LocalPlanner, PlannerParams
from portnav_ros.nodes.runtime import run_node
from portnav_ros.resources import share_directory
from portnav_ros.task.policy import Policy

NAME = 'muzero_planner'
MODEL = 'muzero.safetensors'


def make_policy(params: PlannerParams) -> Policy:
    """Return the released policy.

    Raises:
        ModelError: there is no model.
    """
    return load_policy(share_directory() / 'models' / MODEL)


def make_node(**options: Any) -> LocalPlanner:
    """Return the node."""
    return LocalPlanner(NAME, make_policy, **options)


def main() -> int:
    """Run the node."""
    return run_node(make_node)


if __name__ == '__main__':
    raise SystemExit(main())
