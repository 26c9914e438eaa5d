"""An evaluation's figures: as values for JSON, as a table for the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from portnav_ros.evaluation.metrics.outcome import ENDINGS, outcome_shares
from portnav_ros.evaluation.metrics.table import METRICS, averages
from portnav_ros.evaluation.trial import EpisodeResult


def summarise(results: Sequence[EpisodeResult], wall_s: float) -> dict[str, Any]:
    """Shares of the endings with success_low and success_high, averages of the metrics, speed."""
    simulated_s = sum(result.values['length_s'] for result in results)
    return {
        'episodes': len(results),
        **outcome_shares(result.outcome for result in results),
        **averages([result.values for result in results]),
        'wall_s': wall_s,
        'simulated_over_wall': simulated_s / wall_s,
    }


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write values as JSON; a figure that is not known becomes null."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(_known(values), indent=2, allow_nan=False) + '\n', encoding='utf-8')


def table(summary: Mapping[str, Any]) -> str:
    """Lines for the terminal."""
    low, high = summary['success_low'], summary['success_high']
    rows = [('success', f'{summary["success"]:.1%}', f'95 % interval {low:.1%} to {high:.1%}')]
    rows += [
        (ending.name.lower().replace('_', ' '), f'{summary[ending.name.lower()]:.1%}', '')
        for ending in ENDINGS[1:]
    ]
    for metric in METRICS:
        value = summary[f'{metric.average}_{metric.key}']
        if not math.isnan(value):
            rows.append((metric.label, *metric.text(value)))
    return '\n'.join(f'  {name:24}{value:>10}  {note}'.rstrip() for name, value, note in rows)


def _known(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _known(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_known(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
