"""Means of named numbers between two lines of metrics."""

from __future__ import annotations

from collections.abc import Mapping


class RunningMeans:
    """Sums and counts by name."""

    def __init__(self) -> None:
        self._sums: dict[str, tuple[float, int]] = {}

    def add(self, values: Mapping[str, float]) -> None:
        """Take in one number for each name."""
        for name, value in values.items():
            total, count = self._sums.get(name, (0.0, 0))
            self._sums[name] = total + value, count + 1

    def take(self) -> dict[str, float]:
        """The means since the last call; none where nothing was added."""
        means = {name: total / count for name, (total, count) in self._sums.items()}
        self._sums = {}
        return means

    def state_dict(self) -> dict[str, tuple[float, int]]:
        """Sums and counts, for a checkpoint."""
        return dict(self._sums)

    def load_state_dict(self, state: Mapping[str, tuple[float, int]]) -> None:
        """Go on from a checkpoint; pairs may have become lists on the way through JSON."""
        self._sums = {name: (float(total), int(count)) for name, (total, count) in state.items()}
