"""What every local planner can be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.safety.mounting import Mounting
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.task.observation import ObservationParams
from portnav_ros.vessel import VesselParams


@dataclass(frozen=True)
class PlannerParams(NodeParams):
    """Parameters of a local planner.

    preset: vessel in config/vessels, or a YAML file; vessel.*: what differs from it. autopilot.*: gains of
    the PID controller, which a planner may simulate. lidar.*: the sensor, whose rays are checked.
    mounting.*: where it is. observation.*: what the policy sees; a learned one sees what its model was
    trained on. lock_step: answer each decision with odometry, scan and actuator feedback of the very same
    stamp. period_s: from decision to decision. age_s: of scan and odometry, past which the vessel is stopped.
    release_s: time with both before it sails again. rate: simulated seconds per second. goal_radius_m: from
    the end of the plan, within which it is stopped. stuck_s: time without progress after which a plan is
    asked for anew, once, and after which again the vessel is stopped.
    """

    preset: str = 'shuttle'
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    lidar: LidarParams = field(default_factory=LidarParams)
    mounting: Mounting = field(default_factory=Mounting)
    observation: ObservationParams = field(default_factory=ObservationParams)
    lock_step: bool = False
    period_s: float = 1.0
    age_s: float = 0.5
    release_s: float = 2.0
    rate: float = 1.0
    goal_radius_m: float = 50.0
    stuck_s: float = 180.0
    ranges: ClassVar[Ranges] = {
        'period_s': (0.05, 60.0),
        'age_s': (0.05, 60.0),
        'release_s': (0.0, 600.0),
        'rate': (0.01, 1000.0),
        'goal_radius_m': (0.0, 1000.0),
        'stuck_s': (1.0, 86400.0),
    }

    def __post_init__(self) -> None:
        """Refuse times and distances that make no sense."""
        check_ranges(self)
