"""`portnav train --algorithm ppo`: PPO on the worlds, the task and the budget of MuZero."""

from __future__ import annotations

import dataclasses
import io
import pickle
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch

from portnav_ros.baselines.ppo_agent import PpoAgent, PpoParams
from portnav_ros.baselines.ppo_env import PortVecEnv
from portnav_ros.baselines.ppo_policy import likeliest, policy_layers
from portnav_ros.muzero.model_file import Card, save_model
from portnav_ros.sim.world import DECISION_S
from portnav_ros.task.env import PortVectorEnv, TaskParams
from portnav_ros.training.episode_statistics import EpisodeStatistics
from portnav_ros.training.job import Job
from portnav_ros.training.progress import preparing
from portnav_ros.training.run import TrainingRun
from portnav_ros.training.run_directory import RunDirectory, TrainingError, write_atomically
from portnav_ros.training.scenarios import ScenarioParams, training_source, validation_scenarios
from portnav_ros.training.schedule import ScheduleParams
from portnav_ros.training.validation import Validation
from portnav_ros.types import AnyArray

CHECKPOINT = 'ppo.pt'


@dataclass(frozen=True)
class Params:
    """One training run."""

    task: TaskParams = field(default_factory=TaskParams)
    scenarios: ScenarioParams = field(default_factory=ScenarioParams)
    learner: PpoParams = field(default_factory=PpoParams)
    schedule: ScheduleParams = field(default_factory=ScheduleParams)


def train(params: Params, job: Job) -> None:
    """Learn until the schedule's steps are sailed; the best model by validation is kept.

    A resumed run goes on bit for bit as if it had not been interrupted.

    Raises:
        TrainingError: the folder holds another run, or none to resume.
        ParamError: the parameters do not fit each other.
        ScenarioError: a world cannot be made.
        KeyboardInterrupt: Ctrl-C, after a checkpoint was saved.
    """
    torch.set_num_threads(job.threads)
    run = Run(params, job)
    try:
        run.go_on()
    finally:
        run.close()


class Run(TrainingRun):
    """A run under way: environments, agent, validation and files."""

    algorithm, title = 'ppo', 'PPO'

    def __init__(self, params: Params, job: Job) -> None:
        """Begin a run, or go on with the one in the job's folder, which is made once nothing is refused."""
        super().__init__(job, params.schedule)
        self._params = params
        self._period = params.task.actions.hold
        self._statistics = EpisodeStatistics(params.learner.environments, self._period * DECISION_S)
        with preparing('training worlds') as ready:
            source = training_source(params.scenarios, job.seed, ready)
        self._env = PortVectorEnv(params.learner.environments, seed=job.seed, source=source, task=params.task)
        adapter = PortVecEnv(self._env, params.learner.reward_scale, self._statistics.update)
        self._agent = PpoAgent(params.learner, adapter, job.seed, job.device)
        self._losses: Mapping[str, float] = {}
        if job.resume:
            self._restore()
        with preparing('validation worlds') as ready:
            scenarios = validation_scenarios(params.scenarios, ready)
        self._example = scenarios[0]
        self._validation = Validation(scenarios, params.task)
        self.begin(dataclasses.asdict(params))
        self._logged = self.steps, time.monotonic()

    @property
    def steps(self) -> int:
        """Environment steps so far: decision periods of the world, over all environments."""
        return self._agent.decisions * self._period

    def learn(self) -> None:
        """Sail a rollout in every environment, and improve on it."""
        self._losses = self._agent.improve()

    def summary(self) -> dict[str, float | None]:
        """Success, reward and more of the last episodes."""
        return self._statistics.summary()

    def log(self) -> None:
        """Write a line of metrics."""
        steps, now_s = self.steps, time.monotonic()
        self.files.log(
            {
                'steps': steps,
                'episodes': self._statistics.episodes,
                'decisions': self._agent.decisions,
                'updates': self._agent.updates,
                **self._statistics.summary(),
                'losses': self._losses,
                'steps_per_s': (steps - self._logged[0]) / (now_s - self._logged[1]),
            }
        )
        self._logged = steps, now_s

    def validate(self) -> dict[str, Any]:
        """Sail the validation worlds by the likeliest actions."""
        layers = policy_layers(self._agent.tensors())
        return self._validation.run(lambda features: likeliest(layers, features))

    def keep(self, validation: Mapping[str, Any]) -> None:
        """Write the model."""
        save_model(self.files.best_model, self._agent.tensors(), self._card(validation))

    def _card(self, validation: Mapping[str, Any]) -> Card:
        params = self._params
        return Card(
            algorithm='ppo',
            task=params.task,
            vessel=self._example.vessel,
            lidar=self._example.lidar,
            discount=self._agent.discount,
            network={'hidden': params.learner.hidden},
            training=self.facts(params.scenarios, self._example),
            evaluation={'split': 'validation', **validation},
            git_commit=str(self.job.provenance.get('git_commit', 'unknown')),
        )

    def _restore(self) -> None:
        state = _read_checkpoint(self.job)
        if state is None:
            self.files = RunDirectory.reopen(self.job.out, -1)
            return
        self._agent.load_state_dict(state['agent'])
        self.best = state['best']
        arrays = _unpack(state['arrays'])
        self._env.load_state_dict(_part(arrays, 'env_'))
        self._statistics.load_state_dict(_part(arrays, 'statistics_'))
        self.files = RunDirectory.reopen(self.job.out, self.steps)

    def save(self) -> None:
        """Write a checkpoint."""
        parts = {'env_': self._env.state_dict(), 'statistics_': self._statistics.state_dict()}
        arrays = {prefix + name: array for prefix, part in parts.items() for name, array in part.items()}
        state = {'agent': self._agent.state_dict(), 'best': self.best, 'arrays': _pack(arrays)}
        content = io.BytesIO()
        torch.save(state, content)
        write_atomically(self.files.checkpoint / CHECKPOINT, content.getvalue())


def _pack(arrays: Mapping[str, AnyArray]) -> torch.Tensor:
    """Arrays of any type as bytes, because torch reads tensors only."""
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    return torch.frombuffer(bytearray(content.getvalue()), dtype=torch.uint8)


def _unpack(packed: torch.Tensor) -> dict[str, AnyArray]:
    with np.load(io.BytesIO(packed.numpy().tobytes()), allow_pickle=False) as arrays:
        return dict(arrays)


def _part(arrays: Mapping[str, AnyArray], prefix: str) -> dict[str, AnyArray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _read_checkpoint(job: Job) -> dict[str, Any] | None:
    """What the last checkpoint holds, read without a GPU; None where there is none yet.

    Raises:
        TrainingError: the file is damaged.
    """
    file = RunDirectory(job.out).checkpoint / CHECKPOINT
    if not file.exists():
        return None
    try:
        state: dict[str, Any] = torch.load(file, weights_only=True, map_location='cpu')
    except (RuntimeError, pickle.UnpicklingError) as error:
        raise TrainingError(f'{file}: damaged ({error}); begin a new run with another --out') from error
    return state
