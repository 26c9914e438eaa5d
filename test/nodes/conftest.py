import itertools
import os
import time
from collections import defaultdict
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter

from portnav_ros.nodes.messages import read_values
from portnav_ros.nodes.topics import TOPICS, offered_qos

DOMAINS = itertools.islice(itertools.cycle(range(30, 50)), os.getpid() % 20, None)  # two runs seldom meet
WAIT_S = 30.0
MARK = 'PORTNAV_TEST_MARK'


class Clock:
    """A steady clock that stands still until it is told."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


class Graph:
    """Nodes under test and one node that plays everybody else, on one executor and a domain of its own."""

    def __init__(self):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=next(DOMAINS))
        self.executor = EventsExecutor(context=self.context)
        self.nodes = []
        self.heard = defaultdict(list)
        self._publishers = {}
        self.other = self._take(rclpy.create_node('other', context=self.context))

    def add(self, make_node, **parameters):
        """Build a node under test with parameters, and make it active."""
        node = self.build(make_node, **parameters)
        node.start()
        return node

    def build(self, make_node, **parameters):
        """Build a node under test with parameters; it is left unconfigured."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return self._take(make_node(context=self.context, parameter_overrides=overrides))

    def listen(self, *topics, lock_step=False):
        """Keep what is published on topics in `heard`."""
        for name in topics:
            self.other.create_subscription(
                TOPICS[name].type, name, self.heard[name].append, offered_qos(TOPICS[name], lock_step)
            )

    def publish(self, topic, message):
        """Publish for the others; the first time waits for somebody who listens."""
        if topic not in self._publishers:
            row = TOPICS[topic]
            self._publishers[topic] = self.other.create_publisher(row.type, topic, offered_qos(row))
            self.until(lambda: self._publishers[topic].get_subscription_count(), f'a listener to {topic}')
        self._publishers[topic].publish(message)

    def until(self, condition, what='the condition'):
        """Spin until a condition holds."""
        end_s = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < end_s, f'waited {WAIT_S} s in vain for {what}'
            self.executor.spin_once(0.02)

    def last(self, topic, accept=lambda message: True):
        """Wait for a message that is accepted, and return it."""
        self.until(lambda: any(map(accept, self.heard[topic])), f'a fitting message on {topic}')
        return next(message for message in reversed(self.heard[topic]) if accept(message))

    def status(self, node, accept):
        """Wait for diagnostics of a node that are accepted; return level, text and values."""

        def own(message):
            return message.status[0].name == node and accept(message.status[0])

        status = self.last('diagnostics', own).status[0]
        return status.level, status.message, read_values(status)

    def call(self, service_type, name, **fields):
        """Call a service and return its response."""
        client = self.other.create_client(service_type, name)
        self.until(client.service_is_ready, name)
        future = client.call_async(service_type.Request(**fields))
        self.until(future.done, f'an answer of {name}')
        return future.result()

    def remove(self, node):
        """End a node."""
        self.nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def close(self):
        for node in list(self.nodes):
            self.remove(node)
        self.executor.shutdown()
        self.context.try_shutdown()

    def _take(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node


@pytest.fixture
def marked():
    """Find the processes whose environment carries a mark, zombies not counted."""

    def find(mark):
        found = []
        for path in Path('/proc').glob('[0-9]*'):
            try:
                alive = path.joinpath('stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z'
                if alive and f'{MARK}={mark}'.encode() in path.joinpath('environ').read_bytes().split(b'\0'):
                    found.append(path.name)
            except OSError:
                continue
        return found

    return find


@pytest.fixture
def graph(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    graph = Graph()
    yield graph
    graph.close()


another_graph = graph
