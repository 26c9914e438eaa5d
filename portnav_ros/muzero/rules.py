"""Which action a simulation takes at a node: POZero, PUCT and Gumbel, as functions on one node's arrays.

Every rule fills a row of scores; the action with the greatest score is taken. Rows have W entries, of
which those behind the last action have prior 0 and no visits. A float32 literal keeps a loop in float32,
and so twice as many lanes of a vector instruction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.muzero.exponential import exp_negative
from portnav_ros.types import AnyArray, Array32

POZERO, PUCT, GUMBEL = range(3)
REASSOCIATE = {'contract', 'reassoc', 'nsz', 'nnan'}
ZERO, ONE = np.float32(0.0), np.float32(1.0)
TINY = np.float32(np.finfo(np.float32).tiny)
LEAST_WIDTH = np.float32(1e-8)
EXCESS = np.float32(1e-6)  # of the sum of a regularised policy over 1, where the solver stops
ITERATIONS = 64  # far above what any case needed (test_rules)
LEAST_SCORE = np.float32(-1e9)


class Rule(NamedTuple):
    """The rule of a search and its constants, for compiled code: all float32 but the first two."""

    code: int  # POZERO, PUCT or GUMBEL
    actions: int  # A
    c: np.float32
    q_floor: np.float32
    q_ceiling: np.float32
    pb_c_init: np.float32
    pb_c_base: np.float32
    value_scale: np.float32
    visit_offset: np.float32


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def mix_value(prior: Array32, q: Array32, visits: AnyArray, raw_value: np.float32) -> np.float32:
    """Value of a node from its network and its visited actions, to stand for the unvisited ones.

    Equation (33) of Danihelka et al. 2022, "Policy improvement by planning with Gumbel".
    """
    total, mass, weighted = ZERO, ZERO, ZERO
    for a in range(len(prior)):
        share = max(prior[a], TINY) if visits[a] > 0 else ZERO
        total += np.float32(visits[a])
        mass += share
        weighted += share * q[a]
    if total == ZERO:
        return raw_value
    return (raw_value + total * (weighted / mass)) / (total + ONE)


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def q_width(rule: Rule, low: np.float32, high: np.float32) -> np.float32:
    """Width by which q is normalised: the range itself, within [q_floor, q_ceiling]."""
    return max(min(max(high - low, rule.q_floor), rule.q_ceiling), LEAST_WIDTH)


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def regularise(prior: Array32, gap: Array32, strength: np.float32, out: Array32) -> None:
    """Write pi_bar = strength * prior / (alpha - q) with sum 1, for q = -gap whose greatest is 0.

    Equation (8) of Grill et al. 2020, "Monte-Carlo tree search as regularized policy optimization".
    Taking q relative to its maximum leaves nothing to cancel in alpha - q, so float32 is enough.

    alpha starts at its lower bound max(q + strength * prior). With S(alpha) the sum of the policy,
    1 / S is concave and rises with alpha, hence Newton's method on 1 / S = 1 climbs to the solution from
    below and never passes it; 1 / S is linear where one action dominates, and that makes it quick.

    Args:
        prior: [W] probabilities; positive for some action of gap 0.
        gap: [W] distance from the greatest q, 0 or more.
        strength: lambda, above 0.
        out: [W] the policy.
    """
    width = len(prior)
    alpha = strength * prior[0] - gap[0]
    for a in range(width):
        alpha = max(alpha, strength * prior[a] - gap[a])
    total = ONE
    for _ in range(ITERATIONS):
        total, slope = ZERO, ZERO
        for a in range(width):
            inverse = ONE / (alpha + gap[a])
            share = strength * prior[a] * inverse
            out[a] = share
            total += share
            slope += share * inverse
        if total - ONE < EXCESS:
            break
        alpha += total * (total - ONE) / slope
    scale = ONE / total
    for a in range(width):
        out[a] *= scale


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def pozero_policy(
    rule: Rule,
    prior: Array32,
    q: Array32,
    visits: AnyArray,
    raw_value: np.float32,
    gap: Array32,
    out: Array32,
) -> None:
    """Write the regularised policy of a node; without visits that is its prior.

    lambda = c sqrt(N) / (A + N) with N visits of all actions together; unvisited actions take the mixed
    value, and the range of q is that of the visited actions and the network's value.

    Args:
        rule: constants.
        prior: [W] probabilities.
        q: [W] raw values of the visited actions.
        visits: [W].
        raw_value: of the network.
        gap: [W] working space.
        out: [W] the policy.
    """
    mixed = mix_value(prior, q, visits, raw_value)
    total, best, low, high = ZERO, -np.float32(np.inf), raw_value, raw_value
    for a in range(len(prior)):
        total += np.float32(visits[a])
        completed = q[a] if visits[a] > 0 else mixed
        low, high = min(low, completed), max(high, completed)
        best = max(best, completed if prior[a] > ZERO else -np.float32(np.inf))
    if total == ZERO:
        out[:] = prior
        return
    inverse = ONE / q_width(rule, low, high)
    for a in range(len(prior)):
        completed = q[a] if visits[a] > 0 else mixed
        gap[a] = min(max((best - completed) * inverse, ZERO), ONE)
    strength = rule.c * math.sqrt(total) / (np.float32(rule.actions) + total)
    regularise(prior, gap, strength, out)


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def gumbel_values(
    rule: Rule, prior: Array32, q: Array32, visits: AnyArray, raw_value: np.float32, out: Array32
) -> None:
    """Write completed q, normalised and scaled up with the visits of the most visited action, to out [W].

    sigma(q) = (visit_offset + max n) value_scale q, equation (8) of Danihelka et al. 2022.
    """
    mixed = mix_value(prior, q, visits, raw_value)
    low, high, most = np.float32(np.inf), -np.float32(np.inf), np.int32(0)
    for a in range(rule.actions):
        completed = q[a] if visits[a] > 0 else mixed
        low, high, most = min(low, completed), max(high, completed), max(most, visits[a])
    width = q_width(rule, low, high)
    scale = (rule.visit_offset + np.float32(most)) * rule.value_scale
    for a in range(len(prior)):
        completed = q[a] if visits[a] > 0 else mixed
        out[a] = scale * (max(completed - high, -width) / width + ONE)


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def tilt(prior: Array32, values: Array32) -> None:
    """Turn values [W] into the policy proportional to prior * exp(value), in place."""
    top, total = values[0], ZERO
    for a in range(len(prior)):
        top = max(top, values[a])
    for a in range(len(prior)):
        values[a] = prior[a] * exp_negative(values[a] - top)
        total += values[a]
    for a in range(len(prior)):
        values[a] /= total


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def follow(policy: Array32, visits: AnyArray) -> None:
    """Turn a policy [W] into scores whose argmax keeps the visits in its proportions, in place.

    Section 5 of Danihelka et al. 2022: policy - n / (1 + sum n).
    """
    total = ZERO
    for a in range(len(policy)):
        total += np.float32(visits[a])
    share = ONE / (ONE + total)
    for a in range(len(policy)):
        policy[a] -= np.float32(visits[a]) * share


@njit(cache=True, error_model='numpy', fastmath=REASSOCIATE)
def puct_scores(
    rule: Rule,
    prior: Array32,
    q: Array32,
    visits: AnyArray,
    value: np.float32,
    count: np.float32,
    out: Array32,
) -> None:
    """Write PUCT's scores, q normalised over parent and siblings.

    Appendix B of Schrittwieser et al. 2020, with unvisited actions at the least value.

    Args:
        rule: constants.
        prior: [W] probabilities.
        q: [W] raw values of the visited actions.
        visits: [W].
        value: mean return of the node.
        count: visits of the node.
        out: [W] the scores.
    """
    low, high = value, value
    for a in range(len(prior)):
        completed = q[a] if visits[a] > 0 else value
        low, high = min(low, completed), max(high, completed)
    width = q_width(rule, low, high)
    low = max(low, high - width)
    explore = math.sqrt(count) * (rule.pb_c_init + math.log((count + rule.pb_c_base + ONE) / rule.pb_c_base))
    for a in range(len(prior)):
        completed = q[a] if visits[a] > 0 else low
        known = (max(completed, low) - low) / width
        out[a] = known + explore * prior[a] / (np.float32(visits[a]) + ONE)


@njit(cache=True, error_model='numpy')
def halving_scores(
    prior: Array32, visits: AnyArray, considered: int, noise: Array32, values: Array32
) -> None:
    """Turn scaled q [W] into the root scores of sequential halving, in place.

    Args:
        prior: [W] root probabilities, in place of logits.
        visits: [W] root visits.
        considered: only actions with this number of visits compete.
        noise: [W] Gumbel variables.
        values: [W] scaled q.
    """
    top = prior.max()
    for a in range(len(prior)):
        if visits[a] == considered:
            logit = math.log(max(prior[a], TINY) / top)
            values[a] = max(LEAST_SCORE, noise[a] + np.float32(logit) + values[a])
        else:
            values[a] = -np.float32(np.inf)


def halving_table(most: int, simulations: int) -> AnyArray:
    """Visits that an action must have to be considered by each simulation, [most + 1, simulations] int32.

    Row m is for m actions in the draw: sequential halving (Karnin et al. 2013) visits them equally, keeps
    the better half, and so on.
    """
    table = np.zeros((most + 1, simulations), np.int32)
    for drawn in range(most + 1):
        table[drawn] = _halving_row(drawn, simulations)
    return table


def _halving_row(drawn: int, simulations: int) -> AnyArray:
    if drawn <= 1:
        return np.arange(simulations)
    rounds = math.ceil(math.log2(drawn))
    row: list[int] = []
    visits, left = np.zeros(drawn, int), drawn
    while len(row) < simulations:
        for _ in range(max(1, simulations // (rounds * left))):
            row.extend(visits[:left])
            visits[:left] += 1
        left = max(2, left // 2)
    return np.array(row[:simulations])
