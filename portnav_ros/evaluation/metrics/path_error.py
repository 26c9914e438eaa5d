"""Mean absolute line-of-sight path errors over the decisions of an episode."""

from __future__ import annotations

from portnav_ros.evaluation.episode_log import EpisodeLog


def mean_abs_e_x_m(log: EpisodeLog) -> float:
    """Mean |e_x| in m, along the hull."""
    return _mean_abs(log, 0)


def mean_abs_e_y_m(log: EpisodeLog) -> float:
    """Mean |e_y| in m, across the hull."""
    return _mean_abs(log, 1)


def mean_abs_e_psi_rad(log: EpisodeLog) -> float:
    """Mean |e_psi| in rad, heading against the bearing to the look-ahead point."""
    return _mean_abs(log, 2)


def _mean_abs(log: EpisodeLog, column: int) -> float:
    return float(abs(log.errors[:, column]).mean())
