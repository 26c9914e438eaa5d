"""Heading and speed to rudder and thrust: answers every odometry with a command of the same stamp."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry

from portnav_ros.control.autopilot import PID_SIZE, AutopilotParams, steer
from portnav_ros.nodes.messages import (
    SECOND_NS,
    MessageError,
    fill_joints,
    nanoseconds,
    new_joints,
    read_odometry,
    read_setpoint,
    read_stamp,
)
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import Health, PortNode, run_node
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.types import STATE_SIZE, Actuation, Setpoint
from portnav_ros.vessel import VesselParams

NAME = 'pid_controller'
NEUTRAL = Actuation(0.0, 0.0)
FUTURE_NS = nanoseconds(0.1)
WATCH_S = 0.1


@dataclass(frozen=True)
class PidParams(NodeParams):
    """Parameters of the node.

    preset: vessel in config/vessels, or a YAML file; vessel.*: what differs from it. autopilot.*: gains.
    lock_step: wait for the setpoint of the present decision before answering. planner_period_s: of the
    local planner. setpoint_age_s: age of the setpoint past which the vessel is stopped. odom_age_s: silence
    of the driver past which commands are neutral. period_s: of the odometry, for the first step.
    limit_rates: change commands no faster than the vessel's actuators move (rudder_rate_radps,
    thrust_rate_nps), for a driver that passes them on as they come; the simulated actuators, like most
    steering gears, have a rate of their own, and limiting twice costs agility.
    """

    preset: str = 'shuttle'
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    lock_step: bool = False
    planner_period_s: float = 1.0
    setpoint_age_s: float = 1.5
    odom_age_s: float = 0.5
    period_s: float = 0.05
    limit_rates: bool = False
    ranges: ClassVar[Ranges] = {
        'planner_period_s': (0.05, 60.0),
        'setpoint_age_s': (0.05, 600.0),
        'odom_age_s': (0.05, 60.0),
        'period_s': (0.001, 1.0),
    }

    def __post_init__(self) -> None:
        """Refuse times that make no sense."""
        check_ranges(self)


DEFAULTS = PidParams()


class PidController(PortNode[PidParams]):
    """Time is the stamp of the newest odometry; ages are told in it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, DEFAULTS, **options)

    def configure(self) -> None:
        """Compile the autopilot, and speak and listen."""
        self._gains, self._model = self.params.autopilot.gains(), self.params.vessel.model()
        self._own, self._memory = np.zeros(STATE_SIZE), np.zeros(PID_SIZE)
        self._period_ns = nanoseconds(self.params.planner_period_s)
        self._setpoint_age_ns = nanoseconds(self.params.setpoint_age_s)
        self.get_logger().info('the first start compiles the autopilot, a few seconds')
        steer(self._gains, self._model, np.zeros(PID_SIZE), self._own, 0.0, 0.0, self.params.period_s)
        self._message = new_joints()
        self._commands = self.publisher('cmd_actuators')
        self.subscribe('odom', self._take_odometry)
        self.subscribe('setpoint', self._take_setpoint)
        self.timer(WATCH_S, self._watch)

    def activate(self) -> None:
        """Know nothing yet."""
        self._forget()
        self._stop_reason = 'no odometry yet'

    def deactivate(self) -> None:
        """Leave the actuators neutral."""
        if self._time_ns >= 0:
            self._publish_neutral()

    def health(self) -> Health:
        """Tell why the vessel is being stopped, if it is."""
        values = {'time_ns': self._time_ns, 'setpoint_ns': self._setpoint_ns}
        if self._stop_reason:
            return Health(DiagnosticStatus.WARN, f'stop: {self._stop_reason}', values)
        return Health(values=values)

    def _forget(self) -> None:
        """Start anew: nothing is known of odometry and setpoint."""
        self._memory[:] = 0.0
        self._time_ns, self._setpoint_ns, self._unspent_s = -1, -1, 0.0
        self._setpoint, self._command = Setpoint(0.0, 0.0), NEUTRAL
        self._stop_yaw_rad: float | None = None
        self._heard_s = time.monotonic()

    def _take_odometry(self, message: Odometry) -> None:
        state, time_ns = read_odometry(message), read_stamp(message.header.stamp)
        if time_ns < self._time_ns:
            self._forget()
        first = self._time_ns < 0
        step_s = self.params.period_s if first else (time_ns - self._time_ns) / SECOND_NS
        self._own[:] = state
        self._heard_s, self._time_ns = time.monotonic(), time_ns
        self._unspent_s += step_s
        self._answer()

    def _take_setpoint(self, message: Odometry) -> None:
        setpoint, stamp_ns = read_setpoint(message), read_stamp(message.header.stamp)
        if 0 <= self._time_ns < stamp_ns - FUTURE_NS:
            raise MessageError('stamp lies in the future')
        self._setpoint = setpoint
        self._setpoint_ns = min(stamp_ns, self._time_ns) if self._time_ns >= 0 else stamp_ns
        if self._time_ns >= 0:
            self._answer()

    def _answer(self) -> None:
        """Command the vessel for the newest odometry; in lock-step only with this decision's setpoint."""
        decision_ns = self._time_ns - self._time_ns % self._period_ns
        if self.lock_step and self._setpoint_ns < decision_ns:
            return
        target, step_s, self._unspent_s = self._target(), self._unspent_s, 0.0
        command = Actuation(*steer(self._gains, self._model, self._memory, self._own, *target, step_s))
        if self.params.limit_rates:
            command = limited(command, self._command, self.params.vessel, step_s)
        self._command = command
        fill_joints(self._message, self._time_ns, command)
        self._commands.publish(self._message)

    def _target(self) -> Setpoint:
        """Return the setpoint, or a stop on the present heading, which keeps the rudder effective."""
        if self._setpoint_ns >= 0 and self._time_ns - self._setpoint_ns <= self._setpoint_age_ns:
            self._stop_yaw_rad, self._stop_reason = None, ''
            return self._setpoint
        if self._stop_yaw_rad is None:
            self._stop_yaw_rad = float(self._own[2])
        self._stop_reason = 'no setpoint yet' if self._setpoint_ns < 0 else 'setpoint too old'
        return Setpoint(self._stop_yaw_rad, 0.0)

    def _watch(self) -> None:
        """Keep the actuators neutral while the driver says nothing: there is no heading to keep."""
        silent = self._time_ns >= 0 and time.monotonic() - self._heard_s > self.params.odom_age_s
        if silent and not self.lock_step:
            self._stop_reason = 'odometry too old: actuators neutral'
            self._publish_neutral()

    def _publish_neutral(self) -> None:
        self._command = NEUTRAL
        fill_joints(self._message, self._time_ns, NEUTRAL)
        self._commands.publish(self._message)


def limited(command: Actuation, last: Actuation, vessel: VesselParams, step_s: float) -> Actuation:
    """Return the command, moved from the last one no faster than the vessel's actuators."""
    rudder, thrust = vessel.rudder_rate_radps * step_s, vessel.thrust_rate_nps * step_s
    return Actuation(
        min(max(command.rudder_rad, last.rudder_rad - rudder), last.rudder_rad + rudder),
        min(max(command.thrust_n, last.thrust_n - thrust), last.thrust_n + thrust),
    )


def main() -> int:
    """Run the node."""
    return run_node(PidController)


if __name__ == '__main__':
    raise SystemExit(main())
