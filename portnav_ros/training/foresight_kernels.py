"""Compiled rollouts of the privileged teacher."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.control.autopilot import Gains, steer
from portnav_ros.sim.kernels import CHECK_S, Chart, buoy_gap, quay_gap, vessel_gap
from portnav_ros.sim.traffic import Crowd, move_vessels, place_vessels
from portnav_ros.task.path_errors import advance, path_errors
from portnav_ros.training.sight import near_buoys, near_walls, vessels_in_sight
from portnav_ros.types import SURGE, YAW, Array, Array32, BoolArray, IntArray, X, Y
from portnav_ros.vessel import VesselModel, move_actuators, move_hull

MOVES_PER_SECOND = round(1.0 / CHECK_S)  # as the world moves its traffic, so that both are at the same place
STEP_S = 0.25  # of the hull; the world's own steps are finer
STEPS = 4  # to a second
COURSE_S = 4  # between two looks at the path
FAR_M = 60.0  # up to where gaps to quays are told exactly


class Bounds(NamedTuple):
    """ForesightParams as compiled code reads them, and the reach of the sensor."""

    horizon_s: int
    holds_s: IntArray
    margin_m: float
    path_weight: float
    haste: float
    collision: float
    certain_s: float
    late_share: float
    comfort_m: float
    closeness: float
    lookahead_m: float
    reach_m: float


class Course(NamedTuple):
    """Paths [B, W, 2] m, points in use [B], progress [B] and the spacing of points in m."""

    path: Array
    length: IntArray
    progress: Array
    spacing_m: float


class Scene(NamedTuple):
    """What one vessel could run into: walls [E, 4], buoys [K, 3], goal [3], hulls [M, 2], poses [T, M, 4]."""

    walls: Array
    buoys: Array
    goal: Array
    hulls: Array
    poses: Array


class Ship(NamedTuple):
    """A vessel under way in a rollout; arrays so that kernels can change them.

    own: [7]. memory: [2] of the autopilot. state: [3] progress on the path, cost so far, and m that may
    be sailed before a quay or a buoy can be near.
    """

    own: Array
    memory: Array
    state: Array


PROGRESS, COST, SAFE_M = range(3)
COURSE = 2  # of the path errors: heading less line-of-sight course


@njit(cache=True, nogil=True)
def future_of(crowd: Crowd, time_s: Array, which: BoolArray, poses: Array) -> None:
    """Write the poses [B, T, M, 4] of the vessels at every full second of the episodes `which` [B].

    The crowd is copied, not moved. Seconds before the present time of an environment stay unwritten.
    """
    chosen = np.flatnonzero(which)
    track, leg = crowd.track[chosen], crowd.leg[chosen]
    progress, turn, pose = crowd.progress[chosen], crowd.turn[chosen], crowd.pose[chosen]
    ghosts = Crowd(
        crowd.points[chosen],
        crowd.offsets[chosen],
        crowd.origin[chosen],
        crowd.destination[chosen],
        crowd.tracks[chosen],
        crowd.vessels[chosen],
        crowd.hull[chosen],
        crowd.speed[chosen],
        crowd.arrival[chosen],
        crowd.seed[chosen],
        track,
        leg,
        progress,
        turn,
        pose,
    )
    moving = np.ones(len(chosen), np.bool_)
    now = np.zeros(len(chosen))
    for second in range(poses.shape[1]):
        place_vessels(ghosts, now)
        for i in range(len(chosen)):
            at = second + round(time_s[chosen[i]])
            if at < poses.shape[1]:
                poses[chosen[i], at] = pose[i]
        for _ in range(MOVES_PER_SECOND):
            move_vessels(ghosts, moving, CHECK_S)


@njit(cache=True, nogil=True)
def value_actions(
    bounds: Bounds,
    model: VesselModel,
    gains: Gains,
    own: Array,
    memory: Array,
    time_s: Array,
    course: Course,
    chart: Chart,
    poses: Array,
    hulls: Array,
    table: Array,
    vessels: IntArray,
    action: IntArray,
    value: Array32,
) -> None:
    """Write the values [N, K] of actions [N, K] of the vessels [N]; see `foresight.Foresight`."""
    seen = np.empty((bounds.horizon_s + 2, poses.shape[2], 4))
    sizes = np.empty((poses.shape[2], 2))
    walls = np.empty((chart.walls.shape[1], 4))
    buoys = np.empty((chart.buoys.shape[1], 3))
    reach_m = max(5.5 * bounds.horizon_s + 70.0, bounds.reach_m)
    for n in range(len(vessels)):
        b = vessels[n]
        near = near_walls(chart.walls[b, : chart.wall_count[b]], own[b], reach_m, walls)
        buoyed = near_buoys(chart.buoys[b, : chart.buoy_count[b]], own[b], bounds.reach_m, buoys)
        met = vessels_in_sight(
            poses[b], hulls[b], round(time_s[b]), own[b], walls[:near], bounds.reach_m, seen, sizes
        )
        scene = Scene(walls[:near], buoys[:buoyed], chart.goal[b], sizes[:met], seen[:, :met])
        path = course.path[b, : course.length[b]]
        for k in range(action.shape[1]):
            cost = _cost_of(
                bounds, model, gains, own[b], memory[b], path, course.progress[b], course.spacing_m, scene,
                table[action[n, k]],
            )  # fmt: skip
            value[n, k] = -cost


@njit(cache=True, nogil=True)
def _cost_of(
    bounds: Bounds,
    model: VesselModel,
    gains: Gains,
    own: Array,
    memory: Array,
    path: Array,
    progress: float,
    spacing_m: float,
    scene: Scene,
    setting: Array,
) -> float:
    """Cost of an action [2], heading from the course and speed, held for the best of the times."""
    held = Ship(own.copy(), memory.copy(), np.array([progress, 0.0, 0.0]))
    trial = Ship(own.copy(), memory.copy(), np.zeros(3))
    second, best = 0, np.inf
    for hold_s in bounds.holds_s:
        ended, second, toll = _sail(
            bounds, model, gains, held, path, scene, setting[0], setting[1], second, hold_s
        )
        if ended:
            best = min(best, toll + _rest(bounds, held, path, spacing_m, second))
            break
        trial.own[:] = held.own
        trial.memory[:] = held.memory
        trial.state[:] = held.state
        _, last, toll = _sail(
            bounds, model, gains, trial, path, scene, 0.0, model_speed(model), second, bounds.horizon_s
        )
        best = min(best, toll + _rest(bounds, trial, path, spacing_m, last))
    return best


@njit(cache=True, nogil=True, inline='always')
def model_speed(model: VesselModel) -> float:
    """Steady speed in m/s at full thrust."""
    return math.sqrt(model.thrust_max_n / model.drag_kg_per_m)


@njit(cache=True, nogil=True)
def _rest(bounds: Bounds, ship: Ship, path: Array, spacing_m: float, second: int) -> float:
    """Cost so far, of the time so far, and of the time that the rest of the path will take."""
    left_m = (len(path) - 1 - ship.state[PROGRESS]) * spacing_m
    return ship.state[COST] + bounds.haste * (second + left_m / 5.0)


@njit(cache=True, nogil=True)
def _sail(
    bounds: Bounds,
    model: VesselModel,
    gains: Gains,
    ship: Ship,
    path: Array,
    scene: Scene,
    offset: float,
    speed: float,
    second: int,
    until: int,
) -> tuple[bool, int, float]:
    """Keep an offset from the course up to a second; return whether it ended there, when, and the toll."""
    own, goal, yaw, first = ship.own, scene.goal, 0.0, second
    while second < until:
        if second == first or second % COURSE_S == 0:
            progress = advance(path, len(path), ship.state[PROGRESS], own[X], own[Y])
            errors = path_errors(own, path, len(path), progress, bounds.lookahead_m)
            yaw = own[YAW] - errors[COURSE] + offset
            off = (abs(errors[0]) + abs(errors[1])) / 50.0 + abs(errors[COURSE]) / math.pi
            ship.state[PROGRESS] = progress
            ship.state[COST] += COURSE_S * bounds.path_weight * off
        for _ in range(STEPS):
            rudder, thrust = steer(gains, model, ship.memory, own, yaw, speed, STEP_S)
            move_actuators(model, own, rudder, thrust, STEP_S)
            move_hull(model, own, STEP_S)
        second += 1
        gap = _gap(bounds, model, ship, scene, second)
        if gap <= bounds.margin_m:
            late = (second - bounds.certain_s) / max(bounds.horizon_s - bounds.certain_s, 1.0)
            share = 1.0 - min(max(late, 0.0), 1.0) * (1.0 - bounds.late_share)
            return True, second, bounds.collision * share
        ship.state[COST] += bounds.closeness * max(1.0 - gap / bounds.comfort_m, 0.0)
        if math.hypot(own[X] - goal[0], own[Y] - goal[1]) < goal[2]:
            return True, second, 0.0
    return False, second, 0.0


@njit(cache=True, nogil=True)
def _gap(bounds: Bounds, model: VesselModel, ship: Ship, scene: Scene, second: int) -> float:
    """Gap in m between the hull and anything else; beyond comfort_m a lower bound."""
    own, state = ship.own, ship.state
    far_m = bounds.comfort_m
    state[SAFE_M] -= 1.3 * max(abs(own[SURGE]), 0.5) + 0.5
    if state[SAFE_M] <= far_m:
        state[SAFE_M] = min(quay_gap(scene.walls, model, own, FAR_M), buoy_gap(scene.buoys, model, own))
    return min(state[SAFE_M], vessel_gap(scene.poses[second], scene.hulls, model, own, far_m))
