"""Dynamic window approach on the scan (Fox, Burgard and Thrun 1997), for a vessel with an autopilot.

What a vessel can reach is not a window of velocities but what its autopilot makes of a setpoint. So
each of the paper's 27 setpoints is simulated with vessel and autopilot over the horizon, and judged:

- contact: the first time that the hull, widened by the margin, meets a return of the scan. The
  returns count as standing still: the scan does not tell how they move.
- admissible: no contact, or the vessel can stop before it. It keeps sailing until the next decision
  and then brakes with full astern thrust (drag helps): d = m / (2k) ln(1 + k s^2 / F).
- heading: 1 - |bearing of the local goal - yaw| / pi at the end of the horizon. The local goal is the
  path point `goal_ahead_m` ahead of the vessel's closest one.
- clearance: distance sailed before a contact as a share of what the fastest setpoint sails over the
  horizon, 1 without a contact. A slower setpoint is followed straight on to the same distance, or
  creeping towards an obstacle would look clear.
- room: least gap on that way between the widened hull and a return, as a share of `room_m`. The paper
  has no such term; 0 turns it off.
- speed: the setpoint's speed as a share of the fastest one's.

The admissible setpoint with the greatest weighted sum is taken. Where none is admissible it is the
one whose contact comes last; of those the slowest; of those the one with the greatest sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numba import njit

from portnav_ros.control.autopilot import PID_SIZE, AutopilotParams, Gains, steer
from portnav_ros.geometry import TWO_PI, wrap_angle
from portnav_ros.params import Ranges, check_ranges, override, read_yaml
from portnav_ros.resources import config_path
from portnav_ros.sim.contact import point_gap
from portnav_ros.sim.scenario import PATH_SPACING_M
from portnav_ros.task.actions import ActionParams
from portnav_ros.task.path_errors import path_point
from portnav_ros.task.policy import Observation
from portnav_ros.types import STATE_SIZE, SURGE, YAW, Array, Array32, BoolArray, X, Y
from portnav_ros.vessel import VesselModel, VesselParams, move_actuators, move_hull

DT_S, STEPS_PER_CHECK = 0.25, 4  # contacts are looked for each second
STRIDE_M = 5.0
SLOW_FIRST = 1e6  # outweighs any score
ASTERN_FLOOR_N = 1.0  # a vessel without reverse thrust brakes by drag alone


@dataclass(frozen=True)
class DwaParams:
    """Horizon, margin and weights; config/dwa.yaml holds the tuned ones and tells how."""

    horizon_s: float = 30.0
    margin_m: float = 5.0
    goal_ahead_m: float = 250.0
    room_m: float = 50.0
    heading_weight: float = 1.0
    clearance_weight: float = 0.5
    room_weight: float = 0.5
    speed_weight: float = 0.2
    ranges: ClassVar[Ranges] = {
        'horizon_s': (1.0, 600.0),
        'margin_m': (0.0, 100.0),
        'goal_ahead_m': (1.0, 5000.0),
        'room_m': (0.1, 1000.0),
        'heading_weight': (0.0, 1e3),
        'clearance_weight': (0.0, 1e3),
        'room_weight': (0.0, 1e3),
        'speed_weight': (0.0, 1e3),
    }

    def __post_init__(self) -> None:
        """Refuse an empty horizon and negative weights."""
        check_ranges(self)


def load_dwa_params() -> DwaParams:
    """Read config/dwa.yaml; raises ParamError on an unknown key or a value out of range."""
    path = config_path('dwa.yaml')
    return override(DwaParams(), read_yaml(path), str(path))


class Judge(NamedTuple):
    """DwaParams as scalars for compiled code."""

    seconds: int
    margin_m: float
    goal_ahead: float
    room_m: float
    heading_weight: float
    clearance_weight: float
    room_weight: float
    speed_weight: float


class Way(NamedTuple):
    """What came of a setpoint.

    late_s: time of the first contact, infinite if admissible. free_m: distance sailed before any
    contact, infinite without one. gap_m: least gap on the way. sailed_m: distance sailed.
    """

    late_s: float
    free_m: float
    gap_m: float
    sailed_m: float


class DynamicWindow:
    """Takes, at each decision, the best of the paper's setpoints for the present scan."""

    def __init__(
        self,
        vessel: VesselParams,
        autopilot: AutopilotParams,
        params: DwaParams | None = None,
    ) -> None:
        """Plan for a vessel with its autopilot; params default to config/dwa.yaml."""
        params = params or load_dwa_params()
        self._model, self._gains = vessel.model(), autopilot.gains()
        self._table = ActionParams().table()
        self._judge = Judge(
            round(params.horizon_s),
            params.margin_m,
            params.goal_ahead_m / PATH_SPACING_M,
            params.room_m,
            params.heading_weight,
            params.clearance_weight,
            params.room_weight,
            params.speed_weight,
        )

    def reset(self, which: BoolArray) -> None:
        """Nothing to forget: each decision starts from the present scan."""

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]."""
        setpoints = np.empty((len(observation.own), 2))
        _decide_all(self._judge, self._model, self._gains, self._table, observation, setpoints)
        return setpoints


@njit(cache=True, nogil=True)
def _decide_all(
    judge: Judge, model: VesselModel, gains: Gains, table: Array, seen: Observation, setpoints: Array
) -> None:
    points = np.empty((seen.ranges.shape[1], 2))
    for b in range(len(seen.own)):
        own = seen.own[b]
        count, margin = _obstacles(judge, model, own, seen.ranges[b], points)
        gx, gy = path_point(seen.path[b], seen.path_length[b], seen.progress[b] + judge.goal_ahead)
        best = _choose(judge, model, gains, table, own, points[:count], margin, gx, gy)
        setpoints[b, 0] = wrap_angle(own[YAW] + table[best, 0])
        setpoints[b, 1] = table[best, 1]


@njit(cache=True, nogil=True)
def _obstacles(
    judge: Judge, model: VesselModel, own: Array, ranges: Array32, points: Array
) -> tuple[int, float]:
    """Write the returns that the hull can reach within the horizon into points [R, 2], map frame.

    A return inside the hull is left out: no setpoint avoids it any more. Returns their number and the
    margin in m, no wider than the present gap to the nearest.
    """
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    fastest = max(math.sqrt(model.thrust_max_n / model.drag_kg_per_m), abs(own[SURGE]))
    reach = fastest * judge.seconds + half_length + judge.room_m + judge.margin_m
    count, margin = 0, judge.margin_m
    for i in range(len(ranges)):
        if not 0.0 < ranges[i] < reach:
            continue
        angle = -math.pi + TWO_PI * i / len(ranges)
        gap = point_gap(half_length, half_beam, ranges[i] * math.cos(angle), ranges[i] * math.sin(angle))
        if gap > 0.0:
            points[count, 0] = own[X] + ranges[i] * math.cos(own[YAW] + angle)
            points[count, 1] = own[Y] + ranges[i] * math.sin(own[YAW] + angle)
            margin = min(margin, 0.9 * gap)
            count += 1
    return count, margin


@njit(cache=True, nogil=True)
def _choose(
    judge: Judge,
    model: VesselModel,
    gains: Gains,
    table: Array,
    own: Array,
    points: Array,
    margin: float,
    gx: float,
    gy: float,
) -> int:
    """Return the row of the table to take."""
    state, memory = np.empty(STATE_SIZE), np.empty(PID_SIZE)
    best, best_late, best_score = 0, -1.0, -math.inf
    fastest = table[:, 1].max()
    reach = fastest * judge.seconds
    for a in range(len(table)):
        state[:] = own
        memory[:] = 0.0
        yaw, speed = own[YAW] + table[a, 0], table[a, 1]
        way = _rehearse(judge, model, gains, state, memory, yaw, speed, points, margin)
        off = abs(wrap_angle(math.atan2(gy - state[Y], gx - state[X]) - state[YAW]))
        way = _follow_on(judge, model, state, points, margin, way, reach)
        score = (
            judge.heading_weight * (1.0 - off / math.pi)
            + judge.clearance_weight * min(way.free_m / reach, 1.0)
            + judge.room_weight * min(way.gap_m / judge.room_m, 1.0)
            + judge.speed_weight * speed / fastest
        )
        if way.late_s < math.inf:
            score -= SLOW_FIRST * speed
        if way.late_s > best_late or (way.late_s == best_late and score > best_score):
            best, best_late, best_score = a, way.late_s, score
    return best


@njit(cache=True, nogil=True)
def _rehearse(
    judge: Judge,
    model: VesselModel,
    gains: Gains,
    state: Array,
    memory: Array,
    yaw: float,
    speed: float,
    points: Array,
    margin: float,
) -> Way:
    """Sail a setpoint over the horizon; the state row [7] is left at its end."""
    sailed, braking, clear = 0.0, 0.0, 0.0
    late, free, least = math.inf, math.inf, math.inf
    for second in range(1, judge.seconds + 1):
        x, y = state[X], state[Y]
        for _ in range(STEPS_PER_CHECK):
            rudder, thrust = steer(gains, model, memory, state, yaw, speed, DT_S)
            move_actuators(model, state, rudder, thrust, DT_S)
            move_hull(model, state, DT_S)
        step = math.hypot(state[X] - x, state[Y] - y)
        sailed += step
        clear -= step
        if second == 1:
            braking = sailed + _braking_distance(model, state[SURGE])
        if free < math.inf or clear > 0.0:
            continue
        gap, clear = _nearest(judge, model, state, points, margin)
        least = min(least, gap)
        if gap <= 0.0:
            free = sailed
            late = float(second) if sailed <= braking else math.inf
    return Way(late, free, least, sailed)


@njit(cache=True, nogil=True)
def _follow_on(
    judge: Judge, model: VesselModel, state: Array, points: Array, margin: float, way: Way, reach: float
) -> Way:
    """Go straight on from the end of the horizon until `reach` m are sailed or something is met."""
    sailed, free, least, clear = way.sailed_m, way.free_m, way.gap_m, 0.0
    while sailed < reach and free == math.inf:
        state[X] += STRIDE_M * math.cos(state[YAW])
        state[Y] += STRIDE_M * math.sin(state[YAW])
        sailed += STRIDE_M
        clear -= STRIDE_M
        if clear > 0.0:
            continue
        gap, clear = _nearest(judge, model, state, points, margin)
        least = min(least, gap)
        if gap <= 0.0:
            free = sailed
    return Way(way.late_s, free, least, sailed)


@njit(cache=True, nogil=True)
def _braking_distance(model: VesselModel, surge: float) -> float:
    """Distance in m to rest from a surge speed under full astern thrust and drag."""
    astern = max(-model.thrust_min_n, ASTERN_FLOOR_N)
    drag = model.drag_kg_per_m
    return 0.5 * model.mass_kg / drag * math.log(1.0 + drag * surge * abs(surge) / astern)


@njit(cache=True, nogil=True)
def _nearest(
    judge: Judge, model: VesselModel, state: Array, points: Array, margin: float
) -> tuple[float, float]:
    """Gap in m from the widened hull to the nearest point, and how far to sail before it matters."""
    half_length, half_beam = 0.5 * model.length_m + margin, 0.5 * model.beam_m + margin
    gap, centre = math.inf, math.inf
    cosine, sine = math.cos(state[YAW]), math.sin(state[YAW])
    for k in range(len(points)):
        dx, dy = points[k, 0] - state[X], points[k, 1] - state[Y]
        centre = min(centre, dx * dx + dy * dy)
        along = max(abs(cosine * dx + sine * dy) - half_length, 0.0)
        across = max(abs(cosine * dy - sine * dx) - half_beam, 0.0)
        gap = min(gap, along * along + across * across)
    return math.sqrt(gap), math.sqrt(centre) - math.hypot(half_length, half_beam) - judge.room_m
