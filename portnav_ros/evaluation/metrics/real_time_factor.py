"""How much faster than the real world an episode ran."""

from __future__ import annotations

from portnav_ros.evaluation.episode_log import EpisodeLog


def real_time_factor(log: EpisodeLog) -> float:
    """Simulated time over wall time; NaN where the wall time was not recorded."""
    return log.length_s / log.wall_s if log.wall_s > 0.0 else float('nan')
