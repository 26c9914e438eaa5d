"""Taught self-play: the policy sails alone, and a teacher with foresight says what it should have done.

As in DAgger (Ross, Gordon and Bagnell 2011) the states are those that the learner gets itself into. A
lesson values a few actions of a decision; the loss on them is what the policy would regret.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from portnav_ros.muzero.inference import NumpyModel
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.training.foresight import Foresight, ForesightParams, best_of, regret_of
from portnav_ros.types import AnyArray, Array32, BoolArray, IntArray

NOT_TAUGHT = -1
REGRET_MAX = 2000.0
ACTIONS_MAX = 128  # that a lesson can number in a byte


@dataclass(frozen=True)
class TeachingParams:
    """How much is taught.

    steps: environment steps at the start of a run that are taught; none by default. share: of the
    decisions that get a lesson. actions: K, valued in each. follow: share of the environments that do
    what the teacher says. random: share of the decisions of all others that are made at random.
    temperature: of their policy. worth_after: share of the run from which on the dynamics too is
    taught what the actions of a lesson are worth; the policy comes first.
    """

    steps: int = 0
    share: float = 0.5
    actions: int = 12
    follow: float = 0.125
    random: float = 0.04
    temperature: float = 0.5
    worth_after: float = 0.0
    foresight: ForesightParams = field(default_factory=ForesightParams)
    ranges: ClassVar[Ranges] = {
        'steps': (0, 1e12),
        'worth_after': (0.0, 1.0),
        'share': (0.0, 1.0),
        'actions': (2, 1000),
        'follow': (0.0, 1.0),
        'random': (0.0, 1.0),
        'temperature': (1e-3, 100.0),
    }

    def __post_init__(self) -> None:
        """Refuse lessons without actions."""
        check_ranges(self)


class Taught(NamedTuple):
    """A decision of B vessels.

    action: [B] to take. value: [B] by the network. lesson: [B, K] actions that were valued, NOT_TAUGHT
    where none were. regret: [B, K] of each against the best of its row, units of reward.
    """

    action: IntArray
    value: Array32
    lesson: AnyArray
    regret: AnyArray


class Tutor:
    """Teaches the vessels of a vector environment."""

    def __init__(self, env: PortVectorEnv, params: TeachingParams) -> None:
        """Look into every environment's future.

        Raises:
            ParamError: actions that the teacher cannot value, or fewer than a lesson has.
        """
        check_lesson('teaching.actions', params.actions, env.task.actions.count)
        self._env = env
        self._params = params
        self._foresight = Foresight(env.world, env.task.actions, params.foresight)
        self._following = np.arange(env.num_envs) < round(params.follow * env.num_envs)

    def decide(self, model: NumpyModel, features: Array32, rng: np.random.Generator) -> Taught:
        """Let the policy network decide on features [B, F], and the teacher value some actions."""
        params, batch = self._params, self._env.num_envs
        logits, value = model.predict(model.represent(features))
        chosen = sampled(logits, params.temperature, params.random, rng)
        vessels = np.flatnonzero(self._following | (rng.random(batch) < params.share))
        lesson = self._foresight.teach(self._env.observation, vessels, params.actions, rng)
        taught = np.full((batch, params.actions), NOT_TAUGHT, np.int8)
        regret = np.zeros((batch, params.actions), np.float16)
        taught[vessels] = lesson.action
        regret[vessels] = np.minimum(regret_of(lesson), REGRET_MAX)
        told = np.zeros(batch, np.int64)
        told[vessels] = best_of(lesson)
        return Taught(np.where(self._following, told, chosen), value, taught, regret)

    def look(self, ended: BoolArray) -> None:
        """Look ahead where a new episode has begun."""
        if ended.any():
            self._foresight.look(ended)

    def state_dict(self) -> dict[str, AnyArray]:
        """What the teacher foresees, for a checkpoint."""
        return {'poses': self._foresight.poses}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint."""
        self._foresight.poses = state['poses']


def check_lesson(name: str, size: int, count: int) -> None:
    """Refuse lessons of more actions than a task has, or than a lesson can number.

    Raises:
        ParamError: names the parameter.
    """
    if not size <= count <= ACTIONS_MAX:
        raise ParamError(
            f'{name} = {size}: the task has {count} actions, '
            f'and needs at least as many, but no more than {ACTIONS_MAX}'
        )


def sampled(logits: Array32, temperature: float, random: float, rng: np.random.Generator) -> IntArray:
    """Draw actions [B] from logits [B, A] over a temperature, a share of them from all alike."""
    batch, actions = logits.shape
    chosen = (logits + temperature * rng.gumbel(size=logits.shape)).argmax(axis=1)
    return np.where(rng.random(batch) < random, rng.integers(actions, size=batch), chosen)
