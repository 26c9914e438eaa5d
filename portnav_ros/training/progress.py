"""The progress bars of a run: over worlds as they are made, and over steps with success and reward."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from tqdm import tqdm

from portnav_ros.training.scenarios import Ready

DELAY_S = 1.0


class Progress:
    """A bar over environment steps."""

    def __init__(self, total: int, steps: int = 0, title: str = 'training') -> None:
        """Show a run of `total` steps, of which `steps` are behind it."""
        self._total = total
        done = min(steps, total)
        self._bar = tqdm(total=total, initial=done, desc=title, unit='step', unit_scale=True, smoothing=0.1)

    def show(self, steps: int, summary: Mapping[str, float | None]) -> None:
        """Move on to `steps`, at most to the end; `summary` as of `EpisodeStatistics.summary`."""
        if summary.get('success') is not None:
            text = f'success {summary["success"]:.0%}, reward {summary["reward"]:.0f}'
            self._bar.set_postfix_str(text, refresh=False)
        self._bar.update(min(steps, self._total) - self._bar.n)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._bar.write(text)

    def close(self) -> None:
        """Leave the bar as it stands."""
        self._bar.close()


@contextmanager
def preparing(title: str) -> Iterator[Ready]:
    """Show a bar while worlds are made, unless that takes less than DELAY_S; gives what is told of them."""
    with tqdm(desc=title, unit='world', delay=DELAY_S, leave=False) as bar:

        def ready(count: int, total: int) -> None:
            bar.total = total
            bar.update(count - bar.n)

        yield ready
