"""MuZero's three networks in torch: representation h, dynamics g, prediction f.

Plain MLPs with LayerNorm, because a vessel decides one observation at a time; the representation may
begin with convolutions around the sectors of its scans, so that it need not learn a buoy anew for every
bearing. `muzero.inference` runs the same weights in numpy, and this module is its oracle.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from portnav_ros.muzero.atoms import AtomParams
from portnav_ros.muzero.inference import SCAN_KERNEL, SCAN_STRIDE
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.task.tracking import SLOTS, TRACK_KNOWN, TRACK_SIZE

HIDDEN = ('represent_hidden', 'dynamics_hidden', 'predict_hidden', 'context_hidden', 'track_hidden')


@dataclass(frozen=True)
class NetworkParams:
    """Sizes of the networks, and the atoms of their categorical heads.

    scan_channels: of the convolutions, none by default. scan_shape: ages and sectors of the scans that
    the features begin with, read only where there are convolutions. alive: whether the dynamics tells
    with what probability the episode goes on; without it an end is worth what the value head says of
    absorbing states. tracks: how many the features end with; where there are some, a small network
    looks at each of them beside what the rest of the scene says, and their sum is added to that.
    context_hidden: of what the rest of the scene says, track_hidden: of a track; read only where there are.
    """

    latent: int = 32
    represent_hidden: tuple[int, ...] = (128,)
    dynamics_hidden: tuple[int, ...] = (128,)
    predict_hidden: tuple[int, ...] = (128,)
    value: AtomParams = field(default_factory=AtomParams)
    reward: AtomParams = field(default_factory=AtomParams)
    alive: bool = False
    scan_channels: tuple[int, ...] = ()
    scan_shape: tuple[int, int] = (4, 90)
    tracks: int = 0
    context_hidden: tuple[int, ...] = (384, 128)
    track_hidden: tuple[int, ...] = (128, 128)
    ranges: ClassVar[Ranges] = {'latent': (1, 4096), 'tracks': (0, SLOTS)}

    def __post_init__(self) -> None:
        """Refuse empty layers."""
        check_ranges(self)
        for name in HIDDEN:
            if not getattr(self, name) or min(getattr(self, name)) < 1:
                raise ParamError(
                    f'{name} = {getattr(self, name)} needs at least one layer of at least one unit'
                )
        if any(channels < 1 for channels in self.scan_channels) or min(self.scan_shape) < 1:
            raise ParamError(f'scan_channels = {self.scan_channels}, scan_shape = {self.scan_shape}: below 1')
        if self.scan_channels and self.scan_shape[1] % self.scan_stride:
            raise ParamError(
                f'scan_shape = {self.scan_shape}: sectors must be a multiple of {self.scan_stride}'
            )

    @property
    def scan_stride(self) -> int:
        """Sectors to a place after the convolutions."""
        return int(SCAN_STRIDE ** max(len(self.scan_channels) - 1, 0))


class Prediction(NamedTuple):
    """Logits of policy [B, A] and of the value's atoms [B, bins]."""

    policy: Tensor
    value: Tensor


class Transition(NamedTuple):
    """Latent after an action [B, L], logits of the reward's atoms [B, bins] and of going on [B]."""

    latent: Tensor
    reward: Tensor
    alive: Tensor | None


