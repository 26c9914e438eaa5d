"""How long a run is, and when it logs, validates and saves; the same for every algorithm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from portnav_ros.params import Ranges, check_ranges

LINES, VALIDATIONS = 20, 8  # of a short run, at least


@dataclass(frozen=True)
class ScheduleParams:
    """Intervals in environment steps (world seconds sailed, over all environments); 0 is never."""

    steps: int = 5_000_000
    log_every: int = 20_000
    validate_every: int = 250_000
    save_every: int = 250_000
    ranges: ClassVar[Ranges] = {
        'steps': (1, 1e12),
        'log_every': (1, 1e12),
        'validate_every': (0, 1e12),
        'save_every': (0, 1e12),
    }

    def __post_init__(self) -> None:
        """Refuse intervals that cannot be."""
        check_ranges(self)

    def with_curves(self) -> ScheduleParams:
        """The same schedule, with intervals that make a curve of a short run too.

        It logs and saves after each LINES-th of the run at the latest, and validates after each
        VALIDATIONS-th.
        """
        line, validation = max(self.steps // LINES, 1), max(self.steps // VALIDATIONS, 1)
        return replace(
            self,
            log_every=min(self.log_every, line),
            validate_every=min(self.validate_every, validation),
            save_every=min(self.save_every, line),
        )


def due(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]; needs no memory, so a resumed run agrees."""
    return every > 0 and after // every > before // every
