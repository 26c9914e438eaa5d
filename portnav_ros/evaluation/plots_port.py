"""The picture of an episode: port, plan, sailed track, other vessels, and how it ended."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Outline

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.hull_clearance import hull_corners, poses_at
from portnav_ros.harbour import Harbour
from portnav_ros.types import SURGE, YAW, Array, X, Y

Box = tuple[float, float, float, float]

WIDTH_IN = 10.0
THUMBNAIL_IN = 4.5
HULLS_SHOWN = 14
LABELS_APART = 0.06  # of the picture's width
ZOOM_M = 40.0
STEPS_S = (10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0)


def port_figure(log: EpisodeLog) -> Figure:
    """Draw the whole episode; a collision gets a second panel that zooms in on it."""
    box = view_box(log)
    aspect = (box[3] - box[1]) / (box[2] - box[0])
    height = min(max(WIDTH_IN * aspect, 3.2), 9.0)
    figure = plots.new_figure(WIDTH_IN, height + (4.2 if log.outcome.collision else 0.6))
    with plots.styled():
        if log.outcome.collision:
            main, zoom = figure.subplots(2, 1, height_ratios=(height, 3.6))
            draw_collision(zoom, log)
        else:
            main = figure.subplots()
        draw_port(main, log, box)
        _legend(main, log)
        _speed_bar(main, log)
    return figure


def thumbnail_figure(log: EpisodeLog) -> Figure:
    """Draw the episode small, without legends."""
    box = view_box(log)
    aspect = (box[3] - box[1]) / (box[2] - box[0])
    figure = plots.new_figure(THUMBNAIL_IN, min(THUMBNAIL_IN * aspect, 1.2 * THUMBNAIL_IN))
    with plots.styled():
        draw_port(figure.subplots(), log, box)
    return figure


def view_box(log: EpisodeLog) -> Box:
    """x_min, y_min, x_max, y_max in m about plan and track, no flatter than 1 : 4."""
    plans = [plan.path for plan in log.earlier_plans]
    points = np.vstack([*plans, log.path, log.own[:, [X, Y]], [log.goal]])
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = 0.5 * (low + high), high - low + 2.0 * max(80.0, 2.0 * log.vessel.length_m)
    size = np.maximum(size, size.max() / np.array([2.0, 4.0]))
    low, high = centre - 0.5 * size, centre + 0.5 * size
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def draw_port(axes: Axes, log: EpisodeLog, box: Box) -> None:
    """Chart, plan, tracks and hulls within a box."""
    times = _hull_times(log)
    draw_chart(axes, log.harbour, box)
    for plan in log.earlier_plans:
        axes.plot(*plan.path.T, color=plots.PLAN, linewidth=0.8, alpha=0.6, linestyle=(0, (5, 3)), zorder=3)
    axes.plot(*log.path.T, color=plots.PLAN, linewidth=1.3, linestyle=(0, (5, 3)), zorder=3)
    axes.add_patch(Circle(log.goal, log.goal_radius_m, facecolor=plots.GOAL, alpha=0.15, zorder=2))
    axes.add_patch(Circle(log.goal, log.goal_radius_m, fill=False, edgecolor=plots.GOAL, zorder=3))
    _draw_targets(axes, log, times)
    _draw_own(axes, log, times)
    axes.plot(*log.own[0, [X, Y]], marker='o', color=plots.CHART_INK, markersize=5, zorder=7)
    _mark_outcome(axes, log)
    _label_times(axes, log, times, box)
    _scale_bar(axes, box)
    _north_arrow(axes)


def draw_collision(axes: Axes, log: EpisodeLog) -> None:
    """Hulls in the last half minute, close up."""
    x, y = log.own[-1, [X, Y]]
    half = ZOOM_M + 0.8 * log.vessel.length_m
    box = (x - 2.4 * half, y - half, x + 2.4 * half, y + half)
    draw_chart(axes, log.harbour, box)
    end_s = log.time_s[-1]
    times = np.arange(max(end_s - 30.0, log.time_s[0]), end_s + 1e-6, 10.0 if end_s > 30.0 else 5.0)
    times = np.unique(np.append(times, end_s))
    _draw_targets(axes, log, times)
    _draw_own(axes, log, times)
    _mark_outcome(axes, log)
    _scale_bar(axes, box)
    axes.set_title('The end, close up: hulls in the last 30 s', loc='left', fontsize=9)


def draw_chart(axes: Axes, harbour: Harbour, box: Box) -> None:
    """Land, water, quays, buoys and berths within a box."""
    axes.set(xlim=(box[0], box[2]), ylim=(box[1], box[3]), aspect='equal', xticks=[], yticks=[])
    axes.set_facecolor(plots.LAND)
    for part in shapely.get_parts(shapely.clip_by_rect(harbour.water, *_grown(box))):
        if part.geom_type == 'Polygon':
            axes.add_patch(PathPatch(_outline(part), facecolor=plots.WATER, linewidth=0, zorder=1))
    walls = harbour.walls.reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(walls), colors=plots.SHORE, linewidths=1.0, zorder=2))
    for (x, y, radius), charted in zip(harbour.buoys, harbour.charted, strict=True):
        colour = plots.BUOY if charted else plots.UNCHARTED
        axes.add_patch(Circle((x, y), radius, color=colour, zorder=4))
        axes.plot(x, y, marker='D', markersize=4, color=colour, zorder=4, markeredgewidth=0)
    if len(harbour.berths):
        axes.plot(*harbour.berths[:, :2].T, 's', color=plots.SHORE, markersize=2.5, zorder=2)


def _grown(box: Box) -> Box:
    return box[0] - 10.0, box[1] - 10.0, box[2] + 10.0, box[3] + 10.0


def _outline(polygon: Any) -> Outline:
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))


def _hull_times(log: EpisodeLog) -> Array:
    step = next((s for s in STEPS_S if log.length_s / s <= HULLS_SHOWN), STEPS_S[-1])
    return np.append(np.arange(log.time_s[0], log.time_s[-1], step), log.time_s[-1])


def _rows_at(log: EpisodeLog, times: Array) -> Any:
    return np.clip(np.searchsorted(log.time_s, times), 0, len(log) - 1)


def _draw_own(axes: Axes, log: EpisodeLog, times: Array) -> None:
    points = log.own[:, [X, Y]]
    segments = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(list(segments), cmap=plots.SPEED, linewidths=2.4, capstyle='round', zorder=6)
    line.set_array(log.own[1:, SURGE])
    line.set_clim(0.0, _speed_limit(log))
    axes.add_collection(line)
    hulls = hull_corners(
        log.own[_rows_at(log, times)][:, [X, Y, YAW]], log.vessel.length_m, log.vessel.beam_m
    )
    axes.add_collection(
        PolyCollection(list(hulls), facecolor='white', edgecolor=plots.CHART_INK, linewidths=0.9, zorder=5)
    )


def _draw_targets(axes: Axes, log: EpisodeLog, times: Array) -> None:
    for track in log.targets:
        if not len(track.time_s):
            continue
        axes.plot(*track.pose[:, :2].T, color=plots.OTHERS, linewidth=0.8, alpha=0.55, zorder=3)
        poses = poses_at(track, times)
        there = np.isfinite(poses[:, 0])
        hulls = hull_corners(poses[there], track.length_m, track.beam_m)
        ages = np.linspace(0.12, 0.6, len(times))[there]
        for hull, age in zip(hulls, ages, strict=True):
            axes.fill(*hull.T, facecolor=plots.OTHERS, alpha=age, linewidth=0, zorder=4)


def _mark_outcome(axes: Axes, log: EpisodeLog) -> None:
    x, y = log.own[-1, [X, Y]]
    marker = '*' if log.outcome.name == 'SUCCESS' else 'X'
    axes.plot(
        x,
        y,
        marker=marker,
        markersize=14,
        color=plots.outcome_colour(log.outcome),
        markeredgecolor='white',
        zorder=8,
    )


def _label_times(axes: Axes, log: EpisodeLog, times: Array, box: Box) -> None:
    apart = LABELS_APART * (box[2] - box[0]) * WIDTH_IN * axes.figure.dpi / axes.figure.bbox.width
    last = log.own[0, [X, Y]]
    for row in _rows_at(log, times[1:-1]):
        x, y, yaw = log.own[row, [X, Y, YAW]]
        if math.hypot(x - last[0], y - last[1]) < apart:
            continue
        last = log.own[row, [X, Y]]
        offset = (-14.0 * math.sin(yaw), 14.0 * math.cos(yaw))
        seconds = round(log.time_s[row] - log.time_s[0])
        axes.annotate(
            f'{seconds // 60}:{seconds % 60:02d}',
            (x, y),
            offset,
            textcoords='offset points',
            ha='center',
            va='center',
            fontsize=7,
            color=plots.CHART_INK,
            zorder=9,
            bbox={'boxstyle': 'round,pad=0.15', 'facecolor': 'white', 'alpha': 0.75, 'linewidth': 0},
        )


def _scale_bar(axes: Axes, box: Box) -> None:
    width = box[2] - box[0]
    length = 10.0 ** math.floor(math.log10(0.25 * width))
    length *= max(factor for factor in (1, 2, 5) if factor * length <= 0.25 * width)
    x, y = box[0] + 0.03 * width, box[1] + 0.035 * (box[3] - box[1])
    axes.plot([x, x + length], [y, y], color=plots.CHART_INK, linewidth=3, solid_capstyle='butt', zorder=9)
    label = f'{length:.0f} m' if length < 1000.0 else f'{length / 1000.0:.0f} km'
    axes.annotate(
        label,
        (x + 0.5 * length, y),
        (0, 4),
        textcoords='offset points',
        ha='center',
        va='bottom',
        fontsize=8,
        color=plots.CHART_INK,
        zorder=9,
    )


def _north_arrow(axes: Axes) -> None:
    axes.annotate(
        'N',
        (0.975, 0.95),
        (0.975, 0.86),
        xycoords='axes fraction',
        textcoords='axes fraction',
        ha='center',
        va='center',
        fontsize=9,
        color=plots.CHART_INK,
        arrowprops={'arrowstyle': '-|>', 'color': plots.CHART_INK, 'linewidth': 1.4},
        zorder=9,
    )


def _legend(axes: Axes, log: EpisodeLog) -> None:
    handles = [
        Line2D([], [], color=plots.PLAN, linestyle=(0, (5, 3)), label='plan'),
        Line2D([], [], color=plots.SPEED(0.8), linewidth=2.4, label='sailed'),
        Line2D([], [], color=plots.INK, marker='o', linestyle='', markersize=5, label='start'),
        Line2D(
            [], [], color=plots.GOAL, marker='o', fillstyle='none', linestyle='', markersize=9, label='goal'
        ),
    ]
    if log.targets:
        handles.append(Line2D([], [], color=plots.OTHERS, marker='s', alpha=0.7, label='other vessels'))
    if log.harbour.charted.any():
        handles.append(_diamond(plots.BUOY, 'buoy'))
    if not log.harbour.charted.all():
        handles.append(_diamond(plots.UNCHARTED, 'buoy not on the chart'))
    axes.legend(handles=handles, loc='upper center', bbox_to_anchor=(0.5, -0.01), ncols=len(handles))


def _speed_bar(axes: Axes, log: EpisodeLog) -> None:
    scale = ScalarMappable(Normalize(0.0, _speed_limit(log)), plots.SPEED)
    bar = axes.figure.colorbar(
        scale, ax=axes, location='top', shrink=0.2, anchor=(1.0, 0.0), pad=0.01, aspect=20
    )
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7, length=2)
    bar.set_label('speed, m/s', fontsize=7)


def _speed_limit(log: EpisodeLog) -> float:
    return max(log.vessel.speed_max_mps, float(log.own[:, SURGE].max()), 0.1)


def _diamond(colour: str, label: str) -> Line2D:
    return Line2D([], [], color=colour, marker='D', linestyle='', markersize=5, label=label)
