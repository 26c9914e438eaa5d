"""The one table of topics. Publishers, subscribers, the recorder and the rate tests read it.

Publishers offer strong, subscribers ask weak, so that any vessel driver matches. In lock-step nothing may be
lost, and every publisher is ours: there both ends are reliable and keep a deep history.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, OccupancyGrid, Odometry, Path
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Bool
from visualization_msgs.msg import MarkerArray

MAP_FRAME = 'map'
BODY_FRAME = 'base_link'
DESIRED_FRAME = 'base_link_desired'
LIDAR_FRAME = 'lidar_link'
TARGET_FRAME = 'target'  # followed by /<id>

LOCK_STEP_DEPTH = 2000


@dataclass(frozen=True)
class Topic:
    """One row of the contract.

    name: relative, so that namespaces and remaps work. type: the message class. depth: messages kept at
    either end. latched: the last message is kept for those who come late. rate_hz: as published, 0 for on
    change. frame: of the header. recorded: goes into the bag; False where wall time would make two bags of
    one seed differ, or where the content follows from other topics.
    """

    name: str
    type: Any
    depth: int
    latched: bool = False
    rate_hz: float = 0.0
    frame: str = ''
    recorded: bool = True


_ROWS = (
    Topic('odom', Odometry, 10, rate_hz=20.0, frame=MAP_FRAME),
    Topic('scan', LaserScan, 5, rate_hz=10.0, frame=LIDAR_FRAME),
    Topic('joint_states', JointState, 10, rate_hz=20.0),
    Topic('targets', Odometry, 50, rate_hz=1.0, frame=MAP_FRAME),
    Topic('cmd_actuators', JointState, 1, rate_hz=20.0),
    Topic('clock', Clock, 1, rate_hz=20.0, recorded=False),
    Topic('diagnostics', DiagnosticArray, 10, rate_hz=1.0, recorded=False),
    Topic('map', OccupancyGrid, 1, latched=True, frame=MAP_FRAME),
    Topic('goal_pose', PoseStamped, 1, frame=MAP_FRAME),
    Topic('goal_poses', Goals, 1, frame=MAP_FRAME),
    Topic('plan', Path, 1, latched=True, frame=MAP_FRAME),
    Topic('setpoint_raw', Odometry, 1, rate_hz=1.0, frame=MAP_FRAME),
    Topic('setpoint', Odometry, 1, rate_hz=1.0, frame=MAP_FRAME),
    Topic('safety_state', DiagnosticStatus, 1, latched=True),
    Topic('emergency_stop', Bool, 1, recorded=False),
    Topic('trajectory', Path, 1, rate_hz=1.0, frame=MAP_FRAME, recorded=False),
    Topic('markers', MarkerArray, 1, rate_hz=1.0, frame=MAP_FRAME, recorded=False),
    Topic('navigation_state', DiagnosticStatus, 1, latched=True),
    Topic('episode', DiagnosticStatus, 1, latched=True),
    Topic('recorded', Clock, 1, recorded=False),
    Topic('managed_nodes_activated', Bool, 1, latched=True, recorded=False),
)
TOPICS: dict[str, Topic] = {topic.name: topic for topic in _ROWS}


def offered_qos(topic: Topic, lock_step: bool = False) -> QoSProfile:
    """What a publisher offers: reliable, latched where the table says so."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_depth(topic, lock_step),
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


def asked_qos(topic: Topic, lock_step: bool = False) -> QoSProfile:
    """What a subscriber asks: best effort, unless the topic is latched or the run in lock-step."""
    if topic.latched or lock_step:
        return offered_qos(topic, lock_step)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=topic.depth,
        reliability=ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def every_qos(topic: Topic) -> tuple[QoSProfile, QoSProfile, QoSProfile]:
    """What to ask, all of it, to hear whoever publishes: reliably where offered, and what was latched."""
    reliable = (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
    plain, latched = (QoSProfile(depth=topic.depth, durability=durability) for durability in reliable)
    return asked_qos(topic), plain, latched


def _depth(topic: Topic, lock_step: bool) -> int:
    return LOCK_STEP_DEPTH if lock_step else topic.depth
