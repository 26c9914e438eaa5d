"""The one table of metrics: reports, evaluations and files take names, units and order from here."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from portnav_ros.evaluation.episode_log import EpisodeLog
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


class Metric(NamedTuple):
    """A figure of one episode. key: in files; label, unit and digits: where people read it."""

    key: str
    label: str
    unit: str
    digits: int
    measure: Callable[[EpisodeLog], float]


METRICS = (
    Metric('length_s', 'duration', 's', 1, length_s),
    Metric('return', 'return', '', 1, episode_return),
    Metric('abs_e_x_m', 'mean |e_x|', 'm', 2, mean_abs_e_x_m),
    Metric('abs_e_y_m', 'mean |e_y|', 'm', 2, mean_abs_e_y_m),
    Metric('abs_e_psi_rad', 'mean |e_psi|', 'rad', 3, mean_abs_e_psi_rad),
    Metric('least_clearance_m', 'least clearance', 'm', 1, least_clearance_m),
    Metric('path_over_plan', 'track over plan', '', 3, path_over_plan),
    Metric('control_effort', 'control effort', '', 3, control_effort),
    Metric('rudder_reversals_per_min', 'rudder reversals', '1/min', 2, rudder_reversals_per_min),
    Metric('latency_p50_s', 'decision time, median', 's', 5, latency_p50_s),
    Metric('latency_p99_s', 'decision time, 99 %', 's', 5, latency_p99_s),
    Metric('real_time_factor', 'real-time factor', '', 1, real_time_factor),
)


def measure(log: EpisodeLog) -> dict[str, float]:
    """Every metric of one episode by key, over rows a decision period apart."""
    thinned = log.thinned(DECISION_S)
    return {metric.key: metric.measure(thinned) for metric in METRICS}
