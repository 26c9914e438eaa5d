"""The rung of the ladder that knows the future of what is in sight."""

import dataclasses

import numpy as np
import pytest

from portnav_ros.baselines.foresight import ForesightPolicy
from portnav_ros.evaluation.episodes import sail
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.training.foresight import Extrapolation, Foresight
from portnav_ros.types import Outcome


def scenarios(name, count, range_m=400.0):
    made = (load_scenario(name, seed) for seed in range(count))
    return [dataclasses.replace(s, lidar=dataclasses.replace(s.lidar, range_max_m=range_m)) for s in made]


def logs(name, batch, count=5, look_ahead=Foresight, **options):
    found = sail(lambda _: ForesightPolicy(look_ahead=look_ahead), scenarios(name, count, **options), batch)
    return sorted(found, key=lambda log: log.seed)


@pytest.mark.parametrize('look_ahead', [Foresight, Extrapolation])
def test_it_avoids_what_it_sees(look_ahead):
    found = logs('slow_head_on', 5, look_ahead=look_ahead)  # which sails straight on
    assert [log.outcome for log in found] == [Outcome.SUCCESS] * 5


def test_it_does_not_avoid_what_it_cannot_see():
    assert {log.outcome for log in logs('slow_head_on', 5, range_m=20.0)} == {Outcome.COLLISION_VESSEL}


def test_no_episode_depends_on_the_batch():
    together, alone = logs('half_crossing', 3), logs('half_crossing', 1)
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one.own, other.own)
