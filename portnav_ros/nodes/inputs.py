"""Ages of what a node hears, and the stop that they call for, with its hysteresis; also in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from portnav_ros.nodes.messages import SECOND_NS, MessageError
from portnav_ros.safety.ages import Arrival, InputAges
from portnav_ros.safety.decision import Hold, held


class Inputs:
    """Stands between what a node hears and what it does about it.

    Args:
        limits_s: age in s of each input past which it is too old; the first tells the driver's time.
        rate: simulated seconds per second.
        release_s: time without any reason to stop before a stop ends.
        clock: a steady one, in s; None in lock-step, where only stamps tell the time.
    """

    def __init__(
        self, limits_s: Mapping[str, float], rate: float, release_s: float, clock: Callable[[], float] | None
    ) -> None:
        self._ages, self._release_s, self._clock = InputAges(limits_s, rate), release_s, clock
        self._hold = Hold()

    @property
    def reason(self) -> str:
        """Why the vessel is to be stopped, as last judged, or nothing."""
        return self._hold.reason

    def forget(self) -> None:
        """Start anew: nothing was heard."""
        self._ages.forget()

    def note(self, name: str, stamp_ns: int) -> bool:
        """Take in the stamp of a message; returns whether the clock has jumped and all else is void.

        Raises:
            MessageError: the stamp lies in the future.
        """
        arrival = self._ages.note(name, stamp_ns, self._steady_s(stamp_ns))
        return checked(arrival) is Arrival.JUMPED

    def is_late(self, name: str, stamp_ns: int) -> bool:
        """Whether an input is missing or too old; stamp_ns: of the newest reference."""
        return self._ages.is_late(name, self._steady_s(stamp_ns))

    def judge(self, stamp_ns: int, reason: str = '') -> str:
        """Return why the vessel is to be stopped now, or was until just now; stamp_ns: as for is_late."""
        steady_s = self._steady_s(stamp_ns)
        now_s = self._ages.now_ns(steady_s) / SECOND_NS
        self._hold = held(self._hold, self._ages.too_old(steady_s) or reason, now_s, self._release_s)
        return self._hold.reason

    def _steady_s(self, stamp_ns: int) -> float:
        return self._clock() if self._clock is not None else stamp_ns / SECOND_NS


def checked(arrival: Arrival) -> Arrival:
    """Return what became of a message; raises MessageError where its stamp lies in the future."""
    if arrival is Arrival.FUTURE:
        raise MessageError(arrival.value)
    return arrival
