"""Two planners on the same episodes: the difference in success, and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from portnav_ros.evaluation.statistics import PairedDifference, paired_difference
from portnav_ros.evaluation.trial import EpisodeResult
from portnav_ros.types import Outcome


def compare(first: Sequence[EpisodeResult], second: Sequence[EpisodeResult]) -> PairedDifference:
    """Compare success episode by episode; both hold the same seeds in the same order."""
    won = [np.array([result.outcome == Outcome.SUCCESS for result in results]) for results in (first, second)]
    return paired_difference(won[0], won[1])


def sentence(figures: Mapping[str, Any]) -> str:
    """The comparison in figures as `portnav evaluate --json` writes them; empty where there is none."""
    against = figures.get('against', {})
    if 'paired' not in against:
        return ''
    paired = PairedDifference(**against['paired'])
    names = figures['planner'], against['planner']
    first, second = names if names[0] != names[1] else ('the first', 'the second')
    return (
        f'difference on {figures["episodes"]} same episodes: {paired.difference:+.1%} '
        f'(95 % interval {paired.low:+.1%} to {paired.high:+.1%}, McNemar p = {paired.p_value:.2g}; '
        f'only {first} {paired.only_first}, only {second} {paired.only_second})'
    )
