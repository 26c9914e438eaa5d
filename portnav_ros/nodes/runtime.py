"""What every node shares: parameters, guarded subscriptions, diagnostics, executor and exit codes.

States and transitions are in lifecycle.py.
"""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Callable, Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.experimental import EventsExecutor
from rclpy.lifecycle import LifecyclePublisher, LifecycleState, TransitionCallbackReturn
from rclpy.qos import qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from portnav_ros.harbour import ChartError
from portnav_ros.muzero import ModelError
from portnav_ros.nodes import status_pipe
from portnav_ros.nodes.ends import Mismatches
from portnav_ros.nodes.lifecycle import ManagedNode
from portnav_ros.nodes.messages import MessageError, read_stamp, status_message
from portnav_ros.nodes.parameters import NodeParams, declare
from portnav_ros.nodes.serialised import peek_stamp, read_bytes
from portnav_ros.nodes.topics import TOPICS, asked_qos, offered_qos
from portnav_ros.nodes.vitals import NO_PERIOD, NO_STAMP, Vitals
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import ScenarioError

P = TypeVar('P', bound=NodeParams)

DIAGNOSTICS_PERIOD_S = 1.0
SPIN_S = 0.2  # a signal is seen this late at most
FLUSH_S = 2.0
LOG_S = 1.0


class Exit(IntEnum):
    """Exit codes of a node; a signal ends it with OK."""

    OK = 0
    CRASH = 1
    CONFIGURATION = 2
    NO_MODEL = 3
    NO_ANSWER = 4


class Health(NamedTuple):
    """What a node says of itself: a level of DiagnosticStatus, one line, and figures."""

    level: bytes = DiagnosticStatus.OK
    text: str = 'ok'
    values: Mapping[str, object] = MappingProxyType({})


