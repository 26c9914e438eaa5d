"""`portnav train --algorithm muzero`: a training loop with its files, progress bar and validation."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from portnav_ros.muzero import ModelError
from portnav_ros.muzero.checkpoint import Checkpoints, refusing
from portnav_ros.muzero.inference import likeliest
from portnav_ros.muzero.learner import limit_threads
from portnav_ros.muzero.loop import Loop, Params
from portnav_ros.muzero.model_file import Card, Model, load_model, save_model
from portnav_ros.muzero.search import Search
from portnav_ros.training.job import Job
from portnav_ros.training.progress import preparing
from portnav_ros.training.run import TrainingRun
from portnav_ros.training.run_directory import RunDirectory, TrainingError
from portnav_ros.training.scenarios import validation_scenarios
from portnav_ros.training.validation import Validation
from portnav_ros.types import Array32, IntArray

__all__ = ['Params', 'train']

VALIDATION_BATCH = 100


def train(params: Params, job: Job) -> None:
    """Learn until the schedule's steps are sailed; the best model by validation is kept.

    Raises:
        TrainingError: the folder holds another run, or none to resume, or a rehearsal has no policy.
        ParamError: the parameters do not fit each other.
        ScenarioError: a world cannot be made.
        KeyboardInterrupt: Ctrl-C, after a checkpoint was saved.
    """
    limit_threads(job.threads)
    _warn_of_search(params, job.resume)
    run = Run(params, job)
    try:
        run.go_on()
    finally:
        run.close()


class Run(TrainingRun):
    """A loop with its files, progress bar and validation."""

    algorithm, title = 'muzero', 'MuZero'

    def __init__(self, params: Params, job: Job) -> None:
        """Begin a run, or go on with the one in the job's folder, which is made once nothing is refused."""
        if not job.resume:
            _check_rehearsal(params)
        super().__init__(job, params.schedule)
        self.params = params
        origin = _origin(params)
        with preparing('training worlds') as ready:
            self.loop = Loop(params, job.seed, job.device, ready)
        self.checkpoints = Checkpoints(self.files.checkpoint)
        self.origin = self._start(origin)
        if job.resume:
            self._restore()
        with preparing('validation worlds') as ready:
            scenarios = validation_scenarios(params.scenarios, ready)
        self.example = scenarios[0]
        self.validation = Validation(scenarios, params.task, VALIDATION_BATCH)
        batch = min(VALIDATION_BATCH, len(scenarios))
        count, latent = params.task.actions.count, params.network.latent
        self.search = Search(params.search.quiet(), batch, count, latent)
        self.begin(dataclasses.asdict(params))
        self.logged = self.loop.steps, time.perf_counter(), dict(self.loop.busy_s)

    @property
    def steps(self) -> int:
        """Environment steps so far."""
        return self.loop.steps

    def go_on(self) -> None:
        """Learn to the end of the schedule, with a thread beside."""
        with ThreadPoolExecutor(1) as self.worker:
            super().go_on()

    def learn(self) -> None:
        """Play a segment, and learn from what was played before."""
        self.loop.iterate(self.worker)

    def summary(self) -> dict[str, float | None]:
        """Success, reward and more of the last episodes."""
        return self.loop.selfplay.statistics.summary()

    def log(self) -> None:
        """Write a line of metrics."""
        loop, steps, now_s = self.loop, self.loop.steps, time.perf_counter()
        wall_s = now_s - self.logged[1]
        shares = {name: (busy - self.logged[2][name]) / wall_s for name, busy in loop.busy_s.items()}
        self.files.log(
            {
                'steps': steps,
                'episodes': loop.selfplay.statistics.episodes,
                'decisions': loop.replay.written * loop.replay.batch,
                'updates': loop.learner.updates,
                **loop.selfplay.statistics.summary(),
                'losses': loop.means.take(),
                'samples_per_step': loop.learner.updates * self.params.learner.batch / steps,
                'replay': len(loop.replay),
                'steps_per_s': (steps - self.logged[0]) / wall_s,
                'time_share': shares,
            }
        )
        self.logged = steps, now_s, dict(loop.busy_s)

    def validate(self) -> dict[str, Any]:
        """Sail the validation worlds by the best action of each search, and again by the policy alone."""
        rng, model = np.random.default_rng(0), self.loop.export_mean()

        def plan(features: Array32) -> IntArray:
            return self.search.run(model, features, rng, temperature=0.0).action

        result = self.validation.run(plan)
        if self.params.validate_prior:
            prior = self.validation.run(lambda features: likeliest(model, features))
            result['prior'] = {name: prior[name] for name in ('success', 'interval', 'reward')}
        return result

    def keep(self, validation: Mapping[str, Any]) -> None:
        """Write the model."""
        save_model(self.files.best_model, self.loop.learner.mean_arrays(), self.card(validation))

    def card(self, validation: Mapping[str, Any]) -> Card:
        """What the model is."""
        params = self.params
        return Card(
            algorithm='muzero',
            task=params.task,
            vessel=self.example.vessel,
            lidar=self.example.lidar,
            discount=params.discount,
            network=dataclasses.asdict(params.network),
            search=dataclasses.asdict(params.search),
            training={**self.facts(params.scenarios, self.example), **self.origin},
            evaluation={'split': 'validation', **validation},
            git_commit=str(self.job.provenance.get('git_commit', 'unknown')),
        )

    def save(self) -> None:
        """Write a checkpoint."""
        saved = self.loop.state()
        counters = {**saved.counters, 'best': self.best}
        self.checkpoints.save(str(self.loop.steps), saved._replace(counters=counters), self.loop.replay)

    def _start(self, model: Model | None) -> dict[str, Any]:
        """Begin with the weights of another model where there is one; tells of it for the card."""
        if model is None:
            return {}
        try:
            self.loop.start_from(model.tensors)
        except ValueError as error:
            raise ModelError(f'{model.path}: {error}; it has network: {dict(model.card.network)}') from error
        return {'start_from': {'sha256': model.sha256, **model.card.training}}

    def _restore(self) -> None:
        saved = self.checkpoints.load(self.loop.replay, self.loop.learner.device)
        self.files = RunDirectory.reopen(self.job.out, saved.counters['steps'] if saved else -1)
        if saved is not None:
            with refusing(RunDirectory(self.job.out).checkpoint):
                self.loop.restore(saved)
            self.best = saved.counters['best']


