"""The PPO baseline at run time: a policy network in numpy, always at its likeliest action."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from portnav_ros.muzero import ModelError
from portnav_ros.muzero.model_file import Model, check_sensor, check_vessel, load_model
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.agent import AgentPolicy
from portnav_ros.task.policy import Observation
from portnav_ros.types import Array, Array32, BoolArray, IntArray
from portnav_ros.vessel import VesselParams

Layers = list[tuple[Array32, Array32]]  # weight [outputs, inputs] and bias [outputs] of each


def load_policy(
    path: Path, vessel: VesselParams, lidar: LidarParams, allow_mismatch: bool = False
) -> PpoPolicy:
    """Read a model for a vessel and its sensor.

    Args:
        path: of the weights; their card lies beside them.
        vessel: who will sail.
        lidar: the sensor.
        allow_mismatch: only warn where the model was trained for another vessel.

    Raises:
        ModelError: there is no model, or it does not fit.
    """
    model = load_model(path)
    return PpoPolicy(model, lidar, check_vessel(model, vessel, allow_mismatch))


class PpoPolicy:
    """Takes the action that a model's policy network holds likeliest.

    misfit: what the model does not fit.
    """

    def __init__(self, model: Model, lidar: LidarParams, misfit: str = '') -> None:
        """Take a model.

        Raises:
            ModelError: the weights are not those of PPO for the card's task, or the sensor is not the one
                it was trained with.
        """
        check_sensor(model, lidar)
        task = model.card.task
        self.model = model
        self.misfit = misfit
        self._layers = _layers(model)
        self._agent = AgentPolicy(task.observation, task.actions, lidar, self._decide)

    @property
    def decided(self) -> BoolArray:
        """Vessels [B] (bool) for which the last ``act`` has decided; the others hold what they had."""
        return self._agent.decided

    def reset(self, which: BoolArray) -> None:
        """Forget the vessels [B] (bool)."""
        self._agent.reset(which)

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]: heading in rad and surge speed in m/s."""
        return self._agent.act(observation)

    def _decide(self, features: Array32) -> IntArray:
        return likeliest(self._layers, features)


def likeliest(layers: Layers, features: Array32) -> IntArray:
    """Action [B] of the greatest logit for features [B, F]."""
    hidden = features
    for weight, bias in layers[:-1]:
        hidden = np.tanh(hidden @ weight.T + bias)
    weight, bias = layers[-1]
    return np.asarray(np.argmax(hidden @ weight.T + bias, axis=1))


def policy_layers(tensors: Mapping[str, Array32]) -> Layers:
    """Layers of the policy network, first to last, from tensors `policy.0.weight` and so on."""
    layers: Layers = []
    while f'policy.{len(layers)}.weight' in tensors:
        name = f'policy.{len(layers)}'
        layers.append((tensors[f'{name}.weight'], tensors[f'{name}.bias']))
    return layers


def _layers(model: Model) -> Layers:
    """Arrange the tensors, once they are known to be those of a policy for the card's task."""
    card, path = model.card, model.path
    if card.algorithm != 'ppo':
        raise ModelError(f'{path}: algorithm: {card.algorithm}, expected ppo; name another model')
    try:
        layers = policy_layers(model.tensors)
    except KeyError as error:
        raise ModelError(f'{path}: no tensor {error}; save the model again') from error
    hidden = [len(bias) for _, bias in layers[:-1]]
    widths = [card.task.observation.size, *hidden, card.task.actions.count]
    expected = [((after, before), (after,)) for before, after in pairwise(widths)]
    found = [(weight.shape, bias.shape) for weight, bias in layers]
    if found != expected:
        raise ModelError(f'{path}: policy: layers of shapes {found}, expected {expected} from its card')
    return layers
