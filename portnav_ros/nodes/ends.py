"""Publishers and subscriptions of a topic, as the graph of ROS tells them."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from portnav_ros.nodes.qos_match import End, Ends, mismatches


def ends_of(node: Node, topic: str) -> Ends:
    """Return both sides of a topic, by its relative or full name; a node may not be known by name yet."""
    return Ends(
        tuple(map(_end, node.get_publishers_info_by_topic(topic))),
        tuple(map(_end, node.get_subscriptions_info_by_topic(topic))),
    )


def _end(info: TopicEndpointInfo) -> End:
    return End(
        info.node_name,
        info.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
        info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        info.topic_type,
    )


class Mismatches:
    """Topics of a node on which the middleware has told of an incompatible QoS."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: dict[str, str] = {}
        self._named: dict[str, str] = {}

    def note(self, topic: str, policy: str) -> None:
        """Take note of what the middleware has told; it does not say who is at the other end."""
        self._told[topic] = f'{topic}: another end has an incompatible QoS ({policy})'
        self._node.get_logger().error(self._told[topic])

    def describe(self) -> list[str]:
        """Name both ends and the mend, once the graph tells them, and forget those that have gone."""
        own = self._node.get_name()
        for topic in list(self._told):
            pairs = mismatches(self._node.resolve_topic_name(topic), ends_of(self._node, topic))
            own_pairs = [pair for pair in pairs if own in (pair.publisher, pair.subscriber)]
            if own_pairs:
                self._named[topic] = '; '.join(f'{topic}: {pair}; {pair.mend}' for pair in own_pairs)
            elif topic in self._named:
                del self._told[topic], self._named[topic]
        return [self._named.get(topic, told) for topic, told in self._told.items()]
