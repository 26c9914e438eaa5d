"""Search trees of a whole batch: preallocated arrays, grown by one node per simulation and row.

Node 0 is the root and node n comes from simulation n. Action axes are padded to a multiple of 8 with
prior 0, for whole vector instructions. All values are in units of reward.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.muzero.exponential import exp_negative
from portnav_ros.types import AnyArray, Array32

NO_CHILD = -1
LEAST_PRIOR = np.float32(1e-30)  # of an action that may be chosen: keeps every policy above zero
ONE = np.float32(1.0)


class Tree(NamedTuple):
    """B trees of at most N nodes with A actions, padded to W."""

    prior: Array32  # [B, N, W] policy of the network, at the root with noise
    q: Array32  # [B, N, W] reward + discount * value of the child, where visited
    visits: AnyArray  # [B, N, W] int32
    child: AnyArray  # [B, N, W] int32, NO_CHILD where there is none
    raw_value: Array32  # [B, N] value of the network
    value: Array32  # [B, N] mean over the returns seen from this node
    node_visits: Array32  # [B, N] its own expansion among them
    reward: Array32  # [B, N] of the action that leads here
    discount: Array32  # [B, N] of the action that leads here, 0 where the episode ends
    parent: AnyArray  # [B, N] int32
    action: AnyArray  # [B, N] int32, that leads here
    latent: Array32  # [B, N, L]


class Leaves(NamedTuple):
    """Where one simulation ends in each row: the edge to expand."""

    parent: AnyArray  # [B] int32
    action: AnyArray  # [B] int32
    latent: Array32  # [B, L] of the parent


class Step(NamedTuple):
    """What a model tells of taking one action from each latent."""

    latent: Array32  # [B, L]
    reward: Array32  # [B]
    discount: Array32  # [B], discount of one decision times probability to go on
    logits: Array32  # [B, A] of the policy
    value: Array32  # [B]


def padded(actions: int) -> int:
    """Width W of an action axis."""
    return -(-actions // 8) * 8


def new_tree(batch: int, nodes: int, actions: int, latent: int) -> Tree:
    """Allocate trees; `plant` gives them a root."""
    rows = batch, nodes
    edges = (*rows, padded(actions))
    prior, q = (np.zeros(edges, np.float32) for _ in range(2))
    visits, child = (np.zeros(edges, np.int32) for _ in range(2))
    raw_value, value, node_visits, reward, discount = (np.zeros(rows, np.float32) for _ in range(5))
    parent, action = (np.zeros(rows, np.int32) for _ in range(2))
    features = np.zeros((batch, nodes, latent), np.float32)
    values = raw_value, value, node_visits, reward, discount
    return Tree(prior, q, visits, child, *values, parent, action, features)


def new_leaves(batch: int, latent: int) -> Leaves:
    """Allocate leaves."""
    parent, action = (np.zeros(batch, np.int32) for _ in range(2))
    return Leaves(parent, action, np.zeros((batch, latent), np.float32))


def new_step(batch: int, actions: int, latent: int) -> Step:
    """Allocate a step."""
    reward, discount, value = (np.zeros(batch, np.float32) for _ in range(3))
    features, logits = (np.zeros((batch, size), np.float32) for size in (latent, actions))
    return Step(features, reward, discount, logits, value)


@njit(cache=True, error_model='numpy')
def plant(tree: Tree, prior: Array32, value: Array32, latent: Array32) -> None:
    """Start every tree anew from a root prior [B, W], value [B] and latent [B, L]."""
    for b in range(len(prior)):
        tree.prior[b, 0] = prior[b]
        _open_node(tree, b, 0, value[b], latent[b])


@njit(cache=True, error_model='numpy', fastmath={'contract', 'reassoc', 'nsz', 'nnan'})
def softmax(logits: Array32, out: Array32) -> None:
    """Write the probabilities of logits [A] to the first entries of out [W], each LEAST_PRIOR or more."""
    top, total = logits[0], np.float32(0.0)
    for a in range(len(logits)):
        top = max(top, logits[a])
    for a in range(len(logits)):
        out[a] = exp_negative(logits[a] - top)
        total += out[a]
    scale = ONE / total
    for a in range(len(logits)):
        out[a] = max(out[a] * scale, LEAST_PRIOR)


@njit(cache=True, error_model='numpy')
def grow(tree: Tree, node: int, leaves: Leaves, step: Step) -> None:
    """Add node number `node` to every tree and carry its value up to the root."""
    for b in range(len(leaves.parent)):
        parent, action = leaves.parent[b], leaves.action[b]
        softmax(step.logits[b], tree.prior[b, node])
        _open_node(tree, b, node, step.value[b], step.latent[b])
        tree.reward[b, node] = step.reward[b]
        tree.discount[b, node] = step.discount[b]
        tree.parent[b, node] = parent
        tree.action[b, node] = action
        tree.child[b, parent, action] = node
        _back_up(tree, b, node)


@njit(cache=True, error_model='numpy')
def _open_node(tree: Tree, b: int, node: int, value: float, latent: Array32) -> None:
    for a in range(tree.q.shape[2]):
        tree.q[b, node, a] = np.float32(0.0)
        tree.visits[b, node, a] = np.int32(0)
        tree.child[b, node, a] = np.int32(NO_CHILD)
    for i in range(len(latent)):
        tree.latent[b, node, i] = latent[i]
    tree.raw_value[b, node] = value
    tree.value[b, node] = value
    tree.node_visits[b, node] = ONE


@njit(cache=True, error_model='numpy')
def _back_up(tree: Tree, b: int, node: int) -> None:
    """Mean returns from a new node to the root; the reward of an action belongs to its edge."""
    returns = tree.value[b, node]
    while node > 0:
        parent, action = tree.parent[b, node], tree.action[b, node]
        reward, discount = tree.reward[b, node], tree.discount[b, node]
        returns = reward + discount * returns
        count = tree.node_visits[b, parent]
        tree.value[b, parent] = (tree.value[b, parent] * count + returns) / (count + ONE)
        tree.node_visits[b, parent] = count + ONE
        tree.q[b, parent, action] = reward + discount * tree.value[b, node]
        tree.visits[b, parent, action] += np.int32(1)
        node = parent


@njit(cache=True, error_model='numpy')
def best_path(tree: Tree, first: AnyArray, path: AnyArray) -> None:
    """Write to path [B, D] the first action [B] and then the most visited ones, NO_CHILD behind the end."""
    for b in range(len(path)):
        path[b] = NO_CHILD
        path[b, 0] = first[b]
        node = tree.child[b, 0, first[b]]
        depth = 1
        while node != NO_CHILD and depth < path.shape[1]:
            action = np.argmax(tree.visits[b, node])
            if tree.visits[b, node, action] == 0:
                break
            path[b, depth] = action
            node = tree.child[b, node, action]
            depth += 1
