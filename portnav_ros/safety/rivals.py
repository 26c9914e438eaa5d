"""Publishers where one belongs: two that speak in turn would make the vessel follow neither."""

from __future__ import annotations

from collections.abc import Sequence

GHOST_S = 30.0  # a process that was killed is known for 20 s more


class RivalWatch:
    """Tells apart two publishers from one that was killed and has been started again under its name."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._since_s: float | None = None

    def note(self, publishers: Sequence[str], steady_s: float) -> str:
        """Return what is wrong with the publishers of the topic, named by their nodes, or nothing."""
        if len(publishers) < 2:
            self._since_s = None
            return ''
        self._since_s = steady_s if self._since_s is None else self._since_s
        names = sorted(set(publishers))
        if len(names) == 1 and steady_s - self._since_s < GHOST_S:
            return ''
        told = ' and '.join(names) if len(names) > 1 else f'{len(publishers)} nodes named {names[0]}'
        return f'{len(publishers)} publishers on {self._topic}: {told}'
