"""The feature vector: layout, memory, rows."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from portnav_ros.evaluation import episodes
from portnav_ros.evaluation.planners import make_planner
from portnav_ros.params import ParamError
from portnav_ros.sim.scenario import LidarParams
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.task.observation import ObservationParams, Observer
from portnav_ros.types import Outcome

LIDAR = LidarParams()
PARAMS = ObservationParams()
LEG = np.column_stack([np.arange(0.0, 1001.0, 10.0), np.zeros(101)])
STILL = np.zeros((1, 2))


def observer(batch=1, paths=(LEG,)):
    made = Observer(batch, LIDAR, PARAMS)
    made.reset(np.ones(batch, dtype=bool), paths)
    return made


def own(x=0.0, y=0.0, yaw=0.0, surge=0.0):
    return np.array([[x, y, yaw, surge, 0.0, 0.0, 0.0]])


def far():
    return np.full((1, LIDAR.rays), np.inf, np.float32)


def frames(observation):
    return observation.features.reshape(len(observation.features), PARAMS.frames, PARAMS.frame_size)


def test_frame_holds_what_the_paper_names_at_its_scale():
    ranges = far()
    ranges[0, 90] = 30.0
    first = frames(observer().update(own(100.0, 25.0, 0.0, 2.5), ranges, STILL))[0, 0]
    sector = PARAMS.sectors // 2
    assert first[sector] == pytest.approx(30.0 / LIDAR.range_max_m)
    assert np.delete(first[: PARAMS.sectors], sector).tolist() == [1.0] * (PARAMS.sectors - 1)
    surge, yaw_rate, e_x, e_y, e_psi = first[PARAMS.sectors : PARAMS.sectors + 5]
    assert (surge, yaw_rate, e_x, e_y) == pytest.approx((0.5, 0.0, 0.0, 0.5))
    assert e_psi == pytest.approx(math.atan(0.25) / math.pi)
    points = first[PARAMS.sectors + 5 : -2].reshape(PARAMS.path_points, 2)
    np.testing.assert_allclose(points[:, 0], 30.0 * np.arange(1, 11) / LIDAR.range_max_m, rtol=1e-6)
    np.testing.assert_allclose(points[:, 1], -25.0 / LIDAR.range_max_m, rtol=1e-6)


def test_newest_frame_comes_first_and_a_reset_fills_all():
    watch = observer()
    stacked = frames(watch.update(own(surge=5.0), far(), STILL)).copy()
    assert (stacked[0] == stacked[0, 0]).all()
    later = frames(watch.update(own(10.0, surge=2.5), far(), STILL))[0]
    assert later[:, PARAMS.sectors].tolist() == [0.5, 1.0, 1.0, 1.0]


def test_previous_action_is_the_change_that_was_asked():
    watch = observer()
    watch.update(own(yaw=0.2), far(), STILL)
    row = frames(watch.update(own(yaw=0.25), far(), np.array([[0.2 + math.pi / 12, 2.5]])))[0, 0]
    assert row[-2:] == pytest.approx([0.5, 0.5])


def test_rays_without_a_distance():
    ranges = far()
    ranges[0, 0:3] = [np.nan, np.inf, np.nan]
    ranges[0, 3:6] = [-np.inf, np.nan, 20.0]
    row = frames(observer().update(own(), ranges, STILL))[0, 0]
    assert row[0] == 1.0
    assert row[1] == 0.0
    assert np.isfinite(row).all()


def test_rows_are_independent_and_unnamed_rows_stay():
    both = observer(2, (LEG, LEG + 5.0))
    states = np.vstack([own(100.0), own(200.0, 3.0)])
    ranges = np.vstack([far(), far()])
    features = both.update(states, ranges, np.zeros((2, 2))).features.copy()
    np.testing.assert_array_equal(features[0], observer().update(own(100.0), far(), STILL).features[0])
    only = both.update(states, ranges, np.zeros((2, 2)), np.array([True, False])).features
    np.testing.assert_array_equal(only[1], features[1])


def pooled(ranges):
    """Features of the sectors of one scan, in m."""
    watch = Observer(1, dataclasses.replace(LIDAR, rays=ranges.shape[1]), PARAMS)
    watch.reset(np.ones(1, dtype=bool), [LEG])
    return frames(watch.update(own(), ranges, STILL))[0, 0, : PARAMS.sectors] * LIDAR.range_max_m


@pytest.mark.parametrize('rays', [60, 61, 100, 128, 180, 1024])
def test_every_ray_belongs_to_the_one_sector_that_it_looks_into(rays):
    drawn = np.random.default_rng(rays).uniform(1.0, 399.0, (1, rays)).astype(np.float32)
    edges = np.arange(PARAMS.sectors + 1) * rays // PARAMS.sectors
    assert (np.abs(edges - np.arange(PARAMS.sectors + 1) * rays / PARAMS.sectors) < 1.0).all()
    expected = [drawn[0, a:b].min() for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(pooled(drawn), expected, rtol=1e-6)


def test_fewer_rays_than_sectors_are_refused_with_the_mend():
    with pytest.raises(
        ParamError, match=r'lidar\.rays = 59 .* observation\.sectors = 60: give .* at least 60'
    ):
        Observer(1, dataclasses.replace(LIDAR, rays=59), PARAMS)


@pytest.mark.parametrize('planner', ['dwa', 'line_of_sight'])
@pytest.mark.parametrize('rays', [128, 1024])
def test_planners_that_read_no_features_sail_with_any_number_of_rays(planner, rays):
    scenario = load_scenario('no_traffic')
    sensor = dataclasses.replace(scenario.lidar, rays=rays)
    sailed = dataclasses.replace(scenario, lidar=sensor)
    log = next(episodes.sail(lambda first: make_planner(planner, first), [sailed], 1))
    assert log.outcome == Outcome.SUCCESS
