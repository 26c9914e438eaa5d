"""A driver to put your vessel into: it speaks the vessel's half of the contract, and nothing else.

Every place to fill in is marked FILL IN. As it stands it drives a small hull in a square basin, to be tried
at once:

    python examples/driver_template.py
    portnav check-driver --difficulty examples/workboat.yaml --move
"""

import math
import signal
import time

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, LaserScan
from std_srvs.srv import SetBool

PERIOD_S = 0.05  # odometry and feedback at 20 Hz, scan at 10 Hz, diagnostics at 1 Hz
NEUTRAL_S = 1.0  # commands older than this are worth nothing
RAYS, RANGE_MIN_M, RANGE_MAX_M = 180, 0.5, 150.0  # FILL IN: as `lidar` of your difficulty says
JOINTS = ['rudder', 'propulsion']


class Vessel:
    """FILL IN: your rudder, engine, position and lidar. This one: a hull of 5 m in a basin of 240 m."""

    def __init__(self):
        self.x, self.y, self.yaw, self.surge, self.yaw_rate = 0.0, 0.0, 0.5, 0.0, 0.0
        self.rudder, self.thrust = 0.0, 0.0

    def drive(self, rudder_rad, thrust_n):
        """Hand a command to the actuators: rudder + turns the bow to port, thrust + drives ahead."""
        step_rad, step_n = 0.087 * PERIOD_S, 1875.0 * PERIOD_S  # what they can move in one period
        self.rudder += np.clip(np.clip(rudder_rad, -0.61, 0.61) - self.rudder, -step_rad, step_rad)
        self.thrust += np.clip(np.clip(thrust_n, -2250.0, 5625.0) - self.thrust, -step_n, step_n)
        self._sail()

    def _sail(self):
        rate = max(abs(self.surge), 0.5) / 3.5
        self.yaw_rate += (1.09 * self.surge / 5.0 * self.rudder - self.yaw_rate) * rate * PERIOD_S
        self.surge += (self.thrust - 225.0 * self.surge * abs(self.surge)) / 2200.0 * PERIOD_S
        self.yaw += self.yaw_rate * PERIOD_S
        self.x += math.cos(self.yaw) * self.surge * PERIOD_S
        self.y += math.sin(self.yaw) * self.surge * PERIOD_S

    def sweep(self):
        """Return RAYS distances in m, the first ray astern, then to port; inf: no return (REP-117)."""
        angles = self.yaw - math.pi + 2.0 * math.pi / RAYS * np.arange(RAYS)
        cosine, sine = np.cos(angles) + 1e-12, np.sin(angles) + 1e-12
        to_wall = np.minimum(
            (np.copysign(120.0, cosine) - self.x) / cosine, (np.copysign(120.0, sine) - self.y) / sine
        )
        return np.where(to_wall < RANGE_MAX_M, to_wall, np.inf).astype(np.float32)


