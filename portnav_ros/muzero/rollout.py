"""Where a sequence of actions would take the vessel, roughly: to look at, not to decide by."""

from __future__ import annotations

import math

import numpy as np

from portnav_ros.geometry import wrap_angle
from portnav_ros.task.actions import ActionParams, setpoints_of
from portnav_ros.task.path_errors import advance, path_errors
from portnav_ros.types import SURGE, YAW, Array, IntArray, X, Y
from portnav_ros.vessel import VesselParams

STEP_S = 1.0


def predicted_track(
    actions: IntArray, own: Array, path: Array, params: ActionParams, lookahead_m: float, vessel: VesselParams
) -> Array:
    """Track [T + 1, 2] m, a point a second, of a vessel that is given actions [D] one after the other.

    It turns and speeds up towards each setpoint as fast as rudder and engine allow in the steady state.

    Args:
        actions: action numbers, each held as `params` says.
        own: [7] state row to start from.
        path: [W, 2] m, that headings may be counted from.
        params: meaning of the actions.
        lookahead_m: of the line-of-sight course.
        vessel: who sails.
    """
    state, table, progress = own.copy(), params.table(), -1.0
    points = [state[[X, Y]]]
    for action in actions:
        progress = advance(path, len(path), progress, state[X], state[Y])
        errors = np.array([path_errors(state, path, len(path), progress, lookahead_m)])
        setpoint = setpoints_of(np.array([action]), params.reference_rad(state[None], errors), table)[0]
        for _ in range(params.hold):
            _approach(state, setpoint, vessel)
            points.append(state[[X, Y]])
    return np.array(points)


def _approach(state: Array, setpoint: Array, vessel: VesselParams) -> None:
    """Move a state row [7] by one step towards a setpoint [2]."""
    turn = vessel.turn_gain * abs(state[SURGE]) / vessel.length_m * vessel.rudder_max_rad * STEP_S
    faster = vessel.thrust_max_n / vessel.mass_kg * STEP_S
    state[YAW] += np.clip(wrap_angle(setpoint[0] - state[YAW]), -turn, turn)
    state[SURGE] += np.clip(setpoint[1] - state[SURGE], -faster, faster)
    state[X] += state[SURGE] * math.cos(state[YAW]) * STEP_S
    state[Y] += state[SURGE] * math.sin(state[YAW]) * STEP_S
