"""Between planner and autopilot: passes a setpoint on, slows the vessel down, or stops it with the reason."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from portnav_ros.control.autopilot import AutopilotParams
from portnav_ros.nodes.inputs import checked
from portnav_ros.nodes.markers import track_marker
from portnav_ros.nodes.messages import (
    SECOND_NS,
    MessageError,
    fill_setpoint,
    nanoseconds,
    new_scan,
    new_setpoint,
    read_odometry,
    read_scan,
    read_setpoint,
    read_stamp,
    status_message,
)
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import Health, PortNode, run_node
from portnav_ros.nodes.topics import TOPICS, every_qos
from portnav_ros.params import Ranges, check_ranges
from portnav_ros.safety.ages import Arrival, InputAges
from portnav_ros.safety.decision import SetpointParams
from portnav_ros.safety.emergency import ORDERED_BY, SERVICE, TOPIC, EmergencyOrders
from portnav_ros.safety.guard import ODOM, SCAN, SETPOINT, Decision, Guard
from portnav_ros.safety.mounting import Mounting
from portnav_ros.safety.plausibility import PlausibilityParams, ray_misfit
from portnav_ros.safety.rivals import RivalWatch
from portnav_ros.safety.zones import Zone, ZoneParams
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.types import STATE_SIZE, SURGE, Scan, Setpoint
from portnav_ros.vessel import VesselParams

NAME = 'safety_monitor'
WATCH_S = 0.1
MARKERS_S = 1.0
EMERGENCY = 'emergency stop'
COLOURS = {True: (1.0, 0.1, 0.1), False: (1.0, 0.8, 0.1)}


@dataclass(frozen=True)
class SafetyParams(NodeParams):
    """Parameters of the node.

    preset: vessel in config/vessels, or a YAML file; vessel.*: what differs from it. autopilot.*: gains of
    the PID controller, with which a stop is rehearsed. lidar.*: the sensor, whose rays are checked.
    mounting.*: where it is. zone.*: room for a stop. sensors.*: when a sensor is believed. setpoints.*: what
    a planner may ask, and release. lock_step: decide once for each setpoint, with odometry and scan of its
    stamp. planner_period_s: of the local planner. zones: look after the room for a stop. age_s: of scan and
    odometry, past which the vessel is stopped. setpoint_age_s: the same for the planner's setpoint. rate:
    simulated seconds per second.
    """

    preset: str = 'shuttle'
    vessel: VesselParams = field(default_factory=VesselParams)
    autopilot: AutopilotParams = field(default_factory=AutopilotParams)
    lidar: LidarParams = field(default_factory=LidarParams)
    mounting: Mounting = field(default_factory=Mounting)
    zone: ZoneParams = field(default_factory=ZoneParams)
    sensors: PlausibilityParams = field(default_factory=PlausibilityParams)
    setpoints: SetpointParams = field(default_factory=SetpointParams)
    lock_step: bool = False
    planner_period_s: float = 1.0
    zones: bool = True
    age_s: float = 0.5
    setpoint_age_s: float = 1.5
    rate: float = 1.0
    ranges: ClassVar[Ranges] = {
        'planner_period_s': (0.05, 60.0),
        'age_s': (0.05, 60.0),
        'setpoint_age_s': (0.05, 600.0),
        'rate': (0.01, 1000.0),
    }

    def __post_init__(self) -> None:
        """Refuse times that make no sense."""
        check_ranges(self)


DEFAULTS = SafetyParams()


class SafetyMonitor(PortNode[SafetyParams]):
    """Decides with each setpoint and each scan, and ten times a second; in lock-step once for each setpoint.

    A setpoint that passes is the planner's own message. One that does not is stamped as the newest odometry,
    and a stop is repeated, so that nothing downstream goes without.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, DEFAULTS, **options)
        self.steady_s = time.monotonic
        self._orders = EmergencyOrders()

    def configure(self) -> None:
        """Compile the rehearsal of a stop, and speak and listen."""
        params = self.params
        self._period_ns = nanoseconds(params.planner_period_s)
        self._zone = Zone(params.zone, params.vessel, params.autopilot)
        self.get_logger().info('the first start compiles the rehearsal of a stop, a few seconds')
        points = params.mounting.points(read_scan(new_scan(params.lidar, WATCH_S)))
        self._zone.limit_mps(np.zeros(STATE_SIZE), Setpoint(0.0, 1.0), points)
        self._message = new_setpoint()
        self._setpoints = self.publisher('setpoint')
        self._states, self._markers = self.publisher('safety_state'), self.publisher('markers')
        unwanted = self._is_between_decisions if self.lock_step else None
        self.subscribe(ODOM, self._take_odometry, unwanted)
        self.subscribe(SCAN, self._take_scan, unwanted)
        self._listens_to = self.subscribe(SETPOINT, self._take_setpoint)
        self._listen_for_emergency()
        self.create_service(SetBool, '~/emergency_stop', self._on_emergency)
        if not self.lock_step:
            self.timer(WATCH_S, self._watch)
        self.timer(MARKERS_S, self._draw)

    def activate(self) -> None:
        """Know nothing yet, but an emergency stop."""
        self._guard, self._rivals = self._new_guard(), RivalWatch(SETPOINT)
        self._raw: Odometry | None = None
        self._scan: Scan | None = None
        self._time_ns = self._scan_ns = -1
        self._last, self._rivalry, self._told = Decision(Setpoint(0.0, 0.0), ''), '', ('', '')

    def deactivate(self) -> None:
        """Stop the vessel; in lock-step there is nobody to heed it."""
        if not self.lock_step and self._guard.ready:
            self._act(self._decide('the safety monitor was deactivated'))

    def health(self) -> Health:
        """Tell why the vessel is stopped or slowed, if it is."""
        setpoint, reason = self._last
        values = {'stop_reason': reason, 'speed_mps': f'{setpoint.speed_mps:.2f}', 'zones': self.params.zones}
        return Health(self._level(), self._text(), values)

    def _new_guard(self) -> Guard:
        params = self.params
        limits_s = {ODOM: params.age_s, SCAN: params.age_s, SETPOINT: params.setpoint_age_s}
        ages, zone = InputAges(limits_s, params.rate), self._zone if params.zones else None
        return Guard(params.sensors, params.setpoints, zone, ages, params.mounting)

    def _listen_for_emergency(self) -> None:
        """Hear whoever publishes, reliably where they offer it, and what a latched publisher said before."""
        take = partial(self._order, TOPIC)
        self.subscribe('emergency_stop', take, always=True)
        row, silent = TOPICS['emergency_stop'], SubscriptionEventCallbacks(use_default_callbacks=False)
        for asked in every_qos(row)[1:]:
            self.create_subscription(row.type, row.name, take, asked, event_callbacks=silent)

    def _take_odometry(self, message: Odometry) -> None:
        state, stamp_ns = read_odometry(message), read_stamp(message.header.stamp)
        arrival = checked(self._guard.take_odometry(state, stamp_ns, self._steady_s(stamp_ns)))
        if arrival is not Arrival.REPEATED:
            self._time_ns = stamp_ns
        if self.lock_step:
            self._answer_if_complete()
        elif self._guard.is_doubted(ODOM):
            self._act(self._decide())

    def _take_scan(self, message: LaserScan) -> None:
        self._scan_ns, self._scan = read_stamp(message.header.stamp), None
        try:
            scan = read_scan(message)
            if misfit := ray_misfit(scan, self.params.lidar.rays):
                raise MessageError(misfit)
            self._scan = scan
            if not self.lock_step:
                checked(self._guard.take_scan(scan, self._scan_ns, self.steady_s()))
                self._act(self._decide())
        finally:
            self._answer_if_complete()

    def _take_setpoint(self, message: Odometry) -> None:
        try:
            setpoint, stamp_ns = read_setpoint(message), read_stamp(message.header.stamp)
        except MessageError as error:
            self._guard.doubt_setpoint(str(error))
            self._answer(message)
            raise
        checked(self._guard.take_setpoint(setpoint, stamp_ns, self._steady_s(stamp_ns)))
        self._answer(message)

    def _answer(self, raw: Odometry) -> None:
        if self.lock_step:
            self._raw = raw
            self._answer_if_complete()
        else:
            self._act(self._decide(), raw)

    def _answer_if_complete(self) -> None:
        """In lock-step, answer a setpoint once odometry and scan of its stamp are there."""
        if self._raw is None:
            return
        stamp_ns = read_stamp(self._raw.header.stamp)
        alone = stamp_ns % self._period_ns != 0  # a new plan was answered between two decisions
        if alone or stamp_ns == self._time_ns == self._scan_ns:
            raw, self._raw = self._raw, None
            if self._scan is not None:
                self._guard.take_scan(self._scan, self._scan_ns, self._steady_s(self._scan_ns))
            self._act(self._decide(), raw)

    def _is_between_decisions(self, stamp_ns: int) -> bool:
        """Whether a message cannot matter in lock-step, where each decision has its own."""
        return stamp_ns % self._period_ns != 0

    def _decide(self, ordered: str = '') -> Decision:
        ordered = ordered or (EMERGENCY if self._orders.by else self._rivalry)
        return self._guard.decide(self._steady_s(self._time_ns), ordered)

    def _steady_s(self, stamp_ns: int) -> float:
        """The time that ages are told in; in lock-step only stamps tell it."""
        return stamp_ns / SECOND_NS if self.lock_step else self.steady_s()

    def _act(self, decision: Decision, raw: Odometry | None = None, repeat: bool = False) -> None:
        """Publish a decision where it is new, or where a planner's setpoint or a repetition is due."""
        due = raw is not None or decision != self._last or (repeat and decision.stops)
        if not self._guard.ready or not due:
            return
        self._last = decision
        if raw is not None and not decision.reason:
            self._setpoints.publish(raw)
        else:
            fill_setpoint(self._message, self._time_ns, decision.setpoint, self._guard.own[:2])
            self._setpoints.publish(self._message)
        self._publish_state()

    def _publish_state(self) -> None:
        """Tell of a new state or order; the same one is told once."""
        text, ordered_by = self._text(), self._orders.by
        if (text, ordered_by) == self._told:
            return
        self._told, (setpoint, reason) = (text, ordered_by), self._last
        values = {'stamp': self._time_ns, 'stop_reason': reason, 'speed_mps': f'{setpoint.speed_mps:.3f}'}
        values[ORDERED_BY] = ordered_by
        self._states.publish(status_message(NAME, self._level(), text, values))

    def _text(self) -> str:
        if not self._guard.ready:
            return 'no odom yet'
        if not self._last.reason:
            return 'passing'
        return f'stop: {self._last.reason}' if self._last.stops else self._last.reason

    def _level(self) -> bytes:
        if self._last.reason and self._last.reason in (EMERGENCY, self._rivalry):
            return DiagnosticStatus.ERROR
        calm = self._guard.ready and not self._last.reason
        return DiagnosticStatus.OK if calm else DiagnosticStatus.WARN

    def _watch(self) -> None:
        """Notice who is silent and who speaks out of turn, and repeat a stop."""
        self._rivalry = self._rivals.note(self.rivals_on(self._listens_to), self.steady_s())
        self._act(self._decide(), repeat=True)

    def _draw(self) -> None:
        """Show the way of a stop begun now, yellow, or red while the vessel is stopped."""
        if self._guard.ready and self.params.zones and self._markers.get_subscription_count():
            own, yaw_rad = self._guard.own, self._last.setpoint.yaw_rad
            track = self._zone.stop_track(own, yaw_rad, max(float(own[SURGE]), 0.0))
            marker = track_marker('stop_zone', track, COLOURS[self._last.stops])
            self._markers.publish(MarkerArray(markers=[marker]))

    def _on_emergency(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._order(SERVICE, request)
        by, response.success = self._orders.by, True
        response.message = f'{EMERGENCY} by {by}' if by else 'released'
        return response

    def _order(self, way: str, order: Bool | SetBool.Request) -> None:
        if self._orders.take(way, order.data):
            self.get_logger().warning(f'{EMERGENCY} {"ordered" if order.data else "released"} by {way}')
        if self.active:
            if not self.lock_step:
                self._act(self._decide())
            self._publish_state()


def main() -> int:
    """Run the node."""
    return run_node(SafetyMonitor)


if __name__ == '__main__':
    raise SystemExit(main())
