"""Gaps between hulls, quays and buoys, from recorded poses: for logs that carry none, such as bags."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from portnav_ros.evaluation.episode_log import EpisodeLog, TargetTrack
from portnav_ros.types import YAW, AnyArray, Array, X, Y

GONE_S = 2.0  # a target is taken as present this long before and after each of its poses
APART_S = 10.0  # and between two poses that are no further apart than this


def with_clearance(log: EpisodeLog) -> EpisodeLog:
    """Return the log with exact clearances [T, 3] to quays, buoys and vessels, where it has none."""
    if log.clearance is not None:
        return log
    hulls = hull_polygons(log.own[:, [X, Y, YAW]], log.vessel.length_m, log.vessel.beam_m)
    quays = shapely.distance(hulls, shapely.boundary(log.harbour.water))
    ashore = ~shapely.covered_by(hulls, log.harbour.water)
    columns = [np.where(ashore, 0.0, quays), _to_buoys(hulls, log.harbour.buoys), _to_vessels(hulls, log)]
    return replace(log, clearance=np.column_stack(columns))


def hull_polygons(poses: Array, length_m: float, beam_m: float) -> AnyArray:
    """Rectangles [T] about poses [T, 3] x, y in m and yaw in rad."""
    return shapely.polygons(hull_corners(poses, length_m, beam_m))


def hull_corners(poses: Array, length_m: float, beam_m: float) -> Array:
    """Corners [T, 4, 2] of rectangles about poses [T, 3] x, y in m and yaw in rad."""
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ahead = 0.5 * length_m * np.column_stack([cosine, sine])
    left = 0.5 * beam_m * np.column_stack([-sine, cosine])
    offsets = np.stack([ahead + left, left - ahead, -ahead - left, ahead - left], axis=1)
    corners: Array = poses[:, None, :2] + offsets
    return corners


def poses_at(track: TargetTrack, time_s: Array) -> Array:
    """Poses [T, 3] of a target at given times, interpolated; NaN where nobody tells where it was."""
    at = np.clip(time_s, track.time_s[0], track.time_s[-1])
    after = np.searchsorted(track.time_s, at).clip(min(1, len(track.time_s) - 1))
    before_s, after_s = track.time_s[after - 1], track.time_s[after]
    silent = (after_s - before_s > APART_S) & (np.minimum(at - before_s, after_s - at) > GONE_S)
    yaw = np.unwrap(track.pose[:, 2])
    columns = (track.pose[:, 0], track.pose[:, 1], yaw)
    poses = np.column_stack([np.interp(at, track.time_s, column) for column in columns])
    poses[silent | (np.abs(time_s - at) > GONE_S)] = np.nan
    return poses


def _to_buoys(hulls: AnyArray, buoys: Array) -> Array:
    gaps = [shapely.distance(hulls, shapely.Point(x, y)) - radius for x, y, radius in buoys]
    return np.maximum(np.min(gaps, axis=0), 0.0) if gaps else np.full(len(hulls), np.inf)


def _to_vessels(hulls: AnyArray, log: EpisodeLog) -> Array:
    least = np.full(len(hulls), np.inf)
    for track in log.targets:
        if not len(track.time_s):
            continue
        poses = poses_at(track, log.time_s)
        there = np.isfinite(poses[:, 0])
        others = hull_polygons(poses[there], track.length_m, track.beam_m)
        least[there] = np.minimum(least[there], shapely.distance(hulls[there], others))
    return least
