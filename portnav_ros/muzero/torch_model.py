"""A torch network as a `Model`: the way other libraries search, and the oracle of `inference`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from portnav_ros.muzero.atoms import AtomParams
from portnav_ros.muzero.inference import Beginning
from portnav_ros.muzero.networks import Network, NetworkParams
from portnav_ros.muzero.tree import Step
from portnav_ros.types import AnyArray, Array32


class TorchModel:
    """Arrays in, arrays out, torch in between."""

    def __init__(self, network: Network, discount: float) -> None:
        """Take networks, and the discount of one decision."""
        self.network = network
        self.discount = discount

    def begin(self, observation: Array32) -> Beginning:
        """What observations [B, F] look like."""
        latent = self.represent(observation)
        return Beginning(latent, *self.predict(latent))

    def represent(self, observation: Array32) -> Array32:
        """Latent [B, L] of observations [B, F]."""
        with torch.inference_mode():
            return _array(self.network.represent(torch.from_numpy(observation)))

    def predict(self, latent: Array32) -> tuple[Array32, Array32]:
        """Logits of the policy [B, A] and value [B] of latents [B, L]."""
        with torch.inference_mode():
            return self._predict(torch.from_numpy(latent))

    def step(self, latent: Array32, action: AnyArray) -> Step:
        """What actions [B] lead to from latents [B, L]."""
        with torch.inference_mode():
            after = self.network.step(torch.from_numpy(latent), torch.from_numpy(action.astype(np.int64)))
            reward = torch.softmax(after.reward, 1) @ self.network.reward_atoms
            going_on = torch.ones_like(reward) if after.alive is None else torch.sigmoid(after.alive)
            prediction = self._predict(after.latent)
            return Step(_array(after.latent), _array(reward), _array(self.discount * going_on), *prediction)

    def _predict(self, latent: Tensor) -> tuple[Array32, Array32]:
        said = self.network.predict(latent)
        return _array(said.policy), _array(torch.softmax(said.value, 1) @ self.network.value_atoms)


def network_of(state: Mapping[str, AnyArray], headings: int, speeds: int) -> Network:
    """Networks with the sizes and weights of a state dict in numpy."""
    params = NetworkParams(
        latent=len(state['dynamics.norm.weight']),
        represent_hidden=_widths(state, 'representation'),
        dynamics_hidden=_widths(state, 'dynamics'),
        predict_hidden=_widths(state, 'prediction'),
        value=AtomParams(count=len(state['value_atoms'])),
        reward=AtomParams(count=len(state['reward_atoms'])),
        alive='dynamics.alive.weight' in state,
    )
    features = state['representation.body.0.linear.weight'].shape[1]
    network = Network(features, headings, speeds, params)
    network.load_state_dict({name: torch.from_numpy(array) for name, array in state.items()})
    return network


def _widths(state: Mapping[str, AnyArray], part: str) -> tuple[int, ...]:
    widths: list[int] = []
    while (name := f'{part}.body.{len(widths)}.linear.bias') in state:
        widths.append(len(state[name]))
    return tuple(widths)


def _array(values: Tensor) -> Array32:
    return np.asarray(values.numpy(), np.float32)
