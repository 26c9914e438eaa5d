"""All that is known of a vessel under way, and the decision that follows from it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from portnav_ros.safety.ages import SECOND_NS, Arrival, InputAges
from portnav_ros.safety.decision import Release, SetpointParams, Situation, decide, judge_setpoint
from portnav_ros.safety.mounting import Mounting
from portnav_ros.safety.plausibility import (
    OdometrySeen,
    PlausibilityParams,
    ScanSeen,
    judge_odometry,
    judge_scan,
)
from portnav_ros.safety.zones import Zone
from portnav_ros.types import STATE_SIZE, YAW, YAW_RATE, Array, Scan, Setpoint, VesselState

ODOM, SCAN, SETPOINT = 'odom', 'scan', 'setpoint_raw'


class Decision(NamedTuple):
    """The setpoint to give, and why it is not what the planner asked for, or nothing."""

    setpoint: Setpoint
    reason: str

    @property
    def stops(self) -> bool:
        """Whether the vessel is stopped against the planner's will."""
        return bool(self.reason) and not self.setpoint.speed_mps


class Guard:
    """Remembers the newest of each input, and decides on setpoints.

    Args:
        plausible: when a sensor is believed.
        setpoints: what a setpoint may ask.
        zone: room for a stop; None where it is not looked after.
        ages: of odom, scan and setpoint_raw.
        mounting: of the ranging sensor.
    """

    def __init__(
        self,
        plausible: PlausibilityParams,
        setpoints: SetpointParams,
        zone: Zone | None,
        ages: InputAges,
        mounting: Mounting,
    ) -> None:
        self._plausible, self._setpoints, self._zone, self._ages = plausible, setpoints, zone, ages
        self._mounting = mounting
        self._release = Release()
        self.forget()

    def forget(self) -> None:
        """Know nothing any more; a vessel that was stopped stays so until it is released."""
        self._own = np.zeros(STATE_SIZE)
        self._points = np.zeros((0, 2))
        self._odometry: OdometrySeen | None = None
        self._scan: ScanSeen | None = None
        self._setpoint: Setpoint | None = None
        self._limit_mps: float | None = None  # of the newest setpoint and scan, once it is asked for
        self._doubts = {ODOM: '', SCAN: '', SETPOINT: ''}
        self._release = self._release._replace(limit_mps=math.inf)
        self._ages.forget()

    @property
    def own(self) -> Array:
        """State row [7] of the newest odometry."""
        return self._own

    @property
    def ready(self) -> bool:
        """Whether there is a heading to keep."""
        return self._odometry is not None

    def take_odometry(self, state: VesselState, stamp_ns: int, steady_s: float) -> Arrival:
        """Take the vessel's state; after a jump of the clock nothing else is known."""
        arrival = self._ages.note(ODOM, stamp_ns, steady_s)
        if arrival in (Arrival.FUTURE, Arrival.REPEATED):
            return arrival
        if arrival is Arrival.JUMPED:
            self.forget()
            self._ages.note(ODOM, stamp_ns, steady_s)
        self._own[: YAW_RATE + 1] = state[: YAW_RATE + 1]
        seen, doubt = judge_odometry(self._plausible, self._odometry, state, stamp_ns / SECOND_NS)
        self._odometry, self._doubts[ODOM] = seen, doubt
        if doubt:
            self._scan = None  # the pose it was seen from is worth nothing
        return arrival

    def take_scan(self, scan: Scan, stamp_ns: int, steady_s: float) -> Arrival:
        """Take what the sensor sees."""
        arrival = self._ages.note(SCAN, stamp_ns, steady_s)
        if arrival is Arrival.TAKEN:
            self._points, self._limit_mps = self._mounting.points(scan), None
            state = VesselState(*self._own)
            seen, self._doubts[SCAN] = judge_scan(self._plausible, self._scan, scan, state)
            self._scan = seen if self.ready else None  # without odometry the pose it was seen from is unknown
        return arrival

    def take_setpoint(self, setpoint: Setpoint, stamp_ns: int, steady_s: float) -> Arrival:
        """Take what the planner asks for."""
        fresh = not self._ages.is_late(SETPOINT, steady_s)
        arrival = self._ages.note(SETPOINT, stamp_ns, steady_s)
        if arrival is not Arrival.FUTURE:
            last = self._setpoint if fresh else None
            self._doubts[SETPOINT] = judge_setpoint(self._setpoints, last, setpoint)
            self._setpoint, self._limit_mps = setpoint, None
        return arrival

    def is_doubted(self, name: str) -> bool:
        """Whether the newest of an input is not believed."""
        return bool(self._doubts[name])

    def doubt_setpoint(self, reason: str) -> None:
        """Take note that the planner has said something that cannot be read."""
        self._doubts[SETPOINT] = f'{SETPOINT} refused: {reason}'

    def decide(self, steady_s: float, ordered: str = '') -> Decision:
        """Decide on the newest setpoint.

        Args:
            steady_s: of a steady clock.
            ordered: why the vessel must be stopped whatever else is known, or nothing.
        """
        reason = ordered or self._reason(steady_s)
        limit_mps = math.inf if reason else self._room_mps()
        time_s = self._ages.now_ns(steady_s) / SECOND_NS
        now = Situation(time_s, float(self._own[YAW]), self._setpoint, reason, limit_mps)
        self._release, setpoint, why = decide(self._setpoints, self._release, now)
        if not self.ready:
            self._release = self._release._replace(stop_yaw_rad=None)  # there was no heading to keep yet
        return Decision(setpoint, why)

    def _room_mps(self) -> float:
        """The speed from which a stop stays clear."""
        if self._zone is None or self._setpoint is None or not self._setpoint.speed_mps:
            return math.inf
        if self._limit_mps is None:
            self._limit_mps = self._zone.limit_mps(self._own, self._setpoint, self._points)
        return self._limit_mps

    def _reason(self, steady_s: float) -> str:
        late = self._ages.too_old(steady_s)
        believed = self._doubts[ODOM] or self._doubts[SCAN] or self._doubts[SETPOINT]
        return late if late and SETPOINT not in late else believed or late
