"""Reward by terms, actions by number."""

import math

import numpy as np
import pytest

from portnav_ros.params import ParamError
from portnav_ros.task.actions import ActionParams, setpoints_of
from portnav_ros.task.reward import TERMS, RewardParams, reward_terms
from portnav_ros.types import Outcome


def test_each_outcome_pays_what_the_paper_says():
    outcomes = np.array([int(o) for o in Outcome])
    terms = reward_terms(RewardParams(), np.zeros((len(outcomes), 3)), outcomes)
    paid = dict(zip(Outcome, terms.sum(axis=1), strict=True))
    assert paid == {
        Outcome.RUNNING: 0.0,
        Outcome.SUCCESS: 1000.0,
        Outcome.COLLISION_QUAY: -1000.0,
        Outcome.COLLISION_BUOY: -1000.0,
        Outcome.COLLISION_VESSEL: -1000.0,
        Outcome.TIMEOUT: 0.0,
    }


def test_path_terms_are_scaled_errors():
    terms = reward_terms(RewardParams(), np.array([[-10.0, 20.0, math.pi / 2]]), np.array([0]))
    assert dict(zip(TERMS, terms[0], strict=True)) == pytest.approx(
        {'e_x': -0.2, 'e_y': -0.4, 'e_psi': -0.5, 'goal': 0.0, 'collision': 0.0}
    )


def test_the_27_actions():
    params = ActionParams()
    table = params.table()
    assert params.count == len(table) == 27
    assert table[0] == pytest.approx([-math.pi / 6, 1.0])
    assert table[13] == pytest.approx([0.0, 2.5])
    assert table[26] == pytest.approx([math.pi / 6, 5.0])


def test_setpoints_count_from_the_present_heading():
    params = ActionParams()
    own = np.zeros((2, 7))
    own[:, 2] = [1.0, -2.0]
    setpoints = setpoints_of(np.array([26, 13]), params.reference_rad(own, np.zeros((2, 3))), params.table())
    np.testing.assert_allclose(setpoints, [[1.0 + math.pi / 6, 5.0], [-2.0, 2.5]])


def test_an_empty_grid_is_refused():
    with pytest.raises(ParamError, match='speed_mps'):
        ActionParams(speed_mps=())
