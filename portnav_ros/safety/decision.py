"""Pass, slow down or stop: what becomes of a planner's setpoint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from portnav_ros.geometry import wrap_angle
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import Setpoint


@dataclass(frozen=True)
class SetpointParams:
    """What a setpoint may ask, and when sailing is allowed again.

    speed_max_mps: greatest speed that makes sense; below 0 none does. heading_jump_rad: greatest change from
    one setpoint to the next while under way; pi allows every change. release_s: time without any reason
    to stop before a stop ends, and before a speed limit rises.
    """

    speed_max_mps: float = 12.0
    heading_jump_rad: float = 2.8
    release_s: float = 2.0
    ranges: ClassVar[Ranges] = {
        'speed_max_mps': (0.1, 50.0),
        'heading_jump_rad': (0.1, math.pi),
        'release_s': (0.0, 600.0),
    }

    def __post_init__(self) -> None:
        """Refuse limits that make no sense."""
        check_ranges(self)


class Situation(NamedTuple):
    """What a decision stands on.

    time_s: of the driver. yaw_rad: of the vessel (map). setpoint: the planner's newest, None where there is
    none. reason: why the vessel must be stopped, or nothing. limit_mps: speed from which a stop stays clear.
    """

    time_s: float
    yaw_rad: float
    setpoint: Setpoint | None
    reason: str = ''
    limit_mps: float = math.inf


class Hold(NamedTuple):
    """Hysteresis of a stop.

    cleared: whether there was ever no reason; the first sailing is not made to wait. reason: to stop, the
    last one while it waits for release. clear_s: since when there has been none.
    """

    cleared: bool = False
    reason: str = ''
    clear_s: float | None = None


class Release(NamedTuple):
    """What is remembered between decisions.

    stop_yaw_rad: heading that is kept in a stop, None while sailing. limit_mps: of the speed, and limit_s:
    when it was last called for.
    """

    hold: Hold = Hold()
    stop_yaw_rad: float | None = None
    limit_mps: float = math.inf
    limit_s: float = -math.inf


def held(state: Hold, reason: str, time_s: float, release_s: float) -> Hold:
    """Hold a reason to stop until there has been none for a time; a clock that jumps back starts it anew."""
    if reason:
        return Hold(state.cleared, reason)
    if not state.reason or not state.cleared:
        return Hold(cleared=True)
    clear_s = time_s if state.clear_s is None or time_s < state.clear_s else state.clear_s
    waiting = time_s - clear_s < release_s
    return Hold(True, state.reason, clear_s) if waiting else Hold(cleared=True)


def judge_setpoint(params: SetpointParams, last: Setpoint | None, setpoint: Setpoint) -> str:
    """Say why a setpoint makes no sense after the last one, or nothing; a stop always makes sense."""
    if not 0.0 <= setpoint.speed_mps <= params.speed_max_mps:
        return f'setpoint_raw asks for {setpoint.speed_mps:.1f} m/s'
    if last is None or not last.speed_mps or not setpoint.speed_mps:
        return ''
    jump_rad = abs(wrap_angle(setpoint.yaw_rad - last.yaw_rad))
    return f'setpoint_raw jumps by {jump_rad:.2f} rad' if jump_rad > params.heading_jump_rad else ''


def decide(params: SetpointParams, state: Release, now: Situation) -> tuple[Release, Setpoint, str]:
    """Decide on a setpoint.

    Returns:
        What to hand over to the next decision; the setpoint, the very same where it passes; and why it
        is not what was asked for, or nothing.
    """
    missing = '' if now.setpoint else 'no setpoint_raw yet'
    hold = held(state.hold, now.reason or missing, now.time_s, params.release_s)
    if hold.reason or now.setpoint is None:
        yaw_rad = now.yaw_rad if state.stop_yaw_rad is None else state.stop_yaw_rad
        return Release(hold, yaw_rad), Setpoint(yaw_rad, 0.0), hold.reason
    limit_mps, limit_s = now.limit_mps, now.time_s
    if limit_mps > state.limit_mps and 0.0 <= now.time_s - state.limit_s < params.release_s:
        limit_mps, limit_s = state.limit_mps, state.limit_s
    passing = Release(hold, None, limit_mps, limit_s)
    if limit_mps >= now.setpoint.speed_mps:
        return passing, now.setpoint, ''
    reason = 'slowed: little room ahead' if limit_mps else 'no room to stop in'
    return passing, now.setpoint._replace(speed_mps=limit_mps), reason
