"""The learned local planner at run time: a released model, and a search in it at each decision.

One vessel is searched for at a time, by the one compiled path that the ROS node runs too, so that no
decision depends on how many are made together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from portnav_ros.muzero import ModelError
from portnav_ros.muzero.inference import (
    SCAN_KERNEL,
    Eyes,
    MirroredModel,
    NumpyModel,
    Scan,
    eyes_of,
    weights_of,
)
from portnav_ros.muzero.layers import Head, Layer, Weights
from portnav_ros.muzero.model_file import Card, Model, check_sensor, check_vessel, load_model
from portnav_ros.muzero.rollout import predicted_track
from portnav_ros.muzero.search import Search, SearchParams
from portnav_ros.params import ParamError, override
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.agent import AgentPolicy
from portnav_ros.task.mirror import mirror_of
from portnav_ros.task.policy import Observation
from portnav_ros.task.tracking import TRACK_SIZE
from portnav_ros.types import Array, Array32, BoolArray, IntArray
from portnav_ros.vessel import VesselParams


class Decision(NamedTuple):
    """What the search found. A actions, D of them in a row; without a search the prior alone decides.

    value: return expected, in units of reward. visits, prior: [A] of the root. best: [D] the action
    taken, then the most visited ones.
    """

    value: float
    visits: IntArray
    prior: Array32
    best: IntArray


def load_policy(
    path: Path,
    vessel: VesselParams,
    lidar: LidarParams,
    simulations: int | None = None,
    allow_mismatch: bool = False,
) -> MuZeroPolicy:
    """Read a model for a vessel and its sensor.

    Args:
        path: of the weights; their card lies beside them.
        vessel: who will sail.
        lidar: the sensor.
        simulations: of each search, in place of the card's; 0 takes the prior's best action.
        allow_mismatch: only warn where the model was trained for another vessel.

    Raises:
        ModelError: there is no model, or it does not fit.
    """
    model = load_model(path)
    return MuZeroPolicy(model, lidar, simulations, check_vessel(model, vessel, allow_mismatch))


class MuZeroPolicy:
    """Plans with a model's networks from what its agent sees; always takes the best action.

    It decides anew at every call, also where an action of the model stands for several seconds: what it
    sees next may change its mind.

    decision: the last one, of whichever vessel; None after a reset. misfit: what the model does not fit.
    """

    def __init__(
        self, model: Model, lidar: LidarParams, simulations: int | None = None, misfit: str = ''
    ) -> None:
        """Take a model, and another number of simulations than its card's where given.

        Raises:
            ModelError: the weights are not those of a MuZero network for the card's task, or the sensor
                is not the one it was trained with.
        """
        check_sensor(model, lidar)
        card = model.card
        self.model = model
        self.misfit = misfit
        self.decision: Decision | None = None
        self._networks = _networks(model)
        self._search = _search(model, self._networks, simulations)
        actions = replace(card.task.actions, hold=1)
        self._agent = AgentPolicy(card.task.observation, actions, lidar, self._decide)
        self._random = np.random.default_rng(0)

    @property
    def simulations(self) -> int:
        """Simulations of each search; 0 where the prior alone decides."""
        return self._search.params.simulations if self._search else 0

    def reset(self, which: BoolArray) -> None:
        """Forget the vessels [B] (bool), and the last decision."""
        self.decision = None
        self._agent.reset(which)

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]: heading in rad and surge speed in m/s."""
        return self._agent.act(observation)

    def tracks(self, b: int = 0) -> Array:
        """What it knows of the things around vessel b, [N, 8]: place, velocity and both ends in m, m/s."""
        return self._agent.tracks(b)

    def best_track(self, own: Array, path: Array) -> Array:
        """Track [T, 2] m that the last decision plans for, from a state row [7] along a path [W, 2]."""
        actions = self.decision.best if self.decision else np.zeros(0, np.int64)
        card = self.model.card
        lookahead_m = card.task.observation.lookahead_m
        return predicted_track(actions, own, path, card.task.actions, lookahead_m, card.vessel)

    def _decide(self, features: Array32) -> IntArray:
        decisions = [self._plan(row[None]) for row in features]
        self.decision = decisions[-1]
        return np.array([decision.best[0] for decision in decisions])

    def _plan(self, features: Array32) -> Decision:
        """Decide for one vessel's features [1, F]."""
        if self._search is None:
            return _prior_decision(self._networks, features)
        result = self._search.run(self._networks, features, self._random, temperature=0.0)
        path = result.best_path[0]
        return Decision(float(result.value[0]), result.visits[0], result.prior[0], path[path >= 0])


def _prior_decision(networks: NumpyModel, features: Array32) -> Decision:
    _, logits, value = networks.begin(features)
    weights = np.exp(logits[0] - logits[0].max())
    prior = weights / weights.sum()
    return Decision(float(value[0]), np.zeros(len(prior), np.int64), prior, np.array([prior.argmax()]))


