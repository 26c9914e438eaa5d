"""Learning curves of training runs, and what several seeds have in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from portnav_ros.types import Array, IntArray

FIELDS = ('e_x', 'e_y', 'e_psi', 'success', 'reward', 'length_s')  # m, m, rad, share, -, s


class Curve(NamedTuple):
    """One run. steps: [T] environment steps, rising. values: [T, 6] in the order of FIELDS."""

    steps: Array
    values: Array

    def at(self, steps: Array) -> Array:
        """Values [G, 6] at steps [G], linear between lines; NaN before the first and after the last."""
        if not len(self.steps):
            return np.full((len(steps), len(FIELDS)), np.nan)
        columns = [np.interp(steps, self.steps, column, np.nan, np.nan) for column in self.values.T]
        return np.column_stack(columns)

    def plain(self) -> dict[str, list[float]]:
        """Lists for JSON."""
        return {'steps': self.steps.tolist()} | dict(zip(FIELDS, self.values.T.tolist(), strict=True))


def running(lines: Iterable[Mapping[str, Any]]) -> Curve:
    """The running means over the last 100 training episodes; none before the first one ended."""
    return _curve(line for line in lines if 'validation' not in line and line['reward'] is not None)


def validated(lines: Iterable[Mapping[str, Any]]) -> Curve:
    """The means over the validation episodes."""
    return _curve({**line['validation'], 'steps': line['steps']} for line in lines if 'validation' in line)


def _curve(rows: Iterable[Mapping[str, Any]]) -> Curve:
    kept = list(rows)
    values = np.array([[row[name] for name in FIELDS] for row in kept], float)
    return Curve(np.array([row['steps'] for row in kept], float), values.reshape(-1, len(FIELDS)))


class Across(NamedTuple):
    """Several seeds at the same steps [G]; reached: [G] seeds that have got there.

    mean, spread, low, high: [G, 6]; spread is the standard deviation over seeds, NaN for a single one.
    """

    steps: Array
    reached: IntArray
    mean: Array
    spread: Array
    low: Array
    high: Array

    def plain(self) -> dict[str, Any]:
        """Lists for JSON; what is not known is None."""
        columns = {
            name: {field: _known(values[:, k]) for k, field in enumerate(FIELDS)}
            for name, values in (('mean', self.mean), ('standard_deviation', self.spread))
        }
        return {'steps': self.steps.tolist(), 'seeds': self.reached.tolist(), **columns}


def across(curves: Sequence[Curve], steps: Array) -> Across:
    """Mean and spread over seeds, at steps [G] that at least one of them has reached."""
    stack = np.array([curve.at(steps) for curve in curves]).reshape(len(curves), len(steps), len(FIELDS))
    count = np.sum(np.isfinite(stack[:, :, 0]), axis=0)
    steps, stack, count = steps[count > 0], stack[:, count > 0], count[count > 0]
    mean = np.nanmean(stack, axis=0)
    squares = np.nansum((stack - mean) ** 2, axis=0)
    spread = np.sqrt(squares / np.where(count > 1, count - 1, np.nan)[:, None])
    low, high = np.nanmin(stack, axis=0, initial=np.inf), np.nanmax(stack, axis=0, initial=-np.inf)
    return Across(steps, count, mean, spread, low, high)


def all_steps(curves: Sequence[Curve]) -> Array:
    """Every step at which any of the curves has a line, rising."""
    return np.unique(np.concatenate([np.zeros(0), *(curve.steps for curve in curves)]))


def _known(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
