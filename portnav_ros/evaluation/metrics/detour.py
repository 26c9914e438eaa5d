"""How much longer the sailed track is than the plan was at first."""

from __future__ import annotations

import math

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.geometry import polyline_lengths
from portnav_ros.types import Array, Outcome, X, Y


def path_over_plan(log: EpisodeLog) -> float:
    """Sailed length plus what was left to the goal, over the length of the first plan.

    1 for a track that follows its plan; NaN unless the goal was reached, since a track cut short
    by a collision says nothing about detours, where the goal was another one before, and for a plan
    without length.
    """
    if log.outcome != Outcome.SUCCESS or log.goal_moved:
        return float('nan')
    plan = log.earlier_plans[0].path if log.earlier_plans else log.path
    planned = float(polyline_lengths(plan)[-1])
    if planned <= 0.0:
        return float('nan')
    left = math.hypot(log.goal[0] - log.own[-1, X], log.goal[1] - log.own[-1, Y])
    return (sailed_m(log.own) + left) / planned


def sailed_m(own: Array) -> float:
    """Length in m of a track of state rows [T, 7]."""
    return float(np.hypot(*np.diff(own[:, [X, Y]], axis=0).T).sum())
