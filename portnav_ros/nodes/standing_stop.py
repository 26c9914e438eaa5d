"""An emergency stop that outlives the safety monitor: remembered by the manager of the nodes."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from std_msgs.msg import Bool

from portnav_ros.nodes.messages import read_values
from portnav_ros.nodes.topics import TOPICS, asked_qos, every_qos
from portnav_ros.safety.emergency import ORDERED_BY, SERVICE, TOPIC, EmergencyOrders

MONITOR, STATE, ORDER = 'safety_monitor', 'safety_state', 'emergency_stop'


class StandingStop:
    """Hears orders on the topic by itself, and of those by the service from what the safety monitor tells."""

    def __init__(self, node: Node) -> None:
        """Listen as a node."""
        self._orders = EmergencyOrders()
        state, order = TOPICS[STATE], TOPICS[ORDER]
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        node.create_subscription(state.type, state.name, self._take_state, asked_qos(state))
        for asked in every_qos(order):
            node.create_subscription(order.type, order.name, self._take_order, asked, event_callbacks=silent)

    @property
    def in_force(self) -> bool:
        """Whether a safety monitor that is started now has to stop the vessel."""
        return bool(self._orders.by)

    def _take_order(self, message: Bool) -> None:
        self._orders.take(TOPIC, message.data)

    def _take_state(self, message: DiagnosticStatus) -> None:
        self._orders.take(SERVICE, SERVICE in read_values(message).get(ORDERED_BY, ''))
