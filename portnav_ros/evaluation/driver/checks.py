"""The list of all checks that need no move of the vessel, in the order of the report."""

from __future__ import annotations

from portnav_ros.evaluation.driver.contents import (
    check_covariance,
    check_frames,
    check_joints,
    check_quaternion,
    check_ranges,
    check_rays,
    check_scan_lives,
)
from portnav_ros.evaluation.driver.ends import check_clock, check_commands, check_enable, check_published
from portnav_ros.evaluation.driver.record import Check, DriverRecord, Expected, Finding
from portnav_ros.evaluation.driver.times import (
    LEAST_HZ,
    check_first_ray,
    check_one_clock,
    check_rate,
    check_stamps,
)
from portnav_ros.evaluation.driver.twist import check_twist, check_yaw_rate

CHECKS: tuple[Check, ...] = (
    *(check_published(topic) for topic in ('odom', 'scan', 'joint_states', 'targets', 'diagnostics')),
    check_commands,
    check_enable,
    check_clock,
    *(check_rate(topic) for topic in LEAST_HZ),
    *(check_stamps(topic) for topic in LEAST_HZ),
    check_one_clock,
    check_first_ray,
    check_frames('odom', 'map', 'base_link'),
    check_frames('scan', 'lidar_link'),
    check_frames('targets', 'map', 'target/.+'),
    check_quaternion,
    check_covariance,
    check_twist,
    check_yaw_rate,
    check_rays,
    check_ranges,
    check_scan_lives,
    check_joints,
)


def check_driver(record: DriverRecord, expected: Expected) -> list[Finding]:
    """Make every check of what was heard of a driver."""
    return [check(record, expected) for check in CHECKS]
