"""Checks of what the messages hold: frames, pose, covariance, rays, ranges and actuator feedback."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from portnav_ros.evaluation.driver.record import Check, DriverRecord, Expected, Finding, OdometrySample
from portnav_ros.geometry import TWO_PI, wrap_angle

NORM_TOLERANCE = 1e-2
MOVED_M = 2.0
CARELESS_RAYS = 3  # a scan; as many readings at the very limit are no chance


def check_frames(topic: str, frame: str, child_frame: str = '') -> Check:
    """Header and child frame are those of the contract; the child frame is a pattern."""

    def check(record: DriverRecord, _: Expected) -> Finding:
        name, wanted = f'{topic} frame', f'{frame} -> {child_frame}' if child_frame else frame
        pairs = _frames(record)[topic]
        if not pairs:
            return Finding(name, 'left out', f'there is no {topic}')
        wrong = [pair for pair in pairs if pair[0] != frame or not re.fullmatch(child_frame, pair[1])]
        if wrong:
            found = ', '.join(
                f'{parent!r} -> {child!r}' if child_frame else repr(parent) for parent, child in wrong
            )
            return Finding(name, 'fail', found, f'make it {wanted}')
        return Finding(name, 'ok', wanted)

    return check


def _frames(record: DriverRecord) -> dict[str, list[tuple[str, str]]]:
    """Distinct pairs of frame and child frame by topic."""
    return {
        'odom': sorted({(sample.frame, sample.child_frame) for sample in record.odometry}),
        'scan': sorted({(sample.frame, '') for sample in record.scans}),
        'targets': sorted({(sample.frame, sample.child_frame) for sample in record.targets}),
    }


def check_quaternion(record: DriverRecord, _: Expected) -> Finding:
    """Orientations are unit quaternions, and all of the pose is finite."""
    if not record.odometry:
        return Finding('orientation', 'left out', 'there is no odom')
    norms = np.linalg.norm([sample.quaternion for sample in record.odometry], axis=1)
    wrong = int(np.sum(~(np.abs(norms**2 - 1.0) < NORM_TOLERANCE)))
    if wrong:
        worst = float(norms[np.argmax(np.nan_to_num(np.abs(norms - 1.0), nan=math.inf))])
        mend = 'for a yaw: x = y = 0, z = sin(yaw / 2), w = cos(yaw / 2)'
        return Finding(
            'orientation', 'fail', f'{wrong} of {len(norms)} have not norm 1, but {worst:.3g}', mend
        )
    values = [[*s.position, *s.velocity, s.yaw_rate_radps] for s in record.odometry]
    if not np.isfinite(values).all():
        return Finding('orientation', 'fail', 'pose or twist is not finite', 'send nothing rather than NaN')
    return Finding('orientation', 'ok', 'unit quaternions')


def check_covariance(record: DriverRecord, _: Expected) -> Finding:
    """Variances of x, y, yaw, surge and yaw rate are filled."""
    if not record.odometry:
        return Finding('covariance', 'left out', 'there is no odom')
    pose, twist = np.array([sample.variances for sample in record.odometry]).swapaxes(0, 1)
    needed = np.column_stack([pose[:, [0, 1, 5]], twist[:, [0, 5]]])
    if not (np.isfinite(needed).all() and (needed > 0.0).all()):
        mend = 'fill pose.covariance[0, 7, 35] and twist.covariance[0, 35] with variances above 0'
        return Finding('covariance', 'fail', 'a variance is 0, negative or not finite', mend)
    deviations = np.sqrt(needed.mean(axis=0))
    found = '{:.2g} m, {:.2g} m, {:.2g} rad; {:.2g} m/s, {:.2g} rad/s'.format(*deviations)
    return Finding('covariance', 'ok', f'standard deviations {found}')


def check_rays(record: DriverRecord, expected: Expected) -> Finding:
    """Rays go all around from astern, to port, as many as the planner was told, and reach as far."""
    if not record.scans:
        return Finding('rays', 'left out', 'there is no scan')
    scan, rays = record.scans[-1], expected.lidar.rays
    counts = sorted({len(sample.ranges) for sample in record.scans})
    if counts != [rays]:
        mend = f'send {rays} rays (the nearest return of each sector), or set lidar: rays of your difficulty'
        return Finding('rays', 'fail', f'{", ".join(map(str, counts))} rays, expected {rays}', mend)
    step = TWO_PI / rays
    turned, spread = wrap_angle(scan.angle_min_rad + math.pi), rays * (scan.angle_increment_rad - step)
    found = f'{rays} rays from {scan.angle_min_rad:.4f} every {scan.angle_increment_rad:.4f} rad'
    if not max(abs(turned), abs(spread)) <= 0.5 * step:
        mend = f'angle_min {-math.pi:.4f} (astern), angle_increment {step:.4f} (all around, to port)'
        return Finding('rays', 'fail', found, mend)
    if not math.isclose(scan.range_max_m, expected.lidar.range_max_m, rel_tol=0.01):
        found = f'range_max {scan.range_max_m:g} m, expected {expected.lidar.range_max_m:g} m'
        return Finding(
            'rays', 'fail', found, 'set lidar: range_max_m of your difficulty to what the sensor has'
        )
    return Finding('rays', 'ok', f'{found}, up to {scan.range_max_m:g} m')


def check_ranges(record: DriverRecord, _: Expected) -> Finding:
    """REP-117: a reading lies within the limits, else +inf no return, -inf too close, NaN invalid."""
    if not record.scans:
        return Finding('ranges', 'left out', 'there is no scan')
    ranges = np.concatenate([scan.ranges for scan in record.scans]).astype(float)
    least, most = record.scans[-1].range_min_m, record.scans[-1].range_max_m
    finite = ranges[np.isfinite(ranges)]
    limit = most - 1e-4 * max(most, 1.0)
    for wrong, found, mend in (
        (bool(np.isnan(ranges).all()), 'nothing but NaN', 'NaN is for a ray that cannot be used'),
        (bool(np.any(finite < 0.0)), 'a range below 0', '-inf where something is too close'),
        (
            bool(np.any(finite == 0.0)),
            'a range of 0',
            '+inf where there is no return, -inf where it is too close',
        ),
        (bool(np.any(finite < least * 0.999)), f'a range below range_min {least:g} m', '-inf instead'),
        (
            int(np.sum(finite >= limit)) > CARELESS_RAYS * len(record.scans)
            or bool(np.any(finite > most * 1.001)),
            f'ranges at or above range_max {most:g} m',
            '+inf where there is no return',
        ),
    ):
        if wrong:
            return Finding('ranges', 'fail', found, f'{mend} (REP-117)')
    if len(finite) == 0:
        return Finding('ranges', 'left out', 'no ray has a return: check again beside a quay')
    return Finding(
        'ranges',
        'ok',
        f'{100.0 * len(finite) / len(ranges):.0f} % have a return, nearest {finite.min():.1f} m',
    )


def check_scan_lives(record: DriverRecord, _: Expected) -> Finding:
    """A vessel that moves sees its surroundings change."""
    moved_m = _moved_m(record.odometry)
    if len(record.scans) < 2 or moved_m < MOVED_M:
        return Finding('scan lives', 'left out', f'moved {moved_m:.1f} m only')
    first, *others = [scan.ranges for scan in record.scans]
    same = all(np.array_equal(first, ranges, equal_nan=True) for ranges in others)
    if same and np.isfinite(first).any():
        mend = 'publish each sweep once, and nothing while the sensor is silent'
        return Finding('scan lives', 'fail', f'the same ranges again and again over {moved_m:.1f} m', mend)
    return Finding('scan lives', 'ok', f'it changes over {moved_m:.1f} m')


def check_joints(record: DriverRecord, _: Expected) -> Finding:
    """Feedback has the names and fields of the commands."""
    if not record.joints:
        return Finding('joint names', 'left out', 'there is no joint_states')
    faults = sorted({sample.fault for sample in record.joints if sample.actuation is None})
    if faults:
        mend = 'name [rudder, propulsion], position[0] the rudder in rad, effort[1] the thrust in N'
        return Finding('joint names', 'fail', faults[0], mend)
    return Finding('joint names', 'ok', 'rudder in rad, propulsion in N')


def _moved_m(samples: Sequence[OdometrySample]) -> float:
    positions = np.array([sample.position for sample in samples]).reshape(-1, 2)
    return float(np.ptp(positions, axis=0).max()) if len(positions) else 0.0
