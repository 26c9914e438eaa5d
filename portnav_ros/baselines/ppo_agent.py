"""Proximal policy optimisation (Schulman et al. 2017) as stable-baselines3 has it, on this task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from torch import nn

from portnav_ros.baselines.ppo_env import PortVecEnv
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.types import Array32

LOSSES = (
    'policy_gradient_loss',
    'value_loss',
    'entropy_loss',
    'approx_kl',
    'clip_fraction',
    'explained_variance',
)


@dataclass(frozen=True)
class PpoParams:
    """What stable-baselines3 is given; names as in the paper. rollout, batch: in decisions."""

    environments: int = 64
    rollout: int = 32  # decisions of each environment between updates
    batch: int = 512
    epochs: int = 5
    learning_rate: float = 5e-4
    discount: float = 0.997  # of one decision period; actions may be held for several
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy_weight: float = 0.001
    value_weight: float = 0.5
    gradient_clip: float = 0.5
    hidden: tuple[int, ...] = (256, 256)
    reward_scale: float = 0.01
    ranges: ClassVar[Ranges] = {
        'environments': (1, 65_536),
        'rollout': (1, 65_536),
        'batch': (2, 1_000_000),
        'epochs': (1, 100),
        'learning_rate': (1e-7, 1.0),
        'discount': (0.0, 1.0),
        'gae_lambda': (0.0, 1.0),
        'clip': (1e-3, 1.0),
        'entropy_weight': (0.0, 10.0),
        'value_weight': (0.0, 10.0),
        'gradient_clip': (1e-3, 1e3),
        'reward_scale': (1e-6, 1e3),
    }

    def __post_init__(self) -> None:
        """Refuse values with which nothing can be learned."""
        check_ranges(self)
        if not self.hidden or min(self.hidden) < 1:
            raise ParamError(f'hidden = {self.hidden} needs at least one layer of at least one unit')
        if self.environments * self.rollout % self.batch:
            raise ParamError(
                f'batch = {self.batch} does not divide environments x rollout = '
                f'{self.environments * self.rollout}'
            )


class PpoAgent:
    """The learner: its networks, optimiser and environment."""

    def __init__(self, params: PpoParams, env: PortVecEnv, seed: int, device: str) -> None:
        """Build fresh networks."""
        self.params = params
        self.discount = params.discount**env.env.task.actions.hold  # of one decision
        self.algorithm = PPO(
            'MlpPolicy',
            env,
            learning_rate=params.learning_rate,
            n_steps=params.rollout,
            batch_size=params.batch,
            n_epochs=params.epochs,
            gamma=self.discount,
            gae_lambda=params.gae_lambda,
            clip_range=params.clip,
            ent_coef=params.entropy_weight,
            vf_coef=params.value_weight,
            max_grad_norm=params.gradient_clip,
            policy_kwargs={'net_arch': list(params.hidden), 'activation_fn': nn.Tanh},
            seed=seed,
            device=device,
        )
        self.algorithm.set_logger(Logger(None, []))

    @property
    def decisions(self) -> int:
        """Decisions taken so far, of all environments together."""
        return self.algorithm.num_timesteps

    @property
    def updates(self) -> int:
        """Gradient steps taken so far."""
        return self.algorithm._n_updates * self.params.environments * self.params.rollout // self.params.batch

    def improve(self) -> dict[str, float]:
        """Sail one rollout, learn from it, and return the losses by name."""
        size = self.params.environments * self.params.rollout
        self.algorithm.learn(size, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
        values = self.algorithm.logger.name_to_value
        return {name: float(values[f'train/{name}']) for name in LOSSES}

    def state_dict(self) -> dict[str, Any]:
        """All that learning goes on from, but the environment: tensors, numbers and containers of them."""
        algorithm = self.algorithm
        shuffling = np.random.get_state(legacy=False)  # noqa: NPY002 - stable-baselines3 draws from it
        key = torch.tensor(shuffling['state']['key'].astype(np.int64))
        return {
            'policy': algorithm.policy.state_dict(),
            'optimizer': algorithm.policy.optimizer.state_dict(),
            'decisions': algorithm.num_timesteps,
            'epochs': algorithm._n_updates,
            'features': torch.tensor(algorithm._last_obs),
            'starts': torch.tensor(algorithm._last_episode_starts),
            'torch_generator': torch.get_rng_state(),
            'numpy_generator': {**shuffling, 'state': {**shuffling['state'], 'key': key}},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint; the environment must stand where it stood then."""
        algorithm = self.algorithm
        algorithm.policy.load_state_dict(state['policy'])
        algorithm.policy.optimizer.load_state_dict(state['optimizer'])
        algorithm.num_timesteps = state['decisions']
        algorithm._n_updates = state['epochs']
        algorithm._last_obs = state['features'].numpy()
        algorithm._last_episode_starts = state['starts'].numpy()
        torch.set_rng_state(state['torch_generator'])
        shuffling = state['numpy_generator']
        key = shuffling['state']['key'].numpy().astype(np.uint32)
        np.random.set_state({**shuffling, 'state': {**shuffling['state'], 'key': key}})  # noqa: NPY002

    def tensors(self) -> dict[str, Array32]:
        """Weights of policy and value by the names that `ppo_policy` reads: `policy.0.weight` and so on."""
        policy = self.algorithm.policy
        stacks = {
            'policy': _linear_layers(policy.mlp_extractor.policy_net, policy.action_net),
            'value': _linear_layers(policy.mlp_extractor.value_net, policy.value_net),
        }
        return {
            f'{name}.{index}.{part}': getattr(layer, part).detach().cpu().numpy().copy()
            for name, layers in stacks.items()
            for index, layer in enumerate(layers)
            for part in ('weight', 'bias')
        }


def _linear_layers(*stacks: nn.Module) -> list[nn.Linear]:
    return [layer for stack in stacks for layer in stack.modules() if isinstance(layer, nn.Linear)]
