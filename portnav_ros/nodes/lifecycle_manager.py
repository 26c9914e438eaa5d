"""The manager of a graph's nodes: configures all at once, activates them in order, deactivates in reverse.

Lives in the process of the bringup, which tells it what processes there are and lets it work in small
bits. An emergency stop outlives the safety monitor: a new one is told of it before it is activated. The
manager speaks on ``managed_nodes_activated`` (latched) and answers ``lifecycle_manager/is_active``.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.client import Client
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from portnav_ros.nodes.standing_stop import MONITOR, StandingStop
from portnav_ros.nodes.topics import TOPICS, offered_qos

NAME = 'lifecycle_manager'
ACTIVATED = 'managed_nodes_activated'
UNKNOWN, UNCONFIGURED, INACTIVE, ACTIVE = 'unknown', 'unconfigured', 'inactive', 'active'
ANSWER_S = 1.0  # without an answer for so long, the state is read again
GREETING_S = 0.05  # the same for a process that is new and may not hear yet; doubles with every reading


class Step(NamedTuple):
    """A transition to ask for. number: of lifecycle_msgs/Transition; target: state that it leads to."""

    number: int
    name: str
    target: str


CONFIGURE = Step(Transition.TRANSITION_CONFIGURE, 'configure', INACTIVE)
ACTIVATE = Step(Transition.TRANSITION_ACTIVATE, 'activate', ACTIVE)
STOP = Step(0, 'stop', INACTIVE)  # no transition: an emergency stop that a new safety monitor must know of
DEACTIVATE = Step(Transition.TRANSITION_DEACTIVATE, 'deactivate', INACTIVE)


def ros_arguments(remaps: Iterable[str]) -> list[str]:
    """Arguments of a process by which its nodes rename OLD:=NEW."""
    rules = [part for remap in remaps for part in ('-r', remap)]
    return ['--ros-args', *rules] if rules else []


def due(states: Mapping[str, str], rising: bool) -> dict[str, Step]:
    """Return what to ask of whom next.

    Args:
        states: of every node, in the order of activation.
        rising: whether they are to become active, else inactive.
    """
    if not rising:
        active = [name for name, state in states.items() if state == ACTIVE]
        return {active[-1]: DEACTIVATE} if active else {}
    if unconfigured := [name for name, state in states.items() if state == UNCONFIGURED]:
        return dict.fromkeys(unconfigured, CONFIGURE)
    if not set(states.values()) <= {INACTIVE, ACTIVE}:
        return {}
    inactive = [name for name, state in states.items() if state == INACTIVE]
    return {inactive[0]: ACTIVATE} if inactive else {}


class RemoteNode:
    """What is known of one managed node, and the one question that it has not answered yet."""

    def __init__(self, node: Node, name: str) -> None:
        self.state = UNKNOWN
        self.step: Step | None = None  # the transition that was asked for last, until it is reached
        self.stopped = False  # whether it has taken the order to stop
        self._pid: int | None = None
        self._read = node.create_client(GetState, f'{name}/get_state')
        self._change = node.create_client(ChangeState, f'{name}/change_state')
        self._stop = node.create_client(SetBool, f'{name}/emergency_stop') if name == MONITOR else None
        self._asked: tuple[Client, Future] | None = None
        self._patience_s = self._until_s = 0.0

    @property
    def idle(self) -> bool:
        """Whether it has answered everything."""
        return self._asked is None

    def follow(self, pid: int | None) -> None:
        """Take note of its process, None while there is none that is up; nothing is known of a new one."""
        if pid != self._pid:
            self._pid, self._patience_s, self.stopped = pid, GREETING_S, False
            self._forget()

    def ask(self, step: Step, now_s: float) -> None:
        """Ask for a transition, or for a stop, once it is there to be asked for."""
        if step is STOP:
            self._ask_stop(now_s)
            return
        self.step, self._until_s = step, now_s + ANSWER_S
        request = ChangeState.Request(transition=Transition(id=step.number))
        self._asked = self._change, self._change.call_async(request)

    def _ask_stop(self, now_s: float) -> None:
        if self._stop is not None and self._stop.service_is_ready():
            self.step, self._until_s = STOP, now_s + ANSWER_S
            self._asked = self._stop, self._stop.call_async(SetBool.Request(data=True))

    def listen(self, now_s: float) -> None:
        """Take the answer; read the state where it is not known, or where no answer has come in time."""
        if self._asked is not None:
            _, future = self._asked
            if future.done():
                self._take(future.result())
            elif now_s > self._until_s:
                self._forget()
        if self._pid is not None and self.idle and self.state == UNKNOWN and self._read.service_is_ready():
            self._asked = self._read, self._read.call_async(GetState.Request())
            self._until_s = now_s + self._patience_s
            self._patience_s = min(2.0 * self._patience_s, ANSWER_S)

    def _take(self, answer: Any) -> None:
        self._asked = None
        if isinstance(answer, GetState.Response):
            known = answer.current_state.label in (UNCONFIGURED, INACTIVE, ACTIVE)
            self.state = answer.current_state.label if known else UNKNOWN
        elif answer.success and self.step is not None:
            self.state = self.step.target
            self.stopped = self.stopped or self.step is STOP
        else:
            self.state = UNKNOWN
        if self.step is not None and self.state == self.step.target:
            self.step = None

    def _forget(self) -> None:
        if self._asked is not None:
            client, future = self._asked
            client.remove_pending_request(future)
        self._asked, self.state = None, UNKNOWN


class LifecycleManager:
    """Leads nodes to where they are to be; never waits longer than it is told to.

    Args:
        names: of the nodes, in the order of activation.
        namespace: of the nodes.
        remaps: of the nodes; the manager hears and orders what the safety monitor does.
    """

    def __init__(self, names: Sequence[str], namespace: str = '', remaps: Sequence[str] = ()) -> None:
        self._context = Context()
        arguments = ros_arguments(remap.removeprefix(f'{MONITOR}:') for remap in remaps)
        rclpy.init(args=arguments, context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(NAME, context=self._context, namespace=namespace)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._remotes = {name: RemoteNode(self._node, name) for name in names}
        self._node.create_service(Trigger, '~/is_active', self._answer)
        self._standing = StandingStop(self._node)
        row = TOPICS[ACTIVATED]
        self._publisher = self._node.create_publisher(row.type, row.name, offered_qos(row))
        self._rising = True
        self._tell(False)

    def step(self, pids: Mapping[str, int | None], wait_s: float) -> dict[str, bool]:
        """Hear answers and ask what is due.

        Args:
            pids: process of each node that there is to be; None while it is not up.
            wait_s: longest time to wait for answers.

        Returns:
            The nodes that have become active (True) or inactive (False).
        """
        self._executor.spin_until_future_complete(Future(), wait_s)
        now_s, before = time.monotonic(), self._states(pids)
        for name, remote in self._remotes.items():
            remote.follow(pids.get(name))
            remote.listen(now_s)
        states = self._states(pids)
        for name, step in due(states, self._rising).items():
            remote = self._remotes[name]
            unaware = name == MONITOR and self._standing.in_force and not remote.stopped
            if remote.idle:
                remote.ask(STOP if step is ACTIVATE and unaware else step, now_s)
        if (active := set(states.values()) == {ACTIVE}) != self._active:
            self._tell(active)
        reached = [
            name for name in states if states[name] in (INACTIVE, ACTIVE) and states[name] != before[name]
        ]
        return {name: states[name] == ACTIVE for name in reached}

    def begin_rest(self) -> None:
        """From now on deactivate."""
        self._rising = False

    def waits(self, pids: Mapping[str, int | None]) -> bool:
        """Whether a node is yet to get where it is to be; one that does not answer is none to wait for."""
        states = self._states(pids).values()
        return not set(states) <= {ACTIVE} if self._rising else ACTIVE in states

    def behind(self, pids: Mapping[str, int | None]) -> dict[str, str]:
        """Return the nodes that the others wait for, and what they are to do."""
        found = {}
        for name in self._states(pids):
            remote = self._remotes[name]
            if pids[name] is None:
                found[name] = 'its process is not up'
            elif not remote.idle or remote.state == UNKNOWN:
                found[name] = f'no answer to {remote.step.name if remote.step else "get_state"}'
        return found

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.remove_node(self._node)
        self._executor.shutdown()  # it holds the node's callbacks, which Python cannot collect
        self._node.destroy_node()
        self._context.try_shutdown()

    def _states(self, pids: Mapping[str, int | None]) -> dict[str, str]:
        return {name: remote.state for name, remote in self._remotes.items() if name in pids}

    def _tell(self, active: bool) -> None:
        self._active = active
        self._publisher.publish(Bool(data=active))

    def _answer(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._active
        states = {name: remote.state for name, remote in self._remotes.items()}
        response.message = ', '.join(f'{name} {state}' for name, state in states.items())
        return response
