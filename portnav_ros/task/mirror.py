"""Port and starboard exchanged: the physics does not know one from the other, so neither should a learner."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from portnav_ros.params import ParamError
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.tracking import MIRRORED_SIGN, MIRRORED_TRACK, TRACK_SIZE
from portnav_ros.types import AnyArray, Array32, IntArray


class Mirror(NamedTuple):
    """features[..., feature] * sign are the features of the mirrored scene; action[a] is a's mirror image."""

    feature: IntArray  # [F]
    sign: Array32  # [F]
    action: IntArray  # [A]

    def features(self, values: AnyArray) -> AnyArray:
        """Mirror features [..., F]."""
        return np.asarray(values[..., self.feature] * self.sign.astype(values.dtype))


def mirror_of(observation: ObservationParams, actions: ActionParams) -> Mirror:
    """Tell how features and actions of a task are mirrored.

    Raises:
        ParamError: stacked scans, whose sectors are not symmetric, or a lopsided grid of actions.
    """
    if observation.layout != 'aligned':
        raise ParamError('layout: only aligned observations can be mirrored')
    heading = np.array(actions.heading_change_rad)
    if not np.allclose(heading, -heading[::-1]):
        raise ParamError('heading_change_rad is not symmetric, so actions cannot be mirrored')
    speeds = len(actions.speed_mps)
    number = np.arange(actions.count)
    mirrored = (len(heading) - 1 - number // speeds) * speeds + number % speeds
    scans = len(observation.ages) * observation.sectors
    feature = np.arange(observation.size)
    feature[:scans] = feature[:scans].reshape(-1, observation.sectors)[:, ::-1].ravel()
    sign = np.ones(observation.size, np.float32)
    yaw_rate, e_y, e_psi, first_point = scans + 1, scans + 3, scans + 4, scans + 5
    setpoint = first_point + 2 * observation.path_points
    sign[[yaw_rate, e_y, e_psi, setpoint]] = -1.0
    sign[first_point + 1 : setpoint : 2] = -1.0
    first_track = observation.size - observation.tracks * TRACK_SIZE
    feature[first_track:] = feature[first_track:].reshape(-1, TRACK_SIZE)[:, MIRRORED_TRACK].ravel()
    sign[first_track:] = np.tile(MIRRORED_SIGN, observation.tracks)
    return Mirror(feature, sign, mirrored)
