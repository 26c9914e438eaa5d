"""The learned local planner: reads a released model. No model is released yet."""

from __future__ import annotations

from pathlib import Path

from portnav_ros.muzero import ModelError
from portnav_ros.task.policy import Policy


def load_policy(path: Path) -> Policy:
    """Read a model's weights and card.

    Raises:
        ModelError: there is none, or this version cannot run it.
    """
    if not path.exists():
        raise ModelError(
            f'{path}: no such model; none is released with this version in models/, '
            'so run dwa_planner or line_of_sight_planner instead'
        )
    raise ModelError(f'{path}: this version cannot run a MuZero model; run dwa_planner instead')
