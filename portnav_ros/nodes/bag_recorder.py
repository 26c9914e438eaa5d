"""Records the topics of the table into a rosbag2 bag; in lock-step equal runs give equal bags."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from rclpy.subscription import Subscription

from portnav_ros.evaluation.bag_episode import CHART, RENAMED
from portnav_ros.evaluation.bag_writer import BagError, Storage
from portnav_ros.evaluation.recording import RecordedTopic, Recording
from portnav_ros.nodes import status_pipe
from portnav_ros.nodes.messages import SECOND_NS, clock_message
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import Health, PortNode, run_node
from portnav_ros.nodes.topics import TOPICS, Topic, asked_qos
from portnav_ros.params import ParamError

# How far, in ns, the newest message of a topic may be behind time while nothing of it is missing.
SLACK_NS = {
    'odom': 0,
    'joint_states': 0,
    'cmd_actuators': 0,
    'scan': 50_000_000,
    'targets': 5_000_000_000,
    'setpoint_raw': 5_000_000_000,
    'setpoint': 5_000_000_000,
    'navigation_state': 5_000_000_000,
}
# Nothing is acknowledged before each of these has a publisher that is heard.
AWAITED = ('odom', 'joint_states', 'cmd_actuators', 'scan', 'targets', 'setpoint_raw', 'setpoint')
ACKNOWLEDGE_NS = 2_000_000_000
REPEAT_S = 0.2
ANSWERS = ('cmd_actuators', 'setpoint', 'setpoint_raw', 'navigation_state', 'safety_state')
# Queues are emptied in bulk, which costs a fraction of waking up for each message.
POLL_S, LOCK_STEP_POLL_S = 0.05, 0.01
QUEUE_DEPTH = 5000
SILENCE_S = 5.0
MARGIN_NS = 2_000_000_000
LOCK_STEP_MARGIN_NS = 10_000_000_000


@dataclass(frozen=True)
class RecorderParams(NodeParams):
    """Parameters of the node.

    bag: folder to record into; a recorder that is configured again adds -2, -3 and so on. storage: file
    format. run_file: JSON mapping that goes into the bag's metadata. chart: GeoJSON copied
    into the bag's folder. lock_step: simulated time runs much faster than the clock, so wait longer for
    stragglers. reliable: ask for messages that were lost to be sent again; a real driver may not offer
    that, and would then not be heard.
    """

    bag: str = 'bag'
    storage: Storage = 'sqlite3'
    run_file: str = ''
    chart: str = ''
    lock_step: bool = False
    reliable: bool = True


DEFAULTS = RecorderParams()


class BagRecorder(PortNode[RecorderParams]):
    """Takes serialised messages out of their queues and files them."""

    def __init__(self, **options: Any) -> None:
        super().__init__('bag_recorder', DEFAULTS, **options)
        self._bags = 0

    def configure(self) -> None:
        """Open the bag and listen; from here on nothing is lost."""
        params = self.params
        topics = [topic for topic in TOPICS.values() if topic.recorded]
        self._names = [topic.name for topic in topics]
        for topic in topics:
            self.vitals.expect(topic.name, lasting=topic.latched)
        self._queues = [self._queue(number, topic) for number, topic in enumerate(topics)]
        self._recording = self._open(topics)
        regular = SLACK_NS if params.lock_step else ('odom',)
        self._slack_ns = {n: SLACK_NS[topic.name] for n, topic in enumerate(topics) if topic.name in regular}
        self._complete_ns: dict[int, int] = {}  # of each regular topic that was heard
        self._heard_s = time.monotonic()  # when one of them was heard last
        by_name = zip(topics, self._queues, strict=True)
        self._awaited = [queue for topic, queue in by_name if topic.name in AWAITED]
        self._acknowledged_ns, self._acknowledged_s = -1, 0.0
        self._acknowledgements = self.publisher('recorded')
        self._told = False

    @property
    def _time_ns(self) -> int:
        """Up to when nothing is missing; where nobody waits, time goes on when the odometry falls silent."""
        complete_ns = min(self._complete_ns.values(), default=0)
        silent_s = time.monotonic() - self._heard_s
        if self.params.lock_step or silent_s < SILENCE_S or not complete_ns:
            return complete_ns
        return complete_ns + int(silent_s * SECOND_NS)

    def tick(self) -> int:
        """Empty every queue once and file what is due; returns how many messages there were."""
        self._recording.file(self._time_ns)
        taken = sum(self._empty(number, queue) for number, queue in enumerate(self._queues))
        self._acknowledge(idle=not taken)
        if self._recording.failure and not self._told:
            self._told = True
            self.get_logger().error(f'recording has stopped: {self._recording.failure}')
            status_pipe.report(failure=self._recording.failure)
            self.report_health()
        return taken

    def health(self) -> Health:
        """Say how much is recorded and from how many publishers, or why no more."""
        if self._recording.failure:
            return Health(DiagnosticStatus.ERROR, f'recording has stopped: {self._recording.failure}')
        publishers = sum(queue.get_publisher_count() for queue in self._queues)
        return Health(values={'messages': self._recording.written, 'publishers': publishers})

    def spin(self) -> None:
        """Record until it is to stop."""
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self)
        poll_s = LOCK_STEP_POLL_S if self.params.lock_step else POLL_S
        while not self.ended:
            if self.active:
                self.tick()
            executor.spin_once(timeout_sec=0.0)
            time.sleep(poll_s)

    def deactivate(self) -> None:
        """Take what is still in the queues."""
        while self.tick():
            pass

    def cleanup(self) -> None:
        """Close the bag."""
        self._recording.close()
        self.tick()
        self.get_logger().info(f'{self._recording.written} messages recorded')

    def _open(self, topics: list[Topic]) -> Recording:
        params, path = self.params, Path(self.params.bag)
        if self._bags:
            path = path.with_name(f'{path.name}-{self._bags + 1}')
        by_topic = zip(topics, self._queues, strict=True)
        rows = [_recorded(topic, queue, params.lock_step) for topic, queue in by_topic]
        margin_ns = LOCK_STEP_MARGIN_NS if params.lock_step else MARGIN_NS
        try:
            metadata = _read_metadata(params.run_file) | _renamed(topics, rows)
            recording = Recording(path, params.storage, rows, metadata, margin_ns)
            if params.chart:
                shutil.copy(params.chart, path / CHART)
        except (BagError, OSError, ValueError) as error:
            raise ParamError(f'{self.get_name()}: {error}') from error
        self._bags += 1
        return recording

    def _queue(self, number: int, topic: Topic) -> Subscription:
        qos = asked_qos(topic)
        qos.depth = QUEUE_DEPTH
        if self.params.reliable:
            qos.reliability = ReliabilityPolicy.RELIABLE
        return self.create_subscription(
            topic.type, topic.name, lambda data: self._take(number, data), qos, raw=True
        )

    def _empty(self, number: int, queue: Subscription) -> int:
        taken = 0
        with queue.handle:
            while (item := queue.handle.take_message(queue.msg_type, True)) is not None:
                self._take(number, item[0])
                taken += 1
        return taken

    def _take(self, number: int, data: bytes) -> None:
        try:
            stamp = self._recording.push(number, data)
        except BagError as error:
            self.refuse(self._names[number], str(error))
            return
        self.vitals.hear(self._names[number], time.monotonic(), stamp)
        if number in self._slack_ns:
            self._complete_ns[number] = stamp + self._slack_ns[number]
            self._heard_s = time.monotonic()

    def _acknowledge(self, idle: bool) -> None:
        """Tell sim and bringup up to which time nothing is missing."""
        if self._acknowledged_ns < 0 and not all(queue.get_publisher_count() for queue in self._awaited):
            return
        time_ns = self._time_ns
        behind_ns, now_s = time_ns - self._acknowledged_ns, time.monotonic()
        repeat = now_s - self._acknowledged_s > REPEAT_S  # the sim may not have heard the first
        if behind_ns >= ACKNOWLEDGE_NS or (idle and behind_ns and self.params.lock_step) or repeat:
            self._acknowledged_ns, self._acknowledged_s = time_ns, now_s
            self._acknowledgements.publish(clock_message(time_ns))
            status_pipe.report(recorded_s=time_ns * 1e-9)


def _recorded(topic: Topic, queue: Subscription, lock_step: bool) -> RecordedTopic:
    """A topic of the bag; where equal runs need not give equal bags, the last answers stay in it."""
    package = topic.type.__module__.partition('.')[0]
    message_type = f'{package}/msg/{topic.type.__name__}'
    answer = lock_step and topic.name in ANSWERS
    return RecordedTopic(queue.topic_name, message_type, topic.depth, topic.latched, answer)


def _renamed(topics: Sequence[Topic], rows: Sequence[RecordedTopic]) -> dict[str, str]:
    """Metadata that tells the names in the bag of topics of the table that have others there."""
    names = {row.name: topic.name for topic, row in zip(topics, rows, strict=True)}
    renamed = {name: own for name, own in names.items() if not name.endswith(f'/{own}')}
    return {RENAMED: json.dumps(renamed)} if renamed else {}


def _read_metadata(file: str) -> dict[str, str]:
    return dict(json.loads(Path(file).read_text(encoding='utf-8'))) if file else {}


def main() -> int:
    """Run the node."""
    return run_node(BagRecorder)


if __name__ == '__main__':
    raise SystemExit(main())
