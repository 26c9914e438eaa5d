"""The picture of an encounter: the whole episode, and below it what the sensor saw shortly before."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.hull_clearance import hull_corners, poses_at, with_clearance
from portnav_ros.evaluation.plots_port import WIDTH_IN, Box, draw_chart, draw_port, view_box
from portnav_ros.types import YAW, Array, X, Y

HALF_HEIGHT_M = 220.0
PANEL_IN = 3.4
AHEAD_S = 30.0  # the scan is of this long before the closest approach, while there is something to decide


def encounter_figure(log: EpisodeLog, title: str, column: int) -> Figure:
    """Draw an episode in two panels.

    Args:
        log: with its scans.
        title: above both.
        column: of the clearances (quay, buoy, vessel) whose least value is the encounter.
    """
    box = view_box(log)
    height = min(max(WIDTH_IN * (box[3] - box[1]) / (box[2] - box[0]), 2.6), 7.0)
    figure = plots.new_figure(WIDTH_IN, height + PANEL_IN + 0.8)
    with plots.styled():
        whole, close = figure.subplots(2, 1, height_ratios=(height, PANEL_IN))
        draw_port(whole, log, box)
        whole.set_title(title, loc='left', fontsize=11)
        draw_scan(close, log, decisive_row(log, column), WIDTH_IN / PANEL_IN)
    return figure


def decisive_row(log: EpisodeLog, column: int) -> int:
    """Row AHEAD_S before the least clearance to a quay, a buoy or a vessel; the first if there is none."""
    clearance = with_clearance(log).clearance
    assert clearance is not None
    closest_s = log.time_s[int(np.argmin(clearance[:, column]))]
    return int(np.searchsorted(log.time_s, closest_s - AHEAD_S))


def draw_scan(axes: Axes, log: EpisodeLog, row: int, aspect: float) -> None:
    """Hulls, the track so far and the sensor's returns at one row, `aspect` times as wide as high."""
    x, y = log.own[row, [X, Y]]
    half_width = aspect * HALF_HEIGHT_M
    box: Box = (x - half_width, y - HALF_HEIGHT_M, x + half_width, y + HALF_HEIGHT_M)
    draw_chart(axes, log.harbour, box)
    axes.plot(*log.path.T, color=plots.PLAN, linewidth=1.3, linestyle=(0, (5, 3)), zorder=3)
    axes.plot(*log.own[: row + 1, [X, Y]].T, color=plots.SPEED(0.8), linewidth=2.0, zorder=5)
    time_s = log.time_s[row : row + 1]
    for track in log.targets:
        pose = poses_at(track, time_s) if len(track.time_s) else np.full((1, 3), np.nan)
        if np.isfinite(pose[0, 0]):
            hull = hull_corners(pose, track.length_m, track.beam_m)[0]
            axes.fill(*hull.T, facecolor=plots.OTHERS, alpha=0.6, linewidth=0, zorder=4)
    own = hull_corners(log.own[row : row + 1, [X, Y, YAW]], log.vessel.length_m, log.vessel.beam_m)[0]
    axes.fill(*own.T, facecolor='white', edgecolor=plots.CHART_INK, linewidth=0.9, zorder=6)
    returns = scan_returns(log, row)
    rays = [((x, y), tuple(end)) for end in returns]
    axes.add_collection(LineCollection(rays, colors=plots.DANGER, linewidths=0.3, alpha=0.35, zorder=4))
    axes.plot(*returns.T, '.', color=plots.DANGER, markersize=3.5, zorder=7)
    axes.set_title(f'The scan after {time_s[0] - log.time_s[0]:.0f} s', loc='left', fontsize=9)


def scan_returns(log: EpisodeLog, row: int) -> Array:
    """Map positions [N, 2] of what the sensor saw at a row of the log; none without scans."""
    if log.scans is None:
        return np.zeros((0, 2))
    ranges = log.scans.ranges[row].astype(np.float64)
    seen = np.isfinite(ranges)
    bearings = log.scans.angle_min_rad + log.scans.angle_increment_rad * np.flatnonzero(seen)
    angles = log.own[row, YAW] + bearings
    points: Array = log.own[row, [X, Y]] + ranges[seen, None] * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
    return points
