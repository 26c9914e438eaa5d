"""How often the rudder changed its mind: wear of the gear, and a sign of hunting."""

from __future__ import annotations

import math

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.types import RUDDER, Array

DEAD_BAND_RAD = math.radians(2.0)


def rudder_reversals_per_min(log: EpisodeLog) -> float:
    """Reversals of the rudder's motion per minute; NaN without duration, or where it was not recorded."""
    if log.length_s <= 0.0 or np.isnan(log.own[:, RUDDER]).any():
        return float('nan')
    return 60.0 * count_reversals(log.own[:, RUDDER], DEAD_BAND_RAD) / log.length_s


def count_reversals(angle_rad: Array, dead_band_rad: float) -> int:
    """Count turning points of a signal [T], leaving out swings within a dead band."""
    count, direction = 0, 0
    extreme = float(angle_rad[0])
    for angle in map(float, angle_rad):
        swing = angle - extreme
        if direction * swing > 0.0:
            extreme = angle
        elif abs(swing) > dead_band_rad:
            count += direction != 0
            direction = 1 if swing > 0.0 else -1
            extreme = angle
    return count
