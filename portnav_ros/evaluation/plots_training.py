"""The paper's figure: path errors, success, reward and episode length against environment steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.learning_curves import FIELDS, Across, Curve

LABELS = {
    'e_x': 'mean |e_x|, m',
    'e_y': 'mean |e_y|, m',
    'e_psi': 'mean |e_psi|, rad',
    'success': 'success, %',
    'reward': 'episode reward',
    'length_s': 'episode length, s',
}
PERCENT = 'success'


class Drawn(NamedTuple):
    """One algorithm: a curve for each seed, their mean, and the mean of their validations."""

    title: str
    runs: Sequence[Curve]
    mean: Across
    validation: Across


def training_figure(algorithms: Sequence[Drawn], levels: Mapping[str, float] | None, caption: str) -> Figure:
    """Draw six panels.

    Args:
        algorithms: what has been trained, even if only begun.
        levels: the DWA's value of each field, a horizontal line; None leaves it out.
        caption: what lines mean and how many seeds there are, below the panels.
    """
    figure = plots.new_figure(10.0, 6.2)
    with plots.styled():
        grid = figure.subplots(2, 3, sharex=True)
        for k, (name, axes) in enumerate(zip(FIELDS, grid.flat, strict=True)):
            for colour, algorithm in zip(plots.SERIES, algorithms, strict=False):
                _draw(axes, algorithm, k, colour)
            if levels is not None:
                level = levels[name] * _scale(name)
                axes.axhline(level, color=plots.INK, linewidth=1.1, linestyle=(0, (5, 3)), label='DWA')
            axes.set_ylabel(LABELS[name])
            axes.xaxis.set_major_formatter(FuncFormatter(_millions))
            plots.tidy(axes)
        for axes in grid[-1]:
            axes.set_xlabel('environment steps, millions')
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc='outside upper center', ncols=max(len(labels), 1))
        figure.supxlabel(caption, fontsize=7.5)
    return figure


def _draw(axes: Axes, algorithm: Drawn, k: int, colour: str) -> None:
    """One algorithm in the panel of field k."""
    scale, mean = _scale(FIELDS[k]), algorithm.mean
    for run in algorithm.runs:
        axes.plot(run.steps, scale * run.values[:, k], color=colour, linewidth=0.6, alpha=0.4)
    full = mean.reached == len(algorithm.runs)
    low, high = scale * mean.low[full, k], scale * mean.high[full, k]
    axes.fill_between(mean.steps[full], low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(
        mean.steps[full], scale * mean.mean[full, k], color=colour, linewidth=1.8, label=algorithm.title
    )
    dots = algorithm.validation
    axes.plot(dots.steps, scale * dots.mean[:, k], color=colour, marker='o', markersize=3, linestyle='')


def _scale(name: str) -> float:
    return 100.0 if name == PERCENT else 1.0


def _millions(steps: float, _: int) -> str:
    return f'{steps / 1e6:g}'
