"""Time series of an episode: speed, heading, actuators, clearance, path errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.task.reward import RewardParams
from portnav_ros.types import RUDDER, SURGE, THRUST, YAW, Array

Panel = Callable[[Axes, EpisodeLog, Array], None]
CLEARANCE_SHOWN_M = 150.0


def series_figure(log: EpisodeLog) -> Figure:
    """Draw five panels over one time axis."""
    panels: tuple[Panel, ...] = (_speed, _heading, _actuators, _clearance, _errors)
    figure = plots.new_figure(10.0, 1.75 * len(panels))
    time_s = log.time_s - log.time_s[0]
    with plots.styled():
        rows = figure.subplots(len(panels), 1, sharex=True)
        for axes, panel in zip(rows, panels, strict=True):
            panel(axes, log, time_s)
            plots.tidy(axes)
            axes.axvline(time_s[-1], color=plots.outcome_colour(log.outcome), linewidth=1.5)
            handles, labels = axes.get_legend_handles_labels()
            axes.legend(handles, labels, loc='upper left', bbox_to_anchor=(1.0, 1.0))
        rows[-1].set_xlabel('time, s')
        rows[-1].set_xlim(0.0, max(time_s[-1] * 1.01, 1.0))
    return figure


def _speed(axes: Axes, log: EpisodeLog, time_s: Array) -> None:
    axes.step(
        time_s, log.setpoint[:, 1], where='post', color=plots.SERIES[1], linewidth=1.0, label='setpoint'
    )
    axes.plot(time_s, log.own[:, SURGE], color=plots.SERIES[0], linewidth=1.4, label='speed')
    axes.set_ylabel('speed\nm/s')


def _heading(axes: Axes, log: EpisodeLog, time_s: Array) -> None:
    error = log.setpoint[:, 0] - log.own[:, YAW]
    error_deg = np.degrees((error + np.pi) % (2.0 * np.pi) - np.pi)
    axes.plot(time_s, error_deg, color=plots.SERIES[0], linewidth=1.2, label='setpoint - heading')
    axes.axhline(0.0, color=plots.GRID, linewidth=0.8)
    axes.set_ylabel('heading error\ndegrees')


def _actuators(axes: Axes, log: EpisodeLog, time_s: Array) -> None:
    rudder = 100.0 * log.own[:, RUDDER] / log.vessel.rudder_max_rad
    thrust = 100.0 * log.own[:, THRUST] / log.vessel.thrust_max_n
    axes.plot(time_s, thrust, color=plots.SERIES[1], linewidth=1.2, label='thrust')
    axes.plot(time_s, rudder, color=plots.SERIES[0], linewidth=1.2, label='rudder (+ port)')
    axes.axhline(0.0, color=plots.GRID, linewidth=0.8)
    axes.set_ylim(-108.0, 108.0)
    axes.set_ylabel('actuators\n% of full')


def _clearance(axes: Axes, log: EpisodeLog, time_s: Array) -> None:
    if log.clearance is not None:
        for column, (name, colour) in enumerate(
            zip(('quay', 'buoy', 'vessel'), (plots.SHORE, plots.BUOY, plots.OTHERS), strict=True)
        ):
            gap = np.where(np.isfinite(log.clearance[:, column]), log.clearance[:, column], np.nan)
            axes.plot(time_s, gap, color=colour, linewidth=1.3, label=f'to a {name}')
    axes.axhspan(0.0, 5.0, color=plots.DANGER, alpha=0.15, linewidth=0, label='below 5 m')
    axes.set_ylim(0.0, CLEARANCE_SHOWN_M)
    axes.set_ylabel('clearance\nm')


def _errors(axes: Axes, log: EpisodeLog, time_s: Array) -> None:
    scale = RewardParams().position_scale_m
    axes.plot(time_s, log.errors[:, 0], color=plots.SERIES[3], linewidth=1.0, label='e_x, m')
    axes.plot(time_s, log.errors[:, 1], color=plots.SERIES[0], linewidth=1.3, label='e_y, m')
    axes.plot(
        time_s,
        np.degrees(log.errors[:, 2]),
        color=plots.SERIES[2],
        linewidth=1.0,
        linestyle=(0, (4, 2)),
        label='e_psi, degrees',
    )
    for side in (-scale, scale):
        axes.axhline(side, color=plots.GRID, linewidth=0.9, linestyle=':')
    axes.set_ylabel('path errors')
