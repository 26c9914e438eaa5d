"""The training loop of MuZero without files: self-play, replay and learner.

An iteration plays a segment with the weights of the iteration before, in a thread of its own, while the
learner trains on what was played until then. They share nothing but those weights, so the result does
not depend on which of them is quicker, and a checkpoint between two iterations is the whole state.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import torch

from portnav_ros.muzero.checkpoint import Saved
from portnav_ros.muzero.inference import NumpyModel, numpy_model
from portnav_ros.muzero.learner import Learner, LearnerParams
from portnav_ros.muzero.networks import Network, NetworkParams
from portnav_ros.muzero.rehearsal import RehearsalParams
from portnav_ros.muzero.replay import Replay, ReplayParams, Sample, Segment, half_mirrored
from portnav_ros.muzero.search import SearchParams
from portnav_ros.muzero.selfplay import Mode, SelfPlay, SelfPlayParams, lesson_size
from portnav_ros.muzero.targets import TargetParams
from portnav_ros.muzero.tutor import TeachingParams
from portnav_ros.params import ParamError
from portnav_ros.task.env import PortVectorEnv, TaskParams
from portnav_ros.task.mirror import mirror_of
from portnav_ros.training.running_means import RunningMeans
from portnav_ros.training.scenarios import Ready, ScenarioParams, training_source
from portnav_ros.training.schedule import ScheduleParams
from portnav_ros.types import Array32


@dataclass(frozen=True)
class Params:
    """One training run; the presets in config/train/ override these defaults.

    mirror: whether half of every sample is seen with port and starboard exchanged.
    validate_prior: whether a validation also sails with the policy network alone, which the search has to
    beat. start_from: a model whose weights the run begins with; at random by default.
    """

    task: TaskParams = field(default_factory=TaskParams)
    scenarios: ScenarioParams = field(default_factory=ScenarioParams)
    network: NetworkParams = field(default_factory=NetworkParams)
    search: SearchParams = field(default_factory=SearchParams)
    selfplay: SelfPlayParams = field(default_factory=SelfPlayParams)
    replay: ReplayParams = field(default_factory=ReplayParams)
    targets: TargetParams = field(default_factory=TargetParams)
    learner: LearnerParams = field(default_factory=LearnerParams)
    schedule: ScheduleParams = field(default_factory=ScheduleParams)
    teaching: TeachingParams = field(default_factory=TeachingParams)
    rehearsal: RehearsalParams = field(default_factory=RehearsalParams)
    mirror: bool = False
    validate_prior: bool = True
    start_from: str = ''

    def __post_init__(self) -> None:
        """Refuse parts that do not fit each other."""
        self._check_lessons()
        self._check_replay()
        self._check_networks()

    def _check_lessons(self) -> None:
        """Refuse lessons of two sizes."""
        teaching, rehearsal = self.teaching, self.rehearsal
        if teaching.steps and rehearsal.steps and teaching.actions != rehearsal.actions:
            raise ParamError(
                f'teaching.actions = {teaching.actions}, rehearsal.actions = {rehearsal.actions}: '
                'a run that does both needs them equal'
            )

    def _check_replay(self) -> None:
        """Refuse a replay in which there is never enough for an update."""
        batch = self.selfplay.environments
        kept = self.replay.rows(batch) * batch
        if kept < self.least_held:
            raise ParamError(
                f'replay.capacity = {self.replay.capacity}: {batch} environments keep {kept} decisions, '
                f'but with replay.warmup and learner.unroll an update needs {self.least_held}; raise it'
            )

    def _check_networks(self) -> None:
        """Refuse networks that look for what the observation does not hold."""
        seen, network = self.task.observation, self.network
        if network.tracks not in (0, seen.tracks):
            raise ParamError(
                f'network.tracks = {network.tracks}, but task.observation.tracks = {seen.tracks}: '
                'the networks look at all of them, or with 0 at none in particular'
            )
        if network.scan_channels and seen.layout != 'aligned':
            raise ParamError(
                f'network.scan_channels = {network.scan_channels}: convolutions need '
                f'task.observation.layout = aligned, not {seen.layout}; [] is none'
            )
        scans = len(seen.ages), seen.sectors
        if network.scan_channels and network.scan_shape != scans:
            raise ParamError(
                f'network.scan_shape = {network.scan_shape}, but the observation has {scans}: '
                'the numbers of task.observation.ages and of its sectors'
            )

    @property
    def least_held(self) -> int:
        """Decisions, of all environments together, that the replay holds before the first update."""
        return max(self.replay.warmup, (self.learner.unroll + 1) * self.selfplay.environments)

    @property
    def lessons_end(self) -> int:
        """Environment steps that are taught or rehearsed, after which a search decides."""
        return self.teaching.steps + self.rehearsal.steps

    @property
    def discount(self) -> float:
        """Discount of one decision."""
        return float(self.targets.discount**self.task.actions.hold)


class Loop:
    """Self-play, replay and learner of one run."""

    def __init__(self, params: Params, seed: int, device: str = 'cpu', ready: Ready | None = None) -> None:
        """Build everything from the seed; `ready` is told of the worlds that are made."""
        self.params = params
        streams = np.random.SeedSequence(seed).spawn(3)
        self.rng = np.random.default_rng(streams[0])
        torch.manual_seed(int(streams[1].generate_state(1)[0]))
        task, batch = params.task, params.selfplay.environments
        actions = task.actions
        network = Network(
            task.observation.size, len(actions.heading_change_rad), len(actions.speed_mps), params.network
        )
        self.learner = Learner(network, params.learner, device)
        lessons = lesson_size(params.teaching, params.rehearsal)
        self.replay = Replay(params.replay, batch, task.observation.size, actions.count, lessons)
        source = training_source(params.scenarios, seed, ready)
        env = PortVectorEnv(batch, seed=seed, source=source, task=task)
        self.selfplay = SelfPlay(
            env,
            params.selfplay,
            params.search,
            params.network.latent,
            streams[2],
            params.teaching,
            params.rehearsal,
            params.discount,
        )
        self.model = self.export()
        self.mirror = mirror_of(task.observation, actions) if params.mirror else None
        self.means = RunningMeans()
        self.busy_s = {'selfplay': 0.0, 'learner': 0.0}

    @property
    def steps(self) -> int:
        """Environment steps so far: seconds sailed, over all environments."""
        return self.replay.written * self.replay.batch * self.params.task.actions.hold

    @property
    def mode(self) -> Mode:
        """How the next decisions are made."""
        if self.steps < self.params.teaching.steps:
            return Mode.TAUGHT
        return Mode.REHEARSED if self.steps < self.params.lessons_end else Mode.SEARCHED

    def start_from(self, arrays: Mapping[str, Array32]) -> None:
        """Begin with the weights of a model.

        Raises:
            ValueError: they are those of other networks.
        """
        self.learner.load_arrays(arrays)
        self.model = self.export()

    def export(self) -> NumpyModel:
        """The networks as they stand, for self-play."""
        return self._model(self.learner.arrays())

    def export_mean(self) -> NumpyModel:
        """The networks that a model file would hold, for validations."""
        return self._model(self.learner.mean_arrays())

    def _model(self, arrays: Mapping[str, Array32]) -> NumpyModel:
        return numpy_model(arrays, len(self.params.task.actions.speed_mps), self.params.discount)

    def iterate(self, worker: ThreadPoolExecutor) -> None:
        """Play a segment and learn from those before it."""
        self.learner.set_progress(self.steps / self.params.schedule.steps)
        playing = worker.submit(self.play, self.model, self.learner.updates)
        self.learn()
        self.replay.append(playing.result())
        self.model = self.export()

    def play(self, model: NumpyModel, version: int) -> Segment:
        """Play a segment, and note the time that it took."""
        start = time.perf_counter()
        segment = self.selfplay.play(model, version, self.mode)
        self.busy_s['selfplay'] += time.perf_counter() - start
        return segment

    def learn(self) -> None:
        """Take the updates that are due, no more and no fewer than the replay's rate allows."""
        start = time.perf_counter()
        worth = self.steps >= self.params.teaching.worth_after * self.params.schedule.steps
        for left in range(self.updates_due(), 0, -1):
            sample = self.draw()
            if left == 1:
                self.means.add(self.learner.diagnose(sample))
            self.means.add(self.learner.update(sample, worth))
        self.busy_s['learner'] += time.perf_counter() - start

    def updates_due(self) -> int:
        """Updates that the decisions so far call for, less those taken."""
        params, hold = self.params, self.params.task.actions.hold
        if len(self.replay) < params.least_held:
            return 0
        sequences = params.replay.samples_per_step * (self.steps - params.replay.warmup * hold)
        return max(int(sequences / params.learner.batch) - self.learner.updates, 0)

    def draw(self) -> Sample:
        """Draw the sample of an update."""
        params = self.params
        hold = params.task.actions.hold
        count, unroll = params.learner.batch, params.learner.unroll
        sample = self.replay.sample(self.rng, count, unroll, params.targets, hold)
        return sample if self.mirror is None else half_mirrored(sample, self.mirror)

    def state(self) -> Saved:
        """All but the replay."""
        counters = {
            'steps': self.steps,
            'generator': self.rng.bit_generator.state,
            'means': self.means.state_dict(),
        }
        return Saved(self.selfplay.state_dict(), self.learner.state_dict(), counters)

    def restore(self, saved: Saved) -> None:
        """Go on from a checkpoint, once the replay is filled."""
        self.selfplay.load_state_dict(saved.arrays)
        self.learner.load_state_dict(saved.tensors)
        self.rng.bit_generator.state = saved.counters['generator']
        self.means.load_state_dict(saved.counters['means'])
        self.model = self.export()
