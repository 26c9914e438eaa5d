"""A scenario: everything that decides an episode. The same object runs in process and through ROS."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, NamedTuple

import numpy as np

from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.harbour import Harbour
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import Array, Array32, IntArray
from portnav_ros.vessel import VesselParams


class ScenarioError(ValueError):
    """A scenario cannot be made or used; the message names the file, the key and the mend."""


class Arrival(IntEnum):
    """What a vessel does at the end of its track."""

    RESPAWN = 0  # takes a new track that departs from where it arrived
    STOP = 1  # lies still
    VANISH = 2  # is gone


@dataclass(frozen=True)
class LidarParams:
    """The ranging sensor: rays over 360 degrees, the first at -pi in the body frame.

    rays: of one scan. range_max_m: beyond which nothing returns. range_min_m: below which an echo is too
    close to be told. noise_m: standard deviation of a range. drop_out: share of rays without a return.
    """

    rays: int = 180
    range_max_m: float = 400.0
    range_min_m: float = 0.5
    noise_m: float = 0.0
    drop_out: float = 0.0
    ranges: ClassVar[Ranges] = {
        'rays': (8, 4096),
        'range_max_m': (1.0, 5000.0),
        'range_min_m': (0.0, 100.0),
        'noise_m': (0.0, 100.0),
        'drop_out': (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        """Refuse values that no sensor has."""
        check_ranges(self)


class Tracks(NamedTuple):
    """Where other vessels can sail: N tracks between nodes (berths), as sailed by a hull.

    points: [P, 3] float32, x, y in m and yaw in rad (unwrapped along a track), TRACK_SPACING_M apart.
    offsets: [N + 1] first point of each track. origin, destination: [N] node numbers.
    """

    points: Array32
    offsets: IntArray
    origin: IntArray
    destination: IntArray


TRACK_SPACING_M = 10.0


@dataclass(frozen=True)
class Traffic:
    """Other vessels [M]: constant speed along tracks, not reactive.

    hull: [M, 2] length and beam in m. speed: [M] m/s. track: [M] the track each starts on.
    progress: [M] m along it. seed: draws the next track at each arrival, and the sensor's noise; without
    a vessel the scenario's seed draws the noise.
    """

    tracks: Tracks
    hull: Array
    speed: Array
    track: IntArray
    progress: Array
    arrival: Arrival = Arrival.RESPAWN
    seed: int = 0

    def __len__(self) -> int:
        return len(self.speed)


def no_traffic() -> Traffic:
    """Traffic without a vessel."""
    tracks = Tracks(
        np.zeros((1, 3), np.float32), np.array([0, 1]), np.zeros(1, np.int64), np.zeros(1, np.int64)
    )
    return Traffic(tracks, np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0))


@dataclass(frozen=True)
class Scenario:
    """One episode's world.

    start: x, y in m, yaw in rad. goal: x, y in m. path: [W, 2] m, the global path at a fixed spacing
    of PATH_SPACING_M, or None where a planner is still to be asked.
    """

    name: str
    seed: int
    harbour: Harbour
    start: tuple[float, float, float]
    goal: tuple[float, float]
    traffic: Traffic = field(default_factory=no_traffic)
    path: Array | None = None
    start_speed_mps: float = 0.0
    goal_radius_m: float = 50.0
    time_limit_s: float = 900.0
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    lidar: LidarParams = field(default_factory=LidarParams)


PATH_SPACING_M = 10.0
