"""Beam search through space and time with the true dynamics and the true future of the traffic.

A node is the complete state of vessel and autopilot at a time. All nodes of a layer share that time,
so the beam keeps those with the least time-to-go (space_time_field), at most one in each cell of
place, heading and speed. Each edge holds one setpoint and runs the very kernels of the world, tick by
tick, so that the world repeats the plan exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.baselines.space_time_field import sample
from portnav_ros.control.autopilot import PID_SIZE, Gains, steer
from portnav_ros.geometry import TWO_PI, wrap_angle
from portnav_ros.harbour import ClearanceGrid, clearance_at
from portnav_ros.sim.kernels import (
    CHECK_S,
    TICK_S,
    TICKS_PER_CHECK,
    TICKS_PER_DECISION,
    buoy_gap,
    quay_gap,
    vessel_gap,
)
from portnav_ros.sim.traffic import Crowd, move_vessels, place_vessels
from portnav_ros.types import STATE_SIZE, SURGE, YAW, Array, Array32, IntArray, X, Y
from portnav_ros.vessel import VesselModel, move_actuators, move_hull

DEAD, SAILING, ARRIVED = range(3)
CELL_M, CELL_RAD, CELL_MPS = 6.0, math.radians(3.0), 0.25


class Problem(NamedTuple):
    """All there is to know about an episode.

    walls: [E, 4] m. buoys: [K, 3] m. goal: [3] x, y, radius in m. grid: clearance with every buoy.
    togo: [T + 1, H, W] s, time-to-go of a point at layers of time layer_s apart. poses: [C, M, 4] of
    the other vessels at each collision check from the start on. hulls: [M, 2] m. table: [A, 2]
    heading change in rad and speed in m/s of each edge. decisions: how many an edge holds its
    setpoint. margin_m: kept from everything. lead_s: how far ahead the time-to-go is read.
    """

    model: VesselModel
    gains: Gains
    walls: Array
    buoys: Array
    goal: Array
    grid: ClearanceGrid
    togo: Array32
    layer_s: float
    poses: Array
    hulls: Array
    table: Array
    decisions: int
    margin_m: float
    lead_s: float


class Layer(NamedTuple):
    """Nodes of one time: own [N, 7], memory [N, 2], parent [N], setpoint [N, 2], cost [N] s."""

    own: Array
    memory: Array
    parent: IntArray
    setpoint: Array
    cost: Array


@njit(cache=True, nogil=True)
def traffic_future(crowd: Crowd, poses: Array) -> None:
    """Write the poses [C, M, 4] of environment 0's vessels at each collision check; moves the crowd."""
    for k in range(len(poses)):
        place_vessels(crowd, np.zeros(1))
        poses[k] = crowd.pose[0]
        move_vessels(crowd, np.ones(1, np.bool_), CHECK_S)


@njit(cache=True, nogil=True)
def search(problem: Problem, own: Array, width: int, layers: int) -> tuple[Array, bool]:
    """Plan from a state row [7] at time 0 with a beam of `width` nodes over at most `layers` edges.

    Returns:
        Setpoints [T, 2], one for each decision, and whether they lead to the goal; where none do,
        those that come closest.
    """
    beam = _new_layer(width)
    beam.own[0] = own
    beam.memory[0] = 0.0
    children = _new_layer(width * len(problem.table))
    parents = np.zeros((layers + 1, width), np.int64)
    setpoints = np.zeros((layers + 1, width, 2))
    count, depth, last, arrived = 1, 0, 0, False
    while depth < layers and count > 0 and not arrived:
        born, winner = _expand(problem, beam, count, children, depth)
        arrived = winner >= 0
        kept = _keep(children, born, beam, width) if not arrived else 1
        if arrived:
            _copy(children, winner, beam, 0)
        if kept > 0:
            depth += 1
            parents[depth, :kept] = beam.parent[:kept]
            setpoints[depth, :kept] = beam.setpoint[:kept]
        count = kept
    plan = np.empty((depth * problem.decisions, 2))
    for layer in range(depth, 0, -1):
        plan[(layer - 1) * problem.decisions : layer * problem.decisions] = setpoints[layer, last]
        last = parents[layer, last]
    return plan, arrived


@njit(cache=True, nogil=True)
def _new_layer(size: int) -> Layer:
    return Layer(
        np.empty((size, STATE_SIZE)),
        np.empty((size, PID_SIZE)),
        np.empty(size, np.int64),
        np.empty((size, 2)),
        np.empty(size),
    )


@njit(cache=True, nogil=True)
def _copy(source: Layer, i: int, target: Layer, j: int) -> None:
    target.own[j] = source.own[i]
    target.memory[j] = source.memory[i]
    target.parent[j] = source.parent[i]
    target.setpoint[j] = source.setpoint[i]
    target.cost[j] = source.cost[i]