def _networks(model: Model) -> NumpyModel:
    """The networks, that look at a scene and its mirror image where the task has one."""
    card, weights, eyes = model.card, _weights(model), eyes_of(model.tensors)
    try:
        mirror = mirror_of(card.task.observation, card.task.actions)
    except ParamError:
        return NumpyModel(weights, card.discount, eyes)
    return MirroredModel(weights, card.discount, eyes, mirror)


def _search(model: Model, networks: NumpyModel, simulations: int | None) -> Search | None:
    """A search that explores nothing, as the card has it; None for 0 simulations."""
    try:
        params = override(SearchParams(), model.card.search, f'{model.path.stem}.json: search').quiet()
        if simulations == 0:
            return None
        if simulations is not None:
            params = replace(params, simulations=simulations)
    except ParamError as error:
        raise ModelError(f'{model.path}: {error}') from error
    return Search(params, 1, networks.actions, networks.latent)


def _weights(model: Model) -> Weights:
    """Arrange the tensors, once they are known to be those of a network for the card's task."""
    if model.card.algorithm != 'muzero':
        raise ModelError(
            f'{model.path}: algorithm: {model.card.algorithm}, expected muzero; name another model'
        )
    try:
        weights = weights_of(model.tensors, len(model.card.task.actions.speed_mps))
        eyes = eyes_of(model.tensors)
    except KeyError as error:
        raise ModelError(f'{model.path}: no tensor {error}; save the model again') from error
    except (ValueError, IndexError) as error:
        raise ModelError(f'{model.path}: the tensors do not fit each other ({error})') from error
    _check_widths(model.path, model.card, weights, eyes)
    return weights


def _check_widths(path: Path, card: Card, weights: Weights, eyes: Eyes) -> None:
    latent, actions = weights.dynamics_norm.shape[1], card.task.actions.count
    features = _check_eyes(path, card, eyes)
    reward, value = len(weights.reward_atoms), len(weights.value_atoms)
    alive = int(weights.dynamics_out.weight.shape[1] == latent + reward + 1)
    for part, inputs, layers, out, outputs in (
        ('representation', features, weights.represent, weights.represent_out, latent),
        ('dynamics', latent, weights.dynamics, weights.dynamics_out, latent + reward + alive),
        ('prediction', latent, weights.predict, weights.predict_out, actions + value),
    ):
        _check_layers(path, part, inputs, layers, (out, outputs))
    if len(weights.dynamics[0].bias) != actions or weights.represent_norm.shape[1] != latent:
        raise ModelError(f'{path}: dynamics: made for other actions than the {actions} of its card')


def _check_layers(
    path: Path, part: str, inputs: int, layers: Sequence[Layer], last: tuple[Head, int] | None = None
) -> None:
    """Refuse layers that do not fit each other, or the head and the outputs that come `last`."""
    widths = [layer.weight.shape[1] for layer in layers]
    found = [layer.weight.shape[0] for layer in layers]
    expected = [inputs, *widths[: len(layers) - 1]]
    if last is not None:
        found += [*last[0].weight.shape, len(last[0].bias)]
        expected += [widths[-1], last[1], last[1]]
    found += [array.shape[-1] for layer in layers for array in layer[1:]]  # biases and norms
    expected += [width for width in widths for _ in range(2)]
    if found != expected:
        raise ModelError(f'{path}: {part}: layers of widths {found}, expected {expected} from its card')


def _check_eyes(path: Path, card: Card, eyes: Eyes) -> int:
    """Number of values that the representation's layers get."""
    features = card.task.observation.size
    if eyes.scan is not None:
        _check_scan(path, eyes.scan, features)
        features = eyes.scan.outputs(features)
    if eyes.tracks is None:
        return features
    known = card.task.observation.tracks
    if eyes.tracks.slots != known:
        raise ModelError(f'{path}: tracks: made for {eyes.tracks.slots}, its card observes {known}')
    context, each = eyes.tracks.context, eyes.tracks.each
    _check_layers(path, 'tracks.context', features - known * TRACK_SIZE, context)
    _check_layers(path, 'tracks.each', TRACK_SIZE + context[-1].weight.shape[1], each)
    return eyes.tracks.outputs


def _check_scan(path: Path, scan: Scan, features: int) -> None:
    inputs = scan.ages
    for k, layer in enumerate(scan.layers):
        expected = SCAN_KERNEL * inputs, len(layer.bias)
        if layer.weight.shape != expected:
            raise ModelError(f'{path}: scan.layers.{k}: shape {layer.weight.shape}, expected {expected}')
        inputs = len(layer.bias)
    if scan.sectors % scan.stride or scan.ages * scan.sectors > features:
        raise ModelError(
            f'{path}: scan: {scan.ages} scans of {scan.sectors} sectors do not fit {features} features'
        )
