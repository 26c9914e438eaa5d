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
    probe = graph.add(LatencyProbe, duration_s=0.1)
    odometry, scan, setpoint = new_odometry(), new_scan(LidarParams(), 0.1), new_setpoint()
    fill_odometry(odometry, SECOND_NS, VesselState(0.0, 0.0, 0.0))
    fill_scan(scan, SECOND_NS, 5.0)
    fill_setpoint(setpoint, SECOND_NS, Setpoint(0.0, 1.0))
    graph.publish('odom', odometry)
    graph.publish('scan', scan)
    graph.until(lambda: probe._scans and probe._odometry, 'odometry and scan')
    graph.publish('cmd_actuators', command(SECOND_NS))
    graph.until(lambda: probe.latencies_s['odom_to_actuator'], 'the answer to the odometry')
    assert not probe.latencies_s['scan_to_actuator']
    graph.publish('setpoint', setpoint)
    graph.until(lambda: probe.latencies_s['scan_to_setpoint'], 'the setpoint')
    while not probe._done.done():
        graph.publish('cmd_actuators', command(SECOND_NS))
        graph.executor.spin_once(0.02)
    printed = json.loads(capfd.readouterr().out.splitlines()[-1])
    assert {name: len(found) for name, found in printed.items()} == {
        'scan_to_setpoint': 1,
        'scan_to_actuator': 1,
        'odom_to_actuator': 1,
    }
    assert printed['scan_to_actuator'][0] > printed['scan_to_setpoint'][0] > 0.0
