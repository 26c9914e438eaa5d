"""The learner: one gradient step on a batch of sequences, and what it tells about itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from portnav_ros.muzero.losses import (
    TERMS,
    WORTH_ACTIONS,
    Batch,
    LossWeights,
    Unrolled,
    expectation,
    to_batch,
    unroll,
)
from portnav_ros.muzero.networks import Network
from portnav_ros.muzero.replay import Sample
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.training.run_directory import TrainingError
from portnav_ros.types import Array32


@dataclass(frozen=True)
class LearnerParams:
    """Optimisation by AdamW.

    batch: sequences of an update. unroll: decisions of a sequence. last_rate: learning rate at the end
    of the run, to which it falls linearly. precision: of the products in the unrolled networks; bfloat16
    nearly halves the time of an update where the processor has it. average: updates over which the mean of
    the weights runs that validations judge and the model keeps (Polyak and Juditsky 1992), by a decay of
    1 - 1 / average an update; with 0 they are the last ones.
    """

    batch: int = 256
    unroll: int = 5
    learning_rate: float = 1e-3
    last_rate: float = 1e-4
    weight_decay: float = 1e-4
    gradient_clip: float = 5.0
    precision: Literal['float32', 'bfloat16'] = 'float32'
    average: int = 0
    weights: LossWeights = field(default_factory=LossWeights)
    ranges: ClassVar[Ranges] = {
        'batch': (1, 65_536),
        'unroll': (1, 100),
        'learning_rate': (0.0, 1.0),
        'last_rate': (0.0, 1.0),
        'weight_decay': (0.0, 1.0),
        'gradient_clip': (1e-6, 1e6),
        'average': (0, 1_000_000),
    }

    def __post_init__(self) -> None:
        """Refuse values with which nothing is learned."""
        check_ranges(self)
        if self.precision not in ('float32', 'bfloat16'):
            raise ParamError(f'precision = {self.precision!r} must be float32 or bfloat16')


def limit_threads(count: int) -> None:
    """Let torch compute with so many threads; the result depends on their number in the last bits."""
    torch.set_num_threads(count)


class Learner:
    """Networks and their optimiser."""

    def __init__(self, network: Network, params: LearnerParams, device: str = 'cpu') -> None:
        """Move the networks to the device."""
        self.params = params
        self.updates = 0
        self.device = torch.device(device)
        self.network = network.to(self.device)
        self._optimiser = torch.optim.AdamW(
            network.parameters(),
            lr=params.learning_rate,
            weight_decay=params.weight_decay,
            fused=True,
        )
        self._mean = self._average()

    def _average(self) -> AveragedModel | None:
        """Begin a running mean at the weights as they are."""
        if not self.params.average:
            return None
        decay = 1.0 - 1.0 / self.params.average
        average = get_ema_multi_avg_fn(decay)  # type: ignore[no-untyped-call]
        mean = AveragedModel(self.network, multi_avg_fn=average)
        mean.update_parameters(self.network)
        return mean

    def set_progress(self, share: float) -> None:
        """Set the learning rate for a run of which this share [0, 1] is done."""
        first, last = self.params.learning_rate, self.params.last_rate
        for group in self._optimiser.param_groups:
            group['lr'] = first + min(share, 1.0) * (last - first)

    def update(self, sample: Sample, worth: bool = True) -> dict[str, float]:
        """Take one step, with or without the loss on worth.

        Returns the losses by term and the gradient's norm before it was clipped.

        Raises:
            TrainingError: a loss or the gradient is not finite.
        """
        batch = to_batch(sample, self.device, absorbing=self.network.dynamics.alive is None)
        said = self._unroll(batch, worth)
        losses = {name: term(self.network, said, batch) for name, term in TERMS.items()}
        weights = self.params.weights
        total = torch.stack([getattr(weights, name) * loss for name, loss in losses.items()]).sum()
        self._optimiser.zero_grad(set_to_none=True)
        total.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.params.gradient_clip)
        self._optimiser.step()
        if self._mean is not None:
            self._mean.update_parameters(self.network)
        self.updates += 1
        values = torch.stack([total.detach(), norm, *(loss.detach() for loss in losses.values())]).tolist()
        if not all(map(math.isfinite, values)):
            raise TrainingError(
                f'update {self.updates}: the loss is not finite; '
                'begin again with a lower learner.learning_rate'
            )
        names = ('loss', 'gradient_norm', *(f'loss_{name}' for name in losses))
        return dict(zip(names, values, strict=True))

    def _unroll(self, batch: Batch, worth: bool) -> Unrolled:
        asked = worth and batch.lesson.shape[2] > 0 and self.params.weights.worth > 0.0
        lesson = batch.lesson[:, 0, :WORTH_ACTIONS].clamp(min=0) if asked else None
        if self.params.precision == 'float32':
            return unroll(self.network, batch.features, batch.action, lesson)
        with torch.autocast(self.device.type, torch.bfloat16):
            said = unroll(self.network, batch.features, batch.action, lesson)
        return Unrolled(*(None if part is None else part.float() for part in said))  # type: ignore[arg-type]

    @torch.no_grad()
    def diagnose(self, sample: Sample) -> dict[str, float]:
        """What the networks get wrong on a sample, in units of reward; see `diagnoses`."""
        batch = to_batch(sample, self.device, absorbing=False)
        said = unroll(self.network, batch.features, batch.action)
        lag = float(self.updates - sample.version.mean())
        return {'policy_lag': lag} | diagnoses(self.network, said, batch)

    def arrays(self) -> dict[str, Array32]:
        """The weights as numpy arrays, for self-play."""
        return arrays_of(self.network)

    def mean_arrays(self) -> dict[str, Array32]:
        """The running mean of the weights, for validations and a model file; without one the last weights."""
        return self.arrays() if self._mean is None else arrays_of(self._mean.module)

    def load_arrays(self, arrays: Mapping[str, Array32]) -> None:
        """Begin with the weights of a model, as `arrays` gives them.

        Raises:
            ValueError: they are not those of such networks, or for other atoms.
        """
        for name in ('value', 'reward'):
            self._check_atoms(name, arrays)
        try:
            self.network.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
        except RuntimeError as error:
            raise ValueError('the weights are those of other networks') from error
        self._mean = self._average()

    def _check_atoms(self, head: str, arrays: Mapping[str, Array32]) -> None:
        """Refuse a head's atoms that are not ours; as a part of the weights they would take their place."""
        theirs, ours = arrays.get(f'{head}_atoms'), self.arrays()[f'{head}_atoms']
        if theirs is not None and (theirs.shape != ours.shape or not np.allclose(theirs, ours)):
            raise ValueError(f'the weights are for other atoms than those of network.{head}')

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimiser, running mean and count of updates, for a checkpoint."""
        return {
            'network': self.network.state_dict(),
            'optimiser': self._optimiser.state_dict(),
            'updates': self.updates,
        } | ({} if self._mean is None else {'mean': self._mean.state_dict()})

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.network.load_state_dict(state['network'])
        self._optimiser.load_state_dict(state['optimiser'])
        self.updates = int(state['updates'])
        if self._mean is not None:
            self._mean.load_state_dict(state['mean'])


def arrays_of(network: torch.nn.Module) -> dict[str, Array32]:
    """Weights of networks as numpy arrays."""
    state = network.state_dict()
    return {name: tensor.detach().float().cpu().numpy().copy() for name, tensor in state.items()}


def diagnoses(network: Network, said: Unrolled, batch: Batch) -> dict[str, float]:
    """Errors of the heads.

    The mean absolute error of the reward on decisions that go on and on those that end an episode
    (1 in 300, but they carry the task), of the value at the root and at the last position, the entropy
    of the policy's targets and of the policy, the chance that the networks gave to an end that came, and
    the share of targets beyond the atoms.
    """
    reward, value = network.reward_atoms, network.value_atoms
    reward_error = (expectation(said.reward, reward) - batch.reward).abs()
    value_error = (expectation(said.value, value) - batch.value).abs()
    steps, ends = batch.live[:, :-1] * batch.going_on, batch.live[:, :-1] * (1.0 - batch.going_on)
    log_policy = torch.log_softmax(said.policy, -1)
    found = {
        'reward_error_going_on': masked_mean(reward_error, steps),
        'reward_error_end': masked_mean(reward_error, ends),
        'value_error_root': masked_mean(value_error[:, :1], batch.live[:, :1]),
        'value_error_last': masked_mean(value_error[:, -1:], batch.live[:, -1:]),
        'target_entropy': masked_mean(-torch.xlogy(batch.policy, batch.policy).sum(-1), batch.live),
        'policy_entropy': masked_mean(-(log_policy.exp() * log_policy).sum(-1), batch.live),
        'clipped_values': masked_mean(beyond(value, batch.value), batch.live),
        'clipped_rewards': masked_mean(beyond(reward, batch.reward), batch.live[:, :-1]),
    }
    if said.alive is not None:
        found['end_foreseen'] = masked_mean(1.0 - torch.sigmoid(said.alive), ends)
        found['end_feared'] = masked_mean(1.0 - torch.sigmoid(said.alive), steps)
    return {name: float(item) for name, item in found.items() if not item.isnan()}


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean [] of values where the mask is 1; NaN where it is 1 nowhere."""
    return (values * mask).sum() / mask.sum()


def beyond(atoms: Tensor, targets: Tensor) -> Tensor:
    """1 where a target lies outside the atoms."""
    return ((targets < atoms[0]) | (targets > atoms[-1])).float()