@njit(cache=True, nogil=True)
def _expand(problem: Problem, beam: Layer, count: int, children: Layer, depth: int) -> tuple[int, int]:
    """Sail every edge from every node; return the number of children and the one that arrived, or -1."""
    born, winner, earliest = 0, -1, np.iinfo(np.int64).max
    first_tick = depth * problem.decisions * TICKS_PER_DECISION
    for n in range(count):
        for a in range(len(problem.table)):
            children.own[born] = beam.own[n]
            children.memory[born] = beam.memory[n]
            children.parent[born] = n
            children.setpoint[born, 0] = wrap_angle(beam.own[n, YAW] + problem.table[a, 0])
            children.setpoint[born, 1] = problem.table[a, 1]
            state, tick = _sail(problem, children, born, first_tick)
            if state == DEAD:
                continue
            if state == ARRIVED and tick < earliest:
                winner, earliest = born, tick
            children.cost[born] = _time_to_go(problem, children.own[born], tick)
            born += 1
    return born, winner


@njit(cache=True, nogil=True)
def _sail(problem: Problem, nodes: Layer, n: int, tick: int) -> tuple[int, int]:
    """Hold the setpoint of node n in the order of sim.kernels; return how it ended, and the tick."""
    own, memory = nodes.own[n], nodes.memory[n]
    yaw, speed = nodes.setpoint[n, 0], nodes.setpoint[n, 1]
    goal = problem.goal
    for _ in range(problem.decisions * TICKS_PER_DECISION):
        rudder, thrust = steer(problem.gains, problem.model, memory, own, yaw, speed, TICK_S)
        move_actuators(problem.model, own, rudder, thrust, TICK_S)
        move_hull(problem.model, own, TICK_S)
        tick += 1
        if tick % TICKS_PER_CHECK == 0:
            check = tick // TICKS_PER_CHECK
            if check >= len(problem.poses) or _touches(problem, own, check):
                return DEAD, tick
            if math.hypot(own[X] - goal[0], own[Y] - goal[1]) <= goal[2]:
                return ARRIVED, tick
    return SAILING, tick


@njit(cache=True, nogil=True)
def _touches(problem: Problem, own: Array, check: int) -> bool:
    """Whether anything is within the margin of the hull."""
    model, margin = problem.model, problem.margin_m
    reach = 0.5 * math.hypot(model.length_m, model.beam_m) + margin
    if clearance_at(problem.grid, own[X], own[Y]) < reach + problem.grid.resolution_m:
        if quay_gap(problem.walls, model, own, margin) <= margin:
            return True
        if buoy_gap(problem.buoys, model, own) <= margin:
            return True
    return vessel_gap(problem.poses[check], problem.hulls, model, own, margin) <= margin


@njit(cache=True, nogil=True)
def _time_to_go(problem: Problem, own: Array, tick: int) -> float:
    """Time-to-go in s of where the vessel will be if it keeps on; worse where that is closed."""
    lead = problem.lead_s
    x = own[X] + lead * own[SURGE] * math.cos(own[YAW])
    y = own[Y] + lead * own[SURGE] * math.sin(own[YAW])
    now = tick * TICK_S
    there = lead + _look_up(problem, x, y, now + lead)
    return min(there, 2.0 * lead + _look_up(problem, own[X], own[Y], now))


@njit(cache=True, nogil=True)
def _look_up(problem: Problem, x: float, y: float, time_s: float) -> float:
    grid, last = problem.grid, len(problem.togo) - 1
    row, column = (y - grid.y0_m) / grid.resolution_m - 0.5, (x - grid.x0_m) / grid.resolution_m - 0.5
    at = min(time_s / problem.layer_s, float(last))
    k = min(int(at), last - 1)
    early = sample(problem.togo[k], row, column)
    late = sample(problem.togo[k + 1], row, column)
    return early + (at - k) * (late - early)


@njit(cache=True, nogil=True)
def _keep(children: Layer, born: int, beam: Layer, width: int) -> int:
    """Move the cheapest children into the beam, one for each cell; return how many."""
    kept = 0
    taken = {np.int64(-1)}
    for i in np.argsort(children.cost[:born]):
        if kept == width:
            break
        cell = _cell(children.own[i])
        if cell not in taken:
            taken.add(cell)
            _copy(children, i, beam, kept)
            kept += 1
    return kept


@njit(cache=True, nogil=True)
def _cell(own: Array) -> np.int64:
    """Number of the cell of place, heading and speed that a state row lies in."""
    column, row = math.floor(own[X] / CELL_M), math.floor(own[Y] / CELL_M)
    sector = int((wrap_angle(own[YAW]) + math.pi) / CELL_RAD)
    sectors = round(TWO_PI / CELL_RAD) + 1
    speed = int(max(own[SURGE], 0.0) / CELL_MPS)
    return np.int64(((column + 100_000) * 200_000 + row + 100_000) * sectors * 16 + sector * 16 + speed)
