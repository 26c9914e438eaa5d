"""Thrust bounded in time: a stop that does not come to its end must not drive the vessel away."""

from __future__ import annotations

import math

from portnav_ros.vessel import VesselParams

LEAST_ASTERN_N = 1.0
RESERVE = 1.5


def stopping_time_s(vessel: VesselParams) -> float:
    """Time in s from full speed to rest under full astern thrust F and drag.

    Thrust turns round at its rate first; then m s' = -(F + k s^2), so t = m / sqrt(k F) atan(s sqrt(k / F)).
    """
    astern, drag = max(-vessel.thrust_min_n, LEAST_ASTERN_N), vessel.drag_kg_per_m
    turning_s = (vessel.thrust_max_n - vessel.thrust_min_n) / vessel.thrust_rate_nps
    braking = math.atan(vessel.speed_max_mps * math.sqrt(drag / astern))
    return turning_s + vessel.mass_kg / math.sqrt(drag * astern) * braking


class ThrustBound:
    """Lets thrust be astern, and during a stop ahead, for a bounded time on end."""

    def __init__(self, longest_s: float, vessel: VesselParams) -> None:
        """Bound to a time in s; 0 is half as long again as a stop from full speed takes."""
        self._longest_s = longest_s or RESERVE * stopping_time_s(vessel)
        self.forget()

    @property
    def reached(self) -> bool:
        """Whether no more thrust the same way is allowed."""
        return self._spent_s > self._longest_s

    def forget(self) -> None:
        """Start anew."""
        self._spent_s, self._ahead = 0.0, False

    def apply(self, thrust_n: float, step_s: float, stopping: bool) -> float:
        """Return the thrust in N, 0 where it has been the same way for too long, after another step in s."""
        ahead = thrust_n > 0.0
        bounded = thrust_n < 0.0 or (ahead and stopping)
        on_end = bounded and ahead == self._ahead
        self._spent_s = (self._spent_s if on_end else 0.0) + (step_s if bounded else 0.0)
        self._ahead = ahead
        return 0.0 if self.reached else thrust_n
