"""Stands in for VRX: a hull about as a WAM-V behind VRX's topics, for trying vrx_adapter.py without Gazebo.

Like Gazebo, it stamps by its own clock from 0, publishes that clock, and keeps the last thrust for ever.
"""

import contextlib
import math

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Float64

PERIOD_S = 0.05
MASS_KG, INERTIA_KGM2 = 180.0, 446.0
SURGE_DRAG, SURGE_DRAG_2, YAW_DRAG = 51.3, 72.4, 400.0  # N s/m, N s^2/m^2, N m s
PODS_M = {'left': (-2.37, 1.03), 'right': (-2.37, -1.03)}
SAMPLES, RANGE_MIN_M, RANGE_MAX_M, LIDAR_X_M = 720, 0.1, 130.0, 0.7
HALF_BASIN_M = 120.0


class VrxStandIn(Node):
    """Hull, basin and topics of the simulated vessel."""

    def __init__(self, **options):
        super().__init__('vrx_stand_in', **options)
        self.ticks, self.surge, self.yaw_rate = 0, 0.0, 0.0
        self.x, self.y, self.yaw = 60.0, 60.0, -2.6
        self.thrust, self.angle = dict.fromkeys(PODS_M, 0.0), dict.fromkeys(PODS_M, 0.0)
        self.odometry = self.create_publisher(Odometry, 'wamv/sensors/position/ground_truth_odometry', 10)
        self.scan = self.create_publisher(LaserScan, 'wamv/sensors/lidars/lidar_wamv_sensor/scan', 5)
        self.clock = self.create_publisher(Clock, 'clock', 1)
        for pod in PODS_M:
            for order, kept in (('thrust', self.thrust), ('pos', self.angle)):
                self.create_subscription(Float64, f'wamv/thrusters/{pod}/{order}', self.keeper(kept, pod), 1)

    @staticmethod
    def keeper(kept, pod):
        """Return a callback that keeps the newest order to a pod."""
        return lambda message: kept.update({pod: message.data})

    def tick(self):
        """Advance by one period and publish."""
        self.sail()
        self.ticks += 1
        self.odometry.publish(self.pose())
        if self.ticks % 2 == 0:
            self.scan.publish(self.sweep())
        self.clock.publish(Clock(clock=self.pose().header.stamp))

    def sail(self):
        """Forces of the pods on the hull; a pod's angle is positive from above, counter-clockwise."""
        force = moment = 0.0
        for pod, (x, y) in PODS_M.items():
            ahead = self.thrust[pod] * math.cos(self.angle[pod])
            to_port = self.thrust[pod] * math.sin(self.angle[pod])
            force, moment = force + ahead, moment + x * to_port - y * ahead
        drag = SURGE_DRAG * self.surge + SURGE_DRAG_2 * self.surge * abs(self.surge)
        self.surge += (force - drag) / MASS_KG * PERIOD_S
        self.yaw_rate += (moment - YAW_DRAG * self.yaw_rate) / INERTIA_KGM2 * PERIOD_S
        self.yaw += self.yaw_rate * PERIOD_S
        self.x += math.cos(self.yaw) * self.surge * PERIOD_S
        self.y += math.sin(self.yaw) * self.surge * PERIOD_S

    def pose(self):
        """The truth, in Gazebo's world."""
        message = self.stamped(Odometry(child_frame_id='wamv/base_link'), 'sydney_regatta')
        message.pose.pose.position.x, message.pose.pose.position.y = self.x, self.y
        turn = message.pose.pose.orientation
        turn.z, turn.w = math.sin(self.yaw / 2), math.cos(self.yaw / 2)
        message.twist.twist.linear.x, message.twist.twist.angular.z = self.surge, self.yaw_rate
        return message

    def sweep(self):
        """Distances to the walls of the basin, from the bow's lidar."""
        message = self.stamped(LaserScan(), 'wamv/lidar_wamv_link')
        message.angle_min, message.angle_max = -math.pi, math.pi
        message.angle_increment = 2.0 * math.pi / (SAMPLES - 1)
        message.range_min, message.range_max, message.scan_time = RANGE_MIN_M, RANGE_MAX_M, 2 * PERIOD_S
        angles = self.yaw + message.angle_min + message.angle_increment * np.arange(SAMPLES)
        cosine, sine = np.cos(angles) + 1e-12, np.sin(angles) + 1e-12
        x, y = self.x + LIDAR_X_M * math.cos(self.yaw), self.y + LIDAR_X_M * math.sin(self.yaw)
        to_wall = np.minimum(
            (np.copysign(HALF_BASIN_M, cosine) - x) / cosine, (np.copysign(HALF_BASIN_M, sine) - y) / sine
        )
        message.ranges = np.where(to_wall < RANGE_MAX_M, to_wall, np.inf).astype(np.float32).tolist()
        return message

    def stamped(self, message, frame):
        """Set stamp and frame of a message."""
        time_ns = round(self.ticks * PERIOD_S * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, 10**9)
        message.header.frame_id = frame
        return message


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    stand_in = VrxStandIn()
    stand_in.create_timer(PERIOD_S, stand_in.tick)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(stand_in)


if __name__ == '__main__':
    main()