def _warn_of_search(params: Params, resumed: bool) -> None:
    """Say that a run goes over to search, as one does whose --steps go beyond its lessons."""
    end, steps = params.lessons_end, params.schedule.steps
    if not 0 < end < steps:
        return
    key = 'rehearsal.steps' if params.rehearsal.steps else 'teaching.steps'
    last = params.rehearsal.steps or params.teaching.steps
    warnings.warn(
        f'{key}: lessons end at step {end} of {steps}, and from there on a search decides; to go on with '
        f'them to the end{", begin a new run with" if resumed else ":"} --set {key}={last + steps - end}',
        stacklevel=2,
    )


def _check_rehearsal(params: Params) -> None:
    """Refuse to rehearse with a policy that has learned nothing.

    Raises:
        TrainingError: nobody has taught it, and it begins with the weights of no model.
    """
    if params.rehearsal.steps and not params.teaching.steps and not params.start_from:
        raise TrainingError(
            f'rehearsal.steps = {params.rehearsal.steps} goes on from a policy, and there is none: name its '
            'model with --from FILE; `portnav train --preset best` trains one'
        )


def _origin(params: Params) -> Model | None:
    """The model to begin with."""
    if not params.start_from:
        return None
    model = load_model(Path(params.start_from))
    theirs, ours = model.card.task, params.task
    if (theirs.observation, theirs.actions) != (ours.observation, ours.actions):
        raise ModelError(f'{model.path}: was trained for other observations or actions than task.* asks for')
    return model
