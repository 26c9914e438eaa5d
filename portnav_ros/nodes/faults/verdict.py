"""How long a vessel goes on after a fault, told by the commands that its driver gets. No ROS."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

NEUTRAL_S = 1.0  # silence past which the contract asks a driver to go neutral by itself
AT_REST_MPS = 0.1


class Commanded(NamedTuple):
    """A command at the time in s of the driver when it came, and whether it was safe."""

    time_s: float
    safe: bool


class Asked(NamedTuple):
    """Speed of a setpoint in m/s at the time in s of the driver when it came."""

    time_s: float
    speed_mps: float


class Row(NamedTuple):
    """What came of one fault.

    limit_s: within which the vessel must be stopped, NaN where it must sail on. measured_s: from the fault
    to the last unsafe command; where it must sail on, how long it was told to stop. stopped: whether the
    commands stayed safe from the limit on; where it must sail on, whether it was ever told to stop.
    recovered: whether it sailed again once the fault was gone. reason: in the words of the graph.
    complaint: why it failed.
    """

    name: str
    limit_s: float
    measured_s: float
    stopped: bool
    recovered: bool
    reason: str
    complaint: str = ''

    @property
    def passed(self) -> bool:
        """Whether the graph did as it should."""
        return not self.complaint


class DriverClock:
    """The time of a driver: its newest stamp, carried on by a steady clock, and over a restart."""

    def __init__(self) -> None:
        self._stamp_s, self._steady_s, self._offset_s = 0.0, math.inf, 0.0

    def note(self, stamp_s: float, steady_s: float) -> None:
        """Take in a stamp; one that is earlier than the last comes from a driver that was started again."""
        if stamp_s < self._stamp_s:
            self._offset_s = self.now_s(steady_s) - stamp_s
        self._stamp_s, self._steady_s = stamp_s, steady_s

    def now_s(self, steady_s: float) -> float:
        """Return the time in s since the first driver began."""
        return self._offset_s + self._stamp_s + max(steady_s - self._steady_s, 0.0)


def is_safe(thrust_n: float, stop_asked: bool, surge_mps: float) -> bool:
    """Whether a command lets the vessel stop: no thrust ahead, but for what holds it at rest."""
    return thrust_n <= 0.0 or (stop_asked and surge_mps <= AT_REST_MPS)


def unsafe_for_s(commands: Sequence[Commanded], began_s: float, ended_s: float) -> float:
    """Time in s from the beginning until the last unsafe command was out of effect.

    A command is in effect until the next one comes, or until the driver goes neutral for lack of one.

    Args:
        commands: in the order of time; one from before the beginning may still be in effect.
        began_s: when the fault began.
        ended_s: until when to look.
    """
    last_s = began_s
    for number, command in enumerate(commands):
        following_s = commands[number + 1].time_s if number + 1 < len(commands) else math.inf
        over_s = min(following_s, command.time_s + NEUTRAL_S, ended_s)
        if not command.safe and command.time_s < ended_s:
            last_s = max(last_s, over_s)
    return last_s - began_s


def stopped_for_s(setpoints: Sequence[Asked], began_s: float, ended_s: float) -> float:
    """Time in s between beginning and end for which the newest setpoint was a stop."""
    times_s = [min(max(asked.time_s, began_s), ended_s) for asked in setpoints]
    spans_s = [after - before for before, after in itertools.pairwise([*times_s, ended_s])]
    return sum(span for span, asked in zip(spans_s, setpoints, strict=True) if asked.speed_mps == 0.0)
