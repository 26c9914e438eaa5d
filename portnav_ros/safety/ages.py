"""How old the newest message of each input is, told by its stamp and by its receipt.

The stamps of a driver tell its time, and a steady clock carries it on between two of them: *now* is the
newest stamp heard plus the steady time since. So a lost input is missed even when all are lost at once, and
a run in simulated time needs no clock of its own. In lock-step, where time waits for the answer, the stamps
are the steady clock, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

SECOND_NS = 1_000_000_000
FUTURE_S = 0.1
REORDERED_S = 0.1
CONFIRMATIONS = 3  # messages of one new time, before a jump ahead is believed


class Arrival(Enum):
    """What became of a message."""

    TAKEN = 'taken'
    REPEATED = 'repeated'  # its stamp does not advance, so it says nothing new
    FUTURE = 'stamp lies in the future'
    JUMPED = 'the clock has jumped'  # all inputs are forgotten but this message


class _Heard(NamedTuple):
    stamp_ns: int
    steady_s: float
    advanced: bool  # a driver that waits for its first command repeats its first stamp


class InputAges:
    """Ages of a node's inputs.

    The first input is the reference, whose stamps tell the driver's time. Where it jumps back, or ahead by
    more than steady time and its own limit allow, all inputs are forgotten. What came before its first stamp,
    and lies in the future of that, is forgotten, too.
    """

    def __init__(self, limits_s: Mapping[str, float], rate: float = 1.0) -> None:
        """Watch inputs.

        Args:
            limits_s: age in s past which each is too old; the first is the reference.
            rate: simulated seconds per second. Where that is more than one, the limits are of the clock: a
                process that waits for its turn is no lost sensor.
        """
        patience = max(rate, 1.0)
        self._limits_s = {name: limit_s * patience for name, limit_s in limits_s.items()}
        self._reference = next(iter(limits_s))
        self._rate, self._future_s = rate, FUTURE_S * patience
        self._jumped = False  # until all inputs have been heard since
        self.forget()

    def forget(self) -> None:
        """Start anew: nothing was heard."""
        self._heard: dict[str, _Heard] = {}
        self._newest = _Heard(-1, 0.0, advanced=False)
        self._ahead, self._ahead_count = self._newest, 0

    @property
    def started(self) -> bool:
        """Whether time has begun: the reference has had two stamps."""
        return self._reference in self._heard and self._heard[self._reference].advanced

    def now_ns(self, steady_s: float) -> int:
        """Return the driver's time, -1 where nothing was heard."""
        return self._carried_on(self._newest, steady_s) if self._newest.stamp_ns >= 0 else -1

    def note(self, name: str, stamp_ns: int, steady_s: float) -> Arrival:
        """Take in the stamp of a message; those in the future must not be used."""
        last = self._heard.get(name)
        if last is not None and name == self._reference and self._jumps_back(last, stamp_ns):
            return self._begin(name, stamp_ns, steady_s)
        if self._newest.stamp_ns >= 0 and stamp_ns > self._latest_ns(name, steady_s):
            if name == self._reference and self._is_confirmed(stamp_ns, steady_s):
                return self._begin(name, stamp_ns, steady_s)
            return Arrival.FUTURE
        if last is not None and stamp_ns <= last.stamp_ns:
            if not last.advanced and stamp_ns == last.stamp_ns:
                self._take(name, _Heard(stamp_ns, steady_s, advanced=False))
            return Arrival.REPEATED
        self._take(name, _Heard(stamp_ns, steady_s, advanced=last is not None))
        return Arrival.TAKEN

    def age_s(self, name: str, steady_s: float) -> float:
        """Return the age of an input, infinite where it was never heard."""
        heard = self._heard.get(name)
        if heard is None:
            return math.inf
        by_stamp_s = (self.now_ns(steady_s) - heard.stamp_ns) / SECOND_NS
        return max(by_stamp_s, (steady_s - heard.steady_s) * self._rate)

    def too_old(self, steady_s: float) -> str:
        """Name the first input that is missing or too old; nothing where all are fresh."""
        for name in self._limits_s:
            if self.is_late(name, steady_s):
                missing = f'no {name} since the clock jumped' if self._jumped else f'no {name} yet'
                return f'{name} too old' if name in self._heard else missing
        return ''

    def is_late(self, name: str, steady_s: float) -> bool:
        """Whether an input is missing or too old."""
        return self.age_s(name, steady_s) > self._limits_s[name]

    def _carried_on(self, heard: _Heard, steady_s: float) -> int:
        return heard.stamp_ns + round((steady_s - heard.steady_s) * self._rate * SECOND_NS)

    def _latest_ns(self, name: str, steady_s: float) -> int:
        """The latest stamp that can be true."""
        slack_s = max(self._limits_s[name], self._future_s) if name == self._reference else self._future_s
        return self.now_ns(steady_s) + round(slack_s * SECOND_NS)

    def _jumps_back(self, last: _Heard, stamp_ns: int) -> bool:
        return stamp_ns < last.stamp_ns - round(REORDERED_S * SECOND_NS)

    def _is_confirmed(self, stamp_ns: int, steady_s: float) -> bool:
        """Whether the last messages from the future agree on one new time."""
        slack_ns = round(self._limits_s[self._reference] * SECOND_NS)
        agrees = abs(stamp_ns - self._carried_on(self._ahead, steady_s)) <= slack_ns
        self._ahead_count = self._ahead_count + 1 if self._ahead.stamp_ns >= 0 and agrees else 1
        self._ahead = _Heard(stamp_ns, steady_s, advanced=False)
        return self._ahead_count >= CONFIRMATIONS

    def _begin(self, name: str, stamp_ns: int, steady_s: float) -> Arrival:
        self.forget()
        self._jumped = True
        self._take(name, _Heard(stamp_ns, steady_s, advanced=False))
        return Arrival.JUMPED

    def _take(self, name: str, heard: _Heard) -> None:
        if name == self._reference and name not in self._heard:
            latest_ns = heard.stamp_ns + round(self._future_s * SECOND_NS)
            self._heard = {other: item for other, item in self._heard.items() if item.stamp_ns <= latest_ns}
        self._heard[name] = heard
        self._jumped = self._jumped and len(self._heard) < len(self._limits_s)
        if self._reference in self._heard and heard.stamp_ns >= self._newest.stamp_ns:
            self._newest = heard
