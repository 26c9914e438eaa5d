"""The closest that the hull came to anything."""

from __future__ import annotations

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog


def least_clearance_m(log: EpisodeLog) -> float:
    """Least gap in m between the hull and a quay, buoy or vessel; NaN where it was not recorded."""
    if log.clearance is None:
        return float('nan')
    known = log.clearance[np.isfinite(log.clearance)]
    return float(known.min()) if len(known) else float('nan')
