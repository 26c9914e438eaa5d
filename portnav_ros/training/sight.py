"""What a sensor could see of a world from one place: compiled, for the privileged teacher."""

from __future__ import annotations

import math

from numba import njit

from portnav_ros.geometry import segment_distance_squared
from portnav_ros.types import YAW, Array, X, Y

HULL_POINTS = 5  # of a vessel that are looked for


@njit(cache=True, nogil=True)
def near_walls(walls: Array, own: Array, reach_m: float, near: Array) -> int:
    """Copy the walls [E, 4] within reach; return how many."""
    count = 0
    for e in range(len(walls)):
        x0, y0, x1, y1 = walls[e]
        if segment_distance_squared(own[X], own[Y], x0, y0, x1, y1) < reach_m * reach_m:
            near[count] = walls[e]
            count += 1
    return count


@njit(cache=True, nogil=True)
def near_buoys(buoys: Array, own: Array, reach_m: float, near: Array) -> int:
    """Copy the buoys [K, 3] within reach; return how many."""
    count = 0
    for k in range(len(buoys)):
        if math.hypot(buoys[k, 0] - own[X], buoys[k, 1] - own[Y]) < reach_m:
            near[count] = buoys[k]
            count += 1
    return count


@njit(cache=True, nogil=True)
def vessels_in_sight(
    poses: Array,
    hulls: Array,
    second: int,
    own: Array,
    walls: Array,
    reach_m: float,
    seen: Array,
    sizes: Array,
) -> int:
    """Copy the future of the vessels that can be seen; return how many."""
    last, count = len(poses) - 1, 0
    for m in range(poses.shape[1]):
        pose = poses[min(second, last), m]
        if math.isnan(pose[X]) or not _is_seen(own, pose, hulls[m, 0], walls, reach_m):
            continue
        sizes[count] = hulls[m]
        for k in range(len(seen)):
            seen[k, count] = poses[min(second + k, last), m]
        count += 1
    return count


@njit(cache=True, nogil=True)
def _is_seen(own: Array, pose: Array, length_m: float, walls: Array, reach_m: float) -> bool:
    """Whether a straight line to some point along a vessel's middle line meets no wall."""
    cosine, sine = math.cos(pose[YAW]), math.sin(pose[YAW])
    for k in range(HULL_POINTS):
        along = 0.48 * length_m * (2.0 * k / (HULL_POINTS - 1) - 1.0)
        x, y = pose[X] + along * cosine, pose[Y] + along * sine
        if math.hypot(x - own[X], y - own[Y]) > reach_m:
            continue
        hidden = False
        for e in range(len(walls)):
            if _crosses(own[X], own[Y], x, y, walls[e]):
                hidden = True
                break
        if not hidden:
            return True
    return False


@njit(cache=True, nogil=True)
def _crosses(x0: float, y0: float, x1: float, y1: float, wall: Array) -> bool:
    dx, dy = x1 - x0, y1 - y0
    first = dx * (wall[1] - y0) - dy * (wall[0] - x0)
    second = dx * (wall[3] - y0) - dy * (wall[2] - x0)
    if first * second > 0.0:
        return False
    ex, ey = wall[2] - wall[0], wall[3] - wall[1]
    third = ex * (y0 - wall[1]) - ey * (x0 - wall[0])
    fourth = ex * (y1 - wall[1]) - ey * (x1 - wall[0])
    return third * fourth <= 0.0