class PortNode(ManagedNode, Generic[P]):
    """A managed node with parameters P, which speaks the topics of the table and reports its health at 1 Hz.

    Publishers, subscriptions and timers are made in configure() and do nothing unless the node is active;
    the diagnostics are published in every state.

    Args:
        name: of the node.
        defaults: frozen dataclass whose fields become the parameters.
        options: for rclpy's Node, such as parameter_overrides.

    Raises:
        ParamError: an unknown parameter, a wrong type or a value out of range.
    """

    def __init__(self, name: str, defaults: P, **options: Any) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)
        self.params: P = declare(self, defaults)
        self.lock_step = bool(getattr(self.params, 'lock_step', False))
        self.exit_code = Exit.OK
        self.vitals = Vitals()
        self._refused_s: dict[str, float] = {}  # when it was logged last
        self._mismatches = Mismatches(self)
        self._diagnostics = self._publisher('diagnostics', self.create_publisher)
        self._every(DIAGNOSTICS_PERIOD_S, self.report_health)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to measure, then activate; called by rclpy."""
        self.vitals.begin()
        return super().on_activate(state)

    def publisher(self, topic: str) -> LifecyclePublisher:
        """Return a publisher of a topic of the table; it is silent unless the node is active."""
        publisher: LifecyclePublisher = self._publisher(topic, self.create_lifecycle_publisher)
        return publisher

    def _publisher(self, topic: str, create: Callable[..., Any]) -> Any:
        row = TOPICS[topic]
        return create(
            row.type,
            row.name,
            offered_qos(row, self.lock_step),
            event_callbacks=PublisherEventCallbacks(
                incompatible_qos=lambda event: self._note_mismatch(topic, event)
            ),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def subscribe(
        self,
        topic: str,
        callback: Callable[[Any], None],
        unwanted: Callable[[int], bool] | None = None,
        always: bool = False,
    ) -> Subscription:
        """Subscribe to a topic of the table.

        Args:
            topic: its name.
            callback: takes a message; one for which it raises MessageError is refused and counted.
            unwanted: is told the stamp in ns and may have the message dropped unread, which is much cheaper.
            always: take messages in state inactive, too: a latched one does not come again.
        """
        row = TOPICS[topic]
        stamp_of = peek_stamp if unwanted else _stamp_reader(row.type)
        self.vitals.expect(topic, lasting=always)
        self.vitals.watch(topic, 1.0 / row.rate_hz if row.rate_hz and not self.lock_step else NO_PERIOD)

        def take(message: Any) -> None:
            if not (self.active or always):
                return
            begin_s = time.monotonic()
            try:
                stamp_ns = stamp_of(message)
                self.vitals.hear(topic, begin_s, stamp_ns)
                if unwanted is None:
                    callback(message)
                elif not unwanted(stamp_ns):
                    callback(read_bytes(message, row.type))
            except MessageError as error:
                self.refuse(topic, str(error))
            self.vitals.spend(topic, time.monotonic() - begin_s)

        return self.create_subscription(
            row.type,
            row.name,
            take,
            asked_qos(row, self.lock_step),
            raw=unwanted is not None,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=lambda event: self._note_mismatch(topic, event)
            ),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def timer(self, period_s: float, callback: Callable[[], None]) -> None:
        """Call back, while active, at a period of the steady clock, which no simulation stops."""
        name = getattr(callback, '__name__', 'timer').strip('_')
        self.vitals.watch(name, period_s)

        def call() -> None:
            if self.active:
                begin_s = time.monotonic()
                callback()
                self.vitals.spend(name, time.monotonic() - begin_s)

        self._every(period_s, call)

    def _every(self, period_s: float, callback: Callable[[], None]) -> None:
        self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def rivals_on(self, subscription: Subscription) -> list[str]:
        """Return the names of the nodes that publish to a subscription, where there are several."""
        if subscription.get_publisher_count() < 2:
            return []
        ends = self.get_publishers_info_by_topic(subscription.topic)
        return [f'{end.node_namespace.rstrip("/")}/{end.node_name}' for end in ends]

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message that cannot be used; a new reason is logged, at most one a second of each topic."""
        now_s = time.monotonic()
        if self.vitals.reasons.get(topic) != reason and now_s - self._refused_s.get(topic, -math.inf) > LOG_S:
            self._refused_s[topic] = now_s
            self.get_logger().warning(f'{topic}: message refused: {reason}')
        self.vitals.refuse(topic, reason, now_s)

    def health(self) -> Health:
        """Return the node's own part of the diagnostics; asked for while the node is active."""
        return Health()

    def report_health(self) -> None:
        """Publish the diagnostics."""
        level, text, values = self.health() if self.active else Health(text=self.state)
        now_s = time.monotonic()
        values = {'state': self.state, **values, **self.vitals.report(now_s)}
        reasons, mismatched = self.vitals.refusing(now_s), self._mismatches.describe()
        if reasons and level == DiagnosticStatus.OK:
            text = '; '.join(f'{topic}: message refused: {reason}' for topic, reason in reasons.items())
            level = DiagnosticStatus.WARN
        if mismatched:
            level, text = DiagnosticStatus.ERROR, '; '.join(mismatched)
        message = DiagnosticArray(status=[status_message(self.get_name(), level, text, values)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def finish(self, code: Exit = Exit.OK) -> None:
        """End the node's process, once what it has published is delivered."""
        self.exit_code = code
        self._done.set_result(None)

    def spin(self) -> None:
        """Serve callbacks until finish() or a signal.

        The executor of events is several times faster than the default one. Its plain ``spin()`` must not
        be used: in rclpy 7.1 an idle wait without an end turns into a busy loop that holds the lock of the
        queue, so that no message and no timer gets in. Waits with an end are sound.
        """
        executor = EventsExecutor(context=self.context)
        executor.add_node(self)
        try:
            while not self.ended:
                executor.spin_until_future_complete(self._done, SPIN_S)
        finally:
            executor.remove_node(self)
        if self._done.done():
            self._flush()

    def _flush(self) -> None:
        deadline = time.monotonic() + FLUSH_S
        for publisher in self.publishers:
            left_s = deadline - time.monotonic()
            if isinstance(publisher, LifecyclePublisher) and left_s > 0.0 and self.context.ok():
                publisher.wait_for_all_acked(Duration(seconds=left_s))

    def _note_mismatch(self, topic: str, event: Any) -> None:
        self._mismatches.note(topic, qos_policy_name_from_kind(event.last_policy_kind))


def run_node(factory: Callable[[], PortNode[Any]]) -> int:
    """Build a node, tell the bringup that it is ready, spin it, and return its exit code.

    A node with autostart is ready once it is active, any other as soon as a manager can configure it. SIGINT
    and SIGTERM break off building and configuring; afterwards they end the spinning between two callbacks.
    """
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # such as a parameter file that is not there
        return _complain(error, Exit.CONFIGURATION)
    node = None
    try:
        _on_signals(signal.default_int_handler)
        node = factory()
        _on_signals(lambda number, frame: node.stop())
        if node.params.autostart:
            node.start()
        status_pipe.report_ready()
        node.spin()
        if node.failure is not None:
            raise node.failure
        return int(node.exit_code)
    except (ParamError, ScenarioError, ChartError) as error:
        return _complain(error, Exit.CONFIGURATION)
    except ModelError as error:
        return _complain(error, Exit.NO_MODEL)
    except KeyboardInterrupt:
        return int(Exit.OK)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _stamp_reader(message_type: Any) -> Callable[[Any], int]:
    """What reads the stamp of a message in ns, NO_STAMP where its type has none."""
    if hasattr(message_type, 'header'):
        return lambda message: read_stamp(message.header.stamp)
    return lambda message: NO_STAMP


def _on_signals(handler: Callable[[int, Any], None]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)


def _complain(error: Exception, code: Exit) -> int:
    print(f'error: {error}', file=sys.stderr, flush=True)
    return int(code)
