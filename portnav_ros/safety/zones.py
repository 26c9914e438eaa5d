"""The speed from which a stop stays clear of all that the sensor sees.

A stop is rehearsed with vessel and autopilot (vessel.py, autopilot.py): the speed in question for
`reaction_s` on the heading asked for, then speed 0 with as much astern thrust as the autopilot gives
and the rudder kept to that heading. Thrust and rudder need their time, so the way is longer than that of
a constant force F, which is (integrate m s ds = -(F + k s^2) dx)::

    d(s) = m / (2 k) ln(1 + k s^2 / F)

Speeds are tried from the one asked for down to steerage; the first whose stop meets no return is the
limit, and where none does, it is 0. Returns count as standing still.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from portnav_ros.control.autopilot import PID_SIZE, AutopilotParams, Gains, steer
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import (
    RUDDER,
    STATE_SIZE,
    SURGE,
    THRUST,
    YAW,
    YAW_RATE,
    Array,
    Array32,
    BoolArray,
    Scan,
    Setpoint,
    X,
    Y,
)
from portnav_ros.vessel import VesselModel, VesselParams, move_actuators, move_hull

DT_S = 0.25
AT_REST_MPS = 0.05
SHARE_OF_GAP = 0.9
STEPS = 3600  # at most, so that a vessel without astern thrust comes to an end, too


@dataclass(frozen=True)
class ZoneParams:
    """The zone about the hull.

    margin_m: about the hull, that returns must stay out of; most of the present gap where that is less.
    reaction_s: sailed on before braking. steerage_mps: least speed at which the rudder works; below it
    there is only the stop. speeds: tried between the speed asked for and steerage.
    """

    margin_m: float = 3.0
    reaction_s: float = 1.0
    steerage_mps: float = 1.0
    speeds: int = 8
    ranges: ClassVar[Ranges] = {
        'margin_m': (0.0, 100.0),
        'reaction_s': (0.0, 60.0),
        'steerage_mps': (0.05, 10.0),
        'speeds': (2, 64),
    }

    def __post_init__(self) -> None:
        """Refuse zones that make no sense."""
        check_ranges(self)


def scan_points(scan: Scan, turned_rad: float = 0.0) -> Array:
    """Points [N, 2] of the returns in m, in the frame of the sensor or of one that it is turned in.

    What is too close to be measured is taken to be at the least range.
    """
    first_rad = scan.angle_min_rad + turned_rad
    return _points(scan.ranges, first_rad, scan.angle_increment_rad, scan.range_min_m)


def returned(scan: Scan) -> BoolArray:
    """Which rays [R] have met something."""
    return np.asarray(scan.ranges < np.inf)


class Zone:
    """Limits the speed of one vessel's setpoints."""

    def __init__(self, params: ZoneParams, vessel: VesselParams, autopilot: AutopilotParams) -> None:
        self._params = params
        self._model, self._gains = vessel.model(), autopilot.gains()
        self._track = np.zeros((STEPS + 1, 3))

    def limit_mps(self, own: Array, setpoint: Setpoint, points: Array) -> float:
        """Return the highest speed that leaves room for a stop: infinite for the setpoint's own, 0 for none.

        Args:
            own: [7] state row, of which heading, surge and yaw rate are used.
            setpoint: heading in rad (map) and speed in m/s asked for.
            points: [N, 2] returns in the body frame in m.
        """
        margin = _margin(self._model, points, self._params.margin_m)
        for speed_mps in self._speeds(setpoint.speed_mps):
            track = self._stop(own, setpoint.yaw_rad, speed_mps)
            if not _meets(self._model, track, points, margin):
                return math.inf if speed_mps == setpoint.speed_mps else speed_mps
        return 0.0

    def stop_track(self, own: Array, yaw_rad: float, speed_mps: float) -> Array:
        """Return the way [T, 2] m in the map frame of a stop from a speed, turning to a heading meanwhile."""
        track = self._stop(own, yaw_rad, speed_mps)
        cosine, sine = math.cos(own[YAW]), math.sin(own[YAW])
        turned = [cosine * track[:, 0] - sine * track[:, 1], sine * track[:, 0] + cosine * track[:, 1]]
        return np.column_stack(turned) + own[[X, Y]]

    def _speeds(self, asked_mps: float) -> Iterator[float]:
        """Speeds to try, the fastest first."""
        yield asked_mps
        slowest, steps = self._params.steerage_mps, self._params.speeds - 1
        if asked_mps > slowest:
            yield from (asked_mps + (slowest - asked_mps) * k / steps for k in range(1, steps))
            yield slowest

    def _stop(self, own: Array, yaw_rad: float, speed_mps: float) -> Array:
        """Poses [T, 3] of a stop in the present body frame."""
        turn, reaction = yaw_rad - own[YAW], self._params.reaction_s
        yaw_rate = own[YAW_RATE] * min(speed_mps / max(own[SURGE], 1e-3), 1.0)  # slower, it turns as tightly
        count = _rehearse(self._gains, self._model, yaw_rate, turn, speed_mps, reaction, self._track)
        return self._track[:count]


