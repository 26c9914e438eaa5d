"""Compiled steps of one environment b of a world, and their loops over the batch."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from portnav_ros.control.autopilot import Gains, steer
from portnav_ros.geometry import segment_distance_squared, to_body
from portnav_ros.sim.contact import edge_gap, hull_gap, point_gap
from portnav_ros.sim.lidar import cast_disc, cast_edge, disturb
from portnav_ros.sim.traffic import Crowd, move_vessels, place_vessels
from portnav_ros.types import YAW, Array, Array32, IntArray, Outcome, X, Y
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
SEEN_X, SEEN_Y, SEEN_TICK, SEEN_QUAY, SEEN_BUOY, SEEN_VESSEL = range(6)


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
    outcome: [B]. ranges: [B, R]. clearance: [B, 3]. seen: [B, 6] where and when the sensor looked
    last, and the distance in m from there to the nearest quay, buoy and hull's circle, which bounds
    the next ones.
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


class Sensor(NamedTuple):
    """LidarParams as scalars for compiled code."""

    range_min_m: float
    range_max_m: float
    noise_m: float
    drop_out: float


@njit(cache=True, nogil=True)
def sense_all(
    chart: Chart, crowd: Crowd, body: Body, model: VesselModel, rays: Array, sensor: Sensor
) -> None:
    """Sense in every environment."""
    for b in range(len(body.own)):
        sense(chart, crowd, body, model, rays, sensor, b)


@njit(cache=True, nogil=True)
def tick_all(chart: Chart, crowd: Crowd, body: Body, model: VesselModel) -> None:
    """Advance every environment by one tick under its command."""
    for b in range(len(body.own)):
        tick(chart, crowd, body, model, b)


@njit(cache=True, nogil=True)
def step_all(
    chart: Chart, crowd: Crowd, body: Body, model: VesselModel, gains: Gains, rays: Array, sensor: Sensor
) -> None:
    """Advance every environment by one decision under its setpoint, then sense."""
    for b in range(len(body.own)):
        for _ in range(TICKS_PER_DECISION // TICKS_PER_CHECK):
            if body.outcome[b] != RUNNING:
                break
            _sail(body.own[b], body.memory[b], body.setpoint[b], body.command[b], model, gains)
            body.ticks[b] += TICKS_PER_CHECK
            _check(chart, crowd, body, model, b)
        sense(chart, crowd, body, model, rays, sensor, b)


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
def tick(chart: Chart, crowd: Crowd, body: Body, model: VesselModel, b: int) -> None:
    """Advance environment b by one tick; an ended episode stands still."""
    if body.outcome[b] != RUNNING:
        return
    move_actuators(model, body.own[b], body.command[b, 0], body.command[b, 1], TICK_S)
    move_hull(model, body.own[b], TICK_S)
    body.ticks[b] += 1
    if body.ticks[b] % TICKS_PER_CHECK == 0:
        _check(chart, crowd, body, model, b)


@njit(cache=True, nogil=True)
def _check(chart: Chart, crowd: Crowd, body: Body, model: VesselModel, b: int) -> None:
    """Move the traffic up to now and tell how the episode stands."""
    move_vessels(crowd, b, CHECK_S)
    place_vessels(crowd, b, 0.0)
    body.outcome[b] = _judge(chart, crowd, body, model, b)


@njit(cache=True, nogil=True)
def _judge(chart: Chart, crowd: Crowd, body: Body, model: VesselModel, b: int) -> int:
    """Tell how the episode stands; what was far when last sensed is not looked at again."""
    own, seen = body.own[b], body.seen[b]
    moved = math.hypot(own[X] - seen[SEEN_X], own[Y] - seen[SEEN_Y])
    reach = 0.5 * math.hypot(model.length_m, model.beam_m) + moved
    if seen[SEEN_QUAY] <= reach and quay_gap(chart, model, own, b, 0.0) <= 0.0:
        return QUAY
    if seen[SEEN_BUOY] <= reach and buoy_gap(chart, model, own, b) <= 0.0:
        return BUOY
    elapsed = (body.ticks[b] - seen[SEEN_TICK]) * TICK_S
    fastest = 0.0
    for m in range(crowd.count[b]):
        fastest = max(fastest, crowd.speed[b, m])
    if seen[SEEN_VESSEL] <= reach + fastest * elapsed and vessel_gap(crowd, model, own, b, 0.0) <= 0.0:
        return VESSEL
    if math.hypot(own[X] - chart.goal[b, 0], own[Y] - chart.goal[b, 1]) <= chart.goal[b, 2]:
        return SUCCESS
    return TIMEOUT if body.ticks[b] >= body.limit[b] else RUNNING


@njit(cache=True, nogil=True)
def quay_gap(chart: Chart, model: VesselModel, own: Array, b: int, far_m: float) -> float:
    """Gap in m between the own hull and the nearest quay; exact up to far_m, a lower bound beyond."""
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    reach = math.hypot(half_length, half_beam) + far_m
    gap, beyond = math.inf, math.inf
    for e in range(chart.wall_count[b]):
        x0, y0, x1, y1 = chart.walls[b, e]
        squared = segment_distance_squared(own[X], own[Y], x0, y0, x1, y1)
        if squared > reach * reach:
            beyond = min(beyond, squared)
            continue
        ax, ay = to_body(own[X], own[Y], own[YAW], x0, y0)
        zx, zy = to_body(own[X], own[Y], own[YAW], x1, y1)
        gap = min(gap, edge_gap(half_length, half_beam, ax, ay, zx, zy))
    return min(gap, math.sqrt(beyond) - reach + far_m)


@njit(cache=True, nogil=True)
def buoy_gap(chart: Chart, model: VesselModel, own: Array, b: int) -> float:
    """Gap in m between the own hull and the nearest buoy."""
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    gap = math.inf
    for k in range(chart.buoy_count[b]):
        x, y = to_body(own[X], own[Y], own[YAW], chart.buoys[b, k, 0], chart.buoys[b, k, 1])
        gap = min(gap, max(point_gap(half_length, half_beam, x, y) - chart.buoys[b, k, 2], 0.0))
    return gap


@njit(cache=True, nogil=True)
def vessel_gap(crowd: Crowd, model: VesselModel, own: Array, b: int, far_m: float) -> float:
    """Gap in m between the own hull and the nearest other; exact up to far_m, a lower bound beyond."""
    half_length, half_beam = 0.5 * model.length_m, 0.5 * model.beam_m
    radius = math.hypot(half_length, half_beam)
    gap = math.inf
    for m in range(crowd.count[b]):
        x, y = to_body(own[X], own[Y], own[YAW], crowd.pose[b, m, 0], crowd.pose[b, m, 1])
        if math.isnan(x):
            continue
        length, beam = 0.5 * crowd.hull[b, m, 0], 0.5 * crowd.hull[b, m, 1]
        bound = math.hypot(x, y) - radius - math.hypot(length, beam)
        if bound > far_m:
            gap = min(gap, bound)
        elif bound < gap:
            yaw = crowd.pose[b, m, 2] - own[YAW]
            gap = min(gap, hull_gap(half_length, half_beam, x, y, yaw, length, beam))
    return gap


@njit(cache=True, nogil=True)
def sense(
    chart: Chart, crowd: Crowd, body: Body, model: VesselModel, rays: Array, sensor: Sensor, b: int
) -> None:
    """Cast environment b's rays; note what is near."""
    own, ranges, seen = body.own[b], body.ranges[b], body.seen[b]
    place_vessels(crowd, b, (body.ticks[b] % TICKS_PER_CHECK) * TICK_S)
    ranges[:] = sensor.range_max_m
    seen[SEEN_X], seen[SEEN_Y], seen[SEEN_TICK] = own[X], own[Y], body.ticks[b]
    seen[SEEN_QUAY] = _cast_quays(chart, own, rays, ranges, sensor.range_max_m, b)
    seen[SEEN_BUOY] = _cast_buoys(chart, own, rays, ranges, sensor.range_max_m, b)
    seen[SEEN_VESSEL] = _cast_hulls(crowd, own, rays, ranges, sensor.range_max_m, b)
    disturb(
        ranges,
        sensor.range_min_m,
        sensor.range_max_m,
        sensor.noise_m,
        sensor.drop_out,
        crowd.seed[b],
        body.ticks[b],
    )
    radius = 0.5 * math.hypot(model.length_m, model.beam_m)
    quay, buoy, vessel = seen[SEEN_QUAY] - radius, seen[SEEN_BUOY] - radius, seen[SEEN_VESSEL] - radius
    body.clearance[b, 0] = quay if quay > FAR_M else quay_gap(chart, model, own, b, FAR_M)
    body.clearance[b, 1] = buoy if buoy > FAR_M else buoy_gap(chart, model, own, b)
    body.clearance[b, 2] = vessel if vessel > FAR_M else vessel_gap(crowd, model, own, b, FAR_M)


