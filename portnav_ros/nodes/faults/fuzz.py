"""Messages that a broken or foreign sender might publish: right in type, wrong in anything else."""

from __future__ import annotations

import array
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Goals, Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, LaserScan

from portnav_ros.nodes.messages import (
    clock_message,
    fill_joints,
    fill_odometry,
    fill_scan,
    fill_setpoint,
    new_joints,
    new_odometry,
    new_scan,
    new_setpoint,
    path_message,
    pose_message,
    status_message,
    write_stamp,
)
from portnav_ros.nodes.serialised import with_stamp
from portnav_ros.nodes.topics import TOPICS
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation, Setpoint, VesselState

NUMBERS = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-30, 1e30, -1e30, 2.0, 100.0)
TEXTS = ('', 'map', 'odom', '\0', 'map\n', 'ü' * 300, '-1', 'nan', '1e400', '9' * 40)
POOL = 500  # spoilt messages of a topic, which come again at other times, whole or cut off
LONGEST = 40  # what a sequence grows by
LAP_NS = 200_000_000_000  # after which the vessel is put back
START_M = 100.0
PATH = np.array([[0.0, 0.0], [500.0, 0.0], [1000.0, 0.0]])


def good(topic: str, time_ns: int) -> Any:
    """Return a message of a topic that every node believes, from a vessel that sails laps at 3 m/s."""
    make = _GOOD.get(topic)
    return make(time_ns) if make else TOPICS[topic].type()


def _odometry(time_ns: int) -> Odometry:
    message = new_odometry()
    fill_odometry(message, time_ns, VesselState(_way_m(time_ns), 0.0, 0.0, 3.0))
    return message


def _scan(time_ns: int) -> LaserScan:
    message = new_scan(LidarParams(), 0.1)
    fill_scan(
        message, time_ns, np.full(LidarParams().rays, 90.0 - 0.1 * (_way_m(time_ns) % 90.0), np.float32)
    )
    return message


def _joints(time_ns: int) -> JointState:
    message = new_joints()
    fill_joints(message, time_ns, Actuation(0.05, 500.0))
    return message


def _setpoint(time_ns: int) -> Odometry:
    message = new_setpoint()
    fill_setpoint(message, time_ns, Setpoint(0.1, 3.0), (100.0, 0.0))
    return message


def _state(time_ns: int) -> DiagnosticStatus:
    return status_message('name', DiagnosticStatus.OK, 'sailing', {'stamp': time_ns, 'goal': '1.0 2.0'})


def _goals(time_ns: int) -> Goals:
    return Goals(goals=[pose_message(x_m, 0.0, 0.0, time_ns) for x_m in (500.0, 1000.0)])


def _way_m(time_ns: int) -> float:
    return START_M + 3e-9 * (time_ns % LAP_NS)


_GOOD: dict[str, Callable[[int], Any]] = {
    'odom': _odometry,
    'targets': _odometry,
    'scan': _scan,
    'joint_states': _joints,
    'cmd_actuators': _joints,
    'setpoint': _setpoint,
    'setpoint_raw': _setpoint,
    'plan': lambda time_ns: path_message(PATH, time_ns),
    'goal_pose': lambda time_ns: pose_message(1000.0, 0.0, 0.0, time_ns),
    'goal_poses': _goals,
    'navigation_state': _state,
    'safety_state': _state,
    'episode': _state,
    'recorded': clock_message,
}


class Fuzzer:
    """Spoils good messages at random."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._good: dict[str, bytes] = {}
        self._pools: dict[str, list[bytes]] = {}

    def message(self, topic: str, time_ns: int) -> Any:
        """Return a message that is spoilt in up to three places, its own copy."""
        if topic not in self._good:
            self._good[topic] = serialize_message(good(topic, 0))
        message = deserialize_message(self._good[topic], TOPICS[topic].type)
        if hasattr(message, 'header'):
            write_stamp(message.header.stamp, time_ns)
        for _ in range(self._pick(4)):
            self._spoil(message)
        return message

    def data(self, topic: str, time_ns: int) -> bytes:
        """Return the same as bytes, some of which are cut off or are no message at all."""
        pool = self._pools.setdefault(topic, [])
        if len(pool) < POOL:
            pool.append(bytes(serialize_message(self.message(topic, 0))))
        data = pool[self._pick(len(pool))]
        if hasattr(TOPICS[topic].type, 'header'):
            data = with_stamp(data, time_ns)
        kind = self._pick(8)
        if kind == 0:
            return self._rng.bytes(self._pick(64))
        if kind == 1:
            return data[: self._pick(len(data))]
        return data

    def _pick(self, count: int) -> int:
        return int(self._rng.integers(count))

    def _spoil(self, message: Any) -> None:
        fields = message._fields_and_field_types
        name = list(fields)[self._pick(len(fields))]
        value = getattr(message, name)
        if hasattr(value, '_fields_and_field_types'):
            self._spoil(value)
        elif isinstance(value, np.ndarray):
            value[self._pick(len(value))] = self._number()
        elif isinstance(value, (list, array.array)):
            setattr(message, name, self._sequence(value, fields[name]))
        else:
            setattr(message, name, self._leaf(value, fields[name]))

    def _sequence(self, values: Any, kind: str) -> Any:
        """Return it shorter, longer, empty, or with one element spoilt."""
        choice = self._pick(4)
        if choice == 0 or not len(values):
            return values[:0]
        if choice == 1:
            return values[: self._pick(len(values))]
        if choice == 2:
            return (values * 2)[: len(values) + 1 + self._pick(LONGEST)]
        place = self._pick(len(values))
        if hasattr(values[place], '_fields_and_field_types'):
            self._spoil(values[place])
        else:
            values[place] = self._leaf(values[place], kind.removeprefix('sequence<').removesuffix('>'))
        return values

    def _leaf(self, value: Any, kind: str) -> Any:
        if isinstance(value, str):
            return TEXTS[self._pick(len(TEXTS))]
        if isinstance(value, bool):
            return not value
        if isinstance(value, bytes):
            return bytes([self._pick(256)])
        if isinstance(value, float):
            return self._number()
        return self._integer(kind)

    def _number(self) -> float:
        return NUMBERS[self._pick(len(NUMBERS))]

    def _integer(self, kind: str) -> int:
        bits = int(''.join(filter(str.isdigit, kind)))
        least = 0 if kind.startswith('u') else -(1 << bits - 1)
        most = least + (1 << bits) - 1
        return (least, most, 0, 1, most // 2)[self._pick(5)]
