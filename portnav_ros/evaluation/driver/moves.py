"""What a vessel is led to do with --move, and whether it did it: rudder, thrust, neutral, enable."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from portnav_ros.evaluation.driver.record import (
    DriverRecord,
    Expected,
    Finding,
    JointSample,
    Motion,
    Move,
    motion,
)
from portnav_ros.types import STATE_SIZE, SURGE, THRUST, Actuation, Array
from portnav_ros.vessel import VesselParams, move_actuators, move_hull

NEUTRAL_S = 1.0  # age of the last command past which a driver goes neutral
DISABLED_S = 0.5
MARGIN_S = 0.5  # for a period of feedback, and for actuators to be seen moving
RELEASED = 0.05  # share of the deflection by which they are seen moving
DEVIATIONS = 3.0  # between chance and effect
CORRELATED = 10  # samples that count as one
LEAST_SHARE = 0.3  # of the speed that the preset foresees to gain
END_S, TURN_S = 0.5, 2.0  # at the end of a move, over which speed and yaw rate are taken
STEP_S = 0.05
NAMES = ('thrust', 'rudder', 'neutral', 'disabled')


class Step(NamedTuple):
    """One move: shares of full rudder and thrust; silent: nothing is sent; enable: is called first."""

    name: str
    duration_s: float
    rudder: float = 0.0
    thrust: float = 0.0
    silent: bool = False
    enable: bool | None = None


HELM, AHEAD = 0.3, 0.2
STEPS = (
    Step('coast', 5.0, enable=True),
    Step('ahead', 8.0, 0.0, AHEAD),
    Step('bow to port', 10.0, HELM, AHEAD),
    Step('bow to starboard', 10.0, -HELM, AHEAD),
    Step('silence', 3.0, silent=True),
    Step('ahead again', 4.0, HELM, AHEAD, enable=True),
    Step('disabled', 2.0, HELM, AHEAD, enable=False),
    Step('neutral', 2.0, enable=True),
)


def command_of(step: Step, vessel: VesselParams) -> Actuation | None:
    """What a step sends; None for silence."""
    if step.silent:
        return None
    return Actuation(step.rudder * vessel.rudder_max_rad, step.thrust * vessel.thrust_max_n)


def check_moves(moves: Sequence[Move], record: DriverRecord, expected: Expected) -> list[Finding]:
    """Judge the moves that were made; those that were not are left out."""
    made, track = {move.name: move for move in moves}, motion(record.odometry)
    return [
        _check_thrust(made, track, expected),
        _check_rudder(made, track),
        _check_release('neutral', made, ('bow to starboard', 'silence'), NEUTRAL_S, record, track, expected),
        _check_release('disabled', made, ('ahead again', 'disabled'), DISABLED_S, record, track, expected),
    ]


def moves_left_out(reason: str) -> list[Finding]:
    """Findings of the moves where none was made."""
    return [Finding(name, 'left out', reason) for name in NAMES]


def _check_thrust(made: dict[str, Move], track: Motion, expected: Expected) -> Finding:
    """Positive effort drives ahead: the speed made is nearer to the preset with that thrust than without."""
    if 'ahead' not in made:
        return Finding('thrust', 'left out', 'the move was not made')
    speed, noise, driven, idle = _speeds(track, made['ahead'], expected.vessel, 0.0, made['ahead'].command)
    share, clear = (speed - idle) / max(driven - idle, 1e-9), abs(speed - idle) > DEVIATIONS * noise
    found = f'{speed:.2f} m/s; the preset foresees {driven:.2f}, and {idle:.2f} without thrust'
    if clear and share < -LEAST_SHARE:
        return Finding('thrust', 'fail', f'astern: {found}', 'change the sign: effort above 0 drives ahead')
    if not (clear and share > LEAST_SHARE):
        mend = 'obey effort[propulsion] in N; is the vessel enabled, moored, or its preset too strong?'
        return Finding('thrust', 'fail', f'no effect seen: {found}', mend)
    return Finding('thrust', 'ok', found)


def _speeds(
    track: Motion, move: Move, vessel: VesselParams, held_n: float, command: Actuation | None
) -> tuple[float, float, float, float]:
    """Speed at the end of a move and its noise, and what the preset foresees with the command and without.

    held_n: thrust when the move begins. Speeds are means over END_S at either end, in m/s.
    """
    surge = track.velocity[:, 0]
    first, first_noise = _mean(track, move._replace(end_s=move.begin_s + END_S), surge)
    last, last_noise = _mean(track, move._replace(begin_s=move.end_s - END_S), surge)
    span_s = move.end_s - move.begin_s - END_S
    driven, idle = (
        _foreseen_mps(vessel, first, held_n, thrust_n, span_s)
        for thrust_n in (command.thrust_n if command else 0.0, 0.0)
    )
    return last, math.hypot(first_noise, last_noise), driven, idle


def _foreseen_mps(
    vessel: VesselParams, surge_mps: float, held_n: float, thrust_n: float, span_s: float
) -> float:
    """Speed of the preset's hull after so long, when its thrust goes from what is held to what is ordered."""
    own, model = np.zeros(STATE_SIZE), vessel.model()
    own[SURGE], own[THRUST] = surge_mps, held_n
    for _ in range(round(span_s / STEP_S)):
        move_actuators(model, own, 0.0, thrust_n, STEP_S)
        move_hull(model, own, STEP_S)
    return float(own[SURGE])


