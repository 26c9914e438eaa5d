"""How long an episode took."""

from __future__ import annotations

from portnav_ros.evaluation.episode_log import EpisodeLog


def length_s(log: EpisodeLog) -> float:
    """Simulated time in s from the start to the outcome."""
    return log.length_s
