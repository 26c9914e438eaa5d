"""Each check of a driver, on a record in which nothing is wrong and on one with a single mistake."""

import math
from dataclasses import replace

import numpy as np
import pytest

from portnav_ros.evaluation.driver.checks import check_driver
from portnav_ros.evaluation.driver.ends import ENABLE_TYPE, TYPES, find_driver
from portnav_ros.evaluation.driver.record import (
    DriverRecord,
    End,
    Expected,
    JointSample,
    OdometrySample,
    ScanSample,
    TrackSample,
)
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Actuation
from portnav_ros.vessel import VesselParams

EXPECTED = Expected(VesselParams(), LidarParams())
DELAY_S = 0.02
BEGIN_S, SECONDS = 1000.0, 10.0
SPEED_MPS, YAW_RATE_RADPS, START_YAW_RAD = 2.0, 0.1, 1.0


def odometry(time_s):
    """A circle to port at constant speed, as the contract wants it."""
    yaw = START_YAW_RAD + YAW_RATE_RADPS * (time_s - BEGIN_S)
    radius = SPEED_MPS / YAW_RATE_RADPS
    return OdometrySample(
        time_s,
        time_s + DELAY_S,
        'map',
        'base_link',
        (radius * math.sin(yaw), -radius * math.cos(yaw)),
        (0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)),
        (SPEED_MPS, 0.0),
        YAW_RATE_RADPS,
        np.full((2, 6), 0.01),
    )


def scan(time_s):
    ranges = np.full(180, np.inf, np.float32)
    ranges[:90] = 20.0 + (time_s - BEGIN_S)
    return ScanSample(
        time_s, time_s + DELAY_S, 'lidar_link', ranges, -math.pi, 2.0 * math.pi / 180, 0.0, 0.5, 400.0
    )


def good_record():
    times = BEGIN_S + np.arange(0.0, SECONDS, 0.05)
    sent = ('odom', 'scan', 'joint_states', 'targets', 'diagnostics')
    return DriverRecord(
        publishers={topic: [End('/boat', TYPES[topic])] for topic in sent},
        subscriptions={'cmd_actuators': [End('/boat', TYPES['cmd_actuators'])]},
        services={'enable': ENABLE_TYPE},
        driver='/boat',
        begin_s=BEGIN_S,
        end_s=BEGIN_S + SECONDS,
        odometry=[odometry(time_s) for time_s in times],
        scans=[scan(time_s) for time_s in times[::2]],
        joints=[JointSample(time_s, time_s + DELAY_S, Actuation(0.1, 10.0)) for time_s in times],
        targets=[TrackSample(BEGIN_S, BEGIN_S + DELAY_S, 'map', 'target/7')],
    )


def each(samples, **changes):
    """Replace fields of all samples; a value that is a function takes the sample."""
    return [
        sample._replace(
            **{key: value(sample) if callable(value) else value for key, value in changes.items()}
        )
        for sample in samples
    ]


def with_odometry(**changes):
    record = good_record()
    return replace(record, odometry=each(record.odometry, **changes))


def with_scans(**changes):
    record = good_record()
    return replace(record, scans=each(record.scans, **changes))


def with_ranges(index, value):
    def changed(sample):
        ranges = sample.ranges.copy()
        ranges[index] = value
        return ranges

    return with_scans(ranges=changed)


def with_publishers(topic, *ends):
    record = good_record()
    return replace(record, publishers=record.publishers | {topic: list(ends)})


def without(name):
    return replace(good_record(), **{name: []})


def yaw_of(sample):
    return 2.0 * math.atan2(sample.quaternion[2], sample.quaternion[3])


def quaternion(yaw):
    return 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)


def in_map(sample):
    yaw = yaw_of(sample)
    return SPEED_MPS * math.cos(yaw), SPEED_MPS * math.sin(yaw)


def resting(yaw=START_YAW_RAD, velocity=(0.0, 0.0)):
    return with_odometry(
        position=(5.0, 5.0), quaternion=quaternion(yaw), velocity=velocity, yaw_rate_radps=0.0
    )


def straight(yaw, velocity):
    return with_odometry(
        position=lambda s: (
            SPEED_MPS * math.cos(yaw) * (s.stamp_s - BEGIN_S),
            SPEED_MPS * math.sin(yaw) * (s.stamp_s - BEGIN_S),
        ),
        quaternion=quaternion(yaw),
        velocity=velocity,
        yaw_rate_radps=0.0,
    )


def finding(record, check, expected=EXPECTED):
    return {found.check: found for found in check_driver(record, expected)}[check]


def test_a_driver_that_speaks_the_contract_passes_every_check():
    findings = check_driver(good_record(), EXPECTED)
    assert {found.status for found in findings} == {'ok'}, findings
    assert len({found.check for found in findings}) == len(findings)


