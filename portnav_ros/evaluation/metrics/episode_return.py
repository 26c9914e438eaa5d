"""The undiscounted sum of the task's rewards."""

from __future__ import annotations

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.task.reward import RewardParams, reward_terms
from portnav_ros.types import Array, Outcome


def episode_return(log: EpisodeLog) -> float:
    """Return of an episode whose rows are a decision period apart."""
    return float(rewards(log).sum())


def rewards(log: EpisodeLog) -> Array:
    """Reward by term [T - 1, 5], in the order of task.reward.TERMS; row t is paid at ``time_s[t + 1]``."""
    outcome = np.full(len(log) - 1, Outcome.RUNNING, dtype=np.int64)
    outcome[-1:] = log.outcome
    return reward_terms(RewardParams(), log.errors[1:], outcome)
