"""Rehearsed self-play: before a decision, the policy tries some actions in a copy of the world and sails on.

In the copy it sees what it would see and decides as it would decide, so its own blindness is in what an
action earns: one after which it would find its way beats one that is right only for who knows the
future. To prefer the better of them is a step of policy iteration (Tesauro and Galperin, On-line Policy
Improvement using Monte-Carlo Search, 1996; Bertsekas, Rollout, Policy Iteration and Distributed
Reinforcement Learning, 2020). One rehearsal tells of one course of the traffic; the networks learn from
many of them what to expect.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode

from portnav_ros.muzero.inference import NumpyModel, likeliest
from portnav_ros.muzero.losses import WORTH_OF_REGRET
from portnav_ros.muzero.tutor import NOT_TAUGHT, REGRET_MAX, Taught, check_lesson, sampled
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.types import Array32, IntArray

WEIGHED_ACTIONS = 10  # whose worth tells how much is at stake


@dataclass(frozen=True)
class RehearsalParams:
    """How much is rehearsed.

    steps: environment steps that are rehearsed, after those that are taught; none by default. share: of
    the vessels that rehearse a decision. chance: share of these that are drawn, the others are those for
    which the networks think that most is at stake. actions: K, tried by each. decisions: for which it
    sails on. random, temperature: of the decisions that are taken, as in teaching. threads: that
    rehearse at once; their number may change the last bits.
    """

    steps: int = 0
    share: float = 0.125
    chance: float = 0.125
    actions: int = 8
    decisions: int = 20
    random: float = 0.02
    temperature: float = 0.5
    threads: int = 1
    ranges: ClassVar[Ranges] = {
        'steps': (0, 1e12),
        'share': (0.0, 1.0),
        'chance': (0.0, 1.0),
        'actions': (2, 128),
        'decisions': (0, 1000),
        'random': (0.0, 1.0),
        'temperature': (1e-3, 100.0),
        'threads': (1, 256),
    }

    def __post_init__(self) -> None:
        """Refuse rehearsals without a choice."""
        check_ranges(self)


class Rehearsal:
    """Lets the vessels of a vector environment rehearse."""

    def __init__(self, env: PortVectorEnv, params: RehearsalParams, discount: float) -> None:
        """Make room for the copies; discount: of one decision.

        Raises:
            ParamError: more actions than the task has, or than a lesson can number.
        """
        check_lesson('rehearsal.actions', params.actions, env.task.actions.count)
        self._env, self._params = env, params
        self._vessels = max(round(params.share * env.num_envs), 1)
        shares = np.array_split(np.arange(self._vessels), min(params.threads, self._vessels))
        self._rollouts = [Rollouts(env, len(rows), params, discount) for rows in shares]
        self._shares = shares

    def decide(self, model: NumpyModel, features: Array32, rng: np.random.Generator) -> Taught:
        """Let the policy network decide on features [B, F], and some vessels rehearse it."""
        params, batch = self._params, self._env.num_envs
        latent = model.represent(features)
        logits, value = model.predict(latent)
        vessels = self._chosen(stakes(model, latent, logits), rng)
        action = tried(logits[vessels], params.actions, rng)
        earned = self._earned(model, vessels, action)
        lesson = np.full((batch, params.actions), NOT_TAUGHT, np.int8)
        regret = np.zeros((batch, params.actions), np.float16)
        lesson[vessels] = action
        lost = (earned.max(axis=1, keepdims=True) - earned) / WORTH_OF_REGRET
        regret[vessels] = np.minimum(lost, REGRET_MAX)
        return Taught(sampled(logits, params.temperature, params.random, rng), value, lesson, regret)

    def _chosen(self, stakes: Array32, rng: np.random.Generator) -> IntArray:
        """Who rehearses: first those that are drawn, then those with most at stake."""
        order = rng.permutation(len(stakes))
        drawn = round(self._params.chance * self._vessels)
        rest = order[drawn:]
        return np.concatenate([order[:drawn], rest[np.argsort(-stakes[rest])][: self._vessels - drawn]])

    def _earned(self, model: NumpyModel, vessels: IntArray, action: IntArray) -> Array32:
        """What actions [N, K] of vessels [N] earn."""

        def part(k: int) -> Array32:
            rows = self._shares[k]
            own = NumpyModel(model.weights, float(model.discount), model.eyes)  # with buffers of its own
            return self._rollouts[k].earned(own, vessels[rows], action[rows])

        with ThreadPoolExecutor(len(self._shares)) as pool:
            return np.concatenate(list(pool.map(part, range(len(self._shares)))))


class Rollouts:
    """Copies of N vessels, K of each, that sail on."""

    def __init__(self, env: PortVectorEnv, vessels: int, params: RehearsalParams, discount: float) -> None:
        """Make room for the copies."""
        self._env = env
        self._decisions = params.decisions
        self._discount = discount
        self._copies = PortVectorEnv(
            vessels * params.actions,
            source=env.source,
            task=env.task,
            autoreset_mode=AutoresetMode.DISABLED,
        )

    def earned(self, model: NumpyModel, vessels: IntArray, action: IntArray) -> Array32:
        """What actions [N, K] of vessels [N] earn, [N, K] in units of reward.

        Discounted rewards until the episode ends, or the network's value of where the last decision leads.
        """
        copies = self._copies
        copies.copy(self._env, np.repeat(vessels, action.shape[1]))
        taken = action.reshape(-1).copy()
        earned, weight = np.zeros(len(taken)), np.ones(len(taken))
        afloat = np.arange(len(taken))
        for left in range(self._decisions, -1, -1):
            features, reward, terminated, truncated, _ = copies.step(taken)
            earned[afloat] += weight[afloat] * reward[afloat]
            weight[afloat] *= self._discount
            weight[terminated] = 0.0
            afloat = np.flatnonzero(~terminated & ~truncated)
            if not len(afloat):
                break
            if left:
                taken[afloat] = likeliest(model, features[afloat])
        open_end = np.flatnonzero(weight)
        if len(open_end):
            earned[open_end] += weight[open_end] * model.predict(model.represent(features[open_end]))[1]
        return earned.reshape(action.shape).astype(np.float32)


def stakes(model: NumpyModel, latent: Array32, logits: Array32) -> Array32:
    """How much the likeliest actions differ in what the networks think of them, [B] in units of reward.

    Args:
        model: the networks.
        latent: [B, L].
        logits: [B, A] of the policy there.
    """
    count = min(WEIGHED_ACTIONS, logits.shape[1])
    likely = np.argsort(-logits, axis=1)[:, :count]
    after = model.step(np.repeat(latent, count, axis=0), likely.reshape(-1))
    worth = (after.reward + after.discount * after.value).reshape(likely.shape)
    weight = np.take_along_axis(logits, likely, axis=1)
    weight = np.exp(weight - weight[:, :1])
    weight /= weight.sum(axis=1, keepdims=True)
    mean = (weight * worth).sum(axis=1, keepdims=True)
    return np.sqrt((weight * (worth - mean) ** 2).sum(axis=1))


def tried(logits: Array32, count: int, rng: np.random.Generator) -> IntArray:
    """Actions [N, K] to try under a policy's logits [N, A]: the likeliest first, the others drawn from it."""
    lots = logits + rng.gumbel(size=logits.shape)
    lots[np.arange(len(logits)), logits.argmax(axis=1)] = np.inf
    return np.argsort(-lots, axis=1)[:, :count]
