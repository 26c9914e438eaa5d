"""Where the ranging sensor is mounted: what it sees, told from the middle of the hull."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from portnav_ros.geometry import TWO_PI
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.safety.zones import scan_points
from portnav_ros.types import Array, Scan


@dataclass(frozen=True)
class Mounting:
    """Pose of lidar_link in base_link.

    x_m: ahead of the middle of the hull. y_m: to port of it. yaw_rad: counter-clockwise from the bow, of the
    sensor's own zero direction.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    ranges: ClassVar[Ranges] = {
        'x_m': (-250.0, 250.0),
        'y_m': (-40.0, 40.0),
        'yaw_rad': (-3.1416, 3.1416),  # pi, as people write it
    }

    def __post_init__(self) -> None:
        """Refuse places that are on no vessel."""
        check_ranges(self)

    def points(self, scan: Scan) -> Array:
        """Return the returns of a scan [N, 2] in the body frame in m."""
        points = scan_points(scan, self.yaw_rad)
        points += self.x_m, self.y_m
        return points

    def centred(self, scan: Scan) -> Scan:
        """Return the scan of a sensor in the middle of the hull, with the same rays.

        Each return goes to the ray that points closest to it, the nearest of them where there are several.
        What stands behind something is not seen from the other place, and near things leave gaps between
        their returns; the scan of a sensor that is in the middle comes back as it is.
        """
        if self == Mounting():
            return scan
        points = self.points(scan)
        bearing = np.arctan2(points[:, 1], points[:, 0]) - scan.angle_min_rad
        ray = np.rint(np.mod(bearing, TWO_PI) / scan.angle_increment_rad).astype(np.int64) % len(scan.ranges)
        ranges = np.full(len(scan.ranges), np.inf, np.float32)
        np.minimum.at(ranges, ray, np.hypot(points[:, 0], points[:, 1]).astype(np.float32))
        return scan._replace(ranges=ranges)
