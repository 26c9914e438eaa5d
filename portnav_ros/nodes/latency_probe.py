"""Listens to a running graph and prints, as JSON, how long scans and odometry wait for their answers.

python -m portnav_ros.nodes.latency_probe --ros-args -p duration_s:=20.0
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan

from portnav_ros.nodes.messages import read_stamp
from portnav_ros.nodes.runtime import Health, PortNode, run_node
from portnav_ros.params import check_range

NAME = 'latency_probe'


@dataclass(frozen=True)
class ProbeParams:
    """Parameters of the node. duration_s: to listen, by the wall clock, from the first answer."""

    duration_s: float = 20.0

    def __post_init__(self) -> None:
        """Refuse to listen for ever."""
        check_range(self, duration_s=(0.1, 3600.0))


class LatencyProbe(PortNode[ProbeParams]):
    """Times of receipt here, so each latency holds one hop that the vessel does not have to wait for.

    A scan is answered by the setpoint of its stamp, and that by the next command; an odometry by the first
    command of its stamp.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, ProbeParams(), **options)
        self._scans: dict[int, float] = {}
        self._odometry: dict[int, float] = {}
        self._unanswered: tuple[int, float] | None = None  # stamp of a setpoint, receipt of its scan
        self._begin_s: float | None = None
        self.latencies_s: dict[str, list[float]] = {
            'scan_to_setpoint': [],
            'scan_to_actuator': [],
            'odom_to_actuator': [],
        }
        self.subscribe('scan', self._take_scan)
        self.subscribe('odom', self._take_odometry)
        self.subscribe('setpoint', self._take_setpoint)
        self.subscribe('cmd_actuators', self._take_command)

    def health(self) -> Health:
        """Tell how much has been measured."""
        return Health(values={name: len(found) for name, found in self.latencies_s.items()})

    def _take_scan(self, message: LaserScan) -> None:
        self._scans[read_stamp(message.header.stamp)] = time.perf_counter()

    def _take_odometry(self, message: Odometry) -> None:
        stamp_ns = read_stamp(message.header.stamp)
        if stamp_ns > 0:
            self._odometry[stamp_ns] = time.perf_counter()

    def _take_setpoint(self, message: Odometry) -> None:
        stamp_ns = read_stamp(message.header.stamp)
        if stamp_ns > 0 and stamp_ns in self._scans:
            heard_s = self._scans[stamp_ns]
            self.latencies_s['scan_to_setpoint'].append(time.perf_counter() - heard_s)
            self._unanswered = stamp_ns, heard_s

    def _take_command(self, message: JointState) -> None:
        now_s, stamp_ns = time.perf_counter(), read_stamp(message.header.stamp)
        if stamp_ns in self._odometry:
            self.latencies_s['odom_to_actuator'].append(now_s - self._odometry.pop(stamp_ns))
            self._begin_s = self._begin_s or now_s
        if self._unanswered and stamp_ns >= self._unanswered[0]:
            self.latencies_s['scan_to_actuator'].append(now_s - self._unanswered[1])
            self._unanswered = None
        if self._begin_s and now_s - self._begin_s > self.params.duration_s:
            print(json.dumps(self.latencies_s), flush=True)
            self.finish()


def main() -> int:
    """Run the node."""
    return run_node(LatencyProbe)


if __name__ == '__main__':
    raise SystemExit(main())
