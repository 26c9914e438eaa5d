"""Scans of several ages seen from here and now, so that what stands still coincides in all of them.

A vessel that turns sees everything move. Odometry tells by how much: the points of an older scan are
put into the present course frame (origin at the vessel, x along the line-of-sight course of the
path), and what then differs between two ages has moved by itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.geometry import TWO_PI
from portnav_ros.types import YAW, Array, Array32, BoolArray, IntArray, X, Y

JOIN_M = 15.0  # two neighbouring rays that end closer than this hit one thing
OFF_X, OFF_Y, OFF_YAW = range(3)


class ScanMemory(NamedTuple):
    """The last D scans of B vessels: ranges [B, D, R] m, poses [B, D, 3] m, m, rad, newest [B] index."""

    ranges: Array32
    poses: Array
    newest: IntArray


def new_memory(batch: int, depth: int, rays: int) -> ScanMemory:
    """Allocate an empty memory of `depth` scans."""
    return ScanMemory(
        np.zeros((batch, depth, rays), np.float32), np.zeros((batch, depth, 3)), np.zeros(batch, np.int64)
    )


@njit(cache=True, nogil=True)
def remember(memory: ScanMemory, own: Array, ranges: Array32, fresh: BoolArray, which: BoolArray) -> None:
    """Take in the scans [B, R] of the vessels `which`; a fresh vessel has seen nothing else before."""
    depth = memory.ranges.shape[1]
    for b in np.flatnonzero(which):
        slot = (memory.newest[b] + 1) % depth
        memory.newest[b] = slot
        first, last = (0, depth) if fresh[b] else (slot, slot + 1)
        for d in range(first, last):
            memory.ranges[b, d] = ranges[b]
            memory.poses[b, d, OFF_X] = own[b, X]
            memory.poses[b, d, OFF_Y] = own[b, Y]
            memory.poses[b, d, OFF_YAW] = own[b, YAW]


@njit(cache=True, nogil=True)
def write_aligned(
    memory: ScanMemory, b: int, age: int, course: float, range_max_m: float, out: Array32
) -> None:
    """Write the closeness [S] of vessel b's scan of an age: 0 nothing in reach, 1 touching.

    Sectors begin astern of the course (-pi) and run counter-clockwise.
    """
    depth, rays = memory.ranges.shape[1], memory.ranges.shape[2]
    now, then = memory.newest[b], (memory.newest[b] - age) % depth
    here, there = memory.poses[b, now], memory.poses[b, then]
    dx, dy = there[OFF_X] - here[OFF_X], there[OFF_Y] - here[OFF_Y]
    cosine, sine = math.cos(course), math.sin(course)
    ox, oy = cosine * dx + sine * dy, cosine * dy - sine * dx
    turn = there[OFF_YAW] - course
    ranges = memory.ranges[b, then]
    step = TWO_PI / rays
    cos_step, sin_step = math.cos(step), math.sin(step)
    ux, uy = -math.cos(turn), -math.sin(turn)
    per_radian = len(out) / TWO_PI
    out[:] = 0.0
    last_valid, px, py, last_at = False, 0.0, 0.0, 0.0
    for i in range(rays + 1):
        distance = ranges[i if i < rays else 0]
        valid = 0.0 <= distance < range_max_m
        if valid:
            x, y = ox + distance * ux, oy + distance * uy
            at = (math.atan2(y, x) + math.pi) * per_radian
            _mark(x, y, at, range_max_m, out)
            if last_valid and abs(at - last_at) > 1.0 and (x - px) ** 2 + (y - py) ** 2 < JOIN_M**2:
                _draw(px, py, last_at, x, y, at, range_max_m, out)
            px, py, last_at = x, y, at
        last_valid = valid
        ux, uy = cos_step * ux - sin_step * uy, sin_step * ux + cos_step * uy


@njit(cache=True, nogil=True, inline='always')
def _mark(x: float, y: float, at: float, reach: float, out: Array32) -> None:
    sector = min(int(at), len(out) - 1)
    closeness = max(1.0 - math.sqrt(x * x + y * y) / reach, 0.0)
    out[sector] = max(out[sector], closeness)


@njit(cache=True, nogil=True)
def _draw(
    px: float, py: float, last_at: float, x: float, y: float, at: float, reach: float, out: Array32
) -> None:
    """Fill the sectors between two points of one thing, each given with its place among the sectors."""
    sectors = len(out)
    span = at - last_at
    if abs(span) > 0.5 * sectors:
        span -= math.copysign(sectors, span)
    pieces = int(abs(span)) + 1
    for k in range(1, pieces):
        share = k / pieces
        _mark(px + share * (x - px), py + share * (y - py), (last_at + share * span) % sectors, reach, out)
