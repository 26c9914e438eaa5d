"""Compiled kernels that write the features of B vessels, row by row; `observation.Observer` calls them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.geometry import to_body, wrap_angle
from portnav_ros.sim.scenario import PATH_SPACING_M
from portnav_ros.task.aligned import ScanMemory, write_aligned
from portnav_ros.task.path_errors import advance, path_errors, path_point
from portnav_ros.task.tracking import write_tracks
from portnav_ros.types import SURGE, YAW, YAW_RATE, Array, Array32, BoolArray, IntArray, X, Y


class Scales(NamedTuple):
    """`observation.ObservationParams` and the sensor's reach as scalars for compiled code."""

    sectors: int
    path_points: int
    path_step: float
    lookahead_m: float
    range_m: float
    position_m: float
    speed_mps: float
    yaw_rate_radps: float
    heading_change_rad: float
    remaining_m: float


@njit(cache=True, nogil=True)
def locate(
    lookahead_m: float,
    own: Array,
    path: Array,
    count: IntArray,
    progress: Array,
    errors: Array,
    which: BoolArray,
) -> None:
    """Write how far along their paths the vessels `which` [B] are, and their path errors [B, 3]."""
    for b in np.flatnonzero(which):
        progress[b] = advance(path[b], count[b], progress[b], own[b, X], own[b, Y])
        errors[b] = path_errors(own[b], path[b], count[b], progress[b], lookahead_m)


@njit(cache=True, nogil=True)
def write_stacked_rows(
    scales: Scales,
    own: Array,
    ranges: Array32,
    setpoint: Array,
    path: Array,
    count: IntArray,
    progress: Array,
    errors: Array,
    last_yaw: Array,
    features: Array32,
    which: BoolArray,
) -> None:
    """Move the older frames [B, F] back by one and write the newest; a fresh vessel's are all alike."""
    frame = scales.sectors + 7 + 2 * scales.path_points
    frames = features.shape[1] // frame
    for b in np.flatnonzero(which):
        fresh = math.isnan(last_yaw[b])
        for f in range(frames - 1, 0, -1):
            features[b, f * frame : (f + 1) * frame] = features[b, (f - 1) * frame : f * frame]
        row = features[b, :frame]
        _pool(ranges[b], scales.range_m, row[: scales.sectors])
        at = _write_motion(scales, own[b], errors[b], row, scales.sectors)
        at = _write_path(scales, own[b], own[b, YAW], path[b], count[b], progress[b], row, at)
        row[at] = 0.0 if fresh else wrap_angle(setpoint[b, 0] - last_yaw[b]) / scales.heading_change_rad
        row[at + 1] = 0.0 if fresh else setpoint[b, 1] / scales.speed_mps
        if fresh:
            for f in range(1, frames):
                features[b, f * frame : (f + 1) * frame] = row


@njit(cache=True, nogil=True)
def write_aligned_rows(
    scales: Scales,
    ages: IntArray,
    memory: ScanMemory,
    tracks: Array,
    own: Array,
    setpoint: Array,
    path: Array,
    count: IntArray,
    progress: Array,
    errors: Array,
    fresh: BoolArray,
    features: Array32,
    which: BoolArray,
) -> None:
    """Closeness by age and sector, motion and errors, path points, setpoint, what remains, tracks.

    The setpoint is the one given at the last decision, its heading counted from the course.
    """
    for b in np.flatnonzero(which):
        course = own[b, YAW] - errors[b, 2]
        row, at = features[b], len(ages) * scales.sectors
        for k in range(len(ages)):
            sectors = row[k * scales.sectors : (k + 1) * scales.sectors]
            write_aligned(memory, b, ages[k], course, scales.range_m, sectors)
        at = _write_motion(scales, own[b], errors[b], row, at)
        at = _write_path(scales, own[b], course, path[b], count[b], progress[b], row, at)
        row[at] = 0.0 if fresh[b] else wrap_angle(setpoint[b, 0] - course) / scales.heading_change_rad
        row[at + 1] = 0.0 if fresh[b] else setpoint[b, 1] / scales.speed_mps
        row[at + 2] = (count[b] - 1 - progress[b]) * PATH_SPACING_M / scales.remaining_m
        if len(tracks):
            write_tracks(tracks[b], own[b], course, scales.range_m, scales.speed_mps, row[at + 3 :])


@njit(cache=True, nogil=True)
def _pool(ranges: Array32, range_max_m: float, out: Array32) -> None:
    """Least range of each of S sectors as a share of the sensor's reach; an invalid ray reads as far.

    Each of at least S rays belongs to one sector; where S does not divide them, some have one ray more.
    """
    rays, sectors = len(ranges), len(out)
    for s in range(sectors):
        least = range_max_m
        for i in range(s * rays // sectors, (s + 1) * rays // sectors):
            if ranges[i] < least:
                least = ranges[i]
        out[s] = max(least, 0.0) / range_max_m


@njit(cache=True, nogil=True)
def _write_motion(scales: Scales, own: Array, errors: Array, row: Array32, at: int) -> int:
    row[at] = own[SURGE] / scales.speed_mps
    row[at + 1] = own[YAW_RATE] / scales.yaw_rate_radps
    row[at + 2] = errors[0] / scales.position_m
    row[at + 3] = errors[1] / scales.position_m
    row[at + 4] = errors[2] / math.pi
    return at + 5


@njit(cache=True, nogil=True)
def _write_path(
    scales: Scales, own: Array, axis: float, path: Array, count: int, progress: float, row: Array32, at: int
) -> int:
    """Write points ahead on the path, seen from the vessel with x along the heading `axis`."""
    for k in range(scales.path_points):
        px, py = path_point(path, count, progress + (k + 1) * scales.path_step)
        x, y = to_body(own[X], own[Y], axis, px, py)
        row[at + 2 * k] = x / scales.range_m
        row[at + 2 * k + 1] = y / scales.range_m
    return at + 2 * scales.path_points
