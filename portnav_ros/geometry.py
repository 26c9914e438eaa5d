"""Angles, frames and polylines. Compiled functions work on scalars and on rows of arrays."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from portnav_ros.types import Array

TWO_PI = 2.0 * math.pi


@njit(cache=True, inline='always')
def wrap_angle(angle_rad: float) -> float:
    """Wrap an angle into [-pi, pi)."""
    return angle_rad - TWO_PI * math.floor((angle_rad + math.pi) / TWO_PI)


@njit(cache=True)
def to_body(x_m: float, y_m: float, yaw_rad: float, px_m: float, py_m: float) -> tuple[float, float]:
    """Express the map point (px, py) in the body frame (forward, left) of a pose."""
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    dx, dy = px_m - x_m, py_m - y_m
    return cosine * dx + sine * dy, cosine * dy - sine * dx


@njit(cache=True)
def segment_distance_squared(px: float, py: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Squared distance in m^2 from a point to a segment."""
    dx, dy = x1 - x0, y1 - y0
    length_squared = dx * dx + dy * dy
    along = 0.0
    if length_squared > 0.0:
        along = ((px - x0) * dx + (py - y0) * dy) / length_squared
        along = min(max(along, 0.0), 1.0)
    ex, ey = px - (x0 + along * dx), py - (y0 + along * dy)
    return ex * ex + ey * ey


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Yaw in [-pi, pi] of a unit quaternion, whatever its roll and pitch."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def polyline_lengths(points: Array) -> Array:
    """Arc length in m at each vertex of a polyline [W, 2]; the first is 0."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    return np.concatenate(([0.0], np.cumsum(steps)))


def resample_polyline(points: Array, spacing_m: float) -> Array:
    """Resample a polyline [W, 2] at a fixed arc spacing; both ends are kept."""
    lengths = polyline_lengths(points)
    count = max(math.ceil(lengths[-1] / spacing_m), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)
    return np.column_stack([np.interp(at, lengths, points[:, axis]) for axis in (0, 1)])


def spaced_polyline(points: Array, spacing_m: float) -> Array:
    """Return a polyline [W, 2] as it is where its points are about `spacing_m` apart, else resampled.

    The last segment may be short, and a chord in a bend is shorter than its arc.
    """
    steps = np.hypot(*np.diff(points, axis=0).T)
    if len(points) < 2 or not steps.any():
        return points
    even = steps.max() <= 1.05 * spacing_m and (len(steps) == 1 or steps[:-1].min() >= 0.5 * spacing_m)
    return points if even else resample_polyline(points, spacing_m)


def polyline_yaws(points: Array) -> Array:
    """Tangent direction in rad at each vertex of a polyline [W, 2], unwrapped."""
    tangent = np.gradient(points, axis=0)
    return np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
