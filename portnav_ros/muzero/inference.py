"""The networks without torch: weights arranged for the compiled layers, and what a search plans with.

`networks.Network` trains these weights and is the oracle of this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from portnav_ros.muzero.layers import (
    Buffers,
    Head,
    Layer,
    Weights,
    new_buffers,
    normalise,
    run_layer,
    run_predict,
    run_step,
)
from portnav_ros.muzero.tree import Step, new_step
from portnav_ros.task.mirror import Mirror
from portnav_ros.task.tracking import TRACK_KNOWN, TRACK_SIZE
from portnav_ros.types import AnyArray, Array32, IntArray

SCAN_KERNEL = 5  # sectors that a convolution sees
SCAN_STRIDE = 3  # of every convolution but the first


class Beginning(NamedTuple):
    """Where a search begins: latent [B, L], logits of the policy [B, A] and value [B], units of reward."""

    latent: Array32
    logits: Array32
    value: Array32


class Model(Protocol):
    """What a search plans with. B rows, F features, L latent values, A actions; values in units of reward."""

    def begin(self, observation: Array32) -> Beginning:
        """What observations [B, F] look like."""

    def step(self, latent: Array32, action: AnyArray) -> Step:
        """What actions [B] lead to from latents [B, L]."""


class Scan(NamedTuple):
    """Convolutions around the sectors of scans, each [5 * channels in, channels out], kernel outermost."""

    layers: tuple[Head, ...]
    ages: int
    sectors: int

    @property
    def stride(self) -> int:
        """Sectors to a place after the convolutions."""
        return int(SCAN_STRIDE ** max(len(self.layers) - 1, 0))

    def outputs(self, features: int) -> int:
        """Number of values made of as many features."""
        return (self.sectors // self.stride) * len(self.layers[-1].bias) + features - self.ages * self.sectors


class TrackSum(NamedTuple):
    """Networks that look at the rest of the features, and at each of the track slots with which they end."""

    context: tuple[Layer, ...]
    each: tuple[Layer, ...]
    slots: int

    @property
    def outputs(self) -> int:
        """Number of values made."""
        return self.context[-1].weight.shape[1] + self.each[-1].weight.shape[1]


class Eyes(NamedTuple):
    """What a representation begins with, before its layers; neither by default."""

    scan: Scan | None = None
    tracks: TrackSum | None = None

    def see(self, observation: Array32) -> Array32:
        """What the layers get of observations [B, F]."""
        values = observation if self.scan is None else run_scan(self.scan, observation)
        return values if self.tracks is None else run_tracks(self.tracks, values)


class NumpyModel:
    """A `Model` of trained weights."""

    def __init__(self, weights: Weights, discount: float, eyes: Eyes = Eyes()) -> None:  # noqa: B008
        """Take weights, the discount of one decision, and what looks at the features first."""
        self.weights = weights
        self.eyes = eyes
        self.discount = np.float32(discount)
        self.actions = weights.dynamics[0].bias.shape[0]
        self.latent = weights.dynamics_norm.shape[1]
        self.buffers = new_buffers(weights, 0)

    def begin(self, observation: Array32) -> Beginning:
        """What observations [B, F] look like."""
        latent = self.represent(observation)
        return Beginning(latent, *self.predict(latent))

    def represent(self, observation: Array32) -> Array32:
        """Latent [B, L] of observations [B, F]."""
        values = self.eyes.see(np.ascontiguousarray(observation, np.float32))
        values = run_layers(values, self.weights.represent)
        out = values @ self.weights.represent_out.weight + self.weights.represent_out.bias
        for row in out:
            normalise(row, self.weights.represent_norm)
        return np.asarray(out)

    def predict(self, latent: Array32) -> tuple[Array32, Array32]:
        """Logits of the policy [B, A] and value [B] of latents [B, L]."""
        step = new_step(len(latent), self.actions, self.latent)
        step.latent[:] = latent
        run_predict(self.weights, self.reserve(len(latent)), step)
        return step.logits, step.value

    def step(self, latent: Array32, action: AnyArray) -> Step:
        """What actions [B] lead to from latents [B, L]."""
        step = new_step(len(latent), self.actions, self.latent)
        run_step(
            self.weights, self.reserve(len(latent)), self.discount, latent, action.astype(np.int32), step
        )
        return step

    def reserve(self, batch: int) -> Buffers:
        """Working space for that many rows, kept until another number is asked for."""
        if len(self.buffers.none) != batch:
            self.buffers = new_buffers(self.weights, batch)
        return self.buffers


class MirroredModel(NumpyModel):
    """A model that looks at the start of a search twice, once with port and starboard exchanged.

    Of what both say of policy and value it takes the mean: the physics knows no side, a network does.
    """

    def __init__(self, weights: Weights, discount: float, eyes: Eyes, mirror: Mirror) -> None:
        """Take what a NumpyModel takes, and how the task is mirrored."""
        super().__init__(weights, discount, eyes)
        self._mirror = mirror

    def begin(self, observation: Array32) -> Beginning:
        """What observations [B, F] look like; the latent is that of the scene as it is."""
        as_is, mirrored = super().begin(observation), super().begin(self._mirror.features(observation))
        logits = 0.5 * (as_is.logits + mirrored.logits[:, self._mirror.action])
        return Beginning(as_is.latent, logits, 0.5 * (as_is.value + mirrored.value))


def likeliest(model: NumpyModel, features: Array32) -> IntArray:
    """Actions [B] that the policy network alone would take on features [B, F]."""
    logits, _ = model.predict(model.represent(features))
    return np.asarray(logits.argmax(axis=1))


def numpy_model(state: Mapping[str, AnyArray], speeds: int, discount: float) -> NumpyModel:
    """Make a model of a state dict of `networks.Network`; see `weights_of`."""
    return NumpyModel(weights_of(state, speeds), discount, eyes_of(state))


def weights_of(state: Mapping[str, AnyArray], speeds: int) -> Weights:
    """Arrange a state dict of `networks.Network`, as numpy arrays, for inference.

    Args:
        state: arrays by torch's names.
        speeds: speeds of the action grid; action = heading index * speeds + speed index.

    Raises:
        KeyError: an array is missing.
    """
    dynamics = _layers(state, 'dynamics.body')
    latent = state['dynamics.norm.weight'].shape[0]
    first = dynamics[0]
    headings = first.weight.shape[0] - latent - speeds
    by_heading, by_speed = first.weight[latent : latent + headings], first.weight[latent + headings :]
    by_action = by_heading[:, None] + by_speed[None, :] + first.bias[0]
    action_bias = by_action.reshape(headings * speeds, -1)
    dynamics[0] = Layer(
        np.ascontiguousarray(first.weight[:latent]), np.ascontiguousarray(action_bias), first.norm
    )
    alive = ['dynamics.alive'] if 'dynamics.alive.weight' in state else []
    return Weights(
        represent=tuple(_layers(state, 'representation.body')),
        represent_out=_head(state, 'representation.out'),
        represent_norm=_norm(state, 'representation.norm'),
        dynamics=tuple(dynamics),
        dynamics_out=_head(state, 'dynamics.out', 'dynamics.reward', *alive),
        dynamics_norm=_norm(state, 'dynamics.norm'),
        predict=tuple(_layers(state, 'prediction.body')),
        predict_out=_head(state, 'prediction.policy', 'prediction.value'),
        reward_atoms=_float(state['reward_atoms']),
        value_atoms=_float(state['value_atoms']),
    )


def eyes_of(state: Mapping[str, AnyArray]) -> Eyes:
    """What the representation of a state dict of `networks.Network` begins with.

    Raises:
        KeyError: an array is missing.
    """
    return Eyes(_scan_of(state), _tracks_of(state))


def _tracks_of(state: Mapping[str, AnyArray]) -> TrackSum | None:
    if 'representation.tracks.shape' not in state:
        return None
    context, each = (tuple(_layers(state, f'representation.tracks.{name}')) for name in ('context', 'each'))
    return TrackSum(context, each, int(state['representation.tracks.shape'][0]))


def _scan_of(state: Mapping[str, AnyArray]) -> Scan | None:
    if 'representation.scan.shape' not in state:
        return None
    ages, sectors = (int(size) for size in state['representation.scan.shape'])
    layers: list[Head] = []
    while f'representation.scan.layers.{len(layers)}.weight' in state:
        name = f'representation.scan.layers.{len(layers)}'
        weight = np.moveaxis(state[f'{name}.weight'], (2, 1, 0), (0, 1, 2))
        layers.append(Head(_float(weight.reshape(-1, weight.shape[2])), _float(state[f'{name}.bias'])))
    return Scan(tuple(layers), ages, sectors)


def run_scan(scan: Scan, features: Array32) -> Array32:
    """What the convolutions make of the scans that features [B, F] begin with, and the rest of them."""
    count, size = len(features), scan.ages * scan.sectors
    values = features[:, :size].reshape(count, scan.ages, scan.sectors).transpose(0, 2, 1)
    for k, layer in enumerate(scan.layers):
        seen = around(values, SCAN_STRIDE if k else 1)
        values = np.maximum(seen @ layer.weight + layer.bias, 0.0).reshape(count, -1, len(layer.bias))
    return np.hstack([values.transpose(0, 2, 1).reshape(count, -1), features[:, size:]])


def run_tracks(tracks: TrackSum, values: Array32) -> Array32:
    """What the networks make of values [B, F] that end with tracks."""
    rows, size = len(values), tracks.slots * TRACK_SIZE
    context = run_layers(np.ascontiguousarray(values[:, :-size]), tracks.context)
    each = values[:, -size:].reshape(rows * tracks.slots, TRACK_SIZE)
    known = np.flatnonzero(each[:, TRACK_KNOWN] > 0.0)
    of = known // tracks.slots
    said = run_layers(np.hstack([each[known], context[of]]), tracks.each)
    total = np.zeros((rows, said.shape[1]), np.float32)
    np.add.at(total, of, said)
    return np.hstack([context, total])


def run_layers(values: Array32, layers: tuple[Layer, ...]) -> Array32:
    """Send values [B, F] through layers."""
    none = np.zeros(len(values), np.int32)
    for layer in layers:
        hidden = np.empty((len(values), layer.weight.shape[1]), np.float32)
        run_layer(values, layer, none, hidden)
        values = hidden
    return values


def around(values: Array32, stride: int) -> Array32:
    """What a convolution sees of values [B, S, C] at every `stride`th sector, [B * places, kernel * C]."""
    count, sectors, channels = values.shape
    reach = SCAN_KERNEL // 2
    ring = np.empty((count, sectors + 2 * reach, channels), np.float32)
    ring[:, reach:-reach] = values
    ring[:, :reach], ring[:, -reach:] = values[:, -reach:], values[:, :reach]
    shape = count, -(-sectors // stride), SCAN_KERNEL * channels
    row, sector, value = ring.strides
    windows = np.lib.stride_tricks.as_strided(ring, shape, (row, stride * sector, value), writeable=False)
    return windows.reshape(-1, shape[2])


def _float(values: AnyArray) -> Array32:
    return np.array(values, np.float32, order='C')


def _norm(state: Mapping[str, AnyArray], name: str) -> Array32:
    return _float(np.stack([state[f'{name}.weight'], state[f'{name}.bias']]))


def _layers(state: Mapping[str, AnyArray], name: str) -> list[Layer]:
    layers: list[Layer] = []
    while f'{name}.{len(layers)}.linear.weight' in state:
        block = f'{name}.{len(layers)}'
        weight, bias = state[f'{block}.linear.weight'], state[f'{block}.linear.bias']
        layers.append(Layer(_float(weight.T), _float(bias[None]), _norm(state, f'{block}.norm')))
    if not layers:
        raise KeyError(f'{name}.0.linear.weight')
    return layers


def _head(state: Mapping[str, AnyArray], *names: str) -> Head:
    weight = np.concatenate([state[f'{name}.weight'].T for name in names], 1)
    return Head(_float(weight), _float(np.concatenate([state[f'{name}.bias'] for name in names])))
