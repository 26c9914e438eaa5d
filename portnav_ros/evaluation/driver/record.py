"""What was heard of a vessel's driver: samples of its topics, its ends in the graph, and the moves it was led
through. No ROS in here, so that every check can be tried on made-up data.

Times are in s of the driver's own clock: ``stamp_s`` from the header, ``heard_s`` when the message came in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation, Array, Array32
from portnav_ros.vessel import VesselParams


class Finding(NamedTuple):
    """What one check saw, and how to mend it where it failed; ``left out`` could not be told."""

    check: str
    status: Literal['ok', 'fail', 'left out']
    found: str
    mend: str = ''


class End(NamedTuple):
    """A publisher or subscription of another node. mismatch: why its QoS does not meet the stack's."""

    node: str
    type: str
    mismatch: str = ''


class OdometrySample(NamedTuple):
    """One Odometry. position: x, y in m. velocity: x, y in m/s as sent, body frame if the driver is right.

    covariances: [2, 6] variances on the diagonals of pose and twist.
    """

    stamp_s: float
    heard_s: float
    frame: str
    child_frame: str
    position: tuple[float, float]
    quaternion: tuple[float, float, float, float]
    velocity: tuple[float, float]
    yaw_rate_radps: float
    variances: Array


class ScanSample(NamedTuple):
    """One LaserScan; ranges: [R] m."""

    stamp_s: float
    heard_s: float
    frame: str
    ranges: Array32
    angle_min_rad: float
    angle_increment_rad: float
    time_increment_s: float
    range_min_m: float
    range_max_m: float


class JointSample(NamedTuple):
    """One JointState. actuation: None where it has not the form of the contract; fault tells why."""

    stamp_s: float
    heard_s: float
    actuation: Actuation | None
    fault: str = ''


class TrackSample(NamedTuple):
    """One message of ``targets``."""

    stamp_s: float
    heard_s: float
    frame: str
    child_frame: str


@dataclass
class DriverRecord:
    """Everything heard within one listening.

    publishers, subscriptions: ends by topic, our own left out. services: name to type, of the driver's node.
    driver: full name of the node that drives the actuators. begin_s, end_s: of the listening. clock_s: heard
    on clock.
    """

    publishers: dict[str, list[End]] = field(default_factory=dict)
    subscriptions: dict[str, list[End]] = field(default_factory=dict)
    services: dict[str, str] = field(default_factory=dict)
    driver: str = ''
    begin_s: float = 0.0
    end_s: float = 0.0
    clock_s: list[float] = field(default_factory=list)
    odometry: list[OdometrySample] = field(default_factory=list)
    scans: list[ScanSample] = field(default_factory=list)
    joints: list[JointSample] = field(default_factory=list)
    targets: list[TrackSample] = field(default_factory=list)

    @property
    def simulated(self) -> bool:
        """Whether time is what somebody publishes."""
        return bool(self.clock_s)


class Expected(NamedTuple):
    """The vessel and the sensor that the stack will be told of."""

    vessel: VesselParams
    lidar: LidarParams


Check = Callable[[DriverRecord, Expected], Finding]


class Move(NamedTuple):
    """One thing that the vessel was led to do, from begin_s to end_s; command None: nothing was sent."""

    name: str
    begin_s: float
    end_s: float
    command: Actuation | None


@dataclass(frozen=True)
class Motion:
    """Odometry as arrays [T]: times, positions [T, 2] in map, unwrapped yaw, velocities [T, 2] as sent."""

    stamp_s: Array
    position: Array
    yaw_rad: Array
    velocity: Array
    yaw_rate_radps: Array


def motion(samples: list[OdometrySample]) -> Motion:
    """Return odometry samples as arrays, in the order of their stamps, each stamp once."""
    _, order = np.unique([sample.stamp_s for sample in samples], return_index=True)
    chosen = [samples[k] for k in order]
    x, y, z, w = np.array([sample.quaternion for sample in chosen]).reshape(-1, 4).T
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return Motion(
        np.array([sample.stamp_s for sample in chosen]),
        np.array([sample.position for sample in chosen]).reshape(-1, 2),
        np.unwrap(yaw),
        np.array([sample.velocity for sample in chosen]).reshape(-1, 2),
        np.array([sample.yaw_rate_radps for sample in chosen]),
    )
