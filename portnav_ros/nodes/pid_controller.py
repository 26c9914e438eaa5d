"""Heading and speed to rudder and thrust: answers every odometry with a command of the same stamp."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry

from portnav_ros.control.autopilot import PID_SIZE, AutopilotParams, steer
from portnav_ros.nodes.inputs import Inputs
from portnav_ros.nodes.messages import (
    SECOND_NS,
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
from portnav_ros.safety.braking import ThrustBound
from portnav_ros.safety.rivals import RivalWatch
from portnav_ros.types import STATE_SIZE, SURGE, YAW, Actuation, Setpoint
from portnav_ros.vessel import VesselParams

NAME = 'pid_controller'
ODOM, SETPOINT = 'odom', 'setpoint'
NEUTRAL = Actuation(0.0, 0.0)
WATCH_S = 0.1
AT_REST_MPS = 0.2


@dataclass(frozen=True)
class PidParams(NodeParams):
    """Parameters of the node.

    preset: vessel in config/vessels, or a YAML file; vessel.*: what differs from it. autopilot.*: gains.
    lock_step: wait for the setpoint of the present decision before answering. planner_period_s: of the
    local planner. setpoint_age_s: age of the setpoint past which the vessel is stopped. odom_age_s: the same
    for odometry, past which commands are neutral. release_s: time without any reason to stop before a
    stop ends. rate: simulated seconds per second. astern_s: longest time of astern thrust on end, during
    a stop of thrust ahead, too; 0 is half as long again as a stop from full speed takes. period_s: of the
    odometry, for the first step. limit_rates: change commands no faster than the vessel's actuators move
    (rudder_rate_radps, thrust_rate_nps), for a driver that passes them on as they come; the simulated
    actuators, like most steering gears, have a rate of their own, and limiting twice costs agility.
    """

    preset: str = 'shuttle'
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    lock_step: bool = False
    planner_period_s: float = 1.0
    setpoint_age_s: float = 1.5
    odom_age_s: float = 0.5
    release_s: float = 2.0
    rate: float = 1.0
    astern_s: float = 0.0
    period_s: float = 0.05
    limit_rates: bool = False
    ranges: ClassVar[Ranges] = {
        'planner_period_s': (0.05, 60.0),
        'setpoint_age_s': (0.05, 600.0),
        'odom_age_s': (0.05, 60.0),
        'release_s': (0.0, 600.0),
        'rate': (0.01, 1000.0),
        'astern_s': (0.0, 3600.0),
        'period_s': (0.001, 1.0),
    }

    def __post_init__(self) -> None:
        """Refuse times that make no sense."""
        check_ranges(self)


DEFAULTS = PidParams()


class PidController(PortNode[PidParams]):
    """Answers each odometry with a command of its stamp; without a setpoint to trust it stops the vessel."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, DEFAULTS, **options)
        self.steady_s = time.monotonic

    def configure(self) -> None:
        """Compile the autopilot, and speak and listen."""
        self._gains, self._model = self.params.autopilot.gains(), self.params.vessel.model()
        self._own, self._memory = np.zeros(STATE_SIZE), np.zeros(PID_SIZE)
        self._period_ns = nanoseconds(self.params.planner_period_s)
        limits_s = {ODOM: self.params.odom_age_s, SETPOINT: self.params.setpoint_age_s}
        clock = None if self.lock_step else lambda: self.steady_s()
        self._inputs = Inputs(limits_s, self.params.rate, self.params.release_s, clock)
        self._bound = ThrustBound(self.params.astern_s, self.params.vessel)
        self.get_logger().info('the first start compiles the autopilot, a few seconds')
        steer(self._gains, self._model, np.zeros(PID_SIZE), self._own, 0.0, 0.0, self.params.period_s)
        self._message = new_joints()
        self._commands = self.publisher('cmd_actuators')
        self.subscribe(ODOM, self._take_odometry)
        self._listens_to = self.subscribe(SETPOINT, self._take_setpoint)
        self.timer(WATCH_S, self._watch)

    def activate(self) -> None:
        """Know nothing yet."""
        self._stop_reason, self._rivalry, self._rivals = 'no odom yet', '', RivalWatch(SETPOINT)
        self._forget()

    def deactivate(self) -> None:
        """Leave the actuators neutral."""
        if self._time_ns >= 0:
            self._publish_neutral()

    def health(self) -> Health:
        """Tell why the vessel is being stopped, if it is."""
        values = {
            'time_ns': self._time_ns,
            'setpoint_ns': self._setpoint_ns,
            'stop_reason': self._stop_reason,
            'thrust_bound': 'reached' if self._bound.reached else '',
        }
        if self._rivalry:
            return Health(DiagnosticStatus.ERROR, f'stop: {self._rivalry}', values)
        if self._stop_reason:
            return Health(DiagnosticStatus.WARN, f'stop: {self._stop_reason}', values)
        if self._bound.reached and abs(self._own[SURGE]) > AT_REST_MPS:  # at rest it is as it should be
            return Health(DiagnosticStatus.WARN, 'thrust the same way for too long: held at 0', values)
        return Health(values=values)

    def _forget(self) -> None:
        """Start anew: nothing is known of odometry and setpoint."""
        self._memory[:] = 0.0
        self._time_ns, self._setpoint_ns, self._unspent_s = -1, -1, 0.0
        self._setpoint, self._command = Setpoint(0.0, 0.0), NEUTRAL
        self._stop_yaw_rad: float | None = None
        self._bound.forget()
        self._inputs.forget()

    def _take_odometry(self, message: Odometry) -> None:
        state, time_ns = read_odometry(message), read_stamp(message.header.stamp)
        rested = self._inputs.is_late(ODOM, time_ns)  # a time in neutral is none of braking astern
        if self._inputs.note(ODOM, time_ns):
            self._forget()
            self._inputs.note(ODOM, time_ns)
        if time_ns < self._time_ns:
            return  # overtaken on its way
        if rested or self._time_ns < 0:
            self._unspent_s = self.params.period_s
        else:
            self._unspent_s += (time_ns - self._time_ns) / SECOND_NS
        self._own[:], self._time_ns = state, time_ns
        self._answer()

    def _take_setpoint(self, message: Odometry) -> None:
        setpoint, stamp_ns = read_setpoint(message), read_stamp(message.header.stamp)
        self._inputs.note(SETPOINT, stamp_ns)
        self._setpoint, self._setpoint_ns = setpoint, stamp_ns
        if self._time_ns >= 0:
            self._answer()

    def _answer(self) -> None:
        """Command the vessel for the newest odometry; in lock-step only with this decision's setpoint."""
        decision_ns = self._time_ns - self._time_ns % self._period_ns
        if self.lock_step and self._setpoint_ns < decision_ns:
            return
        target = self._target()
        if self._inputs.is_late(ODOM, self._time_ns):
            self._publish_neutral()
            return
        step_s, self._unspent_s = self._unspent_s, 0.0
        rudder, thrust = steer(self._gains, self._model, self._memory, self._own, *target, step_s)
        command = Actuation(rudder, self._bound.apply(thrust, step_s, target.speed_mps == 0.0))
        if self.params.limit_rates:
            command = limited(command, self._command, self.params.vessel, step_s)
        self._command = command
        fill_joints(self._message, self._time_ns, command)
        self._commands.publish(self._message)

    def _target(self) -> Setpoint:
        """Return the setpoint, or a stop on the present heading, which keeps the rudder effective."""
        self._stop_reason = self._inputs.judge(self._time_ns, self._rivalry)
        if not self._stop_reason:
            self._stop_yaw_rad = None
            return self._setpoint
        if self._stop_yaw_rad is None:
            self._stop_yaw_rad = float(self._own[YAW])
        return Setpoint(self._stop_yaw_rad, 0.0)

    def _watch(self) -> None:
        """Keep the actuators neutral while the driver says nothing: there is no heading to keep."""
        if self.lock_step:
            return
        self._rivalry = self._rivals.note(self.rivals_on(self._listens_to), self.steady_s())
        if self._time_ns >= 0 and self._inputs.is_late(ODOM, self._time_ns):
            self._answer()

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
