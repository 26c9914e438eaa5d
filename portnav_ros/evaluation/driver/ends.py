"""Checks of the graph: who publishes and listens, of which type and QoS, and the services of the driver."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from portnav_ros.evaluation.driver.record import Check, DriverRecord, Expected, Finding

TYPES = {
    'odom': 'nav_msgs/msg/Odometry',
    'scan': 'sensor_msgs/msg/LaserScan',
    'joint_states': 'sensor_msgs/msg/JointState',
    'targets': 'nav_msgs/msg/Odometry',
    'diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
    'cmd_actuators': 'sensor_msgs/msg/JointState',
}
OPTIONAL = ('joint_states', 'targets')
SHARED = ('diagnostics', 'targets')  # may have several publishers
OWN_DIAGNOSTICS = 'let the driver publish a DiagnosticArray of its own, once a second'
ENABLE_TYPE = 'std_srvs/srv/SetBool'


def find_driver(record: DriverRecord, others: Collection[str]) -> str:
    """Name the node that drives the actuators: who listens to commands, and best of those who sends odom.

    Args:
        record: its publishers and subscriptions.
        others: names, without namespace, of nodes that listen for other reasons.
    """
    senders = [end.node for end in record.publishers.get('odom', [])]
    listeners = [
        end.node
        for end in record.subscriptions.get('cmd_actuators', [])
        if end.node.rpartition('/')[2] not in others
    ]
    return next((node for node in senders if node in listeners), (listeners + senders + [''])[0])


def check_published(topic: str) -> Check:
    """One publisher, of the right type, whose QoS meets ours."""

    def check(record: DriverRecord, _: Expected) -> Finding:
        ends = record.publishers.get(topic, [])
        if not ends:
            if topic in OPTIONAL:
                return Finding(topic, 'left out', 'nobody publishes it; it is optional')
            return Finding(topic, 'fail', 'nobody publishes it', _unheard(record, topic))
        nodes = ', '.join(sorted({end.node for end in ends}))
        if len(ends) > 1 and topic not in SHARED:
            return Finding(
                topic, 'fail', f'{len(ends)} publishers: {nodes}', 'end all of them but the driver'
            )
        if topic == 'diagnostics' and record.driver not in {end.node for end in ends}:
            return Finding(topic, 'fail', f'published by {nodes}, not by {record.driver}', OWN_DIAGNOSTICS)
        for end in ends:
            if end.type != TYPES[topic]:
                return Finding(topic, 'fail', f'{end.node} sends {end.type}', f'send {TYPES[topic]}')
            if end.mismatch:
                return Finding(topic, 'fail', f'{end.node}: {end.mismatch}', 'offer reliable, keep last 10')
        return Finding(topic, 'ok', f'{TYPES[topic]} from {nodes}')

    return check


def check_commands(record: DriverRecord, _: Expected) -> Finding:
    """The driver listens to commands."""
    name, ends = 'cmd_actuators', record.subscriptions.get('cmd_actuators', [])
    end = next((end for end in ends if end.node == record.driver), None)
    if end is None:
        return Finding(name, 'fail', 'no driver listens', f'subscribe to it, as {TYPES[name]}')
    if end.type != TYPES[name]:
        return Finding(name, 'fail', f'{end.node} takes {end.type}', f'take {TYPES[name]}')
    if end.mismatch:
        return Finding(name, 'fail', end.mismatch, 'ask for best effort, volatile, no deadline')
    return Finding(name, 'ok', f'{end.node} listens')


def check_enable(record: DriverRecord, _: Expected) -> Finding:
    """The service that makes the actuators neutral is there; it is called only with --move."""
    found = record.services.get('enable')
    if found is None:
        mend = f'offer ~/enable ({ENABLE_TYPE}); false makes the actuators neutral, whatever is commanded'
        return Finding('~/enable', 'fail', f'{record.driver or "the driver"} has no such service', mend)
    if found != ENABLE_TYPE:
        return Finding('~/enable', 'fail', f'is a {found}', f'make it a {ENABLE_TYPE}')
    return Finding('~/enable', 'ok', f'{record.driver}/enable')


def check_clock(record: DriverRecord, _: Expected) -> Finding:
    """Simulated time is for simulators, and never goes back."""
    if not record.simulated:
        return Finding('clock', 'ok', 'not published: the time is real')
    if np.any(np.diff(record.clock_s) < 0.0):
        return Finding(
            'clock', 'fail', 'goes back', 'let one simulator publish it, and restart the stack with it'
        )
    return Finding('clock', 'ok', 'published, so the time is simulated; a vessel must not publish it')


def _unheard(record: DriverRecord, topic: str) -> str:
    if not record.driver:
        return 'start the driver, on the same ROS_DOMAIN_ID and namespace (--namespace)'
    return f'publish it, as {TYPES[topic]}; a name below another namespace needs a remap'
