"""Ways to spoil messages: each function takes a message and gives what is passed on, None for nothing."""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from portnav_ros.nodes.faults.injector import Spoil
from portnav_ros.nodes.messages import read_yaw, write_yaw


def lose(message: Any) -> None:
    """Lose every message."""


def lose_some(share: float, rng: np.random.Generator) -> Spoil:
    """Lose a share of the messages at random."""
    return lambda message: None if rng.random() < share else message


def freeze_scan() -> Spoil:
    """Repeat the ranges of the first scan."""
    first: list[array.array[float]] = []

    def spoil(message: LaserScan) -> LaserScan:
        first.append(message.ranges)
        message.ranges = first[0]
        return message

    return spoil


def fill_ranges(value: float) -> Spoil:
    """Give every ray the same value."""

    def spoil(message: LaserScan) -> LaserScan:
        message.ranges = array.array('f', [value]) * len(message.ranges)
        return message

    return spoil


def shorten(message: LaserScan) -> LaserScan:
    """Leave out half of the rays."""
    message.ranges = message.ranges[: len(message.ranges) // 2]
    return message


def freeze_pose() -> Spoil:
    """Repeat the pose of the first odometry, while its stamp and speed go on."""
    first: list[Any] = []

    def spoil(message: Odometry) -> Odometry:
        first.append(message.pose)
        message.pose = first[0]
        return message

    return spoil


def jump(distance_m: float, every: int) -> Spoil:
    """Jump aside and back again, each time for a number of messages."""
    count = [0]

    def spoil(message: Odometry) -> Odometry:
        count[0] += 1
        message.pose.pose.position.y += distance_m * ((count[0] - 1) // every % 2 == 0)
        return message

    return spoil


def not_a_number(message: Odometry) -> Odometry:
    """Give an odometry or a setpoint a place and a speed that are no numbers."""
    message.pose.pose.position.x = message.twist.twist.linear.x = math.nan
    return message


def turn_about() -> Spoil:
    """Turn every second setpoint to the opposite heading."""
    count = [0]

    def spoil(message: Odometry) -> Odometry:
        count[0] += 1
        if count[0] % 2:
            orientation = message.pose.pose.orientation
            write_yaw(orientation, read_yaw(orientation) + math.pi)
        return message

    return spoil
