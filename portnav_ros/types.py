"""Values that flow between the stages: SI units, map frame ENU, yaw counter-clockwise from east."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
AnyArray = NDArray[Any]

# Columns of a vessel's state row, as the kernels hold it: own[B, 7].
X, Y, YAW, SURGE, YAW_RATE, RUDDER, THRUST = range(7)
STATE_SIZE = 7


class VesselState(NamedTuple):
    """Own ship: pose in the map frame, surge and yaw rate in the body frame, actuator feedback."""

    x_m: float
    y_m: float
    yaw_rad: float
    surge_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    rudder_rad: float = 0.0
    thrust_n: float = 0.0


class Setpoint(NamedTuple):
    """What a local planner asks of the autopilot."""

    yaw_rad: float
    speed_mps: float


class Actuation(NamedTuple):
    """What the autopilot asks of the vessel; rudder positive turns the bow to port."""

    rudder_rad: float
    thrust_n: float


class Scan(NamedTuple):
    """One sweep of the ranging sensor.

    ranges: [R] m, float32; +inf no return, -inf too close, NaN invalid (REP-117). Ray i points at
    ``angle_min_rad + i * angle_increment_rad`` in the body frame, counter-clockwise from the bow.
    """

    ranges: Array32
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float


class Outcome(IntEnum):
    """How an episode stands; every value but RUNNING ends it."""

    RUNNING = 0
    SUCCESS = 1
    COLLISION_QUAY = 2
    COLLISION_BUOY = 3
    COLLISION_VESSEL = 4
    TIMEOUT = 5

    @property
    def collision(self) -> bool:
        """True for the three kinds of collision."""
        return Outcome.COLLISION_QUAY <= self <= Outcome.COLLISION_VESSEL
