"""Ranging sensor: rays cast against quays, buoys and hulls.

An edge is tested only against the rays whose angles it spans, so that a scan costs the rays that
hit something, not rays times edges.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.geometry import TWO_PI
from portnav_ros.types import Array, Array32


class Sensor(NamedTuple):
    """LidarParams as scalars for compiled code."""

    range_min_m: float
    range_max_m: float
    noise_m: float
    drop_out: float


def ray_directions(rays: int) -> Array:
    """Unit vectors [R, 2] of the rays in the body frame; the first looks astern (-pi)."""
    angles = -math.pi + TWO_PI / rays * np.arange(rays)
    return np.column_stack([np.cos(angles), np.sin(angles)])


@njit(cache=True, nogil=True)
def cast_edge(rays: Array, ranges: Array32, x0: float, y0: float, x1: float, y1: float) -> None:
    """Shorten the rays that meet an edge given in the body frame, seen with its left side.

    rays: [R, 2] from `ray_directions`. ranges: [R] m, changed in place. The edge runs from (x0, y0)
    to (x1, y1), forward and left in m.
    """
    across = x0 * y1 - y0 * x1
    if across <= 0.0:
        return
    count = len(ranges)
    per_radian = count / TWO_PI
    first = math.ceil((math.atan2(y0, x0) + math.pi) * per_radian)
    last = math.floor((math.atan2(y1, x1) + math.pi) * per_radian)
    if last < first - 1:
        last += count
    ex, ey = x1 - x0, y1 - y0
    for k in range(first, last + 1):
        i = k if k < count else k - count
        toward = rays[i, 0] * ey - rays[i, 1] * ex
        if toward > 0.0:
            distance = across / toward
            if distance < ranges[i]:
                ranges[i] = distance


@njit(cache=True, nogil=True)
def cast_disc(rays: Array, ranges: Array32, x: float, y: float, radius: float) -> None:
    """Shorten the rays that meet a disc with its centre at (x, y) in the body frame."""
    squared = x * x + y * y - radius * radius
    if squared <= 0.0:
        ranges[:] = 0.0
        return
    count = len(ranges)
    per_radian = count / TWO_PI
    middle = (math.atan2(y, x) + math.pi) * per_radian
    spread = math.asin(radius / math.sqrt(x * x + y * y)) * per_radian
    for k in range(math.ceil(middle - spread), math.floor(middle + spread) + 1):
        i = k % count
        along = rays[i, 0] * x + rays[i, 1] * y
        inside = along * along - squared
        if inside >= 0.0:
            distance = along - math.sqrt(inside)
            if distance < ranges[i]:
                ranges[i] = distance


@njit(cache=True, nogil=True)
def hash_uniform(seed: int, first: int, second: int, third: int) -> float:
    """Uniform number in [0, 1) from a counter: no state, so the future can be read (splitmix64)."""
    z = np.uint64(seed)
    for counter in (first, second, third):
        z = (z ^ np.uint64(counter)) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0xD1B54A32D192ED03)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True, nogil=True)
def disturb(ranges: Array32, sensor: Sensor, seed: int, tick: int) -> None:
    """Turn true distances [R] into readings: noise, drop-outs and REP-117 limits."""
    for i in range(len(ranges)):
        if sensor.noise_m > 0.0 and ranges[i] < sensor.range_max_m:
            radius = math.sqrt(-2.0 * math.log(1.0 - hash_uniform(seed, tick, i, 1)))
            ranges[i] += sensor.noise_m * radius * math.cos(TWO_PI * hash_uniform(seed, tick, i, 2))
        lost = sensor.drop_out > 0.0 and hash_uniform(seed, tick, i, 3) < sensor.drop_out
        if lost or ranges[i] >= sensor.range_max_m:
            ranges[i] = np.inf
        elif ranges[i] < sensor.range_min_m:
            ranges[i] = -np.inf
