"""Sails many episodes at once on the batched world; a slot whose episode ends takes the next scenario."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog, TargetTrack
from portnav_ros.evaluation.planners import EvaluationError, Privileged
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import World
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.task.policy import Holding, Policy
from portnav_ros.types import Array, BoolArray, Outcome


def sail(
    make_policy: Callable[[Scenario], Policy], scenarios: Iterable[Scenario], batch: int
) -> Iterator[EpisodeLog]:
    """Yield the log of each scenario as its episode ends; no log depends on batch or order.

    Args:
        make_policy: builds the local planner, given the first scenario; called once.
        scenarios: taken one by one as slots become free; all share vessel, autopilot and lidar.
        batch: slots B.

    Raises:
        EvaluationError: batch is below 1, or a scenario has no path.
    """
    if batch < 1:
        raise EvaluationError(f'batch = {batch} must be at least 1')
    waiting = iter(scenarios)
    first = list(itertools.islice(waiting, batch))
    if first:
        yield from _Fleet(make_policy(first[0]), first).sail(waiting)


class _Fleet:
    """B slots, each with an episode under way or at rest."""

    def __init__(self, policy: Policy, scenarios: list[Scenario]) -> None:
        batch = len(scenarios)
        self._policy = policy
        self._world = World(scenarios)
        self._observer = Observer(batch, self._world.lidar, ObservationParams())
        self._recordings = [_Recording(scenario) for scenario in scenarios]
        self._active = np.ones(batch, dtype=bool)
        self._begin(self._active)

    def sail(self, waiting: Iterator[Scenario]) -> Iterator[EpisodeLog]:
        world = self._world
        while self._active.any():
            setpoints, decided, latency_s = self._decide()
            for b in _slots(self._active):
                self._recordings[b].note(world, b, setpoints[b])
            for b in _slots(self._active & decided):
                self._recordings[b].latency_s.append(latency_s)
            world.step(setpoints)
            ended = self._active & (world.outcome != Outcome.RUNNING)
            for b in _slots(ended):
                self._recordings[b].note(world, b, setpoints[b])
                yield self._recordings[b].log(world, b)
            self._refill(ended, waiting)

    def _decide(self) -> tuple[Array, BoolArray, float]:
        """Setpoints [B, 2]; who has decided [B], not held what it had; and the time of each decision in s."""
        world = self._world
        observation = self._observer.update(world.own, world.ranges, world.setpoint)
        start = time.perf_counter()
        setpoints = self._policy.act(observation)
        spent_s = time.perf_counter() - start
        decided = self._policy.decided if isinstance(self._policy, Holding) else np.ones_like(self._active)
        return setpoints, decided, spent_s / max(int(decided.sum()), 1)

    def _refill(self, ended: BoolArray, waiting: Iterator[Scenario]) -> None:
        fresh = np.zeros_like(ended)
        for b, scenario in zip(_slots(ended), waiting, strict=False):
            self._world.reset(b, scenario)
            self._recordings[b] = _Recording(scenario)
            fresh[b] = True
        self._active = (self._active & ~ended) | fresh
        if fresh.any():
            self._begin(fresh)

    def _begin(self, which: BoolArray) -> None:
        chosen = [self._recordings[b].scenario for b in _slots(which)]
        self._observer.reset(which, [path_of(scenario) for scenario in chosen])
        self._policy.reset(which)
        if isinstance(self._policy, Privileged):
            for b, scenario in zip(_slots(which), chosen, strict=True):
                self._policy.prepare(b, scenario)


class _Recording:
    """Rows of one episode under way."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.latency_s: list[float] = []
        self._rows: list[Array] = []
        self._vessels: list[Array] = []

    def note(self, world: World, b: int, setpoint: Array) -> None:
        """Append what is true in slot b of the world."""
        nearest = np.nanmin(world.ranges[b], initial=np.inf)
        row = (world.time_s[b], *world.own[b], *setpoint, *world.command[b], nearest, *world.clearance[b])
        self._rows.append(np.array(row))
        self._vessels.append(world.vessels[b, : len(self.scenario.traffic)].copy())

    def log(self, world: World, b: int) -> EpisodeLog:
        """Close the episode of slot b."""
        scenario, rows = self.scenario, np.array(self._rows)
        time_s = rows[:, 0]
        return EpisodeLog(
            time_s=time_s,
            own=rows[:, 1:8],
            setpoint=rows[:, 8:10],
            command=rows[:, 10:12],
            range_min=rows[:, 12],
            clearance=rows[:, 13:16],
            path=path_of(scenario),
            harbour=scenario.harbour,
            goal=scenario.goal,
            goal_radius_m=scenario.goal_radius_m,
            outcome=Outcome(int(world.outcome[b])),
            vessel=scenario.vessel,
            targets=_tracks(time_s, np.array(self._vessels), scenario.traffic.hull),
            latency_s=np.array(self.latency_s),
            scenario=scenario.name,
            seed=scenario.seed,
        )


def _slots(which: BoolArray) -> list[int]:
    return [int(b) for b in np.flatnonzero(which)]


def path_of(scenario: Scenario) -> Array:
    """Return the scenario's path [W, 2].

    Raises:
        EvaluationError: it has none yet.
    """
    if scenario.path is None:
        raise EvaluationError(f'{scenario.name}: seed {scenario.seed} has no path to follow')
    return scenario.path


def _tracks(time_s: Array, poses: Array, hulls: Array) -> tuple[TargetTrack, ...]:
    """Tracks of the vessels in poses [T, M, 4]; rows where a vessel is gone are left out."""
    tracks = []
    for m, (length_m, beam_m) in enumerate(hulls):
        there = np.isfinite(poses[:, m, 0])
        tracks.append(TargetTrack(str(m), time_s[there], poses[there, m], float(length_m), float(beam_m)))
    return tuple(tracks)
