"""``portnav doctor --graph``: listen to the nodes that run, and say in words what is wrong with them."""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from portnav_ros.findings import Finding
from portnav_ros.nodes.domain_lock import read_domain
from portnav_ros.nodes.ends import ends_of
from portnav_ros.nodes.graph_findings import Graph, Status, judge
from portnav_ros.nodes.messages import read_values
from portnav_ros.nodes.preparation import ENVIRONMENT
from portnav_ros.nodes.qos_match import Ends
from portnav_ros.nodes.table import NAMES
from portnav_ros.nodes.topics import TOPICS, asked_qos
from portnav_ros.params import ParamError

NAME = 'portnav_doctor'
DIAGNOSTICS = 'diagnostics'
DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
SPIN_S = 0.1
DISCOVERY_S = 7.0  # who misses the first words of another waits 3 s for the next


def examine(seconds: float, environment: Mapping[str, str]) -> list[Finding]:
    """Listen to the ROS domain of an environment, and judge what was seen.

    Args:
        seconds: to listen, from the first word of a node; they speak once a second.
        environment: of the process.

    Raises:
        ParamError: seconds is not above 0.
        DomainError: ROS_DOMAIN_ID is no domain.
    """
    if not seconds > 0.0:
        raise ParamError(f'--graph {seconds:g}: listen for more than 0 s')
    domain = read_domain(environment)
    os.environ.setdefault(DISCOVERY_RANGE, ENVIRONMENT[DISCOVERY_RANGE])
    return judge(look(seconds, domain), f'ROS domain {domain}')


def look(seconds: float, domain: int) -> list[Graph]:
    """Return what was seen of each namespace with nodes of the table."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    try:
        listener = _Listener(context)
        listener.listen(seconds)
        return listener.graphs()
    finally:
        context.try_shutdown()


class _Listener:
    """A node of its own, which is left out of what it sees."""

    def __init__(self, context: Context) -> None:
        self._node = Node(NAME, context=context, start_parameter_services=False, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._statuses: dict[str, dict[str, Status]] = defaultdict(dict)  # by namespace and node
        self._heard: set[str] = set()

    def listen(self, seconds: float) -> None:
        """Listen from the first word of a node, for which there is patience of its own."""
        self._spin(DISCOVERY_S, self._spoken)
        if self._spoken():
            self._spin(seconds, lambda: False)

    def graphs(self) -> list[Graph]:
        nodes: dict[str, list[str]] = defaultdict(list)
        for name, namespace in self._node.get_node_names_and_namespaces():
            if name != NAME:
                nodes[namespace].append(name)
        return [
            Graph(namespace, tuple(names), self._topics(namespace), self._statuses[namespace])
            for namespace, names in sorted(nodes.items())
            if set(names) & set(NAMES)
        ]

    def _spoken(self) -> bool:
        return any(self._statuses.values())

    def _spin(self, seconds: float, enough: Callable[[], bool]) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not enough():
            self._subscribe()
            self._executor.spin_once(SPIN_S)

    def _subscribe(self) -> None:
        """Listen to the diagnostics of every namespace that has some."""
        for topic, _ in self._node.get_topic_names_and_types():
            namespace, _, name = topic.rpartition('/')
            if name == DIAGNOSTICS and topic not in self._heard:
                self._heard.add(topic)
                keep = partial(_keep, self._statuses[namespace or '/'])
                self._node.create_subscription(DiagnosticArray, topic, keep, asked_qos(TOPICS[name]))

    def _topics(self, namespace: str) -> dict[str, Ends]:
        found = {name: ends_of(self._node, f'{namespace.rstrip("/")}/{name}') for name in TOPICS}
        others = {
            name: Ends(*(tuple(end for end in side if end.node != NAME) for side in ends))
            for name, ends in found.items()
        }
        return {name: ends for name, ends in others.items() if any(ends)}


def _keep(statuses: dict[str, Status], message: DiagnosticArray) -> None:
    for status in message.status:
        statuses[status.name] = Status(status.level[0], status.message, read_values(status))
