"""Records the topics of the table into a rosbag2 bag; in lock-step equal runs give equal bags."""

from __future__ import annotations

import json
import shutil
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from portnav_ros.evaluation.bag_episode import CHART
from portnav_ros.evaluation.bag_writer import Storage
from portnav_ros.evaluation.recording import RecordedTopic, Recording
from portnav_ros.nodes import status_pipe
from portnav_ros.nodes.topics import TOPICS, Topic, asked_qos
from portnav_ros.params import override

NAME = 'bag_recorder'
ROS_OWN = ('use_sim_time', 'start_type_description_service')
POLL_S = 0.01  # queues are emptied in bulk: at 50 times real time this costs a tenth of waking up for each
QUEUE_DEPTH = 5000
MARGIN_NS = 2_000_000_000
LOCK_STEP_MARGIN_NS = 10_000_000_000


@dataclass(frozen=True)
class RecorderParams:
    """Parameters of the node.

    bag: folder to record into. storage: file format. run_file: JSON mapping that goes into the bag's
    metadata. chart: GeoJSON copied into the bag's folder. lock_step: simulated time runs much faster
    than the clock, so wait longer for stragglers. reliable: ask for messages that were lost to be sent
    again; a real driver may not offer that, and would then not be heard.
    """

    bag: str = 'bag'
    storage: Storage = 'sqlite3'
    run_file: str = ''
    chart: str = ''
    lock_step: bool = False
    reliable: bool = True


class BagRecorder(Node):
    """Takes serialised messages out of their queues and files them."""

    def __init__(self, **overrides: Any) -> None:
        super().__init__(NAME, automatically_declare_parameters_from_overrides=True, **overrides)
        params = _read_params(self)
        topics = [topic for topic in TOPICS.values() if topic.recorded]
        self._queues = [
            self._subscribe(topic, params.reliable, number) for number, topic in enumerate(topics)
        ]
        self._diagnostics = self.create_publisher(DiagnosticArray, 'diagnostics', 10)
        path = Path(params.bag)
        self.recording = Recording(
            path,
            params.storage,
            [_recorded(topic, queue) for topic, queue in zip(topics, self._queues, strict=True)],
            _read_metadata(params.run_file),
            LOCK_STEP_MARGIN_NS if params.lock_step else MARGIN_NS,
        )
        if params.chart:
            shutil.copy(params.chart, path / CHART)
        self._reported_s = 0.0

    def tick(self) -> int:
        """Empty every queue once and file what is due; returns how many messages there were."""
        self.recording.file()
        taken = sum(self._empty(number, queue) for number, queue in enumerate(self._queues))
        if self.recording.failure and time.monotonic() - self._reported_s > 1.0:
            self._report_failure()
        return taken

    def finish(self) -> None:
        """Take what is still in the queues and close the bag."""
        while self.tick():
            pass
        self.recording.close()
        if self.recording.failure:
            self._report_failure()
        self.get_logger().info(f'{self.recording.written} messages recorded')

    def _subscribe(self, topic: Topic, reliable: bool, number: int) -> Subscription:
        qos = asked_qos(topic)
        qos.depth = QUEUE_DEPTH
        if reliable:
            qos.reliability = ReliabilityPolicy.RELIABLE
        return self.create_subscription(
            topic.type, topic.name, lambda data: self.recording.push(number, data), qos, raw=True
        )

    def _empty(self, number: int, queue: Subscription) -> int:
        taken = 0
        with queue.handle:
            while (item := queue.handle.take_message(queue.msg_type, True)) is not None:
                self.recording.push(number, item[0])
                taken += 1
        return taken

    def _report_failure(self) -> None:
        failure = self.recording.failure
        if not self._reported_s:
            self.get_logger().error(f'recording has stopped: {failure}')
            status_pipe.report(failure=failure)
        self._reported_s = time.monotonic()
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        status = DiagnosticStatus(level=DiagnosticStatus.ERROR, name=NAME, message=failure)
        message.status.append(status)
        self._diagnostics.publish(message)


def _recorded(topic: Topic, queue: Subscription) -> RecordedTopic:
    package = topic.type.__module__.partition('.')[0]
    message_type = f'{package}/msg/{topic.type.__name__}'
    return RecordedTopic(queue.topic_name, message_type, topic.depth, topic.latched)


def _read_params(node: Node) -> RecorderParams:
    given = {key: item.value for key, item in node.get_parameters_by_prefix('').items()}
    own = {key: value for key, value in given.items() if key not in ROS_OWN and '.' not in key}
    return override(RecorderParams(), own, NAME)


def _read_metadata(file: str) -> dict[str, str]:
    return dict(json.loads(Path(file).read_text(encoding='utf-8'))) if file else {}


def main() -> int:
    """Record until SIGINT or SIGTERM, then close the bag."""
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda n, _: stopped.append(n))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = BagRecorder()
        status_pipe.report_ready()
        while not stopped:
            node.tick()
            rclpy.spin_once(node, timeout_sec=0.0)
            time.sleep(POLL_S)
        node.finish()
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
