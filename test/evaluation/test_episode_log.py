import dataclasses

import numpy as np
import pytest

from portnav_ros.evaluation.episode_log import LogError


def test_thinning_a_dense_log_gives_the_sparse_one(straight):
    dense, sparse = straight(period_s=0.05).thinned(1.0), straight(period_s=1.0)
    np.testing.assert_allclose(dense.time_s, sparse.time_s)
    np.testing.assert_allclose(dense.own, sparse.own)
    np.testing.assert_allclose(dense.clearance, sparse.clearance)


def test_thinning_keeps_the_last_row_and_missing_columns(straight):
    log = straight(period_s=0.05, clearance=None)
    cut = dataclasses.replace(
        log, time_s=log.time_s[:-7], own=log.own[:-7], setpoint=log.setpoint[:-7], clearance=None
    ).thinned(1.0)
    assert cut.time_s[-1] == pytest.approx(99.65)
    assert cut.time_s[-2] == pytest.approx(99.0)
    assert cut.clearance is None


def test_thinning_twice_changes_nothing(straight):
    once = straight(period_s=0.1).thinned(1.0)
    assert once.thinned(1.0) is once


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'time_s': np.zeros(101)}, 'time_s must rise'),
        ({'time_s': np.zeros(0)}, 'nothing was recorded'),
        ({'own': np.zeros((101, 6))}, r'own has the shape \(101, 6\), expected \(101, 7\)'),
        ({'range_min': np.zeros(3)}, 'range_min'),
        ({'path': np.zeros((1, 2))}, 'path'),
    ],
)
def test_arrays_that_do_not_fit_are_refused(straight, changes, message):
    with pytest.raises(LogError, match=message):
        straight(**changes)
