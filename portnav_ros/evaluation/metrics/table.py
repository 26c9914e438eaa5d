"""The one table of metrics: reports, evaluations and files take names, units and order from here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Literal, NamedTuple

import numpy as np

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.hull_clearance import with_clearance
from portnav_ros.evaluation.metrics.control_effort import control_effort
from portnav_ros.evaluation.metrics.decision_latency import latency_p50_s, latency_p99_s
from portnav_ros.evaluation.metrics.detour import path_over_plan
from portnav_ros.evaluation.metrics.episode_return import episode_return
from portnav_ros.evaluation.metrics.least_clearance import least_clearance_m
from portnav_ros.evaluation.metrics.length import length_s
from portnav_ros.evaluation.metrics.path_error import mean_abs_e_psi_rad, mean_abs_e_x_m, mean_abs_e_y_m
from portnav_ros.evaluation.metrics.real_time_factor import real_time_factor
from portnav_ros.evaluation.metrics.rudder_reversals import rudder_reversals_per_min
from portnav_ros.sim.world import DECISION_S

SHORT_S = 0.5


class Metric(NamedTuple):
    """A figure of one episode. key: in files; label and unit: where people read it.

    average: how episodes combine. A median keeps the first call's compilation out of timings.
    """

    key: str
    label: str
    unit: str
    measure: Callable[[EpisodeLog], float]
    average: Literal['mean', 'median'] = 'mean'

    def text(self, value: float) -> tuple[str, str]:
        """Return value and unit as people read them: short times in milliseconds."""
        if self.unit == 's' and abs(value) < SHORT_S:
            return f'{1e3 * value:.3g}', 'ms'
        return f'{value:.4g}', self.unit

    def card(self, value: float) -> str:
        """HTML of the figure on a page."""
        shown, unit = self.text(value)
        return (
            f'<div class="figure"><span class="label">{escape(self.label)}</span>'
            f'<span class="value">{shown}</span> <span class="unit">{escape(unit)}</span></div>'
        )


METRICS = (
    Metric('length_s', 'duration', 's', length_s),
    Metric('return', 'return', '', episode_return),
    Metric('abs_e_x_m', 'mean |e_x|', 'm', mean_abs_e_x_m),
    Metric('abs_e_y_m', 'mean |e_y|', 'm', mean_abs_e_y_m),
    Metric('abs_e_psi_rad', 'mean |e_psi|', 'rad', mean_abs_e_psi_rad),
    Metric('least_clearance_m', 'least clearance', 'm', least_clearance_m),
    Metric('path_over_plan', 'track over plan', '', path_over_plan),
    Metric('control_effort', 'control effort', '', control_effort),
    Metric('rudder_reversals_per_min', 'rudder reversals', '1/min', rudder_reversals_per_min),
    Metric('latency_p50_s', 'decision time, median', 's', latency_p50_s, 'median'),
    Metric('latency_p99_s', 'decision time, 99 %', 's', latency_p99_s, 'median'),
    Metric('real_time_factor', 'real-time factor', '', real_time_factor),
)


def averages(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Combine the metrics of episodes, leaving out NaN; keys as in ``mean_length_s``."""
    combined = {}
    for metric in METRICS:
        column = np.array([row[metric.key] for row in values])
        known = column[np.isfinite(column)]
        combine = np.mean if metric.average == 'mean' else np.median
        combined[f'{metric.average}_{metric.key}'] = float(combine(known)) if len(known) else float('nan')
    return combined


def measure(log: EpisodeLog) -> dict[str, float]:
    """Every metric of one episode by key, over rows a decision period apart."""
    thinned = with_clearance(log.thinned(DECISION_S))
    return {metric.key: metric.measure(thinned) for metric in METRICS}
