"""One page on an evaluation: the endings as a bar, the averages, and a gallery of failures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from string import Template
from typing import Any

from portnav_ros.evaluation import plots
from portnav_ros.evaluation.comparison import sentence
from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.metrics.outcome import ENDINGS
from portnav_ros.evaluation.metrics.table import METRICS, Metric
from portnav_ros.evaluation.plots_port import thumbnail_figure
from portnav_ros.evaluation.report import PAGE
from portnav_ros.evaluation.rerun import rerun_command
from portnav_ros.types import Outcome

SHOWN_OF_A_KIND = 4


def write_overview(path: Path, figures: Mapping[str, Any], logs: Iterable[EpisodeLog]) -> None:
    """Write the page.

    Args:
        path: HTML file; its folder is made where it is missing.
        figures: as `portnav evaluate --json` writes them.
        logs: of failed episodes; the first few of each kind are drawn.
    """
    place = figures['scenario'] or figures['chart'] or f'difficulty {figures["difficulty"]}'
    template = Template((PAGE / 'overview.html').read_text(encoding='utf-8'))
    page = template.substitute(
        title=escape(f'{figures["planner"]} on {place}'),
        style=(PAGE / 'report.css').read_text(encoding='utf-8'),
        headline=escape(f'{figures["planner"]} on {place}: {_success(figures)}'),
        facts=escape(
            f'{figures["episodes"]} episodes · split {figures["split"]}, from seed {figures["seed"]} · '
            f'through {figures["through"]} · version {figures["version"]}, commit {figures["git_commit"]}'
        ),
        comparison=_comparison(figures),
        warning=_warning(figures),
        bar=''.join(_segment(ending, figures) for ending in ENDINGS),
        key=''.join(_entry(ending, figures) for ending in ENDINGS),
        figures='\n'.join(_average(metric, figures) for metric in METRICS),
        about_gallery=f'The first {SHOWN_OF_A_KIND} of each kind, by seed.',
        gallery='\n'.join(map(_exhibit, _chosen(logs))),
        command=escape(figures['command']),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding='utf-8')


def _success(figures: Mapping[str, Any]) -> str:
    if _cut_short(figures):
        return f'{figures["success"]:.1%} success so far'
    success, low, high = (f'{figures[key]:.1%}' for key in ('success', 'success_low', 'success_high'))
    return f'{success} success (95 % interval {low} to {high})'


def _cut_short(figures: Mapping[str, Any]) -> bool:
    """Whether the first planner was: the second sails only after every episode of the first."""
    return not figures['complete'] and 'against' not in figures


def _comparison(figures: Mapping[str, Any]) -> str:
    text = sentence(figures)
    against = figures.get('against', {})
    return (
        f'<p>{escape(against["planner"])}: {escape(_success(against))}; {escape(text)}.</p>' if text else ''
    )


def _warning(figures: Mapping[str, Any]) -> str:
    if figures['complete']:
        return ''
    text = f'Cut short after {figures["episodes"]} episodes: those that end first are mostly collisions.'
    if not _cut_short(figures):
        against = figures['against']
        text = f'{against["planner"]} was cut short after {against["episodes"]} episodes: no comparison.'
    return f'<p class="warning">{escape(text)}</p>'


def _chosen(logs: Iterable[EpisodeLog]) -> Sequence[EpisodeLog]:
    failures = (log for log in logs if log.outcome != Outcome.SUCCESS)
    ordered = sorted(failures, key=lambda log: (log.outcome, log.seed))
    kinds = groupby(ordered, key=lambda log: log.outcome)
    return [log for _, kind in kinds for log in list(kind)[:SHOWN_OF_A_KIND]]


def _segment(ending: Outcome, figures: Mapping[str, Any]) -> str:
    share = figures[ending.name.lower()]
    name = ending.name.lower().replace('_', ' ')
    style = f'width: {100.0 * share:.2f}%; background: {plots.ENDING_COLOURS[ending]}'
    return f'<div style="{style}" title="{name} {share:.1%}"></div>' if share else ''


def _entry(ending: Outcome, figures: Mapping[str, Any]) -> str:
    name = ending.name.lower().replace('_', ' ')
    swatch = f'<i style="background: {plots.ENDING_COLOURS[ending]}"></i>'
    return f'<span>{swatch}{name} {figures[ending.name.lower()]:.1%}</span>'


def _average(metric: Metric, figures: Mapping[str, Any]) -> str:
    value = figures[f'{metric.average}_{metric.key}']
    return '' if math.isnan(value) else metric.card(value)


def _exhibit(log: EpisodeLog) -> str:
    minutes, seconds = divmod(round(log.length_s), 60)
    caption = f'{plots.SENTENCES[log.outcome]} after {minutes}:{seconds:02d} min'
    return (
        f'<figure>{plots.inline_svg(thumbnail_figure(log))}'
        f'<figcaption>{caption}<code>{escape(rerun_command(log))}</code></figcaption></figure>'
    )
