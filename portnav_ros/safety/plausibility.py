"""Whether what a sensor says can be true: it goes on sending, but is it still looking?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from portnav_ros.geometry import wrap_angle
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.safety.zones import returned, scan_points
from portnav_ros.types import Array, Scan, VesselState


@dataclass(frozen=True)
class PlausibilityParams:
    """When a sensor is not believed.

    least_returns: distances in a scan; 0 on open water, where nothing may be in reach. frozen_m: how far the
    returns of a repeated scan should have moved before it counts as frozen, and how far the vessel should
    have come before its pose does. jump_m, jump_rad: how far a pose may be from where speed and yaw rate have
    taken it.
    """

    least_returns: int = 1
    frozen_m: float = 1.0
    jump_m: float = 10.0
    jump_rad: float = 0.5
    ranges: ClassVar[Ranges] = {
        'least_returns': (0, 4096),
        'frozen_m': (0.01, 100.0),
        'jump_m': (0.1, 1000.0),
        'jump_rad': (0.01, math.pi),
    }

    def __post_init__(self) -> None:
        """Refuse limits that make no sense."""
        check_ranges(self)


class ScanSeen(NamedTuple):
    """A scan, and the pose [3] x, y in m and yaw in rad (map) from which its ranges were first seen."""

    scan: Scan
    pose: tuple[float, float, float]


class OdometrySeen(NamedTuple):
    """A state, its time, and how far the vessel should have come since its pose last changed."""

    state: VesselState
    time_s: float
    unmoved_m: float = 0.0


def ray_misfit(scan: Scan, rays: int) -> str:
    """Say how a scan's rays differ from `rays` all around, the first astern; empty where they do not."""
    if len(scan.ranges) != rays:
        return f'{len(scan.ranges)} rays, expected {rays} (lidar.rays)'
    step = 2.0 * math.pi / rays
    turned, spread = wrap_angle(scan.angle_min_rad + math.pi), rays * (scan.angle_increment_rad - step)
    if max(abs(turned), abs(spread)) <= 0.5 * step:
        return ''
    return (
        f'angle_min {scan.angle_min_rad:.4f}, angle_increment {scan.angle_increment_rad:.4f}: expected '
        f'{-math.pi:.4f} (astern) and {step:.4f} (all around, counter-clockwise)'
    )


def judge_scan(
    params: PlausibilityParams, seen: ScanSeen | None, scan: Scan, state: VesselState
) -> tuple[ScanSeen, str]:
    """Judge a scan by the one before and by how the vessel has moved.

    A scan whose ranges repeat to the bit is frozen once its returns should have moved: those of a straight
    quay, along which the vessel sails, may repeat.

    Returns:
        What to hand over with the next scan, and why this one is not believed, or nothing.
    """
    pose = state.x_m, state.y_m, state.yaw_rad
    if np.count_nonzero(np.isfinite(scan.ranges)) < params.least_returns:  # too close is a cover, perhaps
        return ScanSeen(scan, pose), f'scan with fewer than {params.least_returns} returns'
    if seen is None or seen.scan.ranges.tobytes() != scan.ranges.tobytes():
        return ScanSeen(scan, pose), ''
    frozen = _displacement_m(scan, seen.pose, pose) > params.frozen_m
    return seen, 'scan frozen' if frozen else ''


def judge_odometry(
    params: PlausibilityParams, seen: OdometrySeen | None, state: VesselState, time_s: float
) -> tuple[OdometrySeen, str]:
    """Judge an odometry by the one before.

    Returns:
        What to hand over with the next one, and why this one is not believed, or nothing.
    """
    if seen is None or time_s <= seen.time_s:
        return OdometrySeen(state, time_s), ''
    last, step_s = seen.state, time_s - seen.time_s
    way_m = max(abs(last.surge_mps), abs(state.surge_mps)) * step_s
    turn_rad = max(abs(last.yaw_rate_radps), abs(state.yaw_rate_radps)) * step_s
    moved_m = math.hypot(state.x_m - last.x_m, state.y_m - last.y_m)
    turned_rad = abs(wrap_angle(state.yaw_rad - last.yaw_rad))
    unmoved_m = 0.0 if moved_m > 0.0 else seen.unmoved_m + way_m
    now = OdometrySeen(state, time_s, unmoved_m)
    if moved_m > way_m + params.jump_m or turned_rad > turn_rad + params.jump_rad:
        return now, 'odometry jumped'
    return now, 'odometry frozen' if unmoved_m > params.frozen_m else ''


def _displacement_m(scan: Scan, before: tuple[float, float, float], now: tuple[float, float, float]) -> float:
    """How far the returns, seen again after a motion, would lie from the outline that the scan draws.

    The outline joins the returns of neighbouring rays; a return that has moved to a bearing where there is
    none is left out.
    """
    points = scan_points(scan)
    moved = _seen_from(points, before, now)
    count = len(scan.ranges)
    bearing = np.arctan2(moved[:, 1], moved[:, 0]) - scan.angle_min_rad
    ray = np.floor(np.mod(bearing, 2.0 * math.pi) / scan.angle_increment_rad).astype(np.int64)
    known = (ray >= 0) & (ray < count)
    index = np.full(count + 1, -1)
    index[np.flatnonzero(returned(scan))] = np.arange(len(points))
    index[count] = index[0]
    first, second = index[ray[known]], index[ray[known] + 1]
    joined = (first >= 0) & (second >= 0)
    a, b, p = points[first[joined]], points[second[joined]], moved[known][joined]
    along = b - a
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    gap = np.abs(along[:, 0] * (p - a)[:, 1] - along[:, 1] * (p - a)[:, 0]) / length
    return float(gap.max(initial=0.0))


def _seen_from(points: Array, before: tuple[float, float, float], now: tuple[float, float, float]) -> Array:
    """Points [N, 2] of a body frame in that of a later pose."""
    (x0, y0, yaw0), (x1, y1, yaw1) = before, now
    cosine, sine = math.cos(yaw0 - yaw1), math.sin(yaw0 - yaw1)
    back_c, back_s = math.cos(yaw1), math.sin(yaw1)
    shift = back_c * (x0 - x1) + back_s * (y0 - y1), back_c * (y0 - y1) - back_s * (x0 - x1)
    turned = np.column_stack(
        [cosine * points[:, 0] - sine * points[:, 1], sine * points[:, 0] + cosine * points[:, 1]]
    )
    return np.asarray(turned + shift)
