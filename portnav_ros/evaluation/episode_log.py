"""What was recorded of one episode, in process or from a bag: the source of every metric and picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from portnav_ros.harbour import Harbour
from portnav_ros.safety.mounting import Mounting
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.path_errors import path_errors_along
from portnav_ros.types import STATE_SIZE, Array, Array32, IntArray, Outcome
from portnav_ros.vessel import VesselParams


class LogError(ValueError):
    """A recording cannot be used; the message names the field and what it should be."""


class TargetTrack(NamedTuple):
    """Another vessel as recorded: time_s [N] s; pose [N, 4] x, y in m, yaw in rad, speed in m/s.

    length_m, beam_m: of its hull; 0 where they are not known.
    """

    name: str
    time_s: Array
    pose: Array
    length_m: float
    beam_m: float


class PlanLog(NamedTuple):
    """A route, path [W, 2] m, and the time in s from which on it held."""

    time_s: float
    path: Array


class ScanLog(NamedTuple):
    """Sweeps of the ranging sensor: time_s [S] s; ranges [S, R] m (+inf no return); where it is mounted."""

    time_s: Array
    ranges: Array32
    angle_min_rad: float
    angle_increment_rad: float
    mounting: Mounting = Mounting()


@dataclass(frozen=True)
class EpisodeLog:
    """One recorded episode; the row of index t holds what was true at ``time_s[t]``.

    time_s: [T] s, rising. own: [T, 7] state rows, rudder and thrust NaN where nobody told them. setpoint:
    [T, 2] desired heading in rad and speed in m/s, as decided at that time or last before it. path: [W, 2]
    m, the global plan. earlier_plans: those that held before it, in the order of their times, and
    path_since_s: from when on it held itself; errors are counted from the plan of the time. goal: x, y in
    m. command: [T, 2] rudder in rad and thrust in N as the autopilot asked, or None. range_min: [T] m,
    the least return of a scan, or None. clearance: [T, 3] m from the hull to the nearest quay, buoy
    and vessel, or None. latency_s: [N] s that decisions took. wall_s: how long the episode took to
    run, NaN where unknown. metadata: version, command and whatever else helps to repeat the run.
    """

    time_s: Array
    own: Array
    setpoint: Array
    path: Array
    harbour: Harbour
    goal: tuple[float, float]
    outcome: Outcome
    vessel: VesselParams = field(default_factory=VesselParams)
    goal_radius_m: float = 50.0
    earlier_plans: tuple[PlanLog, ...] = ()
    path_since_s: float = float('-inf')
    command: Array | None = None
    range_min: Array | None = None
    clearance: Array | None = None
    targets: tuple[TargetTrack, ...] = ()
    scans: ScanLog | None = None
    latency_s: Array = field(default_factory=lambda: np.zeros(0))
    wall_s: float = float('nan')
    scenario: str = ''
    seed: int = 0
    planner: str = ''
    difficulty: str = ''
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit each other."""
        rows = len(self.time_s)
        if rows == 0:
            raise LogError('time_s is empty: nothing was recorded')
        if np.any(np.diff(self.time_s) <= 0.0):
            raise LogError('time_s must rise from row to row')
        columns = {'own': STATE_SIZE, 'setpoint': 2, 'command': 2, 'clearance': 3}
        for name, width in columns.items():
            values = getattr(self, name)
            if values is not None and values.shape != (rows, width):
                raise LogError(f'{name} has the shape {values.shape}, expected {(rows, width)}')
        if self.range_min is not None and self.range_min.shape != (rows,):
            raise LogError(f'range_min has the shape {self.range_min.shape}, expected {(rows,)}')
        if self.path.ndim != 2 or self.path.shape[1] != 2 or len(self.path) < 2:
            raise LogError(f'path has the shape {self.path.shape}, expected (W, 2) with W >= 2')

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def length_s(self) -> float:
        """Simulated time from the first row to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @cached_property
    def errors(self) -> Array:
        """Line-of-sight path errors [T, 3]: e_x, e_y in m (body frame), e_psi in rad."""
        plans = (*self.earlier_plans, PlanLog(self.path_since_s, self.path))
        held = np.searchsorted([plan.time_s for plan in plans[1:]], self.time_s, side='right')
        legs = ((self.own[held == k], plan.path) for k, plan in enumerate(plans))
        return np.concatenate([path_errors_along(*leg, ObservationParams().lookahead_m) for leg in legs])

    @property
    def goal_moved(self) -> bool:
        """Whether an earlier plan led somewhere else."""
        ends = [plan.path[-1] - self.path[-1] for plan in self.earlier_plans]
        return any(float(np.hypot(*end)) > self.goal_radius_m for end in ends)

    def thinned(self, period_s: float) -> EpisodeLog:
        """Keep the rows closest after each multiple of a period, and the last.

        In-process and bag recordings of the same episode have equal rows once thinned to the
        decision period. A log that is no denser than the period comes back as it is.
        """
        slot = np.floor((self.time_s - self.time_s[0]) / period_s + 1e-6).astype(np.int64)
        keep = np.flatnonzero(np.diff(slot, prepend=-1) > 0)
        keep = np.unique(np.append(keep, len(self) - 1))
        return self if len(keep) == len(self) else self._rows(keep)

    def _rows(self, keep: IntArray) -> EpisodeLog:
        names = ('time_s', 'own', 'setpoint', 'command', 'range_min', 'clearance')
        chosen = {name: getattr(self, name) for name in names}
        return dataclasses.replace(self, **{k: v[keep] for k, v in chosen.items() if v is not None})
