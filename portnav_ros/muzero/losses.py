"""The losses of MuZero as named terms on one unrolled batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from portnav_ros.muzero.networks import Network
from portnav_ros.muzero.replay import Sample
from portnav_ros.params import Ranges, check_ranges

REGRET_SCALE = 10.0  # units of reward
LESSON_TEMPERATURE = 5.0  # units of reward
WORTH_ACTIONS = 4  # of a lesson, that the dynamics is asked about
WORTH_OF_REGRET = 2.5  # a collision costs 1000 in the reward and 400 in a lesson
WORTH_SCALE = 100.0  # units of reward


@dataclass(frozen=True)
class LossWeights:
    """Weight of each term in the sum; `alive` counts only for networks that have that head."""

    policy: float = 1.0
    value: float = 1.0
    reward: float = 1.0
    alive: float = 1.0
    lesson: float = 1.0
    imitation: float = 0.5
    worth: float = 0.0
    ranges: ClassVar[Ranges] = dict.fromkeys(
        ('policy', 'value', 'reward', 'alive', 'lesson', 'imitation', 'worth'), (0.0, 1e6)
    )

    def __post_init__(self) -> None:
        """Refuse negative weights."""
        check_ranges(self)


class Batch(NamedTuple):
    """A sample as tensors: N sequences of K decisions. The masks are those of `targets.Targets`.

    trained: 1 at the positions whose value and reward are trained.
    """

    features: Tensor  # [N, F]
    action: Tensor  # [N, K]
    policy: Tensor  # [N, K + 1, A]
    reward: Tensor  # [N, K]
    value: Tensor  # [N, K + 1]
    going_on: Tensor  # [N, K]
    live: Tensor  # [N, K + 1]
    trained: Tensor  # [N, K + 1]
    lesson: Tensor  # [N, K + 1, C] actions that were valued, below 0 where none were
    regret: Tensor  # [N, K + 1, C] units of reward


class Unrolled(NamedTuple):
    """What the networks say of a batch along its actions."""

    policy: Tensor  # [N, K + 1, A] logits
    value: Tensor  # [N, K + 1, bins] logits
    reward: Tensor  # [N, K, bins] logits
    alive: Tensor | None  # [N, K] logits
    worth: Tensor | None = None  # [N, W] of the first actions of the root's lesson, units of reward


def to_batch(sample: Sample, device: torch.device, absorbing: bool) -> Batch:
    """Move a sample to a device.

    Args:
        sample: as drawn.
        device: where the networks are.
        absorbing: whether to train what lies past a terminal as worth nothing; a network that tells
            whether an episode goes on never asks.
    """
    targets = sample.targets
    trained = targets.live + targets.absorbed if absorbing else targets.live

    def tensor(array: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> Tensor:
        return torch.from_numpy(array).to(device)

    return Batch(
        features=tensor(sample.features).float(),
        action=tensor(sample.action),
        policy=tensor(sample.policy),
        reward=tensor(targets.reward),
        value=tensor(targets.value),
        going_on=tensor(targets.going_on),
        live=tensor(targets.live),
        trained=tensor(trained),
        lesson=tensor(sample.lesson),
        regret=tensor(sample.regret),
    )


def unroll(network: Network, features: Tensor, action: Tensor, lesson: Tensor | None = None) -> Unrolled:
    """Run the networks along actions [N, K] from features [N, F], and to one side for actions [N, W].

    The gradient that flows back through each application of the dynamics is halved (MuZero, appendix
    G). Heads run once on all positions together, which is several times quicker than one by one.
    """
    count, steps = action.shape
    latent = network.represent(features)
    latents, rewards, alive = [latent], [], []
    for k in range(steps):
        transition = network.step(halve_gradient(latent), action[:, k])
        latent = transition.latent
        latents.append(latent)
        rewards.append(transition.reward)
        if transition.alive is not None:
            alive.append(transition.alive)
    policy, value = network.predict(torch.cat(latents))
    return Unrolled(
        policy.view(steps + 1, count, -1).transpose(0, 1),
        value.view(steps + 1, count, -1).transpose(0, 1),
        torch.stack(rewards, 1),
        torch.stack(alive, 1) if alive else None,
        None if lesson is None else worth_of(network, latents[0], lesson),
    )


def worth_of(network: Network, latent: Tensor, action: Tensor) -> Tensor:
    """What the networks think actions [N, W] are worth from latents [N, L]: reward plus value."""
    count, width = action.shape
    after = network.step(halve_gradient(latent).repeat_interleave(width, 0), action.reshape(-1))
    value = expectation(network.predict(after.latent).value.float(), network.value_atoms)
    if after.alive is not None:
        value = torch.sigmoid(after.alive.float()) * value
    return (expectation(after.reward.float(), network.reward_atoms) + value).view(count, width)


def halve_gradient(values: Tensor) -> Tensor:
    """The same values, through which half the gradient flows back."""
    return 0.5 * values + 0.5 * values.detach()


def policy_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Cross-entropy [] to the search's policy, on the episode's own positions."""
    entropy = -(batch.policy * functional.log_softmax(said.policy, -1)).sum(-1)
    return mean_over_unroll(entropy * batch.live)


