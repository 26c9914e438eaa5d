"""The probe pairs every answer with what it answers."""

import json

from portnav_ros.nodes.latency_probe import LatencyProbe
from portnav_ros.nodes.messages import (
    fill_odometry,
    fill_scan,
    fill_setpoint,
    new_joints,
    new_odometry,
    new_scan,
    new_setpoint,
    write_stamp,
)
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import Setpoint, VesselState

SECOND_NS = 1_000_000_000


def command(time_ns):
    message = new_joints()
    write_stamp(message.header.stamp, time_ns)
    return message


def test_answers_are_paired_by_stamp(graph, capfd):
    probe = graph.add(LatencyProbe, duration_s=0.5)
    odometry, scan, setpoint = new_odometry(), new_scan(LidarParams(), 0.1), new_setpoint()
    fill_odometry(odometry, SECOND_NS, VesselState(0.0, 0.0, 0.0))
    fill_scan(scan, SECOND_NS, 5.0)
    fill_setpoint(setpoint, SECOND_NS, Setpoint(0.0, 1.0))
    for topic, message in (
        ('odom', odometry),
        ('scan', scan),
        ('cmd_actuators', command(SECOND_NS)),
        ('setpoint', setpoint),
        ('cmd_actuators', command(SECOND_NS)),
    ):
        count = sum(map(len, probe._heard[topic].values()))
        graph.publish(topic, message)
        graph.until(lambda t=topic, n=count: sum(map(len, probe._heard[t].values())) > n, topic)
    while not probe._done.done():
        graph.publish('cmd_actuators', command(2 * SECOND_NS))
        graph.executor.spin_once(0.02)
    printed = json.loads(capfd.readouterr().out.splitlines()[-1])
    (to_setpoint,), (to_actuator,) = printed['scan_to_setpoint'], printed['scan_to_actuator']
    assert to_actuator > to_setpoint > 0.0
    assert len(printed['odom_to_actuator']) == 1
