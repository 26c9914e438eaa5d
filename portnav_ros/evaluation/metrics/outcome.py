"""How episodes ended: success with its interval, collisions by kind, time-outs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from portnav_ros.training.episode_statistics import wilson_interval
from portnav_ros.types import Outcome

ENDINGS = (
    Outcome.SUCCESS,
    Outcome.COLLISION_QUAY,
    Outcome.COLLISION_BUOY,
    Outcome.COLLISION_VESSEL,
    Outcome.TIMEOUT,
)


def outcome_shares(outcomes: Iterable[Outcome]) -> dict[str, float]:
    """Share of each ending, and the 95 % Wilson interval of success as success_low, success_high.

    Raises:
        ValueError: an episode is still running.
    """
    counts = Counter(outcomes)
    if Outcome.RUNNING in counts:
        raise ValueError('an episode that is still running has no outcome to count')
    total = sum(counts.values())
    low, high = wilson_interval(counts[Outcome.SUCCESS], total)
    shares = {ending.name.lower(): counts[ending] / max(total, 1) for ending in ENDINGS}
    return {**shares, 'success_low': low, 'success_high': high}