def value_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Cross-entropy [] to the two atoms next to the return."""
    return mean_over_unroll(two_hot_loss(said.value, network.value_atoms, batch.value) * batch.trained)


def reward_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Cross-entropy [] to the two atoms next to the reward."""
    loss = two_hot_loss(said.reward, network.reward_atoms, batch.reward) * batch.trained[:, :-1]
    return loss.mean()


def alive_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Binary cross-entropy [] of whether the episode goes on; 0 without that head."""
    if said.alive is None:
        return said.value.new_zeros(())
    loss = functional.binary_cross_entropy_with_logits(said.alive, batch.going_on, reduction='none')
    return (loss * batch.live[:, :-1]).mean()


def lesson_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """What the policy would regret, if it took one of the actions that a teacher valued.

    The expected regret is right about what no sensor tells, because it averages before it chooses.
    """
    if batch.lesson.shape[2] == 0:
        return said.policy.new_zeros(())
    regret = (log_lesson_policy(said, batch).exp() * batch.regret).sum(-1) / REGRET_SCALE
    return mean_over_unroll(regret * taught(batch))


def imitation_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Cross-entropy [] to a softmax of what the actions of a lesson are worth.

    It keeps a gradient where the policy is sure of a wrong action; of lessons that chance decides, as
    those of a rehearsal, it would learn the chance.
    """
    if batch.lesson.shape[2] == 0:
        return said.policy.new_zeros(())
    wanted = functional.softmax(-batch.regret / LESSON_TEMPERATURE, -1)
    entropy = -(wanted * log_lesson_policy(said, batch)).sum(-1)
    return mean_over_unroll(entropy * taught(batch))


def log_lesson_policy(said: Unrolled, batch: Batch) -> Tensor:
    """Logarithm [N, K + 1, C] of the policy over the actions of the lessons alone."""
    return functional.log_softmax(said.policy.gather(2, batch.lesson.clamp(min=0)), -1)


def taught(batch: Batch) -> Tensor:
    """1 at the positions [N, K + 1] that have a lesson."""
    return (batch.lesson[..., 0] >= 0).float() * batch.live


def worth_loss(network: Network, said: Unrolled, batch: Batch) -> Tensor:
    """Squared error [] of what the networks think a lesson's actions are worth, in differences.

    Self-play tells of the one action that was taken; this tells the dynamics of those that were not, so that
    a search finds differences between actions that are more than noise.
    """
    if said.worth is None:
        return said.value.new_zeros(())
    width = said.worth.shape[1]
    wanted = -WORTH_OF_REGRET * batch.regret[:, 0, :width]
    error = (said.worth - said.worth.mean(1, keepdim=True)) - (wanted - wanted.mean(1, keepdim=True))
    return ((error / WORTH_SCALE) ** 2).mean(1).mul(taught(batch)[:, 0]).mean()


TERMS: dict[str, Callable[[Network, Unrolled, Batch], Tensor]] = {
    'policy': policy_loss,
    'value': value_loss,
    'reward': reward_loss,
    'alive': alive_loss,
    'lesson': lesson_loss,
    'imitation': imitation_loss,
    'worth': worth_loss,
}


def mean_over_unroll(loss: Tensor) -> Tensor:
    """Mean of losses [N, K + 1] over the batch: the root's, plus 1 / K of each unrolled position's."""
    if loss.shape[1] == 1:
        return loss.mean()
    return loss[:, 0].mean() + loss[:, 1:].mean()


def two_hot_loss(logits: Tensor, atoms: Tensor, target: Tensor) -> Tensor:
    """Cross-entropy [...] of logits [..., bins] to the two atoms around targets [...].

    A target beyond the atoms is taken as the last atom; `atoms.two_hot` is the same as an array.
    """
    clipped = target.clamp(atoms[0], atoms[-1])
    above = torch.searchsorted(atoms, clipped, right=True).clamp(1, len(atoms) - 1)
    low, high = atoms[above - 1], atoms[above]
    share = (clipped - low) / (high - low)
    log_p = functional.log_softmax(logits, -1)
    below, over = (log_p.gather(-1, index[..., None])[..., 0] for index in (above - 1, above))
    return -((1.0 - share) * below + share * over)


def expectation(logits: Tensor, atoms: Tensor) -> Tensor:
    """Mean [...] of the atoms under logits [..., bins]."""
    return torch.softmax(logits, -1) @ atoms