def _check_rudder(made: dict[str, Move], track: Motion) -> Finding:
    """Positive rudder turns the bow to port, negative to starboard."""
    if 'bow to starboard' not in made:
        return Finding('rudder', 'left out', 'the move was not made')
    straight, port, starboard = (
        _mean(track, move._replace(begin_s=move.end_s - TURN_S), track.yaw_rate_radps)
        for move in (made['ahead'], made['bow to port'], made['bow to starboard'])
    )
    to_port, to_starboard = port[0] - straight[0], starboard[0] - port[0]
    noise_port = DEVIATIONS * math.hypot(port[1], straight[1])
    noise_starboard = DEVIATIONS * math.hypot(starboard[1], port[1])
    found = f'yaw rate {to_port:+.5f} rad/s by +, then {to_starboard:+.5f} rad/s by - rudder'
    if to_port < -noise_port and to_starboard > noise_starboard:
        mend = 'change the sign: position[rudder] above 0 turns the bow to port'
        return Finding('rudder', 'fail', f'the wrong way: {found}', mend)
    if not (to_port > noise_port and to_starboard < -noise_starboard):
        mend = 'obey position[rudder] in rad, both ways; at rest a rudder may need more speed to be felt'
        return Finding('rudder', 'fail', f'no clear effect: {found}', mend)
    return Finding('rudder', 'ok', found)


def _check_release(
    name: str,
    made: dict[str, Move],
    pair: tuple[str, str],
    limit_s: float,
    record: DriverRecord,
    track: Motion,
    expected: Expected,
) -> Finding:
    """Rudder and thrust go back to neutral within a limit from the begin of the second move of a pair."""
    if pair[1] not in made:
        return Finding(name, 'left out', 'the move was not made')
    before, after = made[pair[0]], made[pair[1]]
    when = 'commands stopped' if name == 'neutral' else '~/enable was called with false'
    mend = f'make rudder and thrust neutral within {limit_s} s of when {when}'
    if not record.joints:
        return _release_by_speed(name, before, after, limit_s, track, expected.vessel, mend)
    took_s = [_release_time_s(record.joints, after, column) for column in (0, 1)]
    if None in took_s:
        return Finding(name, 'left out', 'joint_states shows neither rudder nor thrust obeying')
    slowest_s = max(time_s for time_s in took_s if time_s is not None)
    found = f'moving back {slowest_s:.2f} s after {when}'
    if slowest_s > limit_s + MARGIN_S:
        found = found if math.isfinite(slowest_s) else f'did not move back after {when}'
        return Finding(name, 'fail', found, mend)
    return Finding(name, 'ok', found)


def _release_time_s(joints: Sequence[JointSample], after: Move, column: int) -> float | None:
    """Time from a move's begin until feedback has left its deflection for good.

    inf: it is still there when the move ends; None: there was no deflection.
    """
    times, values = _feedback(joints, column)
    held = np.abs(values[times <= after.begin_s + 1e-6])
    if len(held) == 0 or not held[-1] > 0.0:
        return None
    later = (times > after.begin_s) & (times <= after.end_s)
    deflected = np.abs(values[later]) > (1.0 - RELEASED) * held[-1]
    if not later.any() or deflected[-1]:
        return math.inf
    return float(np.max(times[later][deflected], initial=after.begin_s) - after.begin_s)


def _feedback(joints: Sequence[JointSample], column: int) -> tuple[Array, Array]:
    pairs = [(joint.stamp_s, joint.actuation[column]) for joint in joints if joint.actuation is not None]
    times, values = np.array(pairs).reshape(-1, 2).T
    return times, values


def _release_by_speed(
    name: str, before: Move, after: Move, limit_s: float, track: Motion, vessel: VesselParams, mend: str
) -> Finding:
    """Without feedback: once the limit has passed, the speed made is nearer to the preset without thrust."""
    held_n = before.command.thrust_n if before.command else 0.0
    rest = after._replace(begin_s=after.begin_s + limit_s)
    speed, noise, driven, idle = _speeds(track, rest, vessel, held_n, before.command)
    found = (
        f'without joint_states: {speed:.2f} m/s; the preset foresees {idle:.2f}, {driven:.2f} under thrust'
    )
    if driven - speed > max(0.5 * (driven - idle), DEVIATIONS * noise):
        return Finding(name, 'ok', found)
    return Finding(name, 'fail', f'not seen; {found}', f'{mend}, or publish joint_states so that it shows')


def _mean(track: Motion, move: Move, values: Array) -> tuple[float, float]:
    """Mean over a move, and its standard error; successive samples of a hull are no separate witnesses."""
    chosen = values[(track.stamp_s >= move.begin_s) & (track.stamp_s <= move.end_s)]
    if len(chosen) < 3:
        return 0.0, math.inf
    return float(chosen.mean()), float(chosen.std() / math.sqrt(max(len(chosen) / CORRELATED, 1.0)))