@njit(cache=True)
def _points(ranges: Array32, first_rad: float, increment_rad: float, least_m: float) -> Array:
    """Where the rays with ranges [R] m that have met something end: [N, 2]."""
    points, count = np.empty((len(ranges), 2)), 0
    for k in range(len(ranges)):
        if ranges[k] < np.inf:
            angle, distance = first_rad + increment_rad * k, max(ranges[k], least_m)
            points[count] = distance * math.cos(angle), distance * math.sin(angle)
            count += 1
    return points[:count]


@njit(cache=True)
def _rehearse(
    gains: Gains,
    model: VesselModel,
    yaw_rate_radps: float,
    turn_rad: float,
    speed_mps: float,
    reaction_s: float,
    track: Array,
) -> int:
    """Write the poses of a stop from the origin, a quarter of the beam apart, into track [T, 3]."""
    state, memory = np.zeros(STATE_SIZE), np.zeros(PID_SIZE)
    state[SURGE], state[YAW_RATE] = speed_mps, yaw_rate_radps
    state[THRUST] = model.drag_kg_per_m * speed_mps * speed_mps
    laid = yaw_rate_radps * model.length_m / (model.turn_gain * max(speed_mps, AT_REST_MPS))
    state[RUDDER] = min(max(laid, -model.rudder_max_rad), model.rudder_max_rad)
    sailed, count = 0.0, 0
    for step in range(STEPS):
        speed = speed_mps if step * DT_S < reaction_s else 0.0
        rudder, thrust = steer(gains, model, memory, state, turn_rad, speed, DT_S)
        move_actuators(model, state, rudder, thrust, DT_S)
        move_hull(model, state, DT_S)
        sailed += state[SURGE] * DT_S
        at_rest = state[SURGE] < AT_REST_MPS
        if at_rest or sailed >= 0.25 * model.beam_m:
            track[count] = state[X], state[Y], state[YAW]
            count += 1
            sailed = 0.0
        if at_rest:
            break
    return count


@njit(cache=True)
def _margin(model: VesselModel, points: Array, margin_m: float) -> float:
    """The margin in m, or most of the present gap where that is narrower: along a quay, or off it."""
    margin = margin_m
    for k in range(len(points)):
        gap = _gap(model, points[k, 0], points[k, 1])
        if gap > 0.0:
            margin = min(margin, SHARE_OF_GAP * gap)
    return margin


@njit(cache=True)
def _gap(model: VesselModel, x: float, y: float) -> float:
    """How far a point in the body frame is outside the hull, ahead, astern or abeam; 0 or less inside."""
    return max(abs(x) - 0.5 * model.length_m, abs(y) - 0.5 * model.beam_m)


@njit(cache=True)
def _meets(model: VesselModel, track: Array, points: Array, margin: float) -> bool:
    """Whether the hull with a margin in m meets a return at any of the poses [T, 3]; its own do not count."""
    for t in range(len(track)):
        cosine, sine = math.cos(track[t, 2]), math.sin(track[t, 2])
        for k in range(len(points)):
            dx, dy = points[k, 0] - track[t, 0], points[k, 1] - track[t, 1]
            near = _gap(model, cosine * dx + sine * dy, cosine * dy - sine * dx) < margin
            if near and _gap(model, points[k, 0], points[k, 1]) > 0.0:
                return True
    return False
