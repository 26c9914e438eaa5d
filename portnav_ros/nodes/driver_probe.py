"""Listens to a driver, and leads its vessel through moves, for ``portnav check-driver``."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.client import Client
from rclpy.clock import Clock as RosClock
from rclpy.clock_type import ClockType
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan
from std_srvs.srv import SetBool

from portnav_ros.evaluation.driver.ends import TYPES, find_driver
from portnav_ros.evaluation.driver.record import (
    DriverRecord,
    End,
    JointSample,
    OdometrySample,
    ScanSample,
    TrackSample,
)
from portnav_ros.nodes.messages import (
    SECOND_NS,
    MessageError,
    fill_joints,
    new_joints,
    read_joints,
    read_stamp,
    write_stamp,
)
from portnav_ros.nodes.table import NAMES
from portnav_ros.nodes.topics import TOPICS, asked_qos, offered_qos
from portnav_ros.types import Actuation

NAME = 'driver_probe'
LISTENERS = (NAME, 'latency_probe', *(name for name in NAMES if name != 'sim'))
DEPTH = 1000  # whatever keeps this node waiting, it is not the driver's fault
SPIN_S = 0.05
SpinOnce = Callable[[float], None]


class DriverProbe(Node):
    """Keeps what a driver says, and answers each odometry with `command` while there is one.

    Args:
        options: for rclpy's Node.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        self.record = DriverRecord()
        self.command: Actuation | None = None
        self._system = RosClock(clock_type=ClockType.SYSTEM_TIME)
        self._message = new_joints()
        self._enabler: Client | None = None
        self._commands = self.create_publisher(
            JointState, 'cmd_actuators', offered_qos(TOPICS['cmd_actuators'])
        )
        for topic, callback in (
            ('clock', self._take_clock),
            ('odom', self._take_odometry),
            ('scan', self._take_scan),
            ('joint_states', self._take_joints),
            ('targets', self._take_target),
        ):
            row = replace(TOPICS[topic], depth=DEPTH)
            self.create_subscription(row.type, row.name, callback, asked_qos(row))

    @property
    def now_s(self) -> float:
        """Time of the driver: as published on clock, else that of this machine."""
        clock_s = self.record.clock_s
        return clock_s[-1] if clock_s else self._system.now().nanoseconds / SECOND_NS

    def begin(self) -> None:
        """Forget what was heard so far, but the time."""
        self.record = DriverRecord(clock_s=self.record.clock_s[-1:])
        self.record.begin_s = self.record.end_s = self.now_s

    def look_around(self) -> None:
        """Note who is there: ends of the topics and services of the driver."""
        record = self.record
        for topic in TYPES:
            row, name = TOPICS[topic], self.resolve_topic_name(topic)
            publishers = self._others(self.get_publishers_info_by_topic(name))
            subscriptions = self._others(self.get_subscriptions_info_by_topic(name))
            record.publishers[topic] = [
                End(full_name(info), info.topic_type, mismatch(info.qos_profile, asked_qos(row)))
                for info in publishers
            ]
            record.subscriptions[topic] = [
                End(full_name(info), info.topic_type, mismatch(offered_qos(row), info.qos_profile))
                for info in subscriptions
            ]
        record.driver = find_driver(record, LISTENERS)
        record.services = self._services_of(record.driver)
        record.end_s = self.now_s

    def send(self, command: Actuation) -> None:
        """Command the actuators once, stamped as the newest odometry."""
        fill_joints(self._message, 0, command)
        if self.record.odometry:
            write_stamp(self._message.header.stamp, round(self.record.odometry[-1].stamp_s * SECOND_NS))
        self._commands.publish(self._message)

    def enable(self, wanted: bool, spin_once: SpinOnce, patience_s: float) -> bool:
        """Call the driver's service; returns whether it said yes in time.

        Args:
            wanted: enabled, or disabled.
            spin_once: serves this node's callbacks for at most so many seconds.
            patience_s: by the wall clock.
        """
        if self._enabler is None:
            self._enabler = self.create_client(SetBool, f'{self.record.driver}/enable')
        end_s = time.monotonic() + patience_s
        while not self._enabler.service_is_ready() and time.monotonic() < end_s:
            spin_once(SPIN_S)
        answer = self._enabler.call_async(SetBool.Request(data=wanted))
        while not answer.done() and time.monotonic() < end_s:
            spin_once(SPIN_S)
        return answer.done() and bool(answer.result().success)

    def _others(self, ends: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
        return [end for end in ends if end.node_name != NAME]

    def _services_of(self, node: str) -> dict[str, str]:
        namespace, _, name = node.rpartition('/')
        if (name, namespace or '/') not in self.get_node_names_and_namespaces():
            return {}
        offered = self.get_service_names_and_types_by_node(name, namespace or '/')
        return {service.removeprefix(f'{node}/'): types[0] for service, types in offered}

    def _take_clock(self, message: Clock) -> None:
        self.record.clock_s.append(read_stamp(message.clock) / SECOND_NS)

    def _take_odometry(self, message: Odometry) -> None:
        place, turn, twist = (
            message.pose.pose.position,
            message.pose.pose.orientation,
            message.twist.twist,
        )
        self.record.odometry.append(
            OdometrySample(
                *self._times(message),
                message.header.frame_id,
                message.child_frame_id,
                (place.x, place.y),
                (turn.x, turn.y, turn.z, turn.w),
                (twist.linear.x, twist.linear.y),
                twist.angular.z,
                np.array([message.pose.covariance[::7], message.twist.covariance[::7]]),
            )
        )
        if self.command is not None:
            self.send(self.command)

    def _take_scan(self, message: LaserScan) -> None:
        self.record.scans.append(
            ScanSample(
                *self._times(message),
                message.header.frame_id,
                np.array(message.ranges, np.float32),
                message.angle_min,
                message.angle_increment,
                message.time_increment,
                message.range_min,
                message.range_max,
            )
        )

    def _take_joints(self, message: JointState) -> None:
        try:
            sample = JointSample(*self._times(message), read_joints(message))
        except MessageError as error:
            sample = JointSample(*self._times(message), None, str(error))
        self.record.joints.append(sample)

    def _take_target(self, message: Odometry) -> None:
        self.record.targets.append(
            TrackSample(*self._times(message), message.header.frame_id, message.child_frame_id)
        )

    def _times(self, message: Odometry | LaserScan | JointState) -> tuple[float, float]:
        return read_stamp(message.header.stamp) / SECOND_NS, self.now_s


def full_name(end: TopicEndpointInfo) -> str:
    """Namespace and name of the node at an end."""
    return f'{end.node_namespace.rstrip("/")}/{end.node_name}'


def mismatch(offered: QoSProfile, asked: QoSProfile) -> str:
    """Why a publisher and a subscription do not match; empty where they do."""
    compatibility, reason = qos_check_compatible(_unbounded(offered), _unbounded(asked))
    return reason.replace('ERROR: ', '').strip(' ;') if compatibility == QoSCompatibility.ERROR else ''


def _unbounded(profile: QoSProfile) -> QoSProfile:
    """Spell out that a profile without deadline and lease has none, as the ends of a graph do."""
    return QoSProfile(
        depth=1,
        reliability=profile.reliability,
        durability=profile.durability,
        liveliness=profile.liveliness,
        deadline=profile.deadline if profile.deadline.nanoseconds else Infinite,
        liveliness_lease_duration=profile.liveliness_lease_duration
        if profile.liveliness_lease_duration.nanoseconds
        else Infinite,
    )
