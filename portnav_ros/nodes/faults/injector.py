"""Between driver, planner and the rest of a graph: passes messages on, and spoils them when told to."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from portnav_ros.nodes.messages import SECOND_NS
from portnav_ros.nodes.serialised import peek_stamp, with_stamp
from portnav_ros.nodes.topics import TOPICS, offered_qos

Spoil = Callable[[Any], Any | None]  # gives the message to pass on, or None to lose it

FLUSH_S = 0.02
START_S = 1000.0  # by the driver's clock, which can then jump back without getting below 0
DRIVER, PLANNER = 'driver', 'planner'  # prefixes of the topics on the far side
FROM_DRIVER = ('odom', 'scan', 'joint_states')
TO_DRIVER = ('cmd_actuators',)
FROM_PLANNER = ('setpoint_raw',)


def remaps(topics: tuple[str, ...], prefix: str) -> list[str]:
    """Remappings for a process that is to speak on the far side."""
    return [f'{topic}:={prefix}/{topic}' for topic in topics]


class Relay:
    """Passes one topic on as it comes, unless it is told to spoil or delay it or to shift its stamps.

    Args:
        node: to publish and listen with.
        topic: of the table, which tells the type.
        source: where to listen.
        target: where to publish.
    """

    def __init__(self, node: Node, topic: str, source: str, target: str) -> None:
        row = TOPICS[topic]
        self._type = row.type
        self._publisher = node.create_publisher(row.type, target, offered_qos(row))
        self._delayed: deque[tuple[float, bytes]] = deque()
        self.spoil: Spoil | None = None
        self.hear: Callable[[bytes], None] = lambda data: None
        self.delay_s, self.shift_ns = 0.0, 0
        node.create_subscription(row.type, source, self._take, offered_qos(row), raw=True)
        node.create_timer(FLUSH_S, self._flush)

    def _take(self, data: bytes) -> None:
        self.hear(data)
        if self.spoil is not None:
            spoilt = self.spoil(deserialize_message(data, self._type))
            if spoilt is None:
                return
            data = serialize_message(spoilt)
        if self.shift_ns:
            data = with_stamp(data, peek_stamp(data) + self.shift_ns)
        self._delayed.append((time.monotonic() + self.delay_s, data))
        if not self.delay_s:
            self._flush()

    def _flush(self) -> None:
        while self._delayed and self._delayed[0][0] <= time.monotonic():
            self._publisher.publish(self._delayed.popleft()[1])


class Injector:
    """The relays of a graph, by topic."""

    def __init__(self, node: Node) -> None:
        self.relays = {topic: Relay(node, topic, f'{DRIVER}/{topic}', topic) for topic in FROM_DRIVER}
        self.relays |= {topic: Relay(node, topic, topic, f'{DRIVER}/{topic}') for topic in TO_DRIVER}
        self.relays |= {topic: Relay(node, topic, f'{PLANNER}/{topic}', topic) for topic in FROM_PLANNER}
        self.shift_clock(START_S)

    def shift_clock(self, by_s: float) -> None:
        """Let the driver's clock jump."""
        by_ns = round(by_s * SECOND_NS)
        for topic in FROM_DRIVER:
            self.relays[topic].shift_ns += by_ns
        for topic in TO_DRIVER:
            self.relays[topic].shift_ns -= by_ns
