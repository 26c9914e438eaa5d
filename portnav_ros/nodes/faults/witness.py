"""What a graph does and says while a fault goes on: commands, setpoints, and reasons."""

from __future__ import annotations

import time
from fnmatch import fnmatch

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from portnav_ros.nodes.faults.injector import Injector
from portnav_ros.nodes.faults.verdict import Asked, Commanded, DriverClock, is_safe
from portnav_ros.nodes.messages import SECOND_NS, read_path, read_stamp, read_values
from portnav_ros.nodes.topics import TOPICS, offered_qos

STATES = ('safety_state', 'navigation_state')


class Witness:
    """Listens on the driver's side, where nothing is spoilt, and to what the nodes say of themselves."""

    def __init__(self, node: Node, injector: Injector) -> None:
        self._clock = DriverClock()
        self.surge_mps = 0.0
        self.commands: list[Commanded] = []
        self.setpoints: list[Asked] = []
        self.told: list[str] = []
        self.states: dict[str, str] = {}
        self.plan_ends: list[tuple[float, float] | None] = []
        self.activated = False
        self._ahead = False
        injector.relays['odom'].hear = self._take_odometry
        injector.relays['cmd_actuators'].hear = self._take_command
        for topic, take in (
            ('setpoint', self._take_setpoint),
            ('diagnostics', self._take_diagnostics),
            ('plan', self._take_plan),
            ('managed_nodes_activated', self._take_activated),
            *((state, self._take_status) for state in STATES),
        ):
            node.create_subscription(TOPICS[topic].type, topic, take, offered_qos(TOPICS[topic]))

    @property
    def now_s(self) -> float:
        """The driver's time."""
        return self._clock.now_s(time.monotonic())

    @property
    def sailing(self) -> bool:
        """Whether the vessel is being driven ahead, and has been told to be."""
        fresh = bool(self.commands) and self.now_s - self.commands[-1].time_s < 0.5
        return fresh and self._ahead and bool(self.setpoints) and self.setpoints[-1].speed_mps > 0.0

    def forget(self) -> None:
        """Begin a record: nothing has been told, and of commands and setpoints only the last is known."""
        self.told.clear()
        del self.commands[:-1], self.setpoints[:-1]

    def _take_odometry(self, data: bytes) -> None:
        message: Odometry = deserialize_message(data, Odometry)
        self._clock.note(read_stamp(message.header.stamp) / SECOND_NS, time.monotonic())
        self.surge_mps = message.twist.twist.linear.x

    def _take_command(self, data: bytes) -> None:
        message: JointState = deserialize_message(data, JointState)
        thrust_n = message.effort[message.name.index('propulsion')]
        stop_asked = bool(self.setpoints) and self.setpoints[-1].speed_mps == 0.0
        self._ahead = thrust_n > 0.0
        self.commands.append(Commanded(self.now_s, is_safe(thrust_n, stop_asked, self.surge_mps)))

    def _take_setpoint(self, message: Odometry) -> None:
        self.setpoints.append(Asked(self.now_s, message.twist.twist.linear.x))

    def _take_plan(self, message: Path) -> None:
        points = read_path(message)
        self.plan_ends.append((float(points[-1, 0]), float(points[-1, 1])) if len(points) else None)

    def _take_activated(self, message: Bool) -> None:
        self.activated = bool(message.data)

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._take_status(status)

    def _take_status(self, status: DiagnosticStatus) -> None:
        self.states[status.name] = status.message
        values = read_values(status)
        refused = [value for key, value in values.items() if fnmatch(key, 'refused_*_reason')]
        if status.level != DiagnosticStatus.OK:
            self.told += [f'{status.name}: {text}' for text in (status.message, *refused)]
