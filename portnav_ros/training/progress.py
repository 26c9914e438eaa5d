"""The progress bar of a run: success, reward, steps a second and time to go."""

from __future__ import annotations

from collections.abc import Mapping

from tqdm import tqdm


class Progress:
    """A bar over environment steps."""

    def __init__(self, total: int, steps: int = 0, title: str = 'training') -> None:
        """Show a run of `total` steps, of which `steps` are behind it."""
        self._bar = tqdm(total=total, initial=steps, desc=title, unit='step', unit_scale=True, smoothing=0.1)

    def show(self, steps: int, summary: Mapping[str, float | None]) -> None:
        """Move on to `steps`; `summary` as of `EpisodeStatistics.summary`."""
        if summary.get('success') is not None:
            text = f'success {summary["success"]:.0%}, reward {summary["reward"]:.0f}'
            self._bar.set_postfix_str(text, refresh=False)
        self._bar.update(steps - self._bar.n)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._bar.write(text)

    def close(self) -> None:
        """Leave the bar as it stands."""
        self._bar.close()
