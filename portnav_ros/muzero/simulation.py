"""The compiled parts of a search: down the trees, the loop with the networks inside, and the conclusion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.muzero.layers import Buffers, Weights, run_step
from portnav_ros.muzero.rules import (
    GUMBEL,
    POZERO,
    PUCT,
    Rule,
    follow,
    gumbel_values,
    halving_scores,
    mix_value,
    pozero_policy,
    puct_scores,
    tilt,
)
from portnav_ros.muzero.tree import Leaves, Step, Tree, grow, padded
from portnav_ros.types import AnyArray, Array32


class Root(NamedTuple):
    """The root's arrays besides the tree's, W wide as the tree's, and working space."""

    prior: Array32  # [B, W] of the network over the valid actions
    valid: AnyArray  # [B, W] bool
    noise: Array32  # [B, W] Gumbel variables
    considered: AnyArray  # [B, simulations] int32, the visits that sequential halving asks for
    q: Array32  # [B, W] completed, filled by `conclude`
    policy: Array32  # [B, W] of the rule without noise, filled by `conclude`
    choice: AnyArray  # [B] int32 action of sequential halving, filled by `conclude`
    scratch: Array32  # [B, 2, W]


def new_root(batch: int, simulations: int, actions: int) -> Root:
    """Allocate the arrays of a root."""
    shape = batch, padded(actions)
    prior, noise, q, policy = (np.zeros(shape, np.float32) for _ in range(4))
    considered = np.zeros((batch, simulations), np.int32)
    choice, scratch = np.zeros(batch, np.int32), np.zeros((batch, 2, shape[1]), np.float32)
    return Root(prior, np.zeros(shape, bool), noise, considered, q, policy, choice, scratch)


@njit(cache=True, error_model='numpy', nogil=True)
def simulate(
    tree: Tree,
    root: Root,
    rule: Rule,
    leaves: Leaves,
    step: Step,
    weights: Weights,
    buffers: Buffers,
    discount: np.float32,
) -> None:
    """Run every simulation of a planted tree, networks and all, in one call that holds no lock."""
    for node in range(1, tree.prior.shape[1]):
        descend(tree, root, rule, node - 1, leaves)
        run_step(weights, buffers, discount, leaves.latent, leaves.action, step)
        grow(tree, node, leaves, step)


@njit(cache=True, error_model='numpy')
def descend(tree: Tree, root: Root, rule: Rule, simulation: int, leaves: Leaves) -> None:
    """Find in every tree the edge that simulation number `simulation` expands."""
    for b in range(len(leaves.parent)):
        scores = root.scratch[b, 0]
        _score_root(tree, root, rule, b, root.considered[b, simulation])
        node, action = 0, _best(rule, scores, root.valid[b])
        while tree.child[b, node, action] >= 0:
            node = tree.child[b, node, action]
            _score(tree, rule, b, node, root.scratch[b])
            action = np.argmax(scores[: rule.actions])
        leaves.parent[b] = node
        leaves.action[b] = action
        for i in range(tree.latent.shape[2]):
            leaves.latent[b, i] = tree.latent[b, node, i]


@njit(cache=True, error_model='numpy')
def conclude(tree: Tree, root: Root, rule: Rule) -> None:
    """Fill in the root's completed q, the rule's policy without noise, and the choice of the halving."""
    for b in range(len(root.prior)):
        prior, q, visits, raw_value = root.prior[b], tree.q[b, 0], tree.visits[b, 0], tree.raw_value[b, 0]
        mixed = mix_value(prior, q, visits, raw_value)
        for a in range(len(prior)):
            root.q[b, a] = q[a] if visits[a] > 0 else mixed
        if rule.code == GUMBEL:
            _score_root(tree, root, rule, b, visits.max())
            root.choice[b] = _best(rule, root.scratch[b, 0], root.valid[b])
            gumbel_values(rule, prior, q, visits, raw_value, root.policy[b])
            tilt(prior, root.policy[b])
        else:
            pozero_policy(rule, prior, q, visits, raw_value, root.scratch[b, 1], root.policy[b])


@njit(cache=True, error_model='numpy')
def _score_root(tree: Tree, root: Root, rule: Rule, b: int, considered: int) -> None:
    if rule.code != GUMBEL:
        _score(tree, rule, b, 0, root.scratch[b])
        return
    scores, prior, visits = root.scratch[b, 0], tree.prior[b, 0], tree.visits[b, 0]
    gumbel_values(rule, prior, tree.q[b, 0], visits, tree.raw_value[b, 0], scores)
    halving_scores(root.prior[b], visits, considered, root.noise[b], scores)


@njit(cache=True, error_model='numpy')
def _score(tree: Tree, rule: Rule, b: int, node: int, scratch: Array32) -> None:
    """Write the scores of a node to scratch[0]."""
    prior, q, visits = tree.prior[b, node], tree.q[b, node], tree.visits[b, node]
    scores = scratch[0]
    if rule.code == PUCT:
        puct_scores(rule, prior, q, visits, tree.value[b, node], tree.node_visits[b, node], scores)
        return
    if rule.code == POZERO:
        pozero_policy(rule, prior, q, visits, tree.raw_value[b, node], scratch[1], scores)
    else:
        gumbel_values(rule, prior, q, visits, tree.raw_value[b, node], scores)
        tilt(prior, scores)
    follow(scores, visits)


@njit(cache=True, error_model='numpy')
def _best(rule: Rule, scores: Array32, valid: AnyArray) -> int:
    """Valid action with the greatest score."""
    best = -1
    for a in range(rule.actions):
        if valid[a] and (best < 0 or scores[a] > scores[best]):
            best = a
    return best
