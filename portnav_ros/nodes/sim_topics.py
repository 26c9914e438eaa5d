"""What the sim node says: every topic of the driver's half, the sim's own ones, and when each is due."""

from __future__ import annotations

import math

from nav_msgs.msg import Path
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from visualization_msgs.msg import MarkerArray

from portnav_ros.nodes import status_pipe
from portnav_ros.nodes.markers import buoy_markers, hull_marker
from portnav_ros.nodes.messages import (
    fill_joints,
    fill_odometry,
    fill_scan,
    nanoseconds,
    new_joints,
    new_odometry,
    new_scan,
    pose_message,
    status_message,
    write_stamp,
)
from portnav_ros.nodes.runtime import PortNode
from portnav_ros.nodes.topics import MAP_FRAME, TARGET_FRAME
from portnav_ros.sim.scenario import Scenario
from portnav_ros.sim.world import TICK_S, World
from portnav_ros.types import RUDDER, SURGE, THRUST, YAW, Actuation, Outcome, X, Y

TICK_NS = nanoseconds(TICK_S)
TICKS_PER_SCAN = 2
TICKS_PER_SECOND = round(1.0 / TICK_S)
TRAJECTORY_POINTS = 3600
OWN_COLOUR, OTHER_COLOUR = (0.1, 0.7, 0.3), (0.8, 0.2, 0.2)


class SimTopics:
    """Publishers of the sim node; messages are made once and filled at each tick."""

    def __init__(self, node: PortNode, scenario: Scenario, world: World, targets: bool) -> None:
        self._scenario, self._world, self._targets = scenario, world, targets
        self._odom, self._scan = node.publisher('odom'), node.publisher('scan')
        self._joints, self._clock = node.publisher('joint_states'), node.publisher('clock')
        self._target, self._goal = node.publisher('targets'), node.publisher('goal_pose')
        self._trajectory, self._markers = node.publisher('trajectory'), node.publisher('markers')
        self._episode = node.publisher('episode')
        self._odom_message, self._joints_message = new_odometry(), new_joints()
        self._scan_message = new_scan(world.lidar, TICKS_PER_SCAN * TICK_S)
        self._clock_message = Clock()
        self._track = Path()
        self._track.header.frame_id = MAP_FRAME
        self._goal_subscribers = 0

    def publish(self, tick: int) -> None:
        """Publish all that is due at a tick; odometry first, because the autopilot waits for it."""
        time_ns, own = tick * TICK_NS, self._world.own[0]
        fill_odometry(self._odom_message, time_ns, own)
        self._odom.publish(self._odom_message)
        fill_joints(self._joints_message, time_ns, Actuation(own[RUDDER], own[THRUST]))
        self._joints.publish(self._joints_message)
        if tick % TICKS_PER_SCAN == 0:
            fill_scan(self._scan_message, time_ns, self._world.ranges[0])
            self._scan.publish(self._scan_message)
        write_stamp(self._clock_message.clock, time_ns)
        self._clock.publish(self._clock_message)
        if tick % TICKS_PER_SECOND == 0:
            self._publish_slowly(time_ns)

    def publish_goal(self) -> None:
        """Publish the goal, again only when somebody new listens: a goal pre-empts the one before."""
        subscribers = self._goal.get_subscription_count()
        if subscribers > self._goal_subscribers:
            self._goal.publish(pose_message(*self._scenario.goal, 0.0, 0))
        self._goal_subscribers = subscribers

    def publish_episode(self, tick: int, least_clearance_m: tuple[float, float, float]) -> None:
        """Publish how the episode stands; least_clearance_m: to quay, buoy and vessel."""
        outcome = Outcome(int(self._world.outcome[0]))
        quay_m, buoy_m, vessel_m = least_clearance_m
        values = {
            'outcome': outcome.name,
            'stamp': tick * TICK_NS,
            'seed': self._scenario.seed,
            'scenario': self._scenario.name,
            'least_clearance_quay_m': f'{quay_m:.3f}',
            'least_clearance_buoy_m': f'{buoy_m:.3f}',
            'least_clearance_vessel_m': f'{vessel_m:.3f}',
        }
        level = b'\x02' if outcome.collision else b'\x00'
        self._episode.publish(status_message('episode', level, outcome.name, values))
        self._report(tick)

    def begin(self) -> None:
        """Begin anew: no trajectory yet, and nobody who knows the goal."""
        self._track.poses.clear()
        self._goal_subscribers = 0

    def _publish_slowly(self, time_ns: int) -> None:
        world, own = self._world, self._world.own[0]
        if self._targets:
            for number, (x, y, yaw, speed) in enumerate(world.vessels[0]):
                if math.isfinite(x):
                    message = new_odometry(f'{TARGET_FRAME}/{number}')
                    fill_odometry(message, time_ns, (x, y, yaw, speed, 0.0))
                    self._target.publish(message)
        self._track.poses.append(pose_message(own[X], own[Y], own[YAW], time_ns))
        del self._track.poses[:-TRAJECTORY_POINTS]
        write_stamp(self._track.header.stamp, time_ns)
        _publish_if_heard(self._trajectory, self._track)
        if self._markers.get_subscription_count():
            self._markers.publish(self._drawing())
        self._report(time_ns // TICK_NS)

    def _drawing(self) -> MarkerArray:
        world, own, vessel = self._world, self._world.own[0], self._world.vessel
        drawing = buoy_markers(self._scenario.harbour.buoys)
        size = (vessel.length_m, vessel.beam_m)
        drawing.markers.append(hull_marker(0, own[X], own[Y], own[YAW], size, OWN_COLOUR))
        for number, (x, y, yaw, _) in enumerate(world.vessels[0]):
            if math.isfinite(x):
                hull = world.hulls[0, number]
                drawing.markers.append(hull_marker(number + 1, x, y, yaw, hull, OTHER_COLOUR))
        return drawing

    def _report(self, tick: int) -> None:
        own, goal = self._world.own[0], self._scenario.goal
        status_pipe.report(
            time_s=tick * TICK_S,
            distance_m=math.hypot(goal[0] - own[X], goal[1] - own[Y]),
            speed_mps=float(own[SURGE]),
            outcome=Outcome(int(self._world.outcome[0])).name,
        )


def _publish_if_heard(publisher: Publisher, message: Path) -> None:
    if publisher.get_subscription_count():
        publisher.publish(message)
