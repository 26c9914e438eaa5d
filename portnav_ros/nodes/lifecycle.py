"""The states of a node, as ROS 2 manages them: unconfigured, inactive, active, finalized."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future


class ManagedNode(LifecycleNode):
    """A node that somebody configures and activates: a manager by its services, or ``start``.

    Subclasses say what they do in the four methods without a leading ``on_``. What these raise makes the
    transition fail and ends the node; it is kept in ``failure``. A transition that the present state does
    not allow is answered with ``success`` false.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.active = False
        self.failure: BaseException | None = None
        self._done, self._stopped, self._configuring = Future(), False, False
        self._lasting: set[Any] = set()
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._change_state_if_allowed

    def configure(self) -> None:
        """Make publishers, subscriptions, services and timers; load what is needed, and warm up."""

    def activate(self) -> None:
        """Begin: nothing of what was heard before counts, but for latched topics."""

    def deactivate(self) -> None:
        """End well; the last chance to publish."""

    def cleanup(self) -> None:
        """Give back what configure() took, but for what belongs to ROS."""

    @property
    def state(self) -> str:
        """Label of the present state, such as ``inactive``."""
        return str(self._state_machine.current_state[1])

    @property
    def ended(self) -> bool:
        """Whether there is nothing more to do."""
        return self._stopped or self._done.done() or not self.context.ok()

    def start(self) -> None:
        """Configure and activate; raises what they raise, and KeyboardInterrupt where stop() broke it off."""
        for transition in (self.trigger_configure, self.trigger_activate):
            transition()
            if self.failure is not None:
                raise self.failure

    def stop(self) -> None:
        """End soon; may be called by a signal handler, and breaks off configure()."""
        self._stopped = True
        if self._configuring:
            raise KeyboardInterrupt

    def destroy_node(self) -> None:
        """End in good order, in whatever state, and give everything back."""
        if self.context.ok() and self.state != 'finalized':
            self.trigger_shutdown()
        super().destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; called by rclpy."""
        self._lasting = set(self._entities())
        return self._attempt(self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let messages through, then activate; called by rclpy."""
        self.active = True
        super().on_activate(state)
        return self._attempt(self.activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate, then let no more messages through; called by rclpy."""
        result = self._attempt(self.deactivate)
        self.active = False
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Undo on_configure; called by rclpy."""
        result = self._attempt(self.cleanup)
        for entity, destroy in self._entities().items():
            if entity not in self._lasting:
                destroy(entity)
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up as far as there is something to, and end; called by rclpy."""
        if state.label == 'active':
            self.on_deactivate(state)
        if state.label in ('active', 'inactive'):
            self._attempt(self.cleanup)
        self._stopped = True
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        self._configuring = True
        try:
            self.configure()
        finally:
            self._configuring = False

    def _attempt(self, action: Callable[[], None]) -> TransitionCallbackReturn:
        """Act; rclpy would swallow what is raised."""
        try:
            action()
        except (Exception, KeyboardInterrupt) as error:
            self.failure = self.failure or error
            self._stopped = True
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _entities(self) -> dict[Any, Callable[[Any], Any]]:
        """Everything of ROS that the node has, with what destroys it."""
        return {
            **dict.fromkeys(self.publishers, self.destroy_lifecycle_publisher),
            **dict.fromkeys(self.subscriptions, self.destroy_subscription),
            **dict.fromkeys(self.services, self.destroy_service),
            **dict.fromkeys(self.timers, self.destroy_timer),
        }

    def _change_state_if_allowed(self, request: Any, response: Any) -> Any:
        """Keep rclpy 7.1 from ending the process over a transition that the state does not allow."""
        try:
            return self._change_state(request, response)
        except rclpy_implementation.RCLError:
            self.get_logger().warning(f'no transition {request.transition.id} from state {self.state}')
            response.success = False
            return response
