"""Running means over the last episodes of a vectorised run, as the figure of Herremans et al. has them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import norm

from portnav_ros.types import AnyArray, Array, BoolArray, IntArray, Outcome

RATES = {
    'success': Outcome.SUCCESS,
    'collision_quay': Outcome.COLLISION_QUAY,
    'collision_buoy': Outcome.COLLISION_BUOY,
    'collision_vessel': Outcome.COLLISION_VESSEL,
    'timeout': Outcome.TIMEOUT,
}
MEANS = ('reward', 'length_s', 'e_x', 'e_y', 'e_psi')
WINDOW = 100


class EpisodeStatistics:
    """Counts episodes of B environments and remembers the last WINDOW of them.

    decision_s: simulated time of one decision in s.
    """

    def __init__(self, batch: int, decision_s: float, window: int = WINDOW) -> None:
        self.episodes = 0
        self._decision_s = decision_s
        self._running = np.zeros((batch, len(MEANS)))  # sums over the episode under way
        self._outcomes = np.zeros(window, np.int64)
        self._means = np.zeros((window, len(MEANS)))

    def update(self, reward: Array, ended: BoolArray, infos: Mapping[str, Any]) -> None:
        """Take in a decision of all environments.

        Args:
            reward: [B] of the decision.
            ended: [B] whether the episode ended with it.
            infos: of `PortVectorEnv.step`; ``outcome`` [B] and ``errors`` [B, 3] (m, m, rad) are read.
        """
        self._running[:, 0] += reward
        self._running[:, 1] += self._decision_s
        self._running[:, 2:] += np.abs(infos['errors'])
        if ended.any():
            self._finish(ended, infos['outcome'])

    def _finish(self, ended: BoolArray, outcome: IntArray) -> None:
        rows = self._running[ended]
        decisions = rows[:, 1] / self._decision_s
        rows[:, 2:] /= decisions[:, None]
        for row, how in zip(rows, outcome[ended], strict=True):
            at = self.episodes % len(self._outcomes)
            self._means[at], self._outcomes[at] = row, how
            self.episodes += 1
        self._running[ended] = 0.0

    def summary(self) -> dict[str, float | None]:
        """Rates by outcome and means (return, s, m, m, rad) over the last episodes; None before the first."""
        known = min(self.episodes, len(self._outcomes))
        if not known:
            return dict.fromkeys((*RATES, *MEANS))
        return summarise(self._outcomes[:known], self._means[:known])

    def state_dict(self) -> dict[str, AnyArray]:
        """All that is remembered, for a checkpoint."""
        return {
            'episodes': np.array(self.episodes),
            'running': self._running.copy(),
            'outcomes': self._outcomes.copy(),
            'means': self._means.copy(),
        }

    def load_state_dict(self, state: Mapping[str, AnyArray]) -> None:
        """Go on from a checkpoint."""
        self.episodes = int(state['episodes'])
        self._running[:] = state['running']
        self._outcomes[:] = state['outcomes']
        self._means[:] = state['means']


def summarise(outcome: IntArray, means: Array) -> dict[str, float | None]:
    """Rates and means of episodes.

    Args:
        outcome: [N] types.Outcome.
        means: [N, 5] in the order of MEANS.
    """
    rates = [float(np.mean(outcome == value)) for value in RATES.values()]
    return dict(zip((*RATES, *MEANS), (*rates, *map(float, means.mean(axis=0))), strict=True))


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a share (Wilson 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    z = float(norm.ppf(0.5 + 0.5 * confidence))
    share, spread = successes / trials, z * z / trials
    centre = (share + 0.5 * spread) / (1.0 + spread)
    half = z * math.sqrt(share * (1.0 - share) / trials + 0.25 * spread / trials) / (1.0 + spread)
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == trials else centre + half
    return low, high
