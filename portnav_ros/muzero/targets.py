"""What the networks are trained on: returns over stored rewards and root values.

A time-out does not end the world, so it bootstraps from the value of what was seen last; a goal or a
collision is worth its reward alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numba import njit

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.types import AnyArray, Array32, IntArray

RUNNING, TERMINATED, TRUNCATED = range(3)  # how a decision left its episode


@dataclass(frozen=True)
class TargetParams:
    """Returns.

    discount: of one second; a decision held for several has its power. returns: `n_step`, or
    `td_lambda`, the mean of all n-step returns with weights lambda^n. steps: n, or where the mean is
    cut off. trace: lambda.
    """

    discount: float = 0.997
    returns: Literal['n_step', 'td_lambda'] = 'n_step'
    steps: int = 50
    trace: float = 0.95
    ranges: ClassVar[Ranges] = {'discount': (0.0, 1.0), 'steps': (1, 10_000), 'trace': (0.0, 1.0)}

    def __post_init__(self) -> None:
        """Refuse returns that do not converge."""
        check_ranges(self)
        if self.returns not in ('n_step', 'td_lambda'):
            raise ParamError(f'returns = {self.returns!r} must be n_step or td_lambda')


class History(NamedTuple):
    """Decisions of B environments in rows of a ring, as the kernels read them."""

    reward: Array32  # [B, T] of the decision
    end: AnyArray  # [B, T] uint8: RUNNING, TERMINATED or TRUNCATED with the decision
    value: Array32  # [B, T] of the search's root, before the decision
    final_value: Array32  # [B, T] of what was seen last, where truncated


class Targets(NamedTuple):
    """Targets of N sequences of K decisions, K + 1 positions.

    live: 1 where a position is in the episode that the sequence began in. absorbed: 1 past its
    terminal, where nothing is earned any more; past a time-out nothing is known and both are 0.
    going_on: 1 unless the decision terminated the episode.
    """

    reward: Array32  # [N, K]
    value: Array32  # [N, K + 1]
    going_on: Array32  # [N, K]
    live: Array32  # [N, K + 1]
    absorbed: Array32  # [N, K + 1]


def make_targets(
    history: History,
    newest: int,
    which: IntArray,
    first: IntArray,
    unroll: int,
    params: TargetParams,
    hold: int,
) -> Targets:
    """Compute the targets of sequences.

    Args:
        history: the ring; decision t is in row t modulo its length.
        newest: the last decision that it holds.
        which: [N] environment of each sequence.
        first: [N] first decision of each; first + unroll is not beyond the newest.
        unroll: K.
        params: returns.
        hold: seconds that a decision lasts.
    """
    count = len(which)
    targets = Targets(
        np.zeros((count, unroll), np.float32),
        np.zeros((count, unroll + 1), np.float32),
        np.ones((count, unroll), np.float32),
        np.zeros((count, unroll + 1), np.float32),
        np.zeros((count, unroll + 1), np.float32),
    )
    discount = params.discount**hold
    if params.returns == 'n_step':
        _fill_n_step(history, newest, which, first, discount, params.steps, targets.value)
    else:
        _fill_td_lambda(history, newest, which, first, discount, params.trace, params.steps, targets.value)
    _cut_at_ends(history, which, first, targets)
    return targets


@njit(cache=True)
def _fill_n_step(
    history: History,
    newest: int,
    which: IntArray,
    first: IntArray,
    discount: float,
    steps: int,
    value: Array32,
) -> None:
    rows = history.reward.shape[1]
    for n in range(len(which)):
        b = which[n]
        for k in range(value.shape[1]):
            total, weight = 0.0, 1.0
            last = min(first[n] + k + steps, newest)
            for t in range(first[n] + k, last + 1):
                row = t % rows
                if t == last:
                    total += weight * history.value[b, row]
                    break
                total += weight * history.reward[b, row]
                weight *= discount
                if history.end[b, row] == TRUNCATED:
                    total += weight * history.final_value[b, row]
                if history.end[b, row] != RUNNING:
                    break
            value[n, k] = total


@njit(cache=True)
def _fill_td_lambda(
    history: History,
    newest: int,
    which: IntArray,
    first: IntArray,
    discount: float,
    trace: float,
    steps: int,
    value: Array32,
) -> None:
    """Backwards, G_t = r_t + discount ((1 - trace) v_(t+1) + trace G_(t+1)) (Sutton and Barto, 12.1)."""
    rows, positions = history.reward.shape[1], value.shape[1]
    for n in range(len(which)):
        b = which[n]
        last = min(first[n] + positions - 1 + steps, newest)
        following = float(history.value[b, last % rows])
        total = following
        if last - first[n] < positions:
            value[n, last - first[n]] = total
        for t in range(last - 1, first[n] - 1, -1):
            row = t % rows
            ahead = (1.0 - trace) * following + trace * total
            if history.end[b, row] == TERMINATED:
                ahead = 0.0
            elif history.end[b, row] == TRUNCATED:
                ahead = history.final_value[b, row]
            total = history.reward[b, row] + discount * ahead
            following = history.value[b, row]
            if t - first[n] < positions:
                value[n, t - first[n]] = total


@njit(cache=True)
def _cut_at_ends(history: History, which: IntArray, first: IntArray, targets: Targets) -> None:
    """Fill in what is earned on the way; zero what lies beyond the episode's end."""
    rows, unroll = history.reward.shape[1], targets.reward.shape[1]
    for n in range(len(which)):
        end = RUNNING
        for k in range(unroll + 1):
            if end == RUNNING:
                targets.live[n, k] = 1.0
            else:
                targets.value[n, k] = 0.0
                targets.absorbed[n, k] = end == TERMINATED
            if k < unroll and end == RUNNING:
                row = (first[n] + k) % rows
                targets.reward[n, k] = history.reward[which[n], row]
                end = history.end[which[n], row]
                targets.going_on[n, k] = end != TERMINATED
