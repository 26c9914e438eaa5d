"""Self-play: B environments at once, a search for every decision."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from portnav_ros.muzero.inference import NumpyModel
from portnav_ros.muzero.rehearsal import Rehearsal, RehearsalParams
from portnav_ros.muzero.replay import Segment
from portnav_ros.muzero.search import Search, SearchParams
from portnav_ros.muzero.targets import RUNNING, TERMINATED, TRUNCATED
from portnav_ros.muzero.tutor import NOT_TAUGHT, TeachingParams, Tutor
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.sim.world import DECISION_S
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.training.episode_statistics import EpisodeStatistics
from portnav_ros.types import AnyArray, Array32


class Mode(Enum):
    """How decisions are made: under a teacher, after rehearsals, or by a search."""

    TAUGHT = 'taught'
    REHEARSED = 'rehearsed'
    SEARCHED = 'searched'


@dataclass(frozen=True)
class SelfPlayParams:
    """How experience is made.

    environments: B. segment: decisions of each between two exports of the weights. temperature: of the
    first and of the last environment, those between on a geometric ladder.
    """

    environments: int = 25
    segment: int = 40
    temperature: tuple[float, float] = (0.5, 1.5)
    ranges: ClassVar[Ranges] = {'environments': (1, 65_536), 'segment': (1, 10_000)}

    def __post_init__(self) -> None:
        """Refuse empty batches and a ladder that cannot be climbed."""
        check_ranges(self)
        if min(self.temperature) <= 0.0:
            raise ParamError(f'temperature = {self.temperature} must be positive')


class SelfPlay:
    """Environments under way, their search and the statistics of their episodes."""

    def __init__(
        self,
        env: PortVectorEnv,
        params: SelfPlayParams,
        search: SearchParams,
        latent: int,
        seed: np.random.SeedSequence,
        teaching: TeachingParams | None = None,
        rehearsal: RehearsalParams | None = None,
        discount: float = 1.0,
    ) -> None:
        """Begin an episode in every environment; all draws come from the seed. discount: of a decision."""
        self._env = env
        self._length = params.segment
        self._temperature = np.geomspace(*params.temperature, env.num_envs).astype(np.float32)
        self.search = Search(search, env.num_envs, env.task.actions.count, latent)
        words = seed.generate_state(env.num_envs + 1)
        self._rng = np.random.default_rng(words[-1])
        self._features, _ = env.reset(seed=[int(word) for word in words[:-1]])
        self.statistics = EpisodeStatistics(env.num_envs, env.task.actions.hold * DECISION_S)
        self._tutor = Tutor(env, teaching) if teaching and teaching.steps else None
        self._rehearsal = Rehearsal(env, rehearsal, discount) if rehearsal and rehearsal.steps else None
        self._lessons = lesson_size(teaching, rehearsal)

    def play(self, model: NumpyModel, version: int, mode: Mode = Mode.SEARCHED) -> Segment:
        """Sail a segment with a model, that of so many updates."""
        env = self._env
        segment = new_segment(
            self._length, env.num_envs, env.task.observation.size, env.task.actions.count, self._lessons
        )
        segment.version[:] = version
        for t in range(self._length):
            segment.features[t] = self._features
            if mode is Mode.SEARCHED:
                self._plan(model, segment, t)
            else:
                self._be_taught(model, segment, t, mode)
            self._features, reward, terminated, truncated, infos = env.step(segment.action[t])
            segment.reward[t] = reward
            segment.end[t] = np.select([terminated, truncated], [TERMINATED, TRUNCATED], RUNNING)
            if truncated.any():
                segment.final_value[t, truncated] = value_of(model, infos['final_obs'][truncated])
            self.statistics.update(reward, terminated | truncated, infos)
            if mode is Mode.TAUGHT and self._tutor:
                self._tutor.look(terminated | truncated)
        return segment

    def _plan(self, model: NumpyModel, segment: Segment, t: int) -> None:
        found = self.search.run(model, self._features, self._rng, temperature=self._temperature)
        segment.action[t], segment.value[t], segment.policy[t] = found.action, found.value, found.target
        segment.lesson[t] = NOT_TAUGHT

    def _be_taught(self, model: NumpyModel, segment: Segment, t: int, mode: Mode) -> None:
        teacher = self._tutor if mode is Mode.TAUGHT else self._rehearsal
        if teacher is None:
            raise ValueError(f'{mode}: there is nothing of that kind in the parameters')
        taught = teacher.decide(model, self._features, self._rng)
        segment.action[t], segment.value[t] = taught.action, taught.value
        segment.lesson[t], segment.regret[t] = taught.lesson, taught.regret

    def state_dict(self) -> dict[str, AnyArray]:
        """Environments, generators and statistics, for a checkpoint."""
        return {
            'features': self._features,
            'generator': np.array(json.dumps(self._rng.bit_generator.state)),
            **{f'env_{name}': array for name, array in self._env.state_dict().items()},
            **{f'statistics_{name}': array for name, array in self.statistics.state_dict().items()},
            **{f'tutor_{name}': array for name, array in self._foreseen().items()},
        }

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint."""
        self._features = state['features']
        self._rng.bit_generator.state = json.loads(str(state['generator']))
        parts: list[tuple[str, Any]] = [('env_', self._env), ('statistics_', self.statistics)]
        if self._tutor:
            parts.append(('tutor_', self._tutor))
        for prefix, part in parts:
            own = {name.removeprefix(prefix): state[name] for name in state if name.startswith(prefix)}
            part.load_state_dict(own)

    def _foreseen(self) -> dict[str, AnyArray]:
        return self._tutor.state_dict() if self._tutor else {}


def lesson_size(teaching: TeachingParams | None, rehearsal: RehearsalParams | None) -> int:
    """Number of actions that a lesson values; 0 where there are none."""
    return max(part.actions if part and part.steps else 0 for part in (teaching, rehearsal))


def new_segment(length: int, batch: int, features: int, actions: int, lessons: int = 0) -> Segment:
    """Allocate a segment of T decisions of B environments."""
    shape = length, batch
    return Segment(
        features=np.zeros((*shape, features), np.float32),
        action=np.zeros(shape, np.int16),
        reward=np.zeros(shape, np.float32),
        end=np.zeros(shape, np.uint8),
        value=np.zeros(shape, np.float32),
        policy=np.zeros((*shape, actions), np.float32),
        final_value=np.zeros(shape, np.float32),
        version=np.zeros(shape, np.int32),
        lesson=np.full((*shape, lessons), NOT_TAUGHT, np.int8),
        regret=np.zeros((*shape, lessons), np.float16),
    )


def value_of(model: NumpyModel, features: Array32) -> Array32:
    """The network's own value [N] of features [N, F]."""
    return model.predict(model.represent(features))[1]
