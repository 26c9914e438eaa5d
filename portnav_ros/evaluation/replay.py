"""What the replay in a report draws, as JSON: chart, poses and scans, rounded to what a screen shows."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from portnav_ros.evaluation.episode_log import EpisodeLog, PlanLog, ScanLog
from portnav_ros.evaluation.hull_clearance import poses_at
from portnav_ros.evaluation.plots import SENTENCES
from portnav_ros.evaluation.plots_port import view_box
from portnav_ros.harbour import Harbour
from portnav_ros.types import RUDDER, SURGE, YAW, AnyArray, Array, X, Y

MAX_ROWS, MAX_SCANS, MAX_VERTICES = 4000, 700, 20_000
MIN_PERIOD_S = 0.25


def replay_data(log: EpisodeLog) -> dict[str, Any]:
    """Values for replay.js: metres, radians, seconds; ranges in dm with 0 for no return."""
    thin = log.thinned(max(MIN_PERIOD_S, log.length_s / MAX_ROWS))
    columns = thin.own[:, [X, Y, YAW, SURGE, RUDDER]]
    return {
        'time_s': _rounded(thin.time_s, 2),
        'own': _rounded(columns, 3),
        'hull': [log.vessel.length_m, log.vessel.beam_m],
        'targets': [
            {
                'pose': [
                    None if row[0] is None else row for row in _rounded(poses_at(track, thin.time_s), 3)
                ],
                'length_m': track.length_m,
                'beam_m': track.beam_m,
            }
            for track in log.targets
            if len(track.time_s)
        ],
        'plans': [
            [_shown_from(plan.time_s, log), _rounded(plan.path, 1)]
            for plan in (*log.earlier_plans, PlanLog(log.path_since_s, log.path))
        ],
        'goal': list(log.goal),
        'goal_radius_m': log.goal_radius_m,
        'water': _rings(log.harbour),
        'buoys': [[*row, bool(known)] for row, known in _charted(log.harbour)],
        'scans': None if log.scans is None else _scans(log.scans),
        'box': list(view_box(log)),
        'outcome': SENTENCES[log.outcome],
    }


def _rounded(values: Array, digits: int) -> list[Any]:
    """Nested lists, with None for NaN."""
    rounded = np.round(values, digits).astype(object)
    rounded[np.isnan(values)] = None
    result: list[Any] = rounded.tolist()
    return result


def _shown_from(time_s: float, log: EpisodeLog) -> float:
    return round(max(time_s, float(log.time_s[0])), 2)


def _charted(harbour: Harbour) -> list[tuple[list[float], bool]]:
    return list(zip(_rounded(harbour.buoys, 1), harbour.charted, strict=True))


def _rings(harbour: Harbour) -> list[Any]:
    water, tolerance_m = harbour.water, 0.5
    while shapely.get_num_coordinates(water) > MAX_VERTICES:
        water, tolerance_m = shapely.simplify(harbour.water, tolerance_m), 2.0 * tolerance_m
    parts = shapely.get_parts(water)
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    return [_rounded(np.asarray(ring.coords)[:-1, :2], 1) for ring in rings]


def _scans(scans: ScanLog) -> dict[str, Any]:
    step = -(-len(scans.time_s) // MAX_SCANS)
    ranges: AnyArray = scans.ranges[::step]
    decimetres = np.where(np.isfinite(ranges), np.round(10.0 * ranges), 0.0)
    return {
        'time_s': _rounded(scans.time_s[::step], 2),
        'ranges_dm': decimetres.astype(int).tolist(),
        'angle_min_rad': float(scans.angle_min_rad),
        'angle_increment_rad': float(scans.angle_increment_rad),
        'mounting': [scans.mounting.x_m, scans.mounting.y_m, scans.mounting.yaw_rad],
    }
