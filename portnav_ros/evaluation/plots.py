"""One look for every picture: colours that the colour-blind can tell apart, and output as SVG or PNG."""

from __future__ import annotations

import io
import re
from contextlib import AbstractContextManager
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from portnav_ros.types import Outcome

INK = '#1b2733'  # text and axes; follows the page's colour once inlined
CHART_INK = '#22303c'  # text on the chart, which stays light on dark pages
LAND, WATER, SHORE = '#d8d2c4', '#eaf2f6', '#6b665c'
PLAN, GOAL, DANGER = '#0072b2', '#009e73', '#d55e00'
OTHERS, BUOY, UNCHARTED = '#7a4f9a', '#b8860b', '#d55e00'
SERIES = ('#0072b2', '#d55e00', '#009e73', '#cc79a7')
SPEED = LinearSegmentedColormap.from_list('speed', ['#3b0f70', '#8c2981', '#de4968', '#f0810f'])
GRID = '#8a949e'

_STYLE = {
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans'],
    'font.size': 9.0,
    'text.color': INK,
    'axes.labelcolor': INK,
    'axes.edgecolor': INK,
    'axes.linewidth': 0.7,
    'xtick.color': INK,
    'ytick.color': INK,
    'figure.facecolor': 'none',
    'axes.facecolor': 'none',
    'legend.frameon': False,
    'legend.fontsize': 8.0,
    'svg.fonttype': 'none',
    'svg.hashsalt': 'portnav',
}

SENTENCES = {
    Outcome.RUNNING: 'was still under way when the recording ended',
    Outcome.SUCCESS: 'reached its goal',
    Outcome.COLLISION_QUAY: 'hit a quay',
    Outcome.COLLISION_BUOY: 'hit a buoy',
    Outcome.COLLISION_VESSEL: 'hit another vessel',
    Outcome.TIMEOUT: 'ran out of time',
}

ENDING_COLOURS = {
    Outcome.SUCCESS: GOAL,
    Outcome.COLLISION_QUAY: '#56697a',
    Outcome.COLLISION_BUOY: '#e69f00',
    Outcome.COLLISION_VESSEL: DANGER,
    Outcome.TIMEOUT: '#a7b0b8',
}


def outcome_colour(outcome: Outcome) -> str:
    """Green for success, red for a collision, grey otherwise."""
    if outcome == Outcome.SUCCESS:
        return GOAL
    return DANGER if outcome.collision else GRID


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure that needs no screen."""
    with mpl.rc_context(_STYLE):
        return Figure(figsize=(width_in, height_in), layout='constrained')


def styled() -> AbstractContextManager[None]:
    """Context in which axes must be made and filled."""
    return mpl.rc_context(_STYLE)


def tidy(axes: Axes) -> None:
    """Open frame and a quiet grid."""
    axes.spines[['top', 'right']].set_visible(False)
    axes.grid(visible=True, color=GRID, alpha=0.25, linewidth=0.6)


def inline_svg(figure: Figure) -> str:
    """SVG element for a page: scales with its width, and its ink is the text colour of the page."""
    buffer = io.StringIO()
    with styled():
        figure.savefig(buffer, format='svg', metadata={'Date': None})
    text = buffer.getvalue()
    text = text[text.index('<svg') :]
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r'\1', text, count=1, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r'\1', text, count=1, flags=re.DOTALL)
    return text.replace(INK, 'currentColor')


def save_png(figure: Figure, path: Path, dots_per_inch: int = 150) -> None:
    """Write a PNG on white."""
    with styled():
        figure.savefig(path, dpi=dots_per_inch, facecolor='white')


def save_svg(figure: Figure, path: Path) -> None:
    """Write an SVG on white, the same bytes each time."""
    with styled():
        figure.savefig(path, format='svg', facecolor='white', metadata={'Date': None})
