"""Compiled steps of a world of B environments."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.control.autopilot import Gains, steer
from portnav_ros.geometry import segment_distance_squared, to_body
from portnav_ros.sim.contact import edge_gap, hull_gap, point_gap
from portnav_ros.sim.lidar import Sensor, cast_disc, cast_edge, disturb
from portnav_ros.sim.traffic import Crowd, move_vessels, place_vessels
from portnav_ros.types import YAW, Array, Array32, BoolArray, IntArray, Outcome, X, Y
from portnav_ros.vessel import VesselModel, move_actuators, move_hull

TICK_S = 0.05  # physics, autopilot, odometry and actuator commands: 20 Hz
DECISION_S = 1.0  # local planner
TICKS_PER_DECISION = 20
TICKS_PER_CHECK = 5  # traffic, collisions, goal and time limit: 4 Hz
CHECK_S = TICKS_PER_CHECK * TICK_S
FAR_M = 60.0  # beyond this gap from the hull's circle a clearance is that of the circle

RUNNING, SUCCESS = int(Outcome.RUNNING), int(Outcome.SUCCESS)
QUAY, BUOY, VESSEL = int(Outcome.COLLISION_QUAY), int(Outcome.COLLISION_BUOY), int(Outcome.COLLISION_VESSEL)
TIMEOUT = int(Outcome.TIMEOUT)
SEEN_X, SEEN_Y, SEEN_TICK, SEEN_QUAY, SEEN_BUOY, SEEN_VESSEL, SEEN_SPEED = range(7)
SEEN_SIZE = 7


class Chart(NamedTuple):
    """What is fixed: walls [B, E, 4], buoys [B, K, 3], their counts [B], goal [B, 3] x, y, radius."""

    walls: Array
    wall_count: IntArray
    buoys: Array
    buoy_count: IntArray
    goal: Array


class Body(NamedTuple):
    """Own ship and episode.

    own: [B, 7]. memory: [B, 2] integrals of the autopilot. setpoint, command: [B, 2]. ticks, limit,
    outcome: [B]. ranges: [B, R]. clearance: [B, 3]. seen: [B, 7] where and when the sensor looked
    last, the distance in m from there to the nearest quay, buoy and hull's circle, and the speed of
    the fastest vessel: they bound what can be near until it looks again.
    """

    own: Array
    memory: Array
    setpoint: Array
    command: Array
    ticks: IntArray
    limit: IntArray
    outcome: IntArray
    ranges: Array32
    clearance: Array
    seen: Array


@njit(cache=True, nogil=True)
def tick_all(chart: Chart, crowd: Crowd, body: Body, model: VesselModel) -> None:
    """Advance every environment by one tick under its command; an ended episode stands still."""
    due = np.zeros(len(body.own), np.bool_)
    for b in range(len(body.own)):
        if body.outcome[b] == RUNNING:
            move_actuators(model, body.own[b], body.command[b, 0], body.command[b, 1], TICK_S)
            move_hull(model, body.own[b], TICK_S)
            body.ticks[b] += 1
            due[b] = body.ticks[b] % TICKS_PER_CHECK == 0
    if due.any():
        _check(chart, crowd, body, model, due)


@njit(cache=True, nogil=True)
def step_all(
    chart: Chart, crowd: Crowd, body: Body, model: VesselModel, gains: Gains, rays: Array, sensor: Sensor
) -> None:
    """Advance every environment by one decision under its setpoint, then sense.

    Each stage runs over the whole batch: handing thirty arrays to a function costs more than the
    work that it does for one environment.
    """
    for _ in range(TICKS_PER_DECISION // TICKS_PER_CHECK):
        running = body.outcome == RUNNING
        for b in np.flatnonzero(running):
            _sail(body.own[b], body.memory[b], body.setpoint[b], body.command[b], model, gains)
            body.ticks[b] += TICKS_PER_CHECK
        _check(chart, crowd, body, model, running)
    sense_all(chart, crowd, body, model, rays, sensor)


@njit(cache=True, nogil=True)
def _sail(
    own: Array, memory: Array, setpoint: Array, command: Array, model: VesselModel, gains: Gains
) -> None:
    """Advance one vessel under its autopilot from one check to the next."""
    for _ in range(TICKS_PER_CHECK):
        rudder, thrust = steer(gains, model, memory, own, setpoint[0], setpoint[1], TICK_S)
        command[0], command[1] = rudder, thrust
        move_actuators(model, own, rudder, thrust, TICK_S)
        move_hull(model, own, TICK_S)


@njit(cache=True, nogil=True)
def _check(chart: Chart, crowd: Crowd, body: Body, model: VesselModel, due: BoolArray) -> None:
    """Move the traffic up to now and tell how the episodes that are due [B] stand."""
    move_vessels(crowd, due, CHECK_S)
    place_vessels(crowd, np.zeros(len(due)))
    radius = 0.5 * math.hypot(model.length_m, model.beam_m)
    for b in np.flatnonzero(due):
        own, seen = body.own[b], body.seen[b]
        reach = radius + math.hypot(own[X] - seen[SEEN_X], own[Y] - seen[SEEN_Y])
        elapsed = (body.ticks[b] - seen[SEEN_TICK]) * TICK_S
        walls, buoys = chart.walls[b, : chart.wall_count[b]], chart.buoys[b, : chart.buoy_count[b]]
        poses, goal = crowd.pose[b, : crowd.vessels[b]], chart.goal[b]
        near_vessel = seen[SEEN_VESSEL] <= reach + seen[SEEN_SPEED] * elapsed
        if seen[SEEN_QUAY] <= reach and quay_gap(walls, model, own, 0.0) <= 0.0:
            body.outcome[b] = QUAY
        elif seen[SEEN_BUOY] <= reach and buoy_gap(buoys, model, own) <= 0.0:
            body.outcome[b] = BUOY
        elif near_vessel and vessel_gap(poses, crowd.hull[b], model, own, 0.0) <= 0.0:
            body.outcome[b] = VESSEL
        elif math.hypot(own[X] - goal[0], own[Y] - goal[1]) <= goal[2]:
            body.outcome[b] = SUCCESS
        elif body.ticks[b] >= body.limit[b]:
            body.outcome[b] = TIMEOUT


@njit(cache=True, nogil=True)
def quay_gap(walls: Array, model: VesselModel, own: Array, far_m: float) -> float:
    """Gap in m between the own hull and the nearest wall [E, 4]; beyond far_m a lower bound."""
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    reach = math.hypot(half_length, half_beam) + far_m
    gap, beyond = math.inf, math.inf
    for e in range(len(walls)):
        x0, y0, x1, y1 = walls[e]
        squared = segment_distance_squared(own[X], own[Y], x0, y0, x1, y1)
        if squared > reach * reach:
            beyond = min(beyond, squared)
            continue
        ax, ay = to_body(own[X], own[Y], own[YAW], x0, y0)
        zx, zy = to_body(own[X], own[Y], own[YAW], x1, y1)
        gap = min(gap, edge_gap(half_length, half_beam, ax, ay, zx, zy))
    return min(gap, math.sqrt(beyond) - reach + far_m)


@njit(cache=True, nogil=True)
def buoy_gap(buoys: Array, model: VesselModel, own: Array) -> float:
    """Gap in m between the own hull and the nearest buoy [K, 3]."""
    gap = math.inf
    for k in range(len(buoys)):
        x, y = to_body(own[X], own[Y], own[YAW], buoys[k, 0], buoys[k, 1])
        centre = point_gap(0.5 * model.length_m, 0.5 * model.beam_m, x, y)
        gap = min(gap, max(centre - buoys[k, 2], 0.0))
    return gap


@njit(cache=True, nogil=True)
def vessel_gap(poses: Array, hulls: Array, model: VesselModel, own: Array, far_m: float) -> float:
    """Gap in m between the own hull and the nearest other [M, 4]; beyond far_m a lower bound."""
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    radius = math.hypot(half_length, half_beam)
    gap = math.inf
    for m in range(len(poses)):
        x, y = to_body(own[X], own[Y], own[YAW], poses[m, 0], poses[m, 1])
        if math.isnan(x):
            continue
        length, beam = 0.5 * hulls[m, 0], 0.5 * hulls[m, 1]
        bound = math.hypot(x, y) - radius - math.hypot(length, beam)
        if bound > far_m:
            gap = min(gap, bound)
        elif bound < gap:
            yaw = poses[m, 2] - own[YAW]
            gap = min(gap, hull_gap(half_length, half_beam, x, y, yaw, length, beam))
    return gap


@njit(cache=True, nogil=True)
def sense_all(
    chart: Chart, crowd: Crowd, body: Body, model: VesselModel, rays: Array, sensor: Sensor
) -> None:
    """Cast the rays of every environment and note what is near."""
    place_vessels(crowd, (body.ticks % TICKS_PER_CHECK) * TICK_S)
    for b in range(len(body.own)):
        walls = chart.walls[b, : chart.wall_count[b]]
        buoys = chart.buoys[b, : chart.buoy_count[b]]
        poses = crowd.pose[b, : crowd.vessels[b]]
        own, ranges, seen = body.own[b], body.ranges[b], body.seen[b]
        ranges[:] = sensor.range_max_m
        seen[SEEN_X], seen[SEEN_Y], seen[SEEN_TICK] = own[X], own[Y], body.ticks[b]
        seen[SEEN_QUAY] = _cast_quays(walls, own, rays, ranges, sensor.range_max_m)
        seen[SEEN_BUOY] = _cast_buoys(buoys, own, rays, ranges, sensor.range_max_m)
        seen[SEEN_VESSEL] = _cast_hulls(poses, crowd.hull[b], own, rays, ranges, sensor.range_max_m)
        seen[SEEN_SPEED] = crowd.speed[b].max()
        _note_clearance(body.clearance[b], seen, walls, buoys, poses, crowd.hull[b], model, own)
        disturb(ranges, sensor, crowd.seed[b], body.ticks[b])


@njit(cache=True, nogil=True)
def _note_clearance(
    clearance: Array,
    seen: Array,
    walls: Array,
    buoys: Array,
    poses: Array,
    hulls: Array,
    model: VesselModel,
    own: Array,
) -> None:
    radius = 0.5 * math.hypot(model.length_m, model.beam_m)
    quay, buoy, vessel = seen[SEEN_QUAY] - radius, seen[SEEN_BUOY] - radius, seen[SEEN_VESSEL] - radius
    clearance[0] = quay if quay > FAR_M else quay_gap(walls, model, own, FAR_M)
    clearance[1] = buoy if buoy > FAR_M else buoy_gap(buoys, model, own)
    clearance[2] = vessel if vessel > FAR_M else vessel_gap(poses, hulls, model, own, FAR_M)


@njit(cache=True, nogil=True)
def _cast_quays(walls: Array, own: Array, rays: Array, ranges: Array32, reach: float) -> float:
    """Return the distance from the sensor to the nearest wall, at most reach."""
    x, y, cosine, sine = own[X], own[Y], math.cos(own[YAW]), math.sin(own[YAW])
    nearest = reach * reach
    for e in range(len(walls)):
        x0, y0, x1, y1 = walls[e, 0] - x, walls[e, 1] - y, walls[e, 2] - x, walls[e, 3] - y
        if min(x0, x1) > reach or max(x0, x1) < -reach or min(y0, y1) > reach or max(y0, y1) < -reach:
            continue
        squared = segment_distance_squared(0.0, 0.0, x0, y0, x1, y1)
        nearest = min(nearest, squared)
        if squared < reach * reach:
            ax, ay = cosine * x0 + sine * y0, cosine * y0 - sine * x0
            zx, zy = cosine * x1 + sine * y1, cosine * y1 - sine * x1
            cast_edge(rays, ranges, ax, ay, zx, zy)
    return math.sqrt(nearest)


@njit(cache=True, nogil=True)
def _cast_buoys(buoys: Array, own: Array, rays: Array, ranges: Array32, reach: float) -> float:
    """Return the distance from the sensor to the nearest buoy."""
    nearest = math.inf
    for k in range(len(buoys)):
        x, y = to_body(own[X], own[Y], own[YAW], buoys[k, 0], buoys[k, 1])
        distance = math.sqrt(x * x + y * y) - buoys[k, 2]
        nearest = min(nearest, distance)
        if distance < reach:
            cast_disc(rays, ranges, x, y, buoys[k, 2])
    return nearest


@njit(cache=True, nogil=True)
def _cast_hulls(poses: Array, hulls: Array, own: Array, rays: Array, ranges: Array32, reach: float) -> float:
    """Return the distance from the sensor to the circle about the nearest hull."""
    nearest = math.inf
    for m in range(len(poses)):
        x, y = to_body(own[X], own[Y], own[YAW], poses[m, 0], poses[m, 1])
        if math.isnan(x):
            continue
        length, beam = 0.5 * hulls[m, 0], 0.5 * hulls[m, 1]
        distance = math.sqrt(x * x + y * y) - math.sqrt(length * length + beam * beam)
        nearest = min(nearest, distance)
        if distance >= reach:
            continue
        yaw = poses[m, 2] - own[YAW]
        cosine, sine = math.cos(yaw), math.sin(yaw)
        lx, ly, bx, by = cosine * length, sine * length, -sine * beam, cosine * beam
        px, py = x + lx + bx, y + ly + by
        for along, side in ((1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)):
            qx, qy = x + along * lx + side * bx, y + along * ly + side * by
            cast_edge(rays, ranges, px, py, qx, qy)
            px, py = qx, qy
    return nearest
