"""Whether a vessel that wants to sail gets any further along its path."""

from __future__ import annotations

from enum import Enum

LEAST_M = 10.0


class Advance(Enum):
    """What to do about the progress."""

    SAIL_ON = 'sail on'
    PLAN_ANEW = 'plan anew'  # told once for each goal
    GIVE_UP = 'give up'


class ProgressWatch:
    """Watches the best progress along a path; time stands still while the vessel does not want to sail."""

    def __init__(self, stuck_s: float) -> None:
        """Call a vessel stuck that has not come LEAST_M further within a time in s."""
        self._stuck_s = stuck_s
        self._goal: tuple[float, float] | None = None
        self._planned_anew = False
        self._time_s: float | None = None
        self._best_m, self._idle_s = -LEAST_M, 0.0

    def begin(self, goal: tuple[float, float], same_within_m: float) -> None:
        """Take a new path by its end, x and y in m; only one close to the last is of the same goal."""
        last = self._goal
        far = last is None or max(abs(goal[0] - last[0]), abs(goal[1] - last[1])) > same_within_m
        self._planned_anew = self._planned_anew and not far
        self._goal, self._time_s = goal, None
        self._best_m, self._idle_s = -LEAST_M, 0.0

    def rest(self) -> None:
        """Take note of a time at which the vessel does not want to sail."""
        self._time_s = None

    def sail(self, time_s: float, progress_m: float) -> Advance:
        """Take note of the progress in m at a time at which the vessel wants to sail."""
        step_s = max(time_s - self._time_s, 0.0) if self._time_s is not None else 0.0
        self._time_s, self._idle_s = time_s, self._idle_s + step_s
        if progress_m >= self._best_m + LEAST_M:
            self._best_m, self._idle_s = progress_m, 0.0
        if self._idle_s <= self._stuck_s:
            return Advance.SAIL_ON
        if self._planned_anew:
            return Advance.GIVE_UP
        self._planned_anew, self._idle_s = True, 0.0
        return Advance.PLAN_ANEW
