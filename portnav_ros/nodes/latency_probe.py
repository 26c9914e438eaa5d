"""Listens to a running graph and prints, as JSON, how long scans and odometry wait for their answers.

python -m portnav_ros.nodes.latency_probe --ros-args -p duration_s:=20.0
"""

from __future__ import annotations

import json
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan

from portnav_ros.nodes.messages import read_stamp
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import PortNode, run_node
from portnav_ros.params import Ranges, check_ranges

NAME = 'latency_probe'


@dataclass(frozen=True)
class ProbeParams(NodeParams):
    """Parameters of the node. duration_s: to listen, by the wall clock, from when time runs."""

    duration_s: float = 20.0
    ranges: ClassVar[Ranges] = {'duration_s': (0.1, 3600.0)}

    def __post_init__(self) -> None:
        """Refuse to listen for ever."""
        check_ranges(self)


class LatencyProbe(PortNode[ProbeParams]):
    """Times of receipt here, so each latency holds one hop that the vessel does not have to wait for.

    A scan is answered by the setpoint of its stamp. The controller answers an odometry with a first command
    of its stamp, and a new setpoint with a second one; with one for both where the setpoint came first.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, ProbeParams(), **options)

    def configure(self) -> None:
        """Listen."""
        self._heard: dict[str, dict[int, list[float]]] = {}
        for topic in ('scan', 'odom', 'setpoint', 'cmd_actuators'):
            times = self._heard[topic] = defaultdict(list)
            self.subscribe(topic, partial(self._take, times))
        self._begin_s: float | None = None

    def latencies_s(self) -> dict[str, list[float]]:
        """Return what has been measured so far."""
        heard = self._heard
        return {
            'scan_to_setpoint': _gaps(heard['scan'], heard['setpoint'], 0),
            'scan_to_actuator': _gaps(
                {stamp: times for stamp, times in heard['scan'].items() if stamp in heard['setpoint']},
                heard['cmd_actuators'],
                1,
            ),
            'odom_to_actuator': _gaps(heard['odom'], heard['cmd_actuators'], 0),
        }

    def _take(self, times: dict[int, list[float]], message: Odometry | LaserScan | JointState) -> None:
        now_s, stamp_ns = time.perf_counter(), read_stamp(message.header.stamp)
        if stamp_ns > 0:
            times[stamp_ns].append(now_s)
            self._begin_s = self._begin_s or now_s
            if now_s - self._begin_s > self.params.duration_s:
                print(json.dumps(self.latencies_s()), flush=True)
                self.finish()


def _gaps(asked: dict[int, list[float]], answered: dict[int, list[float]], number: int) -> list[float]:
    """Time from each message to its answer: of the same stamp, and of this number or the last."""
    return [
        answered[stamp][: number + 1][-1] - times[0] for stamp, times in asked.items() if answered.get(stamp)
    ]


def main() -> int:
    """Run the node."""
    return run_node(LatencyProbe)


if __name__ == '__main__':
    raise SystemExit(main())