WRONG = {
    'nobody': ('odom', with_publishers('odom'), 'nobody'),
    'two publishers': (
        'odom',
        with_publishers('odom', End('/a', TYPES['odom']), End('/b', TYPES['odom'])),
        '/b',
    ),
    'wrong type': ('scan', with_publishers('scan', End('/a', 'sensor_msgs/msg/PointCloud2')), 'PointCloud2'),
    'qos': ('scan', with_publishers('scan', End('/a', TYPES['scan'], 'durability')), 'durability'),
    'diagnostics of others': (
        'diagnostics',
        with_publishers('diagnostics', End('/other', TYPES['diagnostics'])),
        '/other',
    ),
    'deaf': ('cmd_actuators', replace(good_record(), subscriptions={}), 'no driver listens'),
    'commands of another type': (
        'cmd_actuators',
        replace(good_record(), subscriptions={'cmd_actuators': [End('/boat', TYPES['odom'])]}),
        'takes nav_msgs',
    ),
    'commands with a deadline': (
        'cmd_actuators',
        replace(
            good_record(), subscriptions={'cmd_actuators': [End('/boat', TYPES['cmd_actuators'], 'deadline')]}
        ),
        'deadline',
    ),
    'no enable': ('~/enable', replace(good_record(), services={}), 'no such service'),
    'enable of another type': (
        '~/enable',
        replace(good_record(), services={'enable': 'std_srvs/srv/Trigger'}),
        'Trigger',
    ),
    'clock goes back': ('clock', replace(good_record(), clock_s=[5.0, 6.0, 1.0]), 'goes back'),
    'slow': ('odom rate', replace(good_record(), odometry=good_record().odometry[::3]), '6.7 Hz'),
    'dies half-way': ('scan rate', replace(good_record(), scans=good_record().scans[:40]), '4.0 Hz'),
    'gap': (
        'odom rate',
        replace(good_record(), odometry=good_record().odometry[:100] + good_record().odometry[115:]),
        'longest gap 0.80 s',
    ),
    'silent': ('odom rate', without('odometry'), '0 messages'),
    'stamps stand': ('odom stamps', with_odometry(stamp_s=BEGIN_S), 'do not grow'),
    'stamps go back': (
        'scan stamps',
        replace(good_record(), scans=good_record().scans[::-1]),
        'do not grow',
    ),
    'future': ('odom stamps', with_odometry(stamp_s=lambda s: s.stamp_s + 2.0), 'in the future'),
    'late': ('scan stamps', with_scans(heard_s=lambda s: s.stamp_s + 0.8), '0.8 s old'),
    'time since boot': ('odom stamps', with_odometry(stamp_s=lambda s: s.stamp_s - BEGIN_S), 's old'),
    'two clocks': ('one clock', with_scans(heard_s=lambda s: s.stamp_s + 0.45), '430 ms'),
    'stamp of the last ray': ('first ray', with_scans(time_increment_s=0.1 / 180), 'before their last ray'),
    'rays back in time': ('first ray', with_scans(time_increment_s=-1e-4), 'negative'),
    'frame': ('odom frame', with_odometry(frame='odom'), "'odom'"),
    'child frame': ('odom frame', with_odometry(child_frame='base_footprint'), "'base_footprint'"),
    'scan frame': ('scan frame', with_scans(frame='laser'), "'laser'"),
    'target frame': (
        'targets frame',
        replace(good_record(), targets=[TrackSample(0.0, 0.0, 'map', 'vessel')]),
        "'vessel'",
    ),
    'no quaternion': ('orientation', with_odometry(quaternion=(0.0, 0.0, 0.0, 0.0)), 'norm 1, but 0'),
    'not finite': ('orientation', with_odometry(position=(math.nan, 0.0)), 'not finite'),
    'no covariance': ('covariance', with_odometry(variances=np.zeros((2, 6))), 'is 0'),
    'twist in map': ('twist', with_odometry(velocity=in_map), 'in the map frame'),
    'twist astern': ('twist', with_odometry(velocity=(-SPEED_MPS, 0.0)), 'of the opposite sign'),
    'twist in knots': ('twist', with_odometry(velocity=(SPEED_MPS * 3600.0 / 1852.0, 0.0)), 'in knots'),
    'compass heading': (
        'twist',
        with_odometry(quaternion=lambda s: quaternion(math.pi / 2.0 - yaw_of(s))),
        'compass heading',
    ),
    'twist of another world': ('twist', with_odometry(velocity=(0.3, 5.0)), 'from the differences'),
    'clockwise': ('yaw rate', with_odometry(yaw_rate_radps=-YAW_RATE_RADPS), 'of the opposite sign'),
    'degrees': ('yaw rate', with_odometry(yaw_rate_radps=math.degrees(YAW_RATE_RADPS)), 'in degrees'),
    'yaw rate of a gyro that drifts': ('yaw rate', with_odometry(yaw_rate_radps=0.5), 'from the differences'),
    'too many rays': ('rays', with_scans(ranges=np.ones(360, np.float32)), '360 rays'),
    'first ray ahead': ('rays', with_scans(angle_min_rad=0.0), 'from 0.0000'),
    'clockwise rays': ('rays', with_scans(angle_increment_rad=-2.0 * math.pi / 180), '-0.0349'),
    'half around': ('rays', with_scans(angle_increment_rad=math.pi / 180), '0.0175'),
    'other range': ('rays', with_scans(range_max_m=100.0), 'range_max 100'),
    'all NaN': ('ranges', with_scans(ranges=np.full(180, np.nan, np.float32)), 'NaN'),
    'zero': ('ranges', with_ranges(3, 0.0), 'a range of 0'),
    'negative': ('ranges', with_ranges(3, -1.0), 'below 0'),
    'too near': ('ranges', with_ranges(3, 0.2), 'below range_min'),
    'too far': ('ranges', with_ranges(3, 500.0), 'at or above range_max'),
    'range_max for no return': ('ranges', with_ranges(slice(90, 180), 400.0), 'at or above range_max'),
    'frozen scan': ('scan lives', with_scans(ranges=scan(BEGIN_S).ranges), 'again and again'),
    'joint names': (
        'joint names',
        replace(good_record(), joints=[JointSample(1.0, 1.0, None, 'name is [a]')]),
        'name is [a]',
    ),
}


