"""Signals that ask a process to end, taken down until somebody looks."""

from __future__ import annotations

import contextlib
import os
import signal

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class PendingSignals:
    """Takes the signals from whoever had them until close(); ``descriptor`` is readable once one has come."""

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self.descriptor, self._writer = os.pipe()
        for end in (self.descriptor, self._writer):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._handlers = {
            number: signal.signal(number, lambda n, _: self._numbers.append(n)) for number in SIGNALS
        }

    def __bool__(self) -> bool:
        return bool(self._numbers)

    def take(self) -> int:
        """Return the newest signal, and forget it."""
        return self._numbers.pop()

    def clear(self) -> None:
        """Forget all."""
        self._numbers.clear()

    def quiet(self) -> None:
        """Make the descriptor unreadable again."""
        with contextlib.suppress(BlockingIOError):
            os.read(self.descriptor, 256)

    def close(self) -> None:
        """Give the signals back."""
        signal.set_wakeup_fd(-1)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        os.close(self.descriptor)
        os.close(self._writer)
