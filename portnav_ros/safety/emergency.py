"""Emergency stops by whom they were ordered: the vessel is stopped while anyone says so."""

from __future__ import annotations

TOPIC, SERVICE = 'topic', 'service'
ORDERED_BY = 'emergency_stop_by'  # of safety_state


class EmergencyOrders:
    """The last word of each way to order an emergency stop."""

    def __init__(self) -> None:
        self._stops = {TOPIC: False, SERVICE: False}

    @property
    def by(self) -> str:
        """Which ways call for a stop, such as ``topic and service``; empty where none does."""
        return ' and '.join(way for way, stop in self._stops.items() if stop)

    def take(self, way: str, stop: bool) -> bool:
        """Take an order; returns whether it is another than the last one of this way."""
        changed = stop != self._stops[way]
        self._stops[way] = stop
        return changed
