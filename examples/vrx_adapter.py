"""A driver for the WAM-V of VRX (Virtual RobotX, Gazebo): its topics on one side, the contract on the other.

    ros2 launch vrx_gz competition.launch.py world:=sydney_regatta     (or: python examples/vrx_stand_in.py)
    python examples/vrx_adapter.py
    portnav check-driver --difficulty examples/vrx.yaml --move

A command becomes the same thrust and the same angle at both pods. They stand at the stern, where a push to
port swings the bow to starboard, so a rudder to port is a pod angle of the opposite sign. Gazebo keeps the
last thrust for ever: it is here that old commands end, in the time of VRX's odometry, and with the odometry.
"""

import math
import signal
import time

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

ODOMETRY = 'wamv/sensors/position/ground_truth_odometry'
SCAN = 'wamv/sensors/lidars/lidar_wamv_sensor/scan'
PODS = ('left', 'right')
THRUST_MIN_N, THRUST_MAX_N, ANGLE_MAX_RAD = -100.0, 250.0, 0.61  # of one pod
NEUTRAL_NS, SECOND_NS = 1_000_000_000, 1_000_000_000
SILENCE_S, WATCH_S = 1.0, 0.1  # by the clock on the wall
RAYS = 180
LIDAR_X_M, LIDAR_Y_M, LIDAR_YAW_RAD = 0.7, 0.0, 0.0  # where it stands on the hull
JOINTS = ['rudder', 'propulsion']


class VrxAdapter(Node):
    """Time is the stamp of VRX's odometry, so it runs at any speed of the simulation."""

    def __init__(self, **options):
        super().__init__('vrx_adapter', **options)
        self.enabled, self.time_ns, self.told_ns = True, 0, -SECOND_NS
        self.command, self.commanded_ns = (0.0, 0.0), -math.inf
        self.heard_s = time.monotonic()
        self.odom = self.create_publisher(Odometry, 'odom', 10)
        self.scan = self.create_publisher(LaserScan, 'scan', 5)
        self.joints = self.create_publisher(JointState, 'joint_states', 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, 'diagnostics', 10)
        self.thrusts = [self.create_publisher(Float64, f'wamv/thrusters/{pod}/thrust', 1) for pod in PODS]
        self.angles = [self.create_publisher(Float64, f'wamv/thrusters/{pod}/pos', 1) for pod in PODS]
        self.create_subscription(Odometry, ODOMETRY, self.take_odometry, qos_profile_sensor_data)
        self.create_subscription(LaserScan, SCAN, self.take_scan, qos_profile_sensor_data)
        self.create_subscription(JointState, 'cmd_actuators', self.take_command, qos_profile_sensor_data)
        self.create_service(SetBool, '~/enable', self.enable)
        self.create_timer(WATCH_S, self.watch, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def take_command(self, message):
        """Take a command as a whole or not at all."""
        try:
            at = [list(message.name).index(name) for name in JOINTS]
            command = message.position[at[0]], message.effort[at[1]]
        except (ValueError, IndexError):
            return
        if len(message.name) == len(JOINTS) and all(map(math.isfinite, command)):
            stamp_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
            self.command, self.commanded_ns = command, min(stamp_ns, self.time_ns)

    def take_odometry(self, message):
        """Pass on the pose in the world, as that in the map; VRX's twist is in the body frame already."""
        time_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
        if time_ns < self.time_ns:
            self.commanded_ns = self.told_ns = -math.inf  # the simulation has begun anew
        self.time_ns, self.heard_s = time_ns, time.monotonic()
        rudder, thrust = self.drive()
        message.header.frame_id, message.child_frame_id = 'map', 'base_link'
        message.pose.covariance[::7] = np.full(6, 0.05**2)  # the truth, but nobody trusts a variance of 0
        message.twist.covariance[::7] = np.full(6, 0.02**2)
        self.odom.publish(message)
        feedback = JointState(name=JOINTS, position=[rudder, 0.0], effort=[0.0, thrust])
        feedback.header.stamp = message.header.stamp
        self.joints.publish(feedback)  # what was ordered: VRX follows at once
        if self.time_ns - self.told_ns >= SECOND_NS:
            self.told_ns = self.time_ns
            self.diagnostics.publish(self.status(message.header.stamp))

    def watch(self):
        """Leave the pods without thrust when the odometry has ended, by which time is told."""
        if time.monotonic() - self.heard_s > SILENCE_S:
            self.command = (0.0, 0.0)
            self.drive()

    def drive(self):
        """Order the pods; returns rudder and thrust as the contract counts them."""
        rudder, thrust = self.command if self.obeying() else (0.0, 0.0)
        rudder = min(max(rudder, -ANGLE_MAX_RAD), ANGLE_MAX_RAD)
        each = min(max(0.5 * thrust, THRUST_MIN_N), THRUST_MAX_N)
        for angle, force in zip(self.angles, self.thrusts, strict=True):
            angle.publish(Float64(data=-rudder))
            force.publish(Float64(data=each))
        return rudder, each * len(PODS)

    def obeying(self):
        """Enabled, and commanded not long ago."""
        return self.enabled and self.time_ns - self.commanded_ns <= NEUTRAL_NS

    def enable(self, request, response):
        """Disabled is neutral, whatever is commanded."""
        self.enabled, response.success = request.data, True
        return response

    def take_scan(self, message):
        """Pass on the nearest return in each of RAYS sectors around the middle of the hull."""
        scan = LaserScan(header=message.header, scan_time=message.scan_time)
        scan.header.frame_id = 'lidar_link'
        scan.angle_increment = 2.0 * math.pi / RAYS
        scan.angle_min, scan.angle_max = -math.pi, math.pi - scan.angle_increment
        scan.range_min, scan.range_max = message.range_min, message.range_max
        scan.ranges = sectors(message).tolist()
        self.scan.publish(scan)

    def status(self, stamp):
        """Say whether commands are obeyed."""
        obeying = self.obeying()
        message = DiagnosticArray()
        message.header.stamp = stamp
        text = 'obeying' if obeying else 'neutral: no commands, or disabled'
        level = DiagnosticStatus.OK if obeying else DiagnosticStatus.WARN
        message.status = [DiagnosticStatus(level=level, name=self.get_name(), message=text)]
        return message


def sectors(message):
    """Ranges [RAYS] about base_link, the first astern, then to port: the nearest return of each sector."""
    ranges = np.array(message.ranges, np.float64)
    angles = LIDAR_YAW_RAD + message.angle_min + message.angle_increment * np.arange(len(ranges))
    seen = np.isfinite(ranges) & (ranges >= message.range_min) & (ranges < message.range_max)
    x = LIDAR_X_M + ranges[seen] * np.cos(angles[seen])
    y = LIDAR_Y_M + ranges[seen] * np.sin(angles[seen])
    number = np.rint((np.arctan2(y, x) + math.pi) / (2.0 * math.pi / RAYS)).astype(int) % RAYS
    nearest = np.full(RAYS, np.inf, np.float32)
    np.minimum.at(nearest, number, np.hypot(x, y))
    nearest[nearest < message.range_min] = -np.inf
    nearest[nearest >= message.range_max] = np.inf
    return nearest


def main():
    """Run until Ctrl-C or SIGTERM, then leave the pods without thrust."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    adapter = VrxAdapter()
    try:
        while True:
            rclpy.spin_once(
                adapter, timeout_sec=0.1
            )  # an end to each wait, so that Ctrl-C is heard in silence
    except KeyboardInterrupt:
        adapter.enabled = False
        adapter.drive()


if __name__ == '__main__':
    main()
