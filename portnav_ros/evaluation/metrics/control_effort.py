"""How hard rudder and propulsion worked."""

from __future__ import annotations

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.types import RUDDER, THRUST


def control_effort(log: EpisodeLog) -> float:
    """Mean over the rows of half the squared shares of full rudder and full thrust: 0 idle, 1 flat out.

    NaN where rudder and thrust were not recorded.
    """
    rudder = log.own[:, RUDDER] / log.vessel.rudder_max_rad
    thrust = log.own[:, THRUST] / log.vessel.thrust_max_n
    return float(np.mean(0.5 * (rudder**2 + thrust**2)))
