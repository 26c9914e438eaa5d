"""Where the vessel is on its path: closest point, line-of-sight errors, points ahead."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from portnav_ros.geometry import to_body, wrap_angle
from portnav_ros.sim.scenario import PATH_SPACING_M
from portnav_ros.types import YAW, Array, X, Y

BEHIND, AHEAD = 10, 40  # path points searched about the last progress, PATH_SPACING_M apart


@njit(cache=True, nogil=True)
def advance(path: Array, count: int, progress: float, x_m: float, y_m: float) -> float:
    """Return the progress of the path point closest to (x, y), near the last progress.

    path: [W, 2] m, of which `count` points are in use. Progress is an index with a fraction; a
    negative one asks for a search of the whole path.
    """
    first, last = 0, count - 1
    if progress >= 0.0:
        first, last = max(int(progress) - BEHIND, 0), min(int(progress) + AHEAD, count - 1)
    best, at = math.inf, float(first)
    for i in range(first, last):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        squared = max(dx * dx + dy * dy, 1e-12)
        along = ((x_m - path[i, 0]) * dx + (y_m - path[i, 1]) * dy) / squared
        along = min(max(along, 0.0), 1.0)
        gap = (x_m - path[i, 0] - along * dx) ** 2 + (y_m - path[i, 1] - along * dy) ** 2
        if gap < best:
            best, at = gap, i + along
    return at


@njit(cache=True, nogil=True)
def path_point(path: Array, count: int, progress: float) -> tuple[float, float]:
    """Return the map point at a progress; the last point beyond the end."""
    i = min(max(int(progress), 0), count - 1)
    j = min(i + 1, count - 1)
    share = min(max(progress - i, 0.0), 1.0)
    x = path[i, 0] + share * (path[j, 0] - path[i, 0])
    y = path[i, 1] + share * (path[j, 1] - path[i, 1])
    return x, y


@njit(cache=True, nogil=True)
def path_errors(
    own: Array, path: Array, count: int, progress: float, lookahead_m: float
) -> tuple[float, float, float]:
    """Line-of-sight errors of a state row (Fossen 2011, section 10.3).

    With a the closest path point and b the point `lookahead_m` further on the tangent there:

    Returns:
        e_x, e_y: deviation of the vessel from a in the body frame, in m.
        e_psi: heading minus the bearing from the vessel to b, in rad.
    """
    ax, ay = path_point(path, count, progress)
    i = min(int(progress), max(count - 2, 0))
    j = min(i + 1, count - 1)
    tx, ty = path[j, 0] - path[i, 0], path[j, 1] - path[i, 1]
    length = max(math.hypot(tx, ty), 1e-9)
    bx, by = ax + lookahead_m * tx / length, ay + lookahead_m * ty / length
    ex, ey = to_body(own[X], own[Y], own[YAW], ax, ay)
    return -ex, -ey, wrap_angle(own[YAW] - math.atan2(by - own[Y], bx - own[X]))


def path_errors_along(states: Array, path: Array, lookahead_m: float) -> Array:
    """Errors [T, 3] of a track of state rows [T, 7] against a path [W, 2]."""
    errors = np.zeros((len(states), 3))
    progress = -1.0
    for t, own in enumerate(states):
        progress = advance(path, len(path), progress, own[X], own[Y])
        errors[t] = path_errors(own, path, len(path), progress, lookahead_m)
    return errors


def remaining_m(path: Array, progress: float) -> float:
    """Length in m of the path that is still ahead."""
    return max(len(path) - 1 - progress, 0.0) * PATH_SPACING_M
