"""What a training run does beside learning: lines of metrics, validations, the best model, checkpoints."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from portnav_ros.sim.scenario import Scenario
from portnav_ros.training.interrupt import Interrupt
from portnav_ros.training.job import Job
from portnav_ros.training.progress import Progress
from portnav_ros.training.run_directory import RunDirectory
from portnav_ros.training.scenarios import ScenarioParams
from portnav_ros.training.schedule import ScheduleParams, due


class TrainingRun(ABC):
    """Learns to the end of a schedule; a subclass says how, and what there is to write.

    A subclass calls `begin` once nothing is refused any more, and sets `files` itself where it resumes.
    """

    algorithm: ClassVar[str]
    title: ClassVar[str]

    def __init__(self, job: Job, schedule: ScheduleParams) -> None:
        """Refuse a folder that holds a run already, or, to be resumed, none.

        Raises:
            TrainingError: says which.
        """
        self.job, self.schedule = job, schedule
        self.files = RunDirectory(job.out)
        begun = self.files.read_config() if job.resume else job.provenance
        self._command = {'command': begun['command']} if 'command' in begun else {}
        if not job.resume:
            self.files.check_free()
        self.best = {'success': -1.0, 'reward': 0.0}

    def begin(self, params: Mapping[str, Any]) -> None:
        """Make the folder of a new run, and show the bar."""
        if not self.job.resume:
            config = {'algorithm': self.algorithm, 'seed': self.job.seed, **self.job.provenance, **params}
            self.files = RunDirectory.create(self.job.out, config)
        self.progress = Progress(self.schedule.steps, self.steps, self.title)

    @property
    @abstractmethod
    def steps(self) -> int:
        """Environment steps so far."""

    @abstractmethod
    def learn(self) -> None:
        """Sail and learn a little."""

    @abstractmethod
    def summary(self) -> dict[str, float | None]:
        """Success, reward and more of the last episodes."""

    @abstractmethod
    def log(self) -> None:
        """Write a line of metrics."""

    @abstractmethod
    def validate(self) -> dict[str, Any]:
        """Sail the validation worlds by the best actions; returns success, reward and more."""

    @abstractmethod
    def keep(self, validation: Mapping[str, Any]) -> None:
        """Write the model, which no validation has shown to be worse than another."""

    @abstractmethod
    def save(self) -> None:
        """Write a checkpoint."""

    def go_on(self) -> None:
        """Learn to the end of the schedule.

        Raises:
            KeyboardInterrupt: Ctrl-C, after a checkpoint was saved.
        """
        with Interrupt() as interrupt:
            while self.steps < self.schedule.steps and not interrupt.asked:
                before = self.steps
                self.learn()
                self.progress.show(self.steps, self.summary())
                self._record(before)
        if interrupt.asked:
            self.save()
            self.progress.say(
                f'saved at {self.steps} steps; go on with: portnav train --resume --out {self.job.out}'
            )
            raise KeyboardInterrupt

    def close(self) -> None:
        """Close files and progress bar."""
        self.progress.close()
        self.files.close()

    def facts(self, scenarios: ScenarioParams, example: Scenario) -> dict[str, Any]:
        """What a model's card tells of the run, from its worlds and one scenario of them.

        The command is that by which it was begun, not the one by which it was resumed.
        """
        return {
            **self.job.provenance,
            **self._command,
            'steps': self.steps,
            'seed': self.job.seed,
            'scenarios': dataclasses.asdict(scenarios),
            'autopilot': dataclasses.asdict(example.autopilot),
        }

    def _record(self, before: int) -> None:
        """Log, validate and save where it is time, in this order: a checkpoint covers the lines before it."""
        schedule, after = self.schedule, self.steps
        over = after >= schedule.steps
        if over or due(before, after, schedule.log_every):
            self.log()
        if over or due(before, after, schedule.validate_every):
            self._judge(self.validate())
        if over or due(before, after, schedule.save_every):
            self.save()

    def _judge(self, validation: Mapping[str, Any]) -> None:
        self.files.log({'steps': self.steps, 'validation': validation})
        self.progress.say(f'{self.steps} steps: validation success {validation["success"]:.1%}')
        if (validation['success'], validation['reward']) > (self.best['success'], self.best['reward']):
            self.best = {name: validation[name] for name in self.best}
            self.keep(validation)
