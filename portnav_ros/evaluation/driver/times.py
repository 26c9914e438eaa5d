"""Checks of time: rates, gaps and stamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from portnav_ros.evaluation.driver.record import (
    Check,
    DriverRecord,
    Expected,
    Finding,
    JointSample,
    OdometrySample,
    ScanSample,
)
from portnav_ros.types import Array

LEAST_HZ = {'odom': 10.0, 'scan': 5.0, 'joint_states': 10.0}
AGE_S = 0.5  # past which the stack stops the vessel
FUTURE_S = 0.1
APART_S = 0.3  # odometry and scan; leaves room for the scan's period within AGE_S

Timed = Sequence[OdometrySample] | Sequence[ScanSample] | Sequence[JointSample]


def check_rate(topic: str) -> Check:
    """Messages come often enough, and without a gap in which the stack would stop the vessel."""

    def check(record: DriverRecord, _: Expected) -> Finding:
        name, samples = f'{topic} rate', _samples(record, topic)
        if not record.publishers.get(topic):
            return Finding(name, 'left out', f'there is no {topic}')
        if len(samples) < 2:
            return Finding(
                name, 'fail', f'{len(samples)} messages', 'publish all the time, also while at rest'
            )
        rate_hz = len(samples) / max(record.end_s - record.begin_s, 1e-9)
        gap_s = float(np.max(np.diff(_times(samples)[1])))
        found = f'{rate_hz:.1f} Hz, longest gap {gap_s:.2f} s'
        if rate_hz < 0.95 * LEAST_HZ[topic]:
            return Finding(name, 'fail', found, f'publish at {LEAST_HZ[topic]:.0f} Hz or more')
        if gap_s > AGE_S:
            mend = (
                f'fill the gaps: past {AGE_S} s the vessel is stopped; look for lost messages on the network'
            )
            return Finding(name, 'fail', found, mend)
        return Finding(name, 'ok', found)

    return check


def check_stamps(topic: str) -> Check:
    """Stamps grow, lie not in the future, and are fresh by the clock that the stack goes by."""

    def check(record: DriverRecord, _: Expected) -> Finding:
        name, samples = f'{topic} stamps', _samples(record, topic)
        if len(samples) < 2:
            return Finding(name, 'left out', f'too few messages on {topic}')
        heard, stamps = _times(samples)
        stuck = int(np.sum(np.diff(stamps) <= 0.0))
        if stuck:
            mend = 'stamp each measurement with its own time; a sim that is held: -p hold_until_plan:=false'
            return Finding(name, 'fail', f'{stuck} of {len(stamps) - 1} do not grow', mend)
        clock = 'the published clock' if record.simulated else "this machine's clock"
        ahead_s, age_s = float(np.quantile(stamps - heard, 0.95)), float(np.median(heard - stamps))
        if ahead_s > FUTURE_S:
            mend = f'take the stamp from {clock}; synchronise the clocks of the machines (chrony)'
            return Finding(name, 'fail', f'{ahead_s:.3g} s in the future of {clock}', mend)
        if age_s > AGE_S:
            mend = f'stamp by {clock}, send at once, and synchronise the clocks of the machines (chrony)'
            return Finding(name, 'fail', f'{age_s:.3g} s old by {clock} when they come', mend)
        return Finding(name, 'ok', f'grow; heard {1e3 * age_s:.0f} ms later')

    return check


def check_one_clock(record: DriverRecord, _: Expected) -> Finding:
    """Odometry and scan are stamped by one clock."""
    if len(record.odometry) < 2 or len(record.scans) < 2:
        return Finding('one clock', 'left out', 'needs odom and scan')
    ages_s = [float(np.median(np.subtract(*_times(group)))) for group in (record.odometry, record.scans)]
    apart_s = ages_s[1] - ages_s[0]
    late, early = ('scan', 'odometry') if apart_s >= 0.0 else ('odometry', 'scan')
    found = f'the {late} lags the {early} by {1e3 * abs(apart_s):.0f} ms'
    if abs(apart_s) > APART_S:
        return Finding('one clock', 'fail', found, 'stamp both by one clock, at the time of the measurement')
    return Finding('one clock', 'ok', found)


def check_first_ray(record: DriverRecord, _: Expected) -> Finding:
    """A scan cannot come before its last ray: if it does, the stamp is not that of the first."""
    if not record.scans:
        return Finding('first ray', 'left out', 'there is no scan')
    heard, stamps = _times(record.scans)
    sweeps = np.array([scan.time_increment_s * (len(scan.ranges) - 1) for scan in record.scans])
    if np.any(sweeps < 0.0):
        return Finding(
            'first ray', 'fail', 'time_increment is negative', 'make it 0 or the time between rays'
        )
    slack_s = float(np.median(heard - stamps - sweeps))
    found = f'a sweep takes {1e3 * float(np.median(sweeps)):.0f} ms'
    if slack_s < -(FUTURE_S if record.simulated else 0.005 + 0.1 * float(np.median(sweeps))):
        found += f', but scans come {-1e3 * slack_s:.0f} ms before their last ray'
        return Finding('first ray', 'fail', found, 'stamp the scan with the time of its first ray')
    return Finding('first ray', 'ok', found)


def _samples(record: DriverRecord, topic: str) -> Timed:
    by_topic: dict[str, Timed] = {
        'odom': record.odometry,
        'scan': record.scans,
        'joint_states': record.joints,
    }
    return by_topic[topic]


def _times(samples: Timed) -> tuple[Array, Array]:
    """When they were heard and what their stamps say."""
    return np.array([s.heard_s for s in samples]), np.array([s.stamp_s for s in samples])
