"""How long a run is, and when it logs, validates and saves; the same for every algorithm."""

from __future__ import annotations

from dataclasses import dataclass

from portnav_ros.params import check_range


@dataclass(frozen=True)
class ScheduleParams:
    """Intervals in environment steps (world seconds sailed, over all environments); 0 is never."""

    steps: int = 5_000_000
    log_every: int = 20_000
    validate_every: int = 250_000
    save_every: int = 250_000

    def __post_init__(self) -> None:
        """Refuse intervals that cannot be."""
        check_range(
            self, steps=(1, 1e12), log_every=(1, 1e12), validate_every=(0, 1e12), save_every=(0, 1e12)
        )


def due(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]; needs no memory, so a resumed run agrees."""
    return every > 0 and after // every > before // every
