"""Wall time that the local planner takes for a decision."""

from __future__ import annotations

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog


def latency_p50_s(log: EpisodeLog) -> float:
    """Median decision time in s; NaN where it was not recorded."""
    return _quantile(log, 0.5)


def latency_p99_s(log: EpisodeLog) -> float:
    """99th percentile of the decision time in s; NaN where it was not recorded."""
    return _quantile(log, 0.99)


def _quantile(log: EpisodeLog, share: float) -> float:
    return float(np.quantile(log.latency_s, share)) if len(log.latency_s) else float('nan')
