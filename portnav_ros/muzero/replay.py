"""The replay: a ring of the last decisions of every environment, in flat memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from portnav_ros.muzero.targets import History, TargetParams, Targets, make_targets
from portnav_ros.params import ParamError, Ranges, check_range, check_ranges
from portnav_ros.task.mirror import Mirror
from portnav_ros.types import AnyArray, Array32, IntArray

CANDIDATES = 16  # that are looked at for each sequence that shall begin with a lesson


@dataclass(frozen=True)
class ReplayParams:
    """The ring and how much is drawn from it.

    capacity: decisions of all environments together. warmup: decisions before the first update.
    samples_per_step: sequences drawn for each environment step, on average. lessons: share of them that
    begin with a lesson, where lessons are rarer than that. precision: of the stored features.
    """

    capacity: int = 500_000
    warmup: int = 10_000
    samples_per_step: float = 16.0
    lessons: float = 0.0
    precision: Literal['float16', 'float32'] = 'float16'
    ranges: ClassVar[Ranges] = {'capacity': (100, 1e9), 'samples_per_step': (0.0, 1e4), 'lessons': (0.0, 1.0)}

    def __post_init__(self) -> None:
        """Refuse a ring that is never full enough."""
        check_ranges(self)
        check_range(self, warmup=(0, self.capacity))
        if self.precision not in ('float16', 'float32'):
            raise ParamError(f'precision = {self.precision!r} must be float16 or float32')

    def rows(self, batch: int) -> int:
        """Decisions that are kept of each of B environments."""
        return max(self.capacity // batch, 2)


class Segment(NamedTuple):
    """T decisions of B environments; in the ring the axes are B, T."""

    features: AnyArray  # [T, B, F] seen before the decision
    action: AnyArray  # [T, B] int16
    reward: Array32  # [T, B]
    end: AnyArray  # [T, B] uint8, as in targets
    value: Array32  # [T, B] of the search's root
    policy: Array32  # [T, B, A] target of the search
    final_value: Array32  # [T, B] of what was seen last, where the episode was truncated
    version: AnyArray  # [T, B] int32, updates behind the weights that decided
    lesson: AnyArray  # [T, B, K] int8, actions that a teacher valued; below 0 where none did
    regret: AnyArray  # [T, B, K] float16, of each against the best of them


class Sample(NamedTuple):
    """N sequences of K decisions."""

    features: AnyArray  # [N, F] at the first position; [N, K + 1, F] where asked for all
    action: IntArray  # [N, K]
    policy: Array32  # [N, K + 1, A]
    targets: Targets
    version: AnyArray  # [N]
    lesson: IntArray  # [N, U + 1, K]; U decisions unrolled, K actions of a lesson
    regret: Array32  # [N, U + 1, K]


class Replay:
    """Decisions 0, 1, ... of B environments, of which the last `rows` are kept."""

    def __init__(
        self, params: ReplayParams, batch: int, features: int, actions: int, lessons: int = 0
    ) -> None:
        """Allocate all memory that it will ever take."""
        self.params = params
        self.batch = batch
        self.rows = params.rows(batch)
        self.written = 0

        def ring(kind: str, *shape: int) -> AnyArray:
            return np.zeros((batch, self.rows, *shape), kind)

        self._ring = Segment(
            features=ring(params.precision, features),
            action=ring('int16'),
            reward=ring('float32'),
            end=ring('uint8'),
            value=ring('float32'),
            policy=ring('float32', actions),
            final_value=ring('float32'),
            version=ring('int32'),
            lesson=ring('int8', lessons),
            regret=ring('float16', lessons),
        )

    def __len__(self) -> int:
        """Decisions held, over all environments."""
        return min(self.written, self.rows) * self.batch

    @property
    def nbytes(self) -> int:
        """Memory of the ring in bytes, once it is full."""
        return sum(array.nbytes for array in self._ring)

    @property
    def oldest(self) -> int:
        """Number of the oldest decision held."""
        return max(self.written - self.rows, 0)

    def append(self, segment: Segment) -> None:
        """Take in the next decisions; the oldest are overwritten."""
        count = min(len(segment.action), self.rows)
        at = (self.written + len(segment.action) - count + np.arange(count)) % self.rows
        for kept, new in zip(self._ring, segment, strict=True):
            kept[:, at] = np.moveaxis(new[-count:], 0, 1)
        self.written += len(segment.action)

    def sample(
        self,
        rng: np.random.Generator,
        count: int,
        unroll: int,
        targets: TargetParams,
        hold: int = 1,
        all_features: bool = False,
    ) -> Sample:
        """Draw sequences uniformly, but for those that begin with a lesson.

        Args:
            rng: draws them.
            count: N.
            unroll: K.
            targets: how returns are made.
            hold: seconds that a decision lasts.
            all_features: give the features of every position, not of the first alone.

        Raises:
            ValueError: fewer than K + 1 decisions of each environment are held.
        """
        last = self.written - 1 - unroll
        if last < self.oldest:
            raise ValueError(f'{self.written} decisions do not hold a sequence of {unroll + 1}')
        which = rng.integers(self.batch, size=count)
        first = rng.integers(self.oldest, last + 1, size=count)
        self._prefer_lessons(rng, which, first, last)
        return self.window(which, first, unroll, targets, hold, all_features)

    def _prefer_lessons(self, rng: np.random.Generator, which: IntArray, first: IntArray, last: int) -> None:
        """Replace sequences by some that begin with a lesson, as far as some turn up."""
        wanted = round(self.params.lessons * len(which))
        if not wanted or not self._ring.lesson.shape[2]:
            return
        others = rng.integers(self.batch, size=CANDIDATES * wanted)
        starts = rng.integers(self.oldest, last + 1, size=CANDIDATES * wanted)
        found = np.flatnonzero(self._ring.lesson[others, starts % self.rows, 0] >= 0)[:wanted]
        rows = rng.permutation(len(which))[: len(found)]  # the order tells which are mirrored
        which[rows], first[rows] = others[found], starts[found]

    def window(
        self,
        which: IntArray,
        first: IntArray,
        unroll: int,
        targets: TargetParams,
        hold: int = 1,
        all_features: bool = False,
    ) -> Sample:
        """Sequences of environments [N] from decisions [N] on."""
        ring = self._ring
        steps = (first[:, None] + np.arange(unroll + 1)) % self.rows
        rows = which[:, None], steps
        history = History(ring.reward, ring.end, ring.value, ring.final_value)
        seen = ring.features[rows] if all_features else ring.features[which, steps[:, 0]]
        return Sample(
            features=seen,
            action=ring.action[which[:, None], steps[:, :unroll]].astype(np.int64),
            policy=ring.policy[rows],
            targets=make_targets(history, self.written - 1, which, first, unroll, targets, hold),
            version=ring.version[which, steps[:, 0]],
            lesson=ring.lesson[rows].astype(np.int64),
            regret=ring.regret[rows].astype(np.float32),
        )

    def segment(self, first: int, end: int) -> Segment:
        """Decisions first to end - 1, which must be held, to be saved."""
        at = np.arange(first, end) % self.rows
        return Segment(*(np.moveaxis(kept[:, at], 1, 0) for kept in self._ring))

    def restore(self, written: int, segments: Iterable[tuple[int, Segment]]) -> None:
        """Go on from a checkpoint of `written` decisions; segments come with their first decision."""
        for first, segment in segments:
            self.written = first
            self.append(segment)
        if self.written != written:
            raise ValueError(f'the replay ends at decision {self.written} instead of {written}')


def half_mirrored(sample: Sample, mirror: Mirror) -> Sample:
    """The same sample, in the first half of which port and starboard are exchanged."""
    half = len(sample.action) // 2
    features, action = sample.features.copy(), sample.action.copy()
    policy, lesson = sample.policy.copy(), sample.lesson.copy()
    features[:half] = mirror.features(features[:half])
    action[:half] = mirror.action[action[:half]]
    policy[:half] = policy[:half][..., mirror.action]
    valued = lesson[:half] >= 0
    lesson[:half] = np.where(valued, mirror.action[lesson[:half]], lesson[:half])
    return sample._replace(features=features, action=action, policy=policy, lesson=lesson)
