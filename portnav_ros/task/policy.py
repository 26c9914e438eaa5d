"""The one protocol behind which every local planner stands, learned or not."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from portnav_ros.types import Array, Array32, BoolArray, IntArray


class Observation(NamedTuple):
    """What a local planner may know, for B vessels at once.

    ranges: [B, R] m, float32, as the sensor gave them (+inf no return, NaN invalid). own: [B, 7]
    state rows (types.X .. types.THRUST). path: [B, W, 2] m, map frame. path_length: [B] points in
    use. progress: [B] index of the path point closest to the vessel. features: [B, F] float32, the
    network's input.
    """

    ranges: Array32
    own: Array
    path: Array
    path_length: IntArray
    progress: Array
    features: Array32


class Policy(Protocol):
    """A local planner for B vessels."""

    def reset(self, which: BoolArray) -> None:
        """Forget what belongs to the vessels [B] (bool) whose episode starts anew."""

    def act(self, observation: Observation) -> Array:
        """Return setpoints [B, 2]: desired heading in rad (map) and surge speed in m/s."""


@runtime_checkable
class Holding(Protocol):
    """A policy that holds a setpoint for several calls; only some calls decide anew."""

    @property
    def decided(self) -> BoolArray:
        """Vessels [B] (bool) for which the last ``act`` has decided."""