class Network(nn.Module):
    """h, g and f of one agent.

    Actions number a grid of headings and speeds: action = heading index * speeds + speed index; the
    dynamics reads both indices as one-hot vectors.
    """

    reward_atoms: Tensor
    value_atoms: Tensor

    def __init__(self, observation: int, headings: int, speeds: int, params: NetworkParams) -> None:
        """Build networks for observations [B, F] and headings x speeds actions."""
        super().__init__()
        self.params = params
        self.speeds = speeds
        self.headings = headings
        bins = len(params.value.values()), len(params.reward.values())
        self.representation = Representation(observation, params)
        self.dynamics = Dynamics(headings + speeds, bins[1], params)
        self.prediction = Predictor(headings * speeds, bins[0], params)
        self.register_buffer('value_atoms', torch.tensor(params.value.values(), dtype=torch.float32))
        self.register_buffer('reward_atoms', torch.tensor(params.reward.values(), dtype=torch.float32))

    def represent(self, observation: Tensor) -> Tensor:
        """Latent [B, L] of observations [B, F]."""
        latent: Tensor = self.representation(observation)
        return latent

    def predict(self, latent: Tensor) -> Prediction:
        """Policy and value of latents [B, L]."""
        prediction: Prediction = self.prediction(latent)
        return prediction

    def step(self, latent: Tensor, action: Tensor) -> Transition:
        """What actions [B] (int64) lead to from latents [B, L]."""
        heading = functional.one_hot(action // self.speeds, self.headings)
        speed = functional.one_hot(action % self.speeds, self.speeds)
        transition: Transition = self.dynamics(latent, torch.cat([heading, speed], 1).to(latent.dtype))
        return transition


class Representation(nn.Module):
    """Observation [B, F] to latent [B, L]."""

    def __init__(self, observation: int, params: NetworkParams) -> None:
        super().__init__()
        self.scan = Scan(params) if params.scan_channels else None
        inputs = observation if self.scan is None else self.scan.outputs(observation)
        self.tracks = TrackSum(inputs, params) if params.tracks else None
        inputs = inputs if self.tracks is None else self.tracks.outputs
        self.body = body(inputs, params.represent_hidden)
        self.out = nn.Linear(params.represent_hidden[-1], params.latent)
        self.norm = nn.LayerNorm(params.latent)

    def forward(self, observation: Tensor) -> Tensor:
        """Return latents [B, L]."""
        values = observation if self.scan is None else self.scan(observation)
        values = values if self.tracks is None else self.tracks(values)
        normed: Tensor = self.norm(self.out(self.body(values)))
        return normed


class Scan(nn.Module):
    """Convolutions around the sectors with which the features begin; the rest passes by."""

    shape: Tensor

    def __init__(self, params: NetworkParams) -> None:
        super().__init__()
        channels = (params.scan_shape[0], *params.scan_channels)
        self.layers = nn.ModuleList(
            nn.Conv1d(
                inputs,
                outputs,
                SCAN_KERNEL,
                stride=SCAN_STRIDE if k else 1,
                padding=SCAN_KERNEL // 2,
                padding_mode='circular',
            )
            for k, (inputs, outputs) in enumerate(pairwise(channels))
        )
        self.ages, self.sectors = params.scan_shape
        self.grown = channels[-1] * self.sectors // params.scan_stride
        self.register_buffer('shape', torch.tensor(params.scan_shape))

    def outputs(self, observation: int) -> int:
        """Number of values made of as many features."""
        return self.grown + observation - self.ages * self.sectors

    def forward(self, observation: Tensor) -> Tensor:
        """Map features [B, F] to [B, outputs]."""
        size = self.ages * self.sectors
        values = observation[:, :size].view(-1, self.ages, self.sectors)
        for layer in self.layers:
            values = functional.relu(layer(values))
        return torch.cat([values.flatten(1), observation[:, size:]], 1)


class TrackSum(nn.Module):
    """The tracks with which the features end, each seen beside the rest, and added up.

    What one vessel means is learned once for all of them (Zaheer et al., Deep Sets, 2017).
    """

    shape: Tensor

    def __init__(self, inputs: int, params: NetworkParams) -> None:
        super().__init__()
        self.size = params.tracks * TRACK_SIZE
        self.context = body(inputs - self.size, params.context_hidden)
        self.each = body(TRACK_SIZE + params.context_hidden[-1], params.track_hidden)
        self.outputs = params.context_hidden[-1] + params.track_hidden[-1]
        self.register_buffer('shape', torch.tensor([params.tracks, TRACK_SIZE]))

    def forward(self, values: Tensor) -> Tensor:
        """Map values [B, F] to [B, outputs]."""
        context = self.context(values[:, : -self.size])
        tracks = values[:, -self.size :].reshape(-1, TRACK_SIZE)
        known = (tracks[:, TRACK_KNOWN] > 0.0).nonzero()[:, 0]
        of = known // (self.size // TRACK_SIZE)
        said = self.each(torch.cat([tracks[known], context[of].to(tracks.dtype)], 1))
        total = said.new_zeros(len(values), said.shape[1]).index_add(0, of, said)
        return torch.cat([context, total], 1)


class Dynamics(nn.Module):
    """Latent and action to the next latent and the reward in between."""

    def __init__(self, action: int, bins: int, params: NetworkParams) -> None:
        super().__init__()
        self.body = body(params.latent + action, params.dynamics_hidden)
        self.out = nn.Linear(params.dynamics_hidden[-1], params.latent)
        self.norm = nn.LayerNorm(params.latent)
        self.reward = zero(nn.Linear(params.dynamics_hidden[-1], bins))
        self.alive = zero(nn.Linear(params.dynamics_hidden[-1], 1)) if params.alive else None

    def forward(self, latent: Tensor, action: Tensor) -> Transition:
        """Step from latents [B, L] with one-hot actions [B, H + S]."""
        hidden = self.body(torch.cat([latent, action], 1))
        alive = None if self.alive is None else self.alive(hidden)[:, 0]
        return Transition(self.norm(latent + self.out(hidden)), self.reward(hidden), alive)


class Predictor(nn.Module):
    """Latent to policy and value."""

    def __init__(self, actions: int, bins: int, params: NetworkParams) -> None:
        super().__init__()
        self.body = body(params.latent, params.predict_hidden)
        self.policy = zero(nn.Linear(params.predict_hidden[-1], actions))
        self.value = zero(nn.Linear(params.predict_hidden[-1], bins))

    def forward(self, latent: Tensor) -> Prediction:
        """Return logits for latents [B, L]."""
        hidden = self.body(latent)
        return Prediction(self.policy(hidden), self.value(hidden))


class Block(nn.Module):
    """Linear, LayerNorm, ReLU."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.linear = nn.Linear(inputs, outputs)
        self.norm = nn.LayerNorm(outputs)

    def forward(self, values: Tensor) -> Tensor:
        """Map [B, inputs] to [B, outputs]."""
        return functional.relu(self.norm(self.linear(values)))


def body(inputs: int, hidden: tuple[int, ...]) -> nn.Sequential:
    """Blocks of the given widths."""
    return nn.Sequential(*(Block(*pair) for pair in zip((inputs, *hidden), hidden, strict=False)))


def zero(layer: nn.Linear) -> nn.Linear:
    """Start a head at zero: a uniform policy, and every atom as likely as any other."""
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
    return layer
