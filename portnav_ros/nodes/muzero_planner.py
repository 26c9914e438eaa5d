"""Local planner: the learned policy. It refuses to start without a model and falls back to nothing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from visualization_msgs.msg import MarkerArray

from portnav_ros.muzero.model_file import released_model
from portnav_ros.muzero.policy import Decision, MuZeroPolicy, load_policy
from portnav_ros.nodes.local_planner import EVERYONE, LocalPlanner
from portnav_ros.nodes.markers import sighting_marker, track_marker
from portnav_ros.nodes.planner_params import PlannerParams
from portnav_ros.nodes.runtime import Health, run_node
from portnav_ros.params import Ranges
from portnav_ros.types import STATE_SIZE

NAME = 'muzero_planner'
AS_IN_CARD = -1
SHOWN = 5  # actions in the diagnostics, the most visited ones


@dataclass(frozen=True)
class MuZeroParams(PlannerParams):
    """Parameters of the learned planner, besides those of every local planner.

    model: weights, with their card beside them; the released ones where empty. simulations: of each
    search, -1 for the card's, 0 to follow the prior alone. allow_mismatch: only warn where the model was
    trained for another vessel.
    """

    model: str = ''
    simulations: int = AS_IN_CARD
    allow_mismatch: bool = False

    ranges: ClassVar[Ranges] = {**PlannerParams.ranges, 'simulations': (AS_IN_CARD, 10_000)}


DEFAULTS = MuZeroParams()


def make_policy(params: MuZeroParams) -> MuZeroPolicy:
    """Return the policy of the model.

    Raises:
        ModelError: there is none, or it does not fit vessel or sensor.
    """
    path = Path(params.model) if params.model else released_model('muzero')
    simulations = None if params.simulations == AS_IN_CARD else params.simulations
    return load_policy(path, params.vessel, params.lidar, simulations, params.allow_mismatch)


class MuZeroPlanner(LocalPlanner):
    """A local planner that shows what its search has found."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, make_policy, DEFAULTS, **options)

    def configure(self) -> None:
        """Load the model and compile its search."""
        super().configure()
        self._policy.best_track(np.zeros(STATE_SIZE), np.eye(2))  # compiles
        self._policy.reset(EVERYONE)
        self._markers = self.publisher('markers')
        label, simulations = self._policy.model.label, self._policy.simulations
        self.get_logger().info(f'{label} with {simulations} simulations')

    def health(self) -> Health:
        """Add the model, and what the last search found."""
        level, text, values = super().health()
        policy = self._policy
        found = {**policy.model.identity, 'simulations': policy.simulations}
        if policy.misfit and level == DiagnosticStatus.OK:
            level, text = DiagnosticStatus.WARN, policy.misfit
        if policy.decision is not None:
            found |= {'value': f'{policy.decision.value:.1f}', **_root_values(policy.decision)}
        return Health(level, text, {**values, **found})

    def explain(self, decision_s: float) -> None:
        """Show a new decision."""
        super().explain(decision_s)
        if self._markers.get_subscription_count():
            track = self._policy.best_track(self._own[0], self._path)
            rollout = track_marker('rollout', track, (0.2, 1.0, 0.4))
            self._markers.publish(MarkerArray(markers=[rollout, sighting_marker(self._policy.tracks())]))


def _root_values(decision: Decision) -> dict[str, str]:
    """Visits and prior of the most visited actions, or of the likeliest where nothing was searched."""
    weight = decision.visits if decision.visits.any() else decision.prior
    best = np.argsort(-weight, kind='stable')[:SHOWN]
    return {
        'visits': ' '.join(f'{action}:{decision.visits[action]}' for action in best),
        'prior': ' '.join(f'{action}:{decision.prior[action]:.3f}' for action in best),
    }


def make_node(**options: Any) -> MuZeroPlanner:
    """Return the node."""
    return MuZeroPlanner(**options)


def main() -> int:
    """Run the node."""
    return run_node(make_node)


if __name__ == '__main__':
    raise SystemExit(main())
