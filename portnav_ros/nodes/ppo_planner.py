"""Local planner: the PPO baseline. It refuses to start without a model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from portnav_ros.baselines.ppo_policy import PpoPolicy, load_policy
from portnav_ros.muzero.model_file import released_model
from portnav_ros.nodes.local_planner import LocalPlanner
from portnav_ros.nodes.planner_params import PlannerParams
from portnav_ros.nodes.runtime import Health, run_node

NAME = 'ppo_planner'


@dataclass(frozen=True)
class PpoPlannerParams(PlannerParams):
    """Parameters of the PPO planner, besides those of every local planner.

    model: weights, with their card beside them; models/ppo.safetensors of the package where empty.
    allow_mismatch: only warn where the model was trained for another vessel.
    """

    model: str = ''
    allow_mismatch: bool = False


DEFAULTS = PpoPlannerParams()


def make_policy(params: PpoPlannerParams) -> PpoPolicy:
    """Return the policy of the model.

    Raises:
        ModelError: there is none, or it does not fit vessel or sensor.
    """
    path = Path(params.model) if params.model else released_model('ppo')
    return load_policy(path, params.vessel, params.lidar, params.allow_mismatch)


class PpoPlanner(LocalPlanner):
    """A local planner that names its model."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, make_policy, DEFAULTS, **options)

    def configure(self) -> None:
        """Load the model."""
        super().configure()
        self.get_logger().info(self._policy.model.label)

    def health(self) -> Health:
        """Add the model, and what it does not fit."""
        level, text, values = super().health()
        if self._policy.misfit and level == DiagnosticStatus.OK:
            level, text = DiagnosticStatus.WARN, self._policy.misfit
        return Health(level, text, {**values, **self._policy.model.identity})


def make_node(**options: Any) -> PpoPlanner:
    """Return the node."""
    return PpoPlanner(**options)


def main() -> int:
    """Run the node."""
    return run_node(make_node)


if __name__ == '__main__':
    raise SystemExit(main())
