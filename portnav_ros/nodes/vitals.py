"""How a node is doing: what it hears, how old and how often, and how long its callbacks take.

Noting a message or a call costs less than a microsecond; figures are made when they are asked for, which
the diagnostics do once a second.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass, field

REPORTS = 5  # that a rate is told over
RECENT_S = 5.0  # that a refusal is worth a warning
CALLS = 200  # that the durations of a callback are told of
NO_STAMP = -1
NO_PERIOD = math.inf


@dataclass
class _Input:
    """Messages of a topic.

    lasting: they count for good, such as the last one of a latched topic. reports: time in s and number of
    messages at each of the last reports.
    """

    lasting: bool = False

    messages: int = 0
    refused: int = 0
    reason: str = ''
    refused_s: float = -math.inf
    heard_s: float = -math.inf
    stamp_ns: int = NO_STAMP
    reports: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=REPORTS))


@dataclass
class _Loop:
    """Calls of a callback, each of which should be over within the period."""

    period_s: float
    durations_s: deque[float] = field(default_factory=lambda: deque(maxlen=CALLS))

    @property
    def overruns(self) -> int:
        return sum(duration_s > self.period_s for duration_s in self.durations_s)


class Vitals:
    """Inputs and callbacks of one node. Times are of a steady clock, in s."""

    def __init__(self) -> None:
        self._inputs: dict[str, _Input] = {}
        self._loops: dict[str, _Loop] = {}
        self._newest_ns = NO_STAMP

    def expect(self, topic: str, lasting: bool = False) -> None:
        """Tell of a topic even while nothing is heard of it; a lasting one outlives ``begin``."""
        self._inputs.setdefault(topic, _Input(lasting))

    def watch(self, callback: str, period_s: float = NO_PERIOD) -> None:
        """Tell of a callback's calls, each of which should be over before the next is due."""
        self._loops.setdefault(callback, _Loop(period_s))

    def hear(self, topic: str, now_s: float, stamp_ns: int = NO_STAMP) -> None:
        """Take note of a message of an expected topic, and of its stamp where it has one."""
        heard = self._inputs[topic]
        heard.messages += 1
        heard.heard_s = now_s
        if stamp_ns != NO_STAMP:
            heard.stamp_ns = self._newest_ns = stamp_ns

    def refuse(self, topic: str, reason: str, now_s: float) -> None:
        """Take note that a message of an expected topic could not be used."""
        refusing = self._inputs[topic]
        refusing.refused += 1
        refusing.reason, refusing.refused_s = reason, now_s

    def spend(self, callback: str, duration_s: float) -> None:
        """Take note of a call of a watched callback."""
        self._loops[callback].durations_s.append(duration_s)

    def begin(self) -> None:
        """Forget all that was heard and done, but for lasting topics."""
        self._inputs = {topic: item if item.lasting else _Input() for topic, item in self._inputs.items()}
        self._loops = {name: _Loop(loop.period_s) for name, loop in self._loops.items()}
        self._newest_ns = NO_STAMP

    @property
    def refused(self) -> Counter[str]:
        """Messages refused, by topic."""
        return Counter({topic: item.refused for topic, item in self._inputs.items() if item.refused})

    @property
    def reasons(self) -> dict[str, str]:
        """Why a message was last refused, of each topic where one was."""
        return {topic: item.reason for topic, item in self._inputs.items() if item.refused}

    def refusing(self, now_s: float) -> dict[str, str]:
        """Why a message was last refused, of each topic where one was a short while ago."""
        recent = {topic for topic, item in self._inputs.items() if now_s - item.refused_s <= RECENT_S}
        return {topic: reason for topic, reason in self.reasons.items() if topic in recent}

    def report(self, now_s: float) -> dict[str, str]:
        """Figures for the diagnostics.

        Returns:
            TOPIC_age_s: since the newest message came, inf where none has. TOPIC_hz: since the fifth last
            report. TOPIC_behind_s: by how much its newest stamp is older than that of the message heard
            last on any topic. refused_TOPIC, refused_TOPIC_reason. loop: the callback that takes most of
            the time; loop_p50_ms, loop_p95_ms, loop_max_ms of its last calls. overruns: calls, of the last
            `calls` of all callbacks, that were not over when the next was due.
        """
        values: dict[str, str] = {}
        for topic, item in self._inputs.items():
            values |= {f'{topic}_{key}': value for key, value in self._told(item, now_s).items()}
            if item.refused:
                values |= {f'refused_{topic}': str(item.refused), f'refused_{topic}_reason': item.reason}
        return values | self._durations()

    def _told(self, item: _Input, now_s: float) -> dict[str, str]:
        item.reports.append((now_s, item.messages))
        (first_s, first), told = item.reports[0], {'age_s': f'{now_s - item.heard_s:.3f}'}
        if now_s > first_s:
            told['hz'] = f'{(item.messages - first) / (now_s - first_s):.1f}'
        if item.stamp_ns != NO_STAMP:
            told['behind_s'] = f'{(self._newest_ns - item.stamp_ns) * 1e-9:.3f}'
        return told

    def _durations(self) -> dict[str, str]:
        called = {name: loop for name, loop in self._loops.items() if loop.durations_s}
        if not called:
            return {}
        busiest = max(called, key=lambda name: sum(called[name].durations_s))
        ordered = sorted(called[busiest].durations_s)
        return {
            'loop': busiest,
            'loop_p50_ms': _quantile_ms(ordered, 0.50),
            'loop_p95_ms': _quantile_ms(ordered, 0.95),
            'loop_max_ms': _quantile_ms(ordered, 1.0),
            'overruns': str(sum(loop.overruns for loop in called.values())),
            'calls': str(sum(len(loop.durations_s) for loop in called.values())),
        }


def _quantile_ms(ordered_s: list[float], share: float) -> str:
    """The least of the sorted durations that at least a share of them does not exceed."""
    return f'{1e3 * ordered_s[math.ceil(share * len(ordered_s)) - 1]:.3f}'
