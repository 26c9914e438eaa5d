"""Distances between hulls (rectangles), quays (segments) and buoys (discs)."""

from __future__ import annotations

import math

from numba import njit

from portnav_ros.geometry import segment_distance_squared


@njit(cache=True, nogil=True)
def point_gap(half_length: float, half_beam: float, x: float, y: float) -> float:
    """Distance in m from a hull about the origin to a point in its body frame; 0 inside."""
    dx, dy = max(abs(x) - half_length, 0.0), max(abs(y) - half_beam, 0.0)
    return math.sqrt(dx * dx + dy * dy)


@njit(cache=True, nogil=True)
def meets_edge(half_length: float, half_beam: float, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a segment in the body frame touches the hull (Liang and Barsky's clipping)."""
    enter, leave = 0.0, 1.0
    dx, dy = x1 - x0, y1 - y0
    for start, delta, half in ((x0, dx, half_length), (y0, dy, half_beam)):
        if abs(delta) < 1e-12:
            if abs(start) > half:
                return False
            continue
        first, second = (-half - start) / delta, (half - start) / delta
        enter = max(enter, min(first, second))
        leave = min(leave, max(first, second))
    return enter <= leave


@njit(cache=True, nogil=True)
def edge_gap(half_length: float, half_beam: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Distance in m from a hull about the origin to a segment in its body frame; 0 in contact."""
    if meets_edge(half_length, half_beam, x0, y0, x1, y1):
        return 0.0
    gap = min(point_gap(half_length, half_beam, x0, y0), point_gap(half_length, half_beam, x1, y1))
    squared = gap * gap
    for cx, cy in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        corner = segment_distance_squared(cx * half_length, cy * half_beam, x0, y0, x1, y1)
        squared = min(squared, corner)
    return math.sqrt(squared)


@njit(cache=True, nogil=True)
def hull_gap(
    half_length: float,
    half_beam: float,
    x: float,
    y: float,
    yaw: float,
    other_half_length: float,
    other_half_beam: float,
) -> float:
    """Distance in m between a hull about the origin and another at (x, y, yaw) in its body frame."""
    if abs(x) <= half_length and abs(y) <= half_beam:
        return 0.0
    cosine, sine = math.cos(yaw), math.sin(yaw)
    if abs(cosine * x + sine * y) <= other_half_length and abs(cosine * y - sine * x) <= other_half_beam:
        return 0.0
    lx, ly = cosine * other_half_length, sine * other_half_length
    bx, by = -sine * other_half_beam, cosine * other_half_beam
    gap = math.inf
    px, py = x + lx - bx, y + ly - by
    for along, side in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
        qx, qy = x + along * lx + side * bx, y + along * ly + side * by
        gap = min(gap, edge_gap(half_length, half_beam, px, py, qx, qy))
        px, py = qx, qy
    return gap
