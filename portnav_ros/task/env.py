"""Gymnasium environments: one vessel, or B vessels at once on the batched world.

Importing this module registers ``portnav_ros/Port-v0``::

    import gymnasium
    import portnav_ros.task.env

    env = gymnasium.make('portnav_ros/Port-v0', difficulty='harbour')
    envs = gymnasium.make_vec('portnav_ros/Port-v0', num_envs=256, difficulty='harbour')

An episode that reaches its goal or collides is terminated; one that runs out of time is truncated.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from portnav_ros.params import ParamError
from portnav_ros.sim.generator import ScenarioPool, load_difficulty
from portnav_ros.sim.scenario import Scenario, ScenarioError
from portnav_ros.sim.world import World
from portnav_ros.task.actions import setpoints_of
from portnav_ros.task.observation import Observer
from portnav_ros.task.params import TaskParams
from portnav_ros.task.policy import Observation
from portnav_ros.task.reward import TERMS, reward_terms
from portnav_ros.types import AnyArray, Array, Array32, BoolArray, IntArray, Outcome

__all__ = ['PortEnv', 'PortVectorEnv', 'ScenarioSource', 'TaskParams']

ScenarioSource = Callable[[np.random.Generator], Scenario]


class PortVectorEnv(VectorEnv[Array32, IntArray, Any]):
    """B ports at once. An ended episode is followed by a new one in the same step.

    Observations [B, F] float32 are scaled to about 1; actions [B] number the 27 setpoints. ``infos``
    holds ``outcome`` [B] (types.Outcome), ``errors`` [B, 3] (m, m, rad), ``reward_terms`` [B, 5], and
    where an episode has ended ``final_obs`` [B, F] and ``final_info``, these three with the masks [B] of
    whom they are final for, ``_final_obs`` and ``_final_info`` [B].
    """

    def __init__(
        self,
        num_envs: int = 1,
        difficulty: str = 'harbour',
        ports: int = 16,
        seed: int = 0,
        route: Literal['clearance', 'rrt_star'] = 'clearance',
        source: ScenarioSource | None = None,
        task: TaskParams | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
    ) -> None:
        """Prepare the ports.

        Args:
            num_envs: B.
            difficulty: name or file, unless a source is given.
            ports: how many ports the pool holds.
            seed: of the pool.
            route: how the pool's global paths are laid; RRT* takes 0.3 s a path, ten to a port.
            source: draws scenarios in place of the pool; all must share vessel and sensor.
            task: observation, actions and reward.
            autoreset_mode: SAME_STEP, or DISABLED, where an ended vessel stands still until
                ``reset(options={'reset_mask': ...})``; or the value of one of them.

        Raises:
            ParamError: another mode.
            ScenarioError: a scenario cannot be made.
        """
        self.metadata = {'autoreset_mode': _autoreset(autoreset_mode), 'render_modes': []}
        self.num_envs = num_envs
        self.task = task or TaskParams()
        self._table = self.task.actions.table()
        self._source = source or _pool(difficulty, ports, seed, route).draw
        self._generators = [np.random.default_rng((seed, b)) for b in range(num_envs)]
        self._world = World([self._draw(b)[0] for b in range(num_envs)])
        self._observer = Observer(num_envs, self._world.lidar, self.task.observation)
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (self.task.observation.size,), np.float32)
        self.single_action_space = spaces.Discrete(self.task.actions.count)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def world(self) -> World:
        """The simulation, to look at."""
        return self._world

    @property
    def source(self) -> ScenarioSource:
        """What draws the scenarios."""
        return self._source

    @property
    def observation(self) -> Observation:
        """What was seen last, beyond its features."""
        return self._observer.observation(self._world.own, self._world.ranges)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, dict[str, Any]]:
        """Start new episodes, all B or those of ``options['reset_mask']`` [B].

        Slot b is seeded with ``seed + b``, or by its entry of a list; without, it draws on.

        Raises:
            ParamError: the mask is not B booleans.
            gymnasium.error.ResetNeeded: the mask leaves out a vessel that has never been reset.
        """
        which = self._mask((options or {}).get('reset_mask'))
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + b for b in range(self.num_envs)]
        for b, value in enumerate(() if seed is None else seed):
            if value is not None:
                self._generators[b] = np.random.default_rng(value)
        return self._begin(which).copy(), self._info()

    def step(self, actions: IntArray) -> tuple[Array32, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Sail B vessels for one action: a decision period, or as many as an action is held for.

        Rewards are summed over them.

        Raises:
            gymnasium.error.InvalidAction: an action is not in the action space.
            gymnasium.error.ResetNeeded: nothing has begun yet, by `reset`, `copy` or `load_state_dict`.
        """
        if not self._observer.begun.any():
            raise gymnasium.error.ResetNeeded('call reset() before step()')
        features, terms = self._sail(self._checked(actions))
        outcome = self._world.outcome.copy()
        infos = self._info(terms)
        truncated = outcome == Outcome.TIMEOUT
        terminated = (outcome != Outcome.RUNNING) & ~truncated
        ended = terminated | truncated
        if ended.any() and self.metadata['autoreset_mode'] is AutoresetMode.SAME_STEP:
            infos |= _final(features, infos, ended)
            features = self._begin(ended)
        return features.copy(), terms.sum(axis=1), terminated, truncated, infos

    def copy(self, other: PortVectorEnv, rows: IntArray) -> None:
        """Make the first N environments what those of `rows` [N] are now in another one, made alike.

        The random generators stay, which draw later scenarios.
        """
        self._world.copy(other._world, rows)
        self._observer.copy(other._observer, rows)

    def state_dict(self) -> dict[str, AnyArray]:
        """World, observer and random generators as arrays by name, for a checkpoint."""
        generators = [generator.bit_generator.state for generator in self._generators]
        return {
            **{f'world_{name}': array for name, array in self._world.state_dict().items()},
            **{f'observer_{name}': array for name, array in self._observer.state_dict().items()},
            'generators': np.array(json.dumps(generators)),
        }

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint of an environment that was made alike."""
        for prefix, part in (('world_', self._world), ('observer_', self._observer)):
            own = {name.removeprefix(prefix): state[name] for name in state if name.startswith(prefix)}
            part.load_state_dict(own)
        saved = json.loads(str(state['generators']))
        for generator, value in zip(self._generators, saved, strict=True):
            generator.bit_generator.state = value

    def _mask(self, mask: Any) -> BoolArray:
        """Whom to reset [B], everyone by default."""
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        which: BoolArray = np.asarray(mask)
        if which.dtype != bool or which.shape != (self.num_envs,):
            raise ParamError(
                f'reset_mask of type {which.dtype} and shape {which.shape} must be of type bool '
                f'and shape ({self.num_envs},), true for whom to reset'
            )
        if not (which | self._observer.begun).all():
            raise gymnasium.error.ResetNeeded('call reset() without reset_mask first, for all vessels')
        return which

    def _checked(self, actions: Any) -> IntArray:
        numbers = np.asarray(actions)
        whole = np.issubdtype(numbers.dtype, np.integer) and numbers.shape == (self.num_envs,)
        if not whole or (numbers < 0).any() or (numbers >= len(self._table)).any():
            raise gymnasium.error.InvalidAction(
                f'{actions!r}: expected {self.num_envs} integers from 0 to {len(self._table) - 1}'
            )
        return numbers

    def _sail(self, actions: IntArray) -> tuple[Array32, Array]:
        """Hold the setpoints for the decision periods of an action; return features and summed terms."""
        world, params = self._world, self.task.actions
        reference = params.reference_rad(world.own, self._observer.errors)
        setpoints = setpoints_of(actions, reference, self._table)
        total = np.zeros((self.num_envs, len(TERMS)))
        started = world.outcome == Outcome.RUNNING
        for period in range(1, params.hold + 1):
            running = world.outcome == Outcome.RUNNING
            world.step(setpoints)
            last = period == params.hold
            features = self.observe(started if last else running, deciding=last)
            terms = reward_terms(self.task.reward, self._observer.errors, world.outcome)
            total[running] += terms[running]
        return features, total

    def _draw(self, b: int) -> tuple[Scenario, Array]:
        scenario = self._source(self._generators[b])
        if scenario.path is None:
            raise ScenarioError(f'{scenario.name}: the environment needs scenarios that hold a path')
        return scenario, scenario.path

    def _begin(self, which: BoolArray) -> Array32:
        paths = []
        for b in np.flatnonzero(which):
            scenario, path = self._draw(int(b))
            self._world.reset(int(b), scenario)
            paths.append(path)
        self._observer.reset(which, paths)
        return self.observe(which)

    def observe(self, which: BoolArray | None = None, deciding: bool = True) -> Array32:
        """Take in one more frame for the vessels `which` [B] (all by default); return [B, F]."""
        world = self._world
        return self._observer.update(world.own, world.ranges, world.setpoint, which, deciding).features

    def _info(self, terms: Array | None = None) -> dict[str, Any]:
        if terms is None:
            terms = np.zeros((self.num_envs, len(TERMS)))
        return {
            'outcome': self._world.outcome.copy(),
            'errors': self._observer.errors.copy(),
            'reward_terms': terms,
        }


def _final(features: Array32, infos: dict[str, Any], ended: BoolArray) -> dict[str, Any]:
    """What Gymnasium asks for of the episodes that have `ended` [B] and are followed in the same step."""
    masks = {f'_{key}': ended for key in infos}
    return {
        'final_obs': features.copy(),
        '_final_obs': ended,
        'final_info': {**infos, **masks},
        '_final_info': ended,
    }


def _autoreset(mode: AutoresetMode | str) -> AutoresetMode:
    for known in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
        if mode in (known, known.value):
            return known
    raise ParamError(f'autoreset_mode = {mode!r} must be AutoresetMode.SAME_STEP or AutoresetMode.DISABLED')


def _pool(difficulty: str, ports: int, seed: int, route: Literal['clearance', 'rrt_star']) -> ScenarioPool:
    return ScenarioPool(dataclasses.replace(load_difficulty(difficulty), route=route), ports, seed)


class PortEnv(gymnasium.Env[Array32, int]):
    """One vessel in one port: `PortVectorEnv` with B = 1 and without automatic reset."""

    metadata: dict[str, Any] = {'render_modes': []}  # noqa: RUF012 - declared so by Gymnasium

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Prepare the ports; takes the options of `PortVectorEnv` but num_envs."""
        self.render_mode = render_mode
        self._batch = PortVectorEnv(1, autoreset_mode=AutoresetMode.DISABLED, **options)
        self._seeded = False
        self.observation_space = self._batch.single_observation_space
        self.action_space = self._batch.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, dict[str, Any]]:
        """Start a new episode; the first without a seed is seeded at random, later ones draw on."""
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(2**32))
        self._seeded = True
        features, info = self._batch.reset(seed=seed)
        return features[0], _first(info)

    def step(self, action: int) -> tuple[Array32, float, bool, bool, dict[str, Any]]:
        """Sail for one action.

        Raises:
            gymnasium.error.InvalidAction: the action is not in the action space.
            gymnasium.error.ResetNeeded: there was no reset yet.
        """
        features, reward, terminated, truncated, info = self._batch.step(np.array([action]))
        return features[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)


def _first(info: dict[str, Any]) -> dict[str, Any]:
    return {key: value[0] for key, value in info.items()}


gymnasium.register(
    id='portnav_ros/Port-v0',
    entry_point='portnav_ros.task.env:PortEnv',
    vector_entry_point='portnav_ros.task.env:PortVectorEnv',
)
