"""Validation: a policy sails the same scenarios again and again, each to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import DECISION_S
from portnav_ros.task.env import PortVectorEnv, TaskParams
from portnav_ros.training.episode_statistics import MEANS, summarise, wilson_interval
from portnav_ros.types import Array32, IntArray, Outcome

Act = Callable[[Array32], IntArray]


class Validation:
    """N scenarios, sailed `batch` at a time; a slot whose episode ends takes the next scenario."""

    def __init__(self, scenarios: Sequence[Scenario], task: TaskParams, batch: int = 100) -> None:
        """Build the environments; all scenarios share vessel and sensor."""
        self._scenarios = scenarios
        self._next = 0
        self._decision_s = task.actions.hold * DECISION_S
        self._env = PortVectorEnv(min(batch, len(scenarios)), source=self._take, task=task)

    def run(self, act: Act) -> dict[str, Any]:
        """Sail every scenario once.

        Args:
            act: actions [B] for features [B, F]; draws nothing.

        Returns:
            episodes, success with its Wilson 95 % ``interval``, rates by outcome, mean return
            (``reward``), length in s and errors (m, m, rad).
        """
        outcomes, means = self._sail(act)
        won = int(np.sum(outcomes == Outcome.SUCCESS))
        interval = wilson_interval(won, len(outcomes))
        return {'episodes': len(outcomes), **summarise(outcomes, means), 'interval': list(interval)}

    def _sail(self, act: Act) -> tuple[IntArray, np.ndarray[Any, Any]]:
        """Outcomes [N] and means [N, 5] in the order of the scenarios."""
        count, env = len(self._scenarios), self._env
        outcomes, means = np.zeros(count, np.int64), np.zeros((count, len(MEANS)))
        sums = np.zeros((env.num_envs, len(MEANS)))
        self._next = 0
        features, _ = env.reset()
        slot = np.arange(env.num_envs)  # the scenario that each environment sails
        while (slot < count).any():
            features, reward, terminated, truncated, infos = env.step(act(features))
            sums += np.column_stack([reward, np.full(len(reward), self._decision_s), np.abs(infos['errors'])])
            for b in np.flatnonzero(terminated | truncated):
                if slot[b] < count:
                    outcomes[slot[b]], means[slot[b]] = infos['outcome'][b], sums[b]
                    means[slot[b], 2:] /= sums[b, 1] / self._decision_s
                slot[b], sums[b] = slot.max() + 1, 0.0
        return outcomes, means

    def _take(self, _: np.random.Generator) -> Scenario:
        """Hand out the scenarios in their order; past the last, the last, whose episodes do not count."""
        scenario = self._scenarios[min(self._next, len(self._scenarios) - 1)]
        self._next += 1
        return scenario
