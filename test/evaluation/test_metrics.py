import dataclasses
import math

import numpy as np
import pytest

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.metrics.control_effort import control_effort
from portnav_ros.evaluation.metrics.decision_latency import latency_p50_s, latency_p99_s
from portnav_ros.evaluation.metrics.detour import path_over_plan
from portnav_ros.evaluation.metrics.episode_return import episode_return, rewards
from portnav_ros.evaluation.metrics.least_clearance import least_clearance_m
from portnav_ros.evaluation.metrics.outcome import outcome_shares
from portnav_ros.evaluation.metrics.path_error import mean_abs_e_psi_rad, mean_abs_e_x_m, mean_abs_e_y_m
from portnav_ros.evaluation.metrics.real_time_factor import real_time_factor
from portnav_ros.evaluation.metrics.rudder_reversals import count_reversals, rudder_reversals_per_min
from portnav_ros.evaluation.metrics.table import METRICS, measure
from portnav_ros.task.observation import ObservationParams
from portnav_ros.types import RUDDER, THRUST, Outcome


def with_columns(log: EpisodeLog, **columns: np.ndarray) -> EpisodeLog:
    for name, values in columns.items():
        log.own[:, {'rudder': RUDDER, 'thrust': THRUST}[name]] = values
    return log


def test_path_errors_beside_a_straight_plan(straight):
    log = straight(offset_m=20.0)
    assert mean_abs_e_x_m(log) == pytest.approx(0.0, abs=1e-9)
    assert mean_abs_e_y_m(log) == pytest.approx(20.0)
    expected = math.atan(20.0 / ObservationParams().lookahead_m)
    assert mean_abs_e_psi_rad(log) == pytest.approx(expected)


def test_path_errors_are_mirror_symmetric(straight):
    np.testing.assert_allclose(straight(offset_m=20.0).errors, -straight(offset_m=-20.0).errors, atol=1e-9)


def test_return_on_the_plan_is_that_of_the_outcome(straight):
    assert episode_return(straight()) == pytest.approx(1000.0)
    assert episode_return(straight(outcome=Outcome.COLLISION_BUOY)) == pytest.approx(-1000.0)
    assert episode_return(straight(outcome=Outcome.TIMEOUT)) == pytest.approx(0.0)


def test_every_decision_is_paid_once(straight):
    log = straight(offset_m=25.0, outcome=Outcome.TIMEOUT)
    psi = math.atan(25.0 / ObservationParams().lookahead_m)
    assert len(rewards(log)) == 100
    assert episode_return(log) == pytest.approx(-100 * (25.0 / 50.0 + psi / math.pi))


def test_track_over_plan_counts_what_was_left(straight):
    assert path_over_plan(straight()) == pytest.approx(1.0)
    assert math.isnan(path_over_plan(straight(outcome=Outcome.COLLISION_QUAY)))


def test_a_plan_without_length_has_no_detour(straight):
    log = straight()
    assert math.isnan(path_over_plan(dataclasses.replace(log, path=np.repeat(log.path[:1], 2, axis=0))))


def test_control_effort_flat_out_and_idle(straight):
    log = straight()
    assert control_effort(log) == 0.0
    with_columns(log, rudder=log.vessel.rudder_max_rad, thrust=log.vessel.thrust_max_n)
    assert control_effort(log) == pytest.approx(1.0)


@pytest.mark.parametrize('periods', [1, 3, 7])
def test_a_sine_turns_twice_a_period(periods):
    wave = 0.2 * np.sin(np.linspace(0.0, 2.0 * np.pi * periods, 2000))
    assert count_reversals(wave, math.radians(2.0)) == 2 * periods


def test_chatter_within_the_dead_band_is_no_reversal():
    generator = np.random.default_rng(0)
    ramp = np.linspace(0.0, 0.6, 500) + generator.uniform(-0.005, 0.005, 500)
    assert count_reversals(ramp, math.radians(2.0)) == 0
    assert count_reversals(np.zeros(5), 0.0) == 0


def test_reversals_are_counted_per_minute(straight):
    log = straight()
    with_columns(log, rudder=0.3 * np.sin(2.0 * np.pi * log.time_s / 50.0))
    assert rudder_reversals_per_min(log) == pytest.approx(4 * 60.0 / 100.0)


def test_least_clearance_is_over_time_and_kinds(straight):
    assert least_clearance_m(straight()) == pytest.approx(50.0)
    assert math.isnan(least_clearance_m(straight(clearance=None)))


def test_latency_quantiles_and_real_time_factor(straight):
    log = straight()
    assert latency_p50_s(log) == pytest.approx(0.05)
    assert latency_p99_s(log) == pytest.approx(0.099)
    assert real_time_factor(log) == pytest.approx(50.0)
    unknown = straight(latency_s=np.zeros(0), wall_s=float('nan'))
    assert math.isnan(latency_p99_s(unknown))
    assert math.isnan(real_time_factor(unknown))


def test_measure_does_not_depend_on_the_recording_rate(straight):
    sparse, dense = measure(straight(3.0)), measure(straight(3.0, period_s=0.05, scans=None))
    assert list(sparse) == [metric.key for metric in METRICS]
    for key in sparse:
        assert dense[key] == pytest.approx(sparse[key]), key


def test_outcome_shares_add_up():
    outcomes = [Outcome.SUCCESS] * 6 + [Outcome.TIMEOUT] + [Outcome.COLLISION_BUOY] * 3
    shares = outcome_shares(outcomes)
    assert shares['success'] == pytest.approx(0.6)
    assert shares['collision_buoy'] == pytest.approx(0.3)
    kinds = ('success', 'collision_quay', 'collision_buoy', 'collision_vessel', 'timeout')
    assert sum(shares[kind] for kind in kinds) == pytest.approx(1.0)
    assert shares['success_low'] < 0.6 < shares['success_high']


def test_a_running_episode_has_no_outcome_to_count():
    with pytest.raises(ValueError, match='still running'):
        outcome_shares([Outcome.RUNNING])