@njit(cache=True, nogil=True)
def _cast_quays(chart: Chart, own: Array, rays: Array, ranges: Array32, reach: float, b: int) -> float:
    x, y, cosine, sine = own[X], own[Y], math.cos(own[YAW]), math.sin(own[YAW])
    nearest = math.inf
    for e in range(chart.wall_count[b]):
        wall = chart.walls[b, e]
        x0, y0, x1, y1 = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
        if min(x0, x1) > reach or max(x0, x1) < -reach or min(y0, y1) > reach or max(y0, y1) < -reach:
            continue
        squared = segment_distance_squared(0.0, 0.0, x0, y0, x1, y1)
        nearest = min(nearest, squared)
        if squared < reach * reach:
            cast_edge(
                rays,
                ranges,
                cosine * x0 + sine * y0,
                cosine * y0 - sine * x0,
                cosine * x1 + sine * y1,
                cosine * y1 - sine * x1,
            )
    return min(math.sqrt(nearest), reach)


@njit(cache=True, nogil=True)
def _cast_buoys(chart: Chart, own: Array, rays: Array, ranges: Array32, reach: float, b: int) -> float:
    nearest = math.inf
    for k in range(chart.buoy_count[b]):
        x, y = to_body(own[X], own[Y], own[YAW], chart.buoys[b, k, 0], chart.buoys[b, k, 1])
        radius = chart.buoys[b, k, 2]
        distance = math.sqrt(x * x + y * y) - radius
        nearest = min(nearest, distance)
        if distance < reach:
            cast_disc(rays, ranges, x, y, radius)
    return nearest


@njit(cache=True, nogil=True)
def _cast_hulls(crowd: Crowd, own: Array, rays: Array, ranges: Array32, reach: float, b: int) -> float:
    """Return the distance from the sensor to the circle about the nearest hull."""
    nearest = math.inf
    for m in range(crowd.count[b]):
        x, y = to_body(own[X], own[Y], own[YAW], crowd.pose[b, m, 0], crowd.pose[b, m, 1])
        if math.isnan(x):
            continue
        length, beam = 0.5 * crowd.hull[b, m, 0], 0.5 * crowd.hull[b, m, 1]
        distance = math.sqrt(x * x + y * y) - math.sqrt(length * length + beam * beam)
        nearest = min(nearest, distance)
        if distance >= reach:
            continue
        yaw = crowd.pose[b, m, 2] - own[YAW]
        cosine, sine = math.cos(yaw), math.sin(yaw)
        lx, ly, bx, by = cosine * length, sine * length, -sine * beam, cosine * beam
        px, py = x + lx + bx, y + ly + by
        for along, side in ((1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)):
            qx, qy = x + along * lx + side * bx, y + along * ly + side * by
            cast_edge(rays, ranges, px, py, qx, qy)
            px, py = qx, qy
    return nearest
