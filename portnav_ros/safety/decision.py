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


class Release(NamedTuple):
    """What is remembered between decisions.

    sailed: whether a setpoint was ever passed; the first is not made to wait. stop_yaw_rad: heading that
    is kept in a stop, None while sailing. reason: of the stop, the last one while it waits for release.
    clear_s: since when nothing speaks against sailing. limit_mps: of the speed, and limit_s: when it was
    last called for.
    """

    sailed: bool = False
    stop_yaw_rad: float | None = None
    reason: str = ''
    clear_s: float | None = None
    limit_mps: float = math.inf
    limit_s: float = -math.inf


def judge_setpoint(params: SetpointParams, last: Setpoint | None, setpoint: Setpoint) -> str:
    """Say why a setpoint makes no sense after the last one, or nothing; a stop always makes sense."""
    if not all(map(math.isfinite, setpoint)):
        return 'setpoint_raw is not finite'
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
    waiting = state.stop_yaw_rad is not None and state.sailed
    clear_s = now.time_s if state.clear_s is None or now.time_s < state.clear_s else state.clear_s
    if now.reason or now.setpoint is None:
        return _stop(state, now, now.reason or 'no setpoint_raw yet', None)
    if waiting and now.time_s - clear_s < params.release_s:
        return _stop(state, now, state.reason, clear_s)
    limit_mps, limit_s = now.limit_mps, now.time_s
    if limit_mps > state.limit_mps and now.time_s - state.limit_s < params.release_s:
        limit_mps, limit_s = state.limit_mps, state.limit_s
    passing = Release(sailed=True, limit_mps=limit_mps, limit_s=limit_s)
    if limit_mps >= now.setpoint.speed_mps:
        return passing, now.setpoint, ''
    reason = 'slowed: little room ahead' if limit_mps else 'no room to stop in'
    return passing, now.setpoint._replace(speed_mps=limit_mps), reason


def _stop(
    state: Release, now: Situation, reason: str, clear_s: float | None
) -> tuple[Release, Setpoint, str]:
    yaw_rad = now.yaw_rad if state.stop_yaw_rad is None else state.stop_yaw_rad
    stopped = Release(state.sailed, yaw_rad, reason, clear_s)
    return stopped, Setpoint(yaw_rad, 0.0), reason
