"""`portnav report`: one self-contained page on an episode, its figures as JSON, its picture as PNG."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.bag_episode import LOST, read_episode
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.hull_clearance import with_clearance
from portnav_ros.evaluation.metrics.table import METRICS, measure
from portnav_ros.evaluation.plots_port import port_figure
from portnav_ros.evaluation.plots_series import series_figure
from portnav_ros.evaluation.replay import replay_data
from portnav_ros.evaluation.rerun import rerun_command
from portnav_ros.evaluation.summary import write_json
from portnav_ros.types import Outcome

PAGE = Path(__file__).resolve().with_name('page')
PLOT_PERIOD_S = 0.5
_NEAREST = ('a quay', 'a buoy', 'another vessel')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('bag', type=Path, help='a bag, or the folder of a run that holds bag/')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='where to write (default: into the folder that is named)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the report of a recorded bag."""
    bag: Path = arguments.bag
    log = read_episode(bag)
    page = write_report(log, arguments.out or (bag.parent if bag.is_file() else bag))
    print(f'{headline(log)}\n{page}')
    for other in sorted(bag.glob('bag-*/')):
        print(f'{other}: another bag of this run; portnav report {other}')
    return 0


def write_report(source: EpisodeLog | Path, folder: Path) -> Path:
    """Write report.html, summary.json and port.png; return the page's path.

    Args:
        source: a log, or a bag that `portnav up` or `portnav demo` has recorded.
        folder: made where it is missing.

    Raises:
        BagError: the bag cannot be read.
        OSError: the folder cannot be written.
    """
    log = source if isinstance(source, EpisodeLog) else read_episode(source)
    folder.mkdir(parents=True, exist_ok=True)
    values = measure(log)
    write_json(folder / 'summary.json', summary(log, values))
    drawn = with_clearance(log.thinned(PLOT_PERIOD_S))
    port = port_figure(drawn)
    plots.save_png(port, folder / 'port.png')
    page = folder / 'report.html'
    series = plots.inline_svg(series_figure(drawn))
    page.write_text(_page(log, drawn, values, plots.inline_svg(port), series), encoding='utf-8')
    return page


def headline(log: EpisodeLog) -> str:
    """Return the outcome in one line."""
    minutes, seconds = divmod(round(log.length_s), 60)
    who = f'The {log.planner} planner' if log.planner else 'The vessel'
    text = f'{who} {plots.SENTENCES[log.outcome]} after {minutes}:{seconds:02d} min'
    return f'{text}{_closest(log)}.'


def summary(log: EpisodeLog, values: dict[str, float]) -> dict[str, Any]:
    """Figures of one episode for summary.json."""
    return {
        'outcome': log.outcome.name.lower(),
        'success': log.outcome == Outcome.SUCCESS,
        'headline': headline(log),
        'planner': log.planner,
        'difficulty': log.difficulty,
        'scenario': log.scenario,
        'seed': log.seed,
        **values,
        'metadata': dict(log.metadata),
    }


def _closest(log: EpisodeLog) -> str:
    if log.outcome.collision:
        return ''
    clearance = with_clearance(log.thinned(1.0)).clearance
    if clearance is None or not np.isfinite(clearance).any():
        return ''
    least = np.nanmin(clearance, axis=0)
    kind = int(np.argmin(least))
    return f'; it came no closer than {least[kind]:.1f} m to {_NEAREST[kind]}'


def _page(log: EpisodeLog, drawn: EpisodeLog, values: dict[str, float], port: str, series: str) -> str:
    template = Template((PAGE / 'report.html').read_text(encoding='utf-8'))
    data = json.dumps(replay_data(log), separators=(',', ':')).replace('</', '<\\/')
    text = headline(log)
    return template.substitute(
        title=escape(text),
        style=(PAGE / 'report.css').read_text(encoding='utf-8'),
        outcome=escape(log.outcome.name.lower().replace('_', ' ')),
        outcome_class=_badge(log.outcome),
        sentence=escape(text),
        facts=escape(_facts(log)),
        warning=_warning(log),
        figures='\n'.join(_cards(values)),
        port=port,
        series=series,
        command=_again(log),
        metadata='\n'.join(map(_row, sorted(log.metadata.items()))),
        data=data,
        script=(PAGE / 'replay.js').read_text(encoding='utf-8'),
    )


def _badge(outcome: Outcome) -> str:
    if outcome == Outcome.SUCCESS:
        return 'good'
    return 'bad' if outcome.collision else 'idle'


def _facts(log: EpisodeLog) -> str:
    vessel = log.vessel
    return ' · '.join(
        part
        for part in (
            f'{log.harbour.name}',
            f'difficulty {log.difficulty}' if log.difficulty else '',
            f'seed {log.seed}',
            f'vessel {vessel.name} ({vessel.length_m:.0f} m by {vessel.beam_m:.1f} m)',
            f'{len(log.targets)} other vessels',
        )
        if part
    )


def _warning(log: EpisodeLog) -> str:
    return ''.join(f'<p class="warning">{escape(note)}</p>\n' for note in _notes(log))


def _notes(log: EpisodeLog) -> Iterator[str]:
    """What has to be known of the figures."""
    if lost := log.metadata.get(LOST):
        yield f'The recording is damaged: {lost}.'
    if log.earlier_plans:
        times = f'{len(log.earlier_plans)} time{"s" if len(log.earlier_plans) > 1 else ""}'
        moved = ', and led to another goal before' if log.goal_moved else ''
        yield f'The plan changed {times}{moved}: path errors are counted from the plan of the time.'
    if unknown := sum(track.length_m == 0.0 for track in log.targets):
        yield f'{unknown} of the other vessels are of unknown size: clearances are to their positions.'


def _again(log: EpisodeLog) -> str:
    command = rerun_command(log)
    return f'<pre>{escape(command)}</pre>' if command else '<p>No command repeats this trip.</p>'


def _cards(values: dict[str, float]) -> list[str]:
    return [metric.card(values[metric.key]) for metric in METRICS if not math.isnan(values[metric.key])]


def _row(item: tuple[str, str]) -> str:
    key, value = item
    return f'<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>'
