"""Tries one fault after the other on a running graph, and says what came of each."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import rclpy
from rclpy.context import Context
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from portnav_ros.nodes.domain_lock import read_domain
from portnav_ros.nodes.faults.graph import GOAL, FaultError, GraphUnderTest
from portnav_ros.nodes.faults.injector import Injector, Spoil
from portnav_ros.nodes.faults.verdict import Row, stopped_for_s, unsafe_for_s
from portnav_ros.nodes.faults.witness import Witness
from portnav_ros.nodes.messages import pose_message
from portnav_ros.nodes.topics import TOPICS, offered_qos

PATIENCE_S = 120.0  # by the clock, with a graph that starts or recovers
GOAL_S = 3.0  # by the clock, after which the diagnostics tell whether a goal was heard
REASON_S = 20.0  # by the clock: diagnostics come once a second
SETTLED_S = 0.8  # of safe commands on end, until a stop is believed
STALL_S = 3.0  # of a stop because the machine stalls: its processes cannot tell that from a lost sensor
LEAST_SPEED_MPS = 1.2  # before a fault begins
STEP_S = 0.05


@dataclass(frozen=True)
class Fault:
    """One row of the table.

    limit_s: within which the vessel must be stopped, None where it must sail on. reason: what the graph
    must say meanwhile, a part of the text. begin: lets it last as long as its context. hold_s: for how long,
    in the driver's time, once the vessel is stopped; 0 for a fault that mends itself.
    """

    name: str
    limit_s: float | None
    reason: str
    begin: Callable[[Rig], AbstractContextManager[None]]
    hold_s: float = 0.5


class Rig:
    """A graph under test, and the node that stands between it and its driver.

    Args:
        out: folder for what the graph leaves.
    """

    def __init__(self, out: Path) -> None:
        self.graph = GraphUnderTest(out)
        self._stack, self._ended_s = ExitStack(), math.inf

    def __enter__(self) -> Self:
        """Start everything, and set out for the goal."""
        try:
            self.context = Context()
            rclpy.init(context=self.context, domain_id=read_domain(os.environ))
            self._stack.callback(self.context.try_shutdown)
            self._executor: Executor = EventsExecutor(context=self.context)
            self.node = self._stack.enter_context(self.another_node('fault_injector'))
            self.injector = Injector(self.node)
            self.witness = Witness(self.node, self.injector)
            row = TOPICS['goal_pose']
            self._goals = self.node.create_publisher(row.type, row.name, offered_qos(row))
            self._stack.enter_context(self.graph)
            self.set_out(GOAL)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End everything."""
        self._stack.close()

    def run(self, fault: Fault) -> Row:
        """Wait until the vessel sails, try a fault, and wait until it sails again."""
        self.until(self._under_way, 'the vessel to sail')
        self.witness.forget()
        said, began_s = len(self.graph.said()), self.witness.now_s
        self._ended_s, complaint = math.inf, ''
        try:
            with fault.begin(self):
                self._endure(fault, began_s)
                self._await_reason(fault, said)
        except FaultError as error:
            complaint = str(error)
        row = self._judge(fault, began_s)._replace(reason=self._reason(fault, said))
        recovered = self._recovers()
        lost = '' if recovered else f'it did not sail again; {self.graph.last_words()}'
        return row._replace(recovered=recovered, complaint=complaint or row.complaint or lost)

    def set_out(self, goal: tuple[float, float]) -> None:
        """Send a goal once the graph is active, and wait for a plan to it."""
        self.until(lambda: self.witness.activated, 'an active graph')
        self.witness.plan_ends.clear()
        while goal not in self.witness.plan_ends:
            self._send(goal)

    def sail(self, time_s: float) -> None:
        """Let time pass, in the driver's time."""
        end_s = self.witness.now_s + time_s
        self.until(lambda: self.witness.now_s >= end_s, 'time to pass')

    def until(self, condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
        """Pass messages on until a condition holds.

        Raises:
            FaultError: it does not hold in time, or the graph has ended.
        """
        limit_s = time.monotonic() + patience_s
        while not condition():
            if not self.graph.running:
                raise FaultError(f'the graph has ended; {self.graph.last_words()}')
            if time.monotonic() > limit_s:
                raise FaultError(f'waited {patience_s:g} s in vain for {what}')
            self._executor.spin_once(STEP_S)

    @contextmanager
    def spoilt(self, topic: str, spoil: Spoil) -> Iterator[None]:
        """Spoil every message of a topic."""
        relay = self.injector.relays[topic]
        relay.spoil = spoil
        try:
            yield
        finally:
            relay.spoil = None

    @contextmanager
    def another_node(self, name: str) -> Iterator[Node]:
        """Join the graph with a node more."""
        node = rclpy.create_node(name, context=self.context)
        self._executor.add_node(node)
        try:
            yield node
        finally:
            self._executor.remove_node(node)
            node.destroy_node()

    def send_goal(self, x_m: float, y_m: float) -> None:
        """Send a goal to whoever listens."""
        self._goals.publish(pose_message(x_m, y_m, 0.0, 0))

    def _send(self, goal: tuple[float, float]) -> None:
        sent_s = time.monotonic()
        self.send_goal(*goal)
        self.until(lambda: goal in self.witness.plan_ends or self._unheard(sent_s), f'a plan to {goal}')

    def _unheard(self, sent_s: float) -> bool:
        """Whether the global planner, just started, was not there yet when a goal was sent."""
        waited = time.monotonic() - sent_s > GOAL_S
        return waited and self.witness.states.get('global_planner') == 'no goal yet'

    def _under_way(self) -> bool:
        return self.witness.sailing and self.witness.surge_mps >= LEAST_SPEED_MPS

    def _endure(self, fault: Fault, began_s: float) -> None:
        """Watch what the fault does; what comes later, while its reason is waited for, is not judged."""
        if fault.limit_s is not None:
            self._await_stop(began_s + fault.limit_s)
        self.sail(fault.hold_s)
        if fault.limit_s is None:
            self.until(lambda: self.witness.sailing, 'the vessel to sail on')
        self._ended_s = self.witness.now_s

    def _judge(self, fault: Fault, began_s: float) -> Row:
        ended_s = min(self._ended_s, self.witness.now_s)
        if fault.limit_s is None:
            stopped_s = stopped_for_s(self.witness.setpoints, began_s, ended_s)
            complaint = f'the vessel was stopped for {stopped_s:.1f} s' if stopped_s > STALL_S else ''
            return Row(fault.name, math.nan, stopped_s, stopped_s > 0.0, False, '', complaint)
        measured_s = unsafe_for_s(self.witness.commands, began_s, ended_s)
        stopped = measured_s <= fault.limit_s
        complaint = '' if stopped else f'unsafe commands for {measured_s:.2f} s'
        return Row(fault.name, fault.limit_s, measured_s, stopped, False, '', complaint)

    def _await_stop(self, limit_s: float) -> None:
        """Wait until commands have been safe for a while, or the limit is over."""
        witness = self.witness
        begin_s = witness.now_s

        def settled() -> bool:
            safe_for_s = witness.now_s - begin_s - unsafe_for_s(witness.commands, begin_s, witness.now_s)
            return safe_for_s >= SETTLED_S or witness.now_s > limit_s + SETTLED_S

        self.until(settled, 'a stop')

    def _await_reason(self, fault: Fault, said: int) -> None:
        try:
            self.until(lambda: fault.reason in self._reason(fault, said), 'the reason', REASON_S)
        except FaultError:
            told = '; '.join(sorted(set(self.witness.told)))
            raise FaultError(f'nobody names {fault.reason!r}, but: {told}') from None

    def _recovers(self) -> bool:
        try:
            self.until(lambda: self.witness.sailing, 'the vessel to sail again')
        except FaultError:
            return False
        return True

    def _reason(self, fault: Fault, said: int) -> str:
        """What the graph has said that holds the reason looked for, or nothing."""
        if not fault.reason:
            return ''
        texts = (*self.witness.told, *self.graph.said()[said:])
        return next((text.strip() for text in texts if fault.reason in text), '')
