"""Markers for RViz and Foxglove, all in the map frame."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from portnav_ros.nodes.messages import new_pose
from portnav_ros.nodes.topics import MAP_FRAME
from portnav_ros.types import Array

TRACK_WIDTH_M = 2.0


def hull_marker(
    number: int, x_m: float, y_m: float, yaw_rad: float, size_m: Sequence[float], colour: Sequence[float]
) -> Marker:
    """Return a box of length and beam at a pose; colour is red, green, blue in [0, 1]."""
    marker = _marker('hulls', number, Marker.CUBE, colour)
    marker.pose = new_pose(x_m, y_m, yaw_rad)
    marker.scale.x, marker.scale.y, marker.scale.z = float(size_m[0]), float(size_m[1]), 3.0
    return marker


def buoy_markers(buoys: Array) -> MarkerArray:
    """Return a cylinder for each buoy [K, 3]: x, y, radius in m."""
    message = MarkerArray()
    for number, (x, y, radius) in enumerate(buoys):
        marker = _marker('buoys', number, Marker.CYLINDER, (1.0, 0.5, 0.0))
        marker.pose = new_pose(x, y, 0.0)
        marker.scale.x = marker.scale.y = 2.0 * float(radius)
        marker.scale.z = 3.0
        message.markers.append(marker)
    return message


def track_marker(name: str, points: Array, colour: Sequence[float]) -> Marker:
    """Return a line through map points [T, 2]."""
    marker = _marker(name, 0, Marker.LINE_STRIP, colour)
    marker.pose = new_pose(0.0, 0.0, 0.0)
    marker.scale.x = TRACK_WIDTH_M
    marker.points = [Point(x=x, y=y) for x, y in points.tolist()]
    return marker


def sighting_marker(tracks: Array, lead_s: float = 20.0) -> Marker:
    """Return a line from end to end of each track [N, 8], and one to where it will be in `lead_s`."""
    marker = _marker('tracks', 0, Marker.LINE_LIST, (1.0, 0.2, 0.8))
    marker.pose = new_pose(0.0, 0.0, 0.0)
    marker.scale.x = TRACK_WIDTH_M
    for x, y, vx, vy, *ends in tracks.tolist():
        for px, py in ((ends[0], ends[1]), (ends[2], ends[3]), (x, y), (x + lead_s * vx, y + lead_s * vy)):
            marker.points.append(Point(x=px, y=py))
    return marker


def _marker(namespace: str, number: int, kind: int, colour: Sequence[float]) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = MAP_FRAME
    marker.color.r, marker.color.g, marker.color.b = (float(part) for part in colour)
    marker.color.a = 1.0
    return marker
