"""What the local planner sees: ranges, odometry, path errors, points ahead, the previous action.

Herremans et al. stack four such frames. The paper does not tell scales, frames or spacing; those
chosen here are the fields of `ObservationParams`, and all points are in the body frame. The layout
`aligned` is our own: one frame, with scans of several ages put where they are now (task/aligned.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.sim.scenario import PATH_SPACING_M, LidarParams
from portnav_ros.task.aligned import new_memory, remember
from portnav_ros.task.observation_rows import Scales, locate, write_aligned_rows, write_stacked_rows
from portnav_ros.task.policy import Observation
from portnav_ros.task.tracking import SLOTS, TRACK_SIZE, follow, known_tracks, new_tracks
from portnav_ros.types import YAW, AnyArray, Array, Array32, BoolArray, IntArray


@dataclass(frozen=True)
class ObservationParams:
    """Shape and scales of the feature vector.

    layout: `stacked` is the paper's, whole frames one after the other; `aligned` holds scans of several
    ages in the frame of the line-of-sight course. frames: of the layout `stacked`. ages: of the scans of
    the layout `aligned`, in decision periods, from 0 to 120. sectors: into which rays are pooled by their
    minimum. tracks: how many the layout `aligned` tells of, of the nearest things that stand alone
    (task/tracking.py); none by default. path_points: how many points ahead on the path.
    path_point_spacing_m: between two of these points. lookahead_m: of the line-of-sight point b.
    position_scale_m: unit of the path errors. speed_scale_mps: unit of speeds. yaw_rate_scale_radps: unit
    of yaw rates. heading_change_scale_rad: unit of the previous action's heading change.
    remaining_scale_m: unit of the distance left.
    """

    layout: Literal['stacked', 'aligned'] = 'stacked'
    frames: int = 4
    ages: tuple[int, ...] = (0, 2, 5, 10)
    sectors: int = 60
    tracks: int = 0
    path_points: int = 10
    path_point_spacing_m: float = 30.0
    lookahead_m: float = 100.0
    position_scale_m: float = 50.0
    speed_scale_mps: float = 5.0
    yaw_rate_scale_radps: float = 0.05
    heading_change_scale_rad: float = math.pi / 6.0
    remaining_scale_m: float = 1000.0
    ranges: ClassVar[Ranges] = {
        'frames': (1, 64),
        'sectors': (1, 4096),
        'tracks': (0, SLOTS),
        'path_points': (1, 100),
        'path_point_spacing_m': (1.0, 1000.0),
        'lookahead_m': (1.0, 1000.0),
        'position_scale_m': (1e-3, 1e6),
        'speed_scale_mps': (1e-3, 1e3),
        'yaw_rate_scale_radps': (1e-6, 1e3),
        'heading_change_scale_rad': (1e-3, math.pi),
        'remaining_scale_m': (1.0, 1e6),
    }

    def __post_init__(self) -> None:
        """Refuse empty shapes and zero scales."""
        check_ranges(self)
        if self.layout not in ('stacked', 'aligned'):
            raise ParamError(f'layout = {self.layout!r} must be stacked or aligned')
        if not self.ages or min(self.ages) < 0 or max(self.ages) > 120:
            raise ParamError(f'ages = {self.ages} needs values from 0 to 120')
        if self.tracks and self.layout != 'aligned':
            raise ParamError(f'tracks = {self.tracks} needs layout = aligned')

    @property
    def frame_size(self) -> int:
        """Features of one frame: sectors, surge, yaw rate, 3 errors, path points, 2 of the action."""
        return self.sectors + 2 + 3 + 2 * self.path_points + 2

    @property
    def size(self) -> int:
        """Length F of the feature vector, newest frame first."""
        if self.layout == 'aligned':
            scans = (len(self.ages) - 1) * self.sectors
            return self.frame_size + scans + 1 + self.tracks * TRACK_SIZE
        return self.frames * self.frame_size


class Observer:
    """Turns states and scans of B vessels into observations; remembers frames and progress."""

    def __init__(self, batch: int, lidar: LidarParams, params: ObservationParams) -> None:
        """Allocate for B vessels with one kind of sensor.

        Raises:
            ParamError: the layout is stacked, and there are fewer rays than sectors.
        """
        if params.layout == 'stacked' and lidar.rays < params.sectors:
            raise ParamError(
                f'lidar.rays = {lidar.rays} are fewer than observation.sectors = {params.sectors}: '
                f'give the sensor at least {params.sectors} rays, or ask for at most {lidar.rays} sectors'
            )
        self.params = params
        self._scales = Scales(
            params.sectors,
            params.path_points,
            params.path_point_spacing_m / PATH_SPACING_M,
            params.lookahead_m,
            lidar.range_max_m,
            params.position_scale_m,
            params.speed_scale_mps,
            params.yaw_rate_scale_radps,
            params.heading_change_scale_rad,
            params.remaining_scale_m,
        )
        self._ages = np.array(params.ages, np.int64)
        depth = max(params.ages) + 1 if params.layout == 'aligned' else 0
        self._memory = new_memory(batch, depth, lidar.rays)
        self._tracks = new_tracks(batch if params.tracks else 0)
        self._features = np.zeros((batch, params.size), np.float32)
        self._path = np.zeros((batch, 2, 2))
        self._count = np.full(batch, 2, np.int64)
        self._progress = np.full(batch, -1.0)
        self._errors = np.zeros((batch, 3))
        self._last_yaw = np.full(batch, np.nan)
        self._everyone = np.ones(batch, dtype=bool)

    @property
    def errors(self) -> Array:
        """Path errors [B, 3] at the last update: e_x, e_y in m (body frame), e_psi in rad."""
        return self._errors

    @property
    def begun(self) -> BoolArray:
        """Which vessels [B] have been observed since their reset, so that they have a path."""
        return ~np.isnan(self._last_yaw)

    @property
    def progress(self) -> Array:
        """Index with fraction [B] of the path point closest to each vessel."""
        return self._progress

    def tracks(self, b: int) -> Array:
        """What is known of the things around vessel b, [N, 8] as `known_tracks`; none where unasked."""
        return known_tracks(self._tracks[b]) if self.params.tracks else np.zeros((0, 8))

    def reset(self, which: BoolArray, paths: Sequence[Array]) -> None:
        """Start episodes anew: `which` [B] tells whose, `paths` holds one [W, 2] for each of those."""
        for b, path in zip(np.flatnonzero(which), paths, strict=True):
            if len(path) > self._path.shape[1]:
                grown = np.zeros((len(self._path), 2 * len(path), 2))
                grown[:, : self._path.shape[1]] = self._path
                self._path = grown
            self._path[b, : len(path)] = path
            self._count[b] = len(path)
        self._progress[which] = -1.0
        self._last_yaw[which] = np.nan

    def state_dict(self) -> dict[str, AnyArray]:
        """Copies of all that is remembered, by name, for a checkpoint."""
        return {name: array.copy() for name, array in self._remembered().items()}

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint of an observer of as many vessels with the same parameters."""
        self._path = state['path'].copy()
        for name, array in self._remembered().items():
            array[:] = state[name]

    def copy(self, other: Observer, rows: IntArray) -> None:
        """Remember of the first N vessels what another observer remembers of those of `rows` [N]."""
        if self._path.shape[1] != other._path.shape[1]:
            self._path = np.zeros((len(self._path), *other._path.shape[1:]))
        theirs = other._remembered()
        for name, array in self._remembered().items():
            array[: len(rows)] = theirs[name][rows]

    def _remembered(self) -> dict[str, AnyArray]:
        return {
            'path': self._path,
            'count': self._count,
            'progress': self._progress,
            'errors': self._errors,
            'last_yaw': self._last_yaw,
            'features': self._features,
            **{f'memory_{name}': array for name, array in self._memory._asdict().items()},
            **({'tracks': self._tracks} if self.params.tracks else {}),
        }

    def update(
        self,
        own: Array,
        ranges: Array32,
        setpoint: Array,
        which: BoolArray | None = None,
        deciding: bool = True,
    ) -> Observation:
        """Take in a decision period.

        Args:
            own: [B, 7] state rows.
            ranges: [B, R] m as sensed.
            setpoint: [B, 2] the setpoints given at the last decision; unread after a reset.
            which: [B] the vessels to update; all by default.
            deciding: whether anyone reads the features; aligned ones are not made otherwise.
        """
        chosen = self._everyone if which is None else which
        fresh = np.isnan(self._last_yaw)
        locate(self._scales.lookahead_m, own, self._path, self._count, self._progress, self._errors, chosen)
        if self.params.layout == 'aligned':
            remember(self._memory, own, ranges, fresh, chosen)
            if self.params.tracks:
                follow(self._tracks, own, ranges, self._scales.range_m, fresh, chosen)
            if deciding:
                write_aligned_rows(
                    self._scales,
                    self._ages,
                    self._memory,
                    self._tracks,
                    own,
                    setpoint,
                    self._path,
                    self._count,
                    self._progress,
                    self._errors,
                    fresh,
                    self._features,
                    chosen,
                )
        else:
            write_stacked_rows(
                self._scales,
                own,
                ranges,
                setpoint,
                self._path,
                self._count,
                self._progress,
                self._errors,
                self._last_yaw,
                self._features,
                chosen,
            )
        self._last_yaw[chosen] = own[chosen, YAW]
        return self.observation(own, ranges)

    def observation(self, own: Array, ranges: Array32) -> Observation:
        """What the last update made of state rows [B, 7] and ranges [B, R]."""
        return Observation(ranges, own, self._path, self._count, self._progress, self._features)
