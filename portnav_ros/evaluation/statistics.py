"""What a figure is worth: paired differences over episodes and over seeds, and their intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, norm, t

from portnav_ros.types import Array, BoolArray


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


class Sample(NamedTuple):
    """Values over n seeds. standard_deviation: None for fewer than two; mean: None for none."""

    n: int
    mean: float | None
    standard_deviation: float | None

    def text(self, form: str, scale: float = 1.0) -> str:
        """Mean and standard deviation as people read them; empty without values."""
        if self.mean is None:
            return ''
        mean = f'{scale * self.mean:{form}}'
        if self.standard_deviation is None:
            return mean
        return f'{mean} ± {scale * self.standard_deviation:{form}}'


def sample(values: Array) -> Sample:
    """Describe values [n]."""
    n = len(values)
    deviation = float(np.std(values, ddof=1)) if n > 1 else None
    return Sample(n, float(np.mean(values)) if n else None, deviation)


class SeedDifference(NamedTuple):
    """Mean difference over n pairs of seeds; low, high: its 95 % interval, None for fewer than two."""

    n: int
    mean: float | None
    low: float | None
    high: float | None

    @property
    def resolved(self) -> bool:
        """Whether the interval leaves 0 out; pairs that all differ alike tell nothing of their spread."""
        if self.low is None or self.high is None or math.isclose(self.low, self.high, abs_tol=1e-9):
            return False
        return self.low > 0.0 or self.high < 0.0


def seed_difference(first: Array, second: Array, confidence: float = 0.95) -> SeedDifference:
    """Compare two columns [n] of figures of runs with the same seeds, by Student's paired interval."""
    n, mean, deviation = sample(first - second)
    if mean is None or deviation is None:
        return SeedDifference(n, mean, None, None)
    half = float(t.ppf(0.5 + 0.5 * confidence, n - 1)) * deviation / math.sqrt(n)
    return SeedDifference(n, mean, mean - half, mean + half)


def _z(confidence: float) -> float:
    return float(norm.ppf(0.5 + 0.5 * confidence))