class Driver(Node):
    """Publishes odometry, scan, feedback and diagnostics; obeys commands; goes neutral when they stop."""

    def __init__(self, **options):
        super().__init__('driver', **options)
        self.enabled = self.declare_parameter('enabled', True).value
        self.vessel, self.refused, self.ticks = Vessel(), 0, 0
        self.command, self.commanded_ns, self.received_s = (0.0, 0.0), -math.inf, -math.inf
        self.odom = self.create_publisher(Odometry, 'odom', 10)
        self.scan = self.create_publisher(LaserScan, 'scan', 5)
        self.joints = self.create_publisher(JointState, 'joint_states', 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, 'diagnostics', 10)
        self.create_subscription(JointState, 'cmd_actuators', self.take_command, qos_profile_sensor_data)
        self.create_service(SetBool, '~/enable', self.enable)

    def now_ns(self):
        """Return the one clock that stamps everything and tells ages."""
        return self.get_clock().now().nanoseconds

    def take_command(self, message):
        """Take a command as a whole or not at all."""
        try:
            at = [list(message.name).index(name) for name in JOINTS]
            command = message.position[at[0]], message.effort[at[1]]
            whole = len(message.name) == len(JOINTS) and all(map(math.isfinite, command))
        except (ValueError, IndexError):
            whole = False
        if not whole:
            self.refused += 1
            return
        stamp = message.header.stamp
        self.command = command
        self.commanded_ns = min(stamp.sec * 10**9 + stamp.nanosec, self.now_ns())
        self.received_s = time.monotonic()  # by a clock that nobody sets

    def enable(self, request, response):
        """Disabled is neutral, whatever is commanded."""
        self.enabled, response.success = request.data, True
        return response

    def tick(self):
        """Drive, then say where the vessel is."""
        age_s = max((self.now_ns() - self.commanded_ns) * 1e-9, time.monotonic() - self.received_s)
        fresh = age_s <= NEUTRAL_S
        self.vessel.drive(*(self.command if self.enabled and fresh else (0.0, 0.0)))
        self.odom.publish(self.odometry())
        self.joints.publish(self.feedback())
        if self.ticks % 2 == 0:
            self.scan.publish(self.sweep())
        if self.ticks % 20 == 0:
            self.diagnostics.publish(self.status(fresh))
        self.ticks += 1

    def odometry(self):
        """Pose in a local metric frame `map` (east, north; yaw 0 is east), twist in the BODY frame."""
        message, vessel = self.stamped(Odometry(child_frame_id='base_link'), 'map'), self.vessel
        message.pose.pose.position.x, message.pose.pose.position.y = vessel.x, vessel.y  # FILL IN
        yaw = vessel.yaw  # FILL IN: from a compass heading, yaw = pi / 2 - heading
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = (
            math.sin(yaw / 2),
            math.cos(yaw / 2),
        )
        message.twist.twist.linear.x, message.twist.twist.angular.z = vessel.surge, vessel.yaw_rate
        message.pose.covariance[::7] = np.array([0.1, 0.1, 1e3, 1e3, 1e3, 0.05]) ** 2  # FILL IN: deviations
        message.twist.covariance[::7] = np.array([0.1, 0.1, 1e3, 1e3, 1e3, 0.02]) ** 2
        return message

    def sweep(self):
        """One sweep; its stamp is the time of the FIRST ray, so take it before, not after."""
        message = self.stamped(LaserScan(), 'lidar_link')
        message.angle_min, message.angle_increment = -math.pi, 2.0 * math.pi / RAYS
        message.angle_max = message.angle_min + (RAYS - 1) * message.angle_increment
        message.scan_time, message.time_increment = 2 * PERIOD_S, 0.0  # FILL IN: time from ray to ray
        message.range_min, message.range_max = RANGE_MIN_M, RANGE_MAX_M
        message.ranges = self.vessel.sweep().tolist()
        return message

    def feedback(self):
        """Rudder and thrust as measured; leave joint_states out if they cannot be measured."""
        message = self.stamped(JointState(name=JOINTS), '')
        message.position, message.effort = [float(self.vessel.rudder), 0.0], [0.0, float(self.vessel.thrust)]
        return message

    def status(self, fresh):
        """Say how the driver is; FILL IN what your hardware tells of itself."""
        text = (
            'obeying'
            if self.enabled and fresh
            else 'neutral: ' + ('no commands' if self.enabled else 'disabled')
        )
        level = DiagnosticStatus.OK if self.enabled and fresh else DiagnosticStatus.WARN
        message = self.stamped(DiagnosticArray(), '')
        message.status = [DiagnosticStatus(level=level, name=self.get_name(), message=text)]
        return message

    def stamped(self, message, frame):
        """Set stamp and frame of a message."""
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.now_ns(), 10**9)
        message.header.frame_id = frame
        return message


def main():
    """Run until Ctrl-C or SIGTERM, then leave the actuators neutral."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    driver = Driver()
    driver.create_timer(PERIOD_S, driver.tick)
    try:
        rclpy.spin(driver)
    except KeyboardInterrupt:  # the timer lets it be heard
        driver.vessel.drive(0.0, 0.0)


if __name__ == '__main__':
    main()
