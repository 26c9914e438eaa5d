"""The batched environment as stable-baselines3 wants it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from gymnasium import Wrapper
from stable_baselines3.common.vec_env import VecEnv

from portnav_ros.task.env import PortVectorEnv
from portnav_ros.types import Array, Array32, BoolArray, IntArray

StepListener = Callable[[Array, BoolArray, dict[str, Any]], None]
Indices = None | int | Iterable[int]


class PortVecEnv(VecEnv):
    """B ports behind the interface of stable-baselines3.

    Rewards are multiplied by a constant, so that returns are of the size its value loss and its clipping
    of gradients are meant for. An episode that ran out of time is marked, with its last observation:
    stable-baselines3 then adds the discounted value of that observation to the last reward.
    """

    def __init__(self, env: PortVectorEnv, reward_scale: float, listen: StepListener) -> None:
        """Wrap an environment that starts ended episodes anew in the same step.

        Args:
            env: B ports.
            reward_scale: what rewards are multiplied by.
            listen: is told of each step: raw rewards [B], ended [B], the environment's infos.
        """
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._reward_scale = reward_scale
        self._listen = listen
        self._actions: IntArray = np.zeros(env.num_envs, np.int64)

    def reset(self) -> Array32:
        """Start B new episodes; returns [B, F]."""
        features, _ = self.env.reset()
        return features

    def step_async(self, actions: IntArray) -> None:
        """Keep the actions [B] for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Array32, Array32, BoolArray, list[dict[str, Any]]]:
        """Sail; returns features [B, F], scaled rewards [B], ended [B] and a mapping for each vessel."""
        features, rewards, terminated, truncated, infos = self.env.step(self._actions)
        ended = terminated | truncated
        self._listen(rewards, ended, infos)
        rows: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for b in np.flatnonzero(ended):
            rows[b] = {
                'terminal_observation': infos['final_obs'][b],
                'TimeLimit.truncated': bool(truncated[b]),
            }
        return features, (self._reward_scale * rewards).astype(np.float32), ended, rows

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the environment, once for each of the vessels."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Refuse: the vessels share one environment."""
        raise NotImplementedError(f'{attr_name} cannot be set for single vessels')

    def env_method(self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any) -> list[Any]:
        """Refuse: the vessels share one environment."""
        raise NotImplementedError(f'{method_name} cannot be called for single vessels')

    def env_is_wrapped(
        self, wrapper_class: type[Wrapper[Any, Any, Any, Any]], indices: Indices = None
    ) -> list[bool]:
        """No vessel has an environment of its own that could be wrapped."""
        return [False] * len(list(self._get_indices(indices)))
