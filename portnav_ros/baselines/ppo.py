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
from portnav_ros.training.interrupt import Interrupt
from portnav_ros.training.job import Job
from portnav_ros.training.progress import Progress, preparing
from portnav_ros.training.run_directory import RunDirectory, TrainingError, write_atomically
from portnav_ros.training.scenarios import ScenarioParams, training_source, validation_scenarios
from portnav_ros.training.schedule import ScheduleParams, due
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
        run.sail()
    finally:
        run.close()


class Run:
    """A run under way: environments, agent, validation and files."""

    def __init__(self, params: Params, job: Job) -> None:
        """Begin a run, or go on with the one in the job's folder, which is made once nothing is refused."""
        self._params, self._job = params, job
        if not job.resume:
            RunDirectory(job.out).check_free()
        self._period = params.task.actions.hold
        self._statistics = EpisodeStatistics(params.learner.environments, self._period * DECISION_S)
        with preparing('training worlds') as ready:
            source = training_source(params.scenarios, job.seed, ready)
        self._env = PortVectorEnv(params.learner.environments, seed=job.seed, source=source, task=params.task)
        adapter = PortVecEnv(self._env, params.learner.reward_scale, self._statistics.update)
        self._agent = PpoAgent(params.learner, adapter, job.seed, job.device)
        self._best = {'success': -1.0, 'reward': 0.0}
        if job.resume:
            self._restore()
        with preparing('validation worlds') as ready:
            scenarios = validation_scenarios(params.scenarios, ready)
        self._example = scenarios[0]
        self._validation = Validation(scenarios, params.task)
        if not job.resume:
            config = {'algorithm': 'ppo', 'seed': job.seed, **job.provenance, **dataclasses.asdict(params)}
            self._files = RunDirectory.create(job.out, config)
        self._progress = Progress(params.schedule.steps, self.steps, 'PPO')
        self._logged = self.steps, time.monotonic()

    @property
    def steps(self) -> int:
        """Environment steps so far: decision periods of the world, over all environments."""
        return self._agent.decisions * self._period

    def sail(self) -> None:
        """Learn to the end of the schedule; Ctrl-C ends a run early, after a checkpoint."""
        with Interrupt() as interrupt:
            while self.steps < self._params.schedule.steps and not interrupt.asked:
                before = self.steps
                losses = self._agent.improve()
                self._progress.show(self.steps, self._statistics.summary())
                self._record(before, losses)
        if interrupt.asked:
            self._save()
            self._progress.say(
                f'saved at {self.steps} steps; go on with: portnav train --resume --out {self._job.out}'
            )
            raise KeyboardInterrupt

    def close(self) -> None:
        """Close files and progress bar."""
        self._progress.close()
        self._files.close()

    def _record(self, before: int, losses: Mapping[str, float]) -> None:
        """Log, validate and save where it is time, in this order: a checkpoint covers the lines before it."""
        schedule, after = self._params.schedule, self.steps
        over = after >= schedule.steps
        if over or due(before, after, schedule.log_every):
            self._log(losses)
        if over or due(before, after, schedule.validate_every):
            self._validate()
        if over or due(before, after, schedule.save_every):
            self._save()

    def _log(self, losses: Mapping[str, float]) -> None:
        steps, now_s = self.steps, time.monotonic()
        self._files.log(
            {
                'steps': steps,
                'episodes': self._statistics.episodes,
                'decisions': self._agent.decisions,
                'updates': self._agent.updates,
                **self._statistics.summary(),
                'losses': losses,
                'steps_per_s': (steps - self._logged[0]) / (now_s - self._logged[1]),
            }
        )
        self._logged = steps, now_s

    def _validate(self) -> None:
        """Sail the validation worlds, and keep the model if none was better."""
        layers = policy_layers(self._agent.tensors())
        result = self._validation.run(lambda features: likeliest(layers, features))
        self._files.log({'steps': self.steps, 'validation': result})
        self._progress.say(f'{self.steps} steps: validation success {result["success"]:.1%}')
        if (result['success'], result['reward']) > (self._best['success'], self._best['reward']):
            self._best = {name: result[name] for name in self._best}
            save_model(self._files.best_model, self._agent.tensors(), self._card(result))

    def _card(self, validation: Mapping[str, Any]) -> Card:
        params, job = self._params, self._job
        return Card(
            algorithm='ppo',
            task=params.task,
            vessel=self._example.vessel,
            lidar=self._example.lidar,
            discount=self._agent.discount,
            network={'hidden': params.learner.hidden},
            training={
                **job.provenance,
                'steps': self.steps,
                'seed': job.seed,
                'scenarios': dataclasses.asdict(params.scenarios),
                'autopilot': dataclasses.asdict(self._example.autopilot),
            },
            evaluation={'split': 'validation', **validation},
            git_commit=str(job.provenance.get('git_commit', 'unknown')),
        )

    def _restore(self) -> None:
        state = _read_checkpoint(self._job)
        if state is None:
            self._files = RunDirectory.reopen(self._job.out, -1)
            return
        self._agent.load_state_dict(state['agent'])
        self._best = state['best']
        arrays = _unpack(state['arrays'])
        self._env.load_state_dict(_part(arrays, 'env_'))
        self._statistics.load_state_dict(_part(arrays, 'statistics_'))
        self._files = RunDirectory.reopen(self._job.out, self.steps)

    def _save(self) -> None:
        parts = {'env_': self._env.state_dict(), 'statistics_': self._statistics.state_dict()}
        arrays = {prefix + name: array for prefix, part in parts.items() for name, array in part.items()}
        state = {'agent': self._agent.state_dict(), 'best': self._best, 'arrays': _pack(arrays)}
        content = io.BytesIO()
        torch.save(state, content)
        write_atomically(self._files.checkpoint / CHECKPOINT, content.getvalue())


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