@pytest.mark.parametrize(('check', 'record', 'found'), WRONG.values(), ids=WRONG)
def test_a_mistake_is_found_and_mended(check, record, found):
    failure = finding(record, check)
    assert failure.status == 'fail', failure
    assert found in failure.found
    assert failure.mend


UNTOLD = {
    'no feedback': ('joint_states', with_publishers('joint_states')),
    'no targets': ('targets', with_publishers('targets')),
    'at rest': ('twist', resting()),
    'to the east': ('twist', straight(0.0, (SPEED_MPS, 0.0))),
    'straight on': ('yaw rate', straight(1.0, (SPEED_MPS, 0.0))),
    'open water': ('ranges', with_scans(ranges=np.full(180, np.inf, np.float32))),
    'scan at rest': (
        'scan lives',
        replace(resting(), scans=each(good_record().scans, ranges=scan(BEGIN_S).ranges)),
    ),
    'no scans': ('rays', without('scans')),
    'no odometry': ('twist', without('odometry')),
}


@pytest.mark.parametrize(('check', 'record'), UNTOLD.values(), ids=UNTOLD)
def test_what_cannot_be_told_is_left_out(check, record):
    assert finding(record, check).status == 'left out'


def test_noise_of_a_real_sensor_passes():
    generator = np.random.default_rng(0)
    noisy = with_odometry(
        position=lambda s: tuple(np.add(s.position, generator.normal(0.0, 0.02, 2))),
        velocity=lambda s: tuple(np.add(s.velocity, generator.normal(0.0, 0.1, 2))),
        yaw_rate_radps=lambda s: s.yaw_rate_radps + generator.normal(0.0, 0.02),
    )
    assert {finding(noisy, check).status for check in ('twist', 'yaw rate', 'odom stamps')} == {'ok'}


def test_a_sway_is_no_mistake():
    """The hull drifts to port by half its speed ahead; who tells so in the body frame is right."""

    def place(sample):
        yaw = yaw_of(sample)
        radius = SPEED_MPS / YAW_RATE_RADPS
        x, y = radius * math.sin(yaw), -radius * math.cos(yaw)
        return x + 0.5 * radius * math.cos(yaw), y + 0.5 * radius * math.sin(yaw)

    drifting = with_odometry(position=place, velocity=(SPEED_MPS, 0.5 * SPEED_MPS))
    assert finding(drifting, 'twist').status == 'ok'
    assert (
        'starboard'
        in finding(
            replace(drifting, odometry=each(drifting.odometry, velocity=(SPEED_MPS, -0.5 * SPEED_MPS))),
            'twist',
        ).found
    )


def test_stamps_of_simulated_time_are_held_against_the_clock():
    simulated = replace(good_record(), clock_s=list(BEGIN_S + np.arange(0.0, SECONDS, 0.05)))
    assert finding(simulated, 'odom stamps').status == 'ok'
    assert (
        'the published clock'
        in finding(
            replace(simulated, odometry=each(simulated.odometry, stamp_s=lambda s: s.stamp_s + 1e9)),
            'odom stamps',
        ).mend
    )


@pytest.mark.parametrize(
    ('senders', 'listeners', 'driver'),
    [
        (['/boat'], ['/bag_recorder', '/boat'], '/boat'),
        (['/boat/gps'], ['/bag_recorder', '/boat/engine'], '/boat/engine'),
        (['/boat'], ['/bag_recorder'], '/boat'),
        ([], ['/boat'], '/boat'),
        ([], [], ''),
    ],
)
def test_the_driver_is_who_listens_to_commands(senders, listeners, driver):
    record = DriverRecord(
        publishers={'odom': [End(node, TYPES['odom']) for node in senders]},
        subscriptions={'cmd_actuators': [End(node, TYPES['cmd_actuators']) for node in listeners]},
    )
    assert find_driver(record, ('bag_recorder',)) == driver
