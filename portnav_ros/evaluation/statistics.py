"""Intervals for shares: what a success rate over N episodes is worth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, norm

from portnav_ros.types import BoolArray


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a share (Wilson 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    z = _z(confidence)
    share, spread = successes / trials, z * z / trials
    centre = (share + 0.5 * spread) / (1.0 + spread)
    half = z * math.sqrt(share * (1.0 - share) / trials + 0.25 * spread / trials) / (1.0 + spread)
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == trials else centre + half
    return low, high


class PairedDifference(NamedTuple):
    """Success of one planner minus that of another on the same episodes.

    low, high: 95 % interval. p_value: exact McNemar test. only_first, only_second: episodes that
    just one of them finished.
    """

    difference: float
    low: float
    high: float
    p_value: float
    only_first: int
    only_second: int


def paired_difference(first: BoolArray, second: BoolArray, confidence: float = 0.95) -> PairedDifference:
    """Compare two success columns [N] over the same episodes.

    The interval is Wald's with half a pair added to each of the four cells (Agresti and Min 2005),
    which keeps its coverage for few episodes.

    Raises:
        ValueError: the columns differ in length or are empty.
    """
    if len(first) != len(second) or len(first) == 0:
        raise ValueError(f'paired episodes are needed, got {len(first)} and {len(second)}')
    only_first, only_second = int(np.sum(first & ~second)), int(np.sum(second & ~first))
    b, c, n = only_first + 0.5, only_second + 0.5, len(first) + 2.0
    centre = (b - c) / n
    half = _z(confidence) * math.sqrt(b + c - (b - c) ** 2 / n) / n
    discordant = only_first + only_second
    p_value = float(binomtest(only_first, discordant).pvalue) if discordant else 1.0
    return PairedDifference(
        (only_first - only_second) / len(first),
        max(centre - half, -1.0),
        min(centre + half, 1.0),
        p_value,
        only_first,
        only_second,
    )


def _z(confidence: float) -> float:
    return float(norm.ppf(0.5 + 0.5 * confidence))
