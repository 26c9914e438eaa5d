"""Compiled layers of the networks, on float32 arrays: one BLAS product per layer and batch.

Rows of a batch go through the same arithmetic whether they come alone or together, but for the order of
sums inside BLAS.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from portnav_ros.muzero.exponential import exp_negative
from portnav_ros.muzero.tree import Step
from portnav_ros.types import AnyArray, Array32

EPSILON = np.float32(1e-5)  # of torch's LayerNorm
ZERO, ONE = np.float32(0.0), np.float32(1.0)


class Layer(NamedTuple):
    """Linear, LayerNorm and ReLU. A bias of more than one row holds one row for each action."""

    weight: Array32  # [inputs, outputs]
    bias: Array32  # [1 or A, outputs]
    norm: Array32  # [2, outputs]: scale and shift


class Head(NamedTuple):
    """Linear maps of one input, side by side."""

    weight: Array32  # [inputs, outputs]
    bias: Array32  # [outputs]


class Weights(NamedTuple):
    """The networks h, g and f; `weights_of` reads them from a state dict."""

    represent: tuple[Layer, ...]
    represent_out: Head
    represent_norm: Array32  # [2, L]
    dynamics: tuple[Layer, ...]
    dynamics_out: (
        Head  # change of latent [L], reward logits [bins], and logit of going on [1] if there is one
    )
    dynamics_norm: Array32  # [2, L]
    predict: tuple[Layer, ...]
    predict_out: Head  # policy logits [A], value logits [bins]
    reward_atoms: Array32  # [bins] units of reward
    value_atoms: Array32  # [bins] units of reward


class Buffers(NamedTuple):
    """Working space of the compiled layers for B rows."""

    dynamics: tuple[Array32, ...]
    dynamics_out: Array32
    predict: tuple[Array32, ...]
    predict_out: Array32
    none: AnyArray  # [B] zeros: the bias row of layers that no action enters


def new_buffers(weights: Weights, batch: int) -> Buffers:
    """Allocate working space for that many rows."""

    def rows(like: Array32) -> Array32:
        return np.zeros((batch, like.shape[-1]), np.float32)

    dynamics, predict = (
        tuple(rows(layer.weight) for layer in layers) for layers in (weights.dynamics, weights.predict)
    )
    outs = rows(weights.dynamics_out.weight), rows(weights.predict_out.weight)
    return Buffers(dynamics, outs[0], predict, outs[1], np.zeros(batch, np.int32))


@njit(cache=True, error_model='numpy', nogil=True)
def run_step(
    weights: Weights, buffers: Buffers, discount: np.float32, latent: Array32, action: AnyArray, step: Step
) -> None:
    """Fill a step with what the networks g and f tell of actions [B] from latents [B, L]."""
    hidden = latent
    rows = action
    for i in range(len(weights.dynamics)):
        run_layer(hidden, weights.dynamics[i], rows, buffers.dynamics[i])
        hidden = buffers.dynamics[i]
        rows = buffers.none
    out = buffers.dynamics_out
    np.dot(hidden, weights.dynamics_out.weight, out)
    size, bins = latent.shape[1], len(weights.reward_atoms)
    for b in range(len(latent)):
        for i in range(out.shape[1]):
            out[b, i] += weights.dynamics_out.bias[i]
        for i in range(size):
            step.latent[b, i] = latent[b, i] + out[b, i]
        normalise(step.latent[b], weights.dynamics_norm)
        step.reward[b] = expectation(out[b], size, weights.reward_atoms)
        step.discount[b] = discount
        if out.shape[1] > size + bins:
            step.discount[b] *= ONE / (ONE + np.exp(-out[b, size + bins]))
    run_predict(weights, buffers, step)


@njit(cache=True, error_model='numpy', nogil=True)
def run_predict(weights: Weights, buffers: Buffers, step: Step) -> None:
    """Fill in the logits and the value of a step whose latents are known."""
    hidden = step.latent
    for i in range(len(weights.predict)):
        run_layer(hidden, weights.predict[i], buffers.none, buffers.predict[i])
        hidden = buffers.predict[i]
    out = buffers.predict_out
    np.dot(hidden, weights.predict_out.weight, out)
    actions = step.logits.shape[1]
    for b in range(len(out)):
        for i in range(out.shape[1]):
            out[b, i] += weights.predict_out.bias[i]
        for i in range(actions):
            step.logits[b, i] = out[b, i]
        step.value[b] = expectation(out[b], actions, weights.value_atoms)


@njit(cache=True, error_model='numpy', nogil=True)
def run_layer(values: Array32, layer: Layer, rows: AnyArray, out: Array32) -> None:
    """Write relu(norm(values @ weight + bias[rows])) to out [B, outputs]."""
    np.dot(values, layer.weight, out)
    for b in range(len(out)):
        bias = layer.bias[rows[b]]
        for i in range(out.shape[1]):
            out[b, i] += bias[i]
        normalise(out[b], layer.norm)
        for i in range(out.shape[1]):
            out[b, i] = max(out[b, i], ZERO)


@njit(cache=True, error_model='numpy', fastmath={'contract', 'reassoc', 'nsz', 'nnan'})
def normalise(row: Array32, norm: Array32) -> None:
    """LayerNorm of one row, in place."""
    size = np.float32(len(row))
    mean, square = ZERO, ZERO
    for i in range(len(row)):
        mean += row[i]
    mean /= size
    for i in range(len(row)):
        square += (row[i] - mean) * (row[i] - mean)
    scale = ONE / np.sqrt(square / size + EPSILON)
    for i in range(len(row)):
        row[i] = (row[i] - mean) * scale * norm[0, i] + norm[1, i]


@njit(cache=True, error_model='numpy', fastmath={'contract', 'reassoc', 'nsz', 'nnan'})
def expectation(row: Array32, start: int, atoms: Array32) -> np.float32:
    """Mean of the atoms under the softmax of as many logits from `start` on."""
    top = row[start]
    for i in range(len(atoms)):
        top = max(top, row[start + i])
    total, weighted = ZERO, ZERO
    for i in range(len(atoms)):
        share = exp_negative(row[start + i] - top)
        total += share
        weighted += share * atoms[i]
    return weighted / total
