import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.baselines.space_time import SpaceTime, SpaceTimeParams, plan_episode
from portnav_ros.baselines.space_time_field import Haste, time_to_go
from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError
from portnav_ros.planning.clearance_route import RouteCost, clearance_field
from portnav_ros.sim.generator import load_difficulty, make_scenario
from portnav_ros.sim.scenario_files import load_scenario
from portnav_ros.types import Outcome

POINT = Haste(step_s=8.0, speed_mps=5.0, half_beam_m=5.0, comfort_m=1.0, weight=0.0)
NO_VESSELS = np.zeros((40, 0, 4)), np.zeros((0, 2))


@pytest.fixture(scope='module')
def strip():
    """Grid of a canal 600 m by 100 m and the time to its east end."""
    grid = Harbour('strip', box(0.0, 0.0, 600.0, 100.0)).clearance(10.0)
    field = clearance_field(grid, (580.0, 50.0), RouteCost(5.0, 1.0, 0.0))
    return grid, field / np.float32(POINT.speed_mps)


def at(grid, layer, x_m, y_m):
    return layer[int((y_m - grid.y0_m) / grid.resolution_m), int((x_m - grid.x0_m) / grid.resolution_m)]


def test_time_to_go_without_vessels_is_distance_over_speed(strip):
    grid, rest = strip
    togo = time_to_go(grid, rest, *NO_VESSELS, POINT)

    assert at(grid, togo[0], 105.0, 55.0) == pytest.approx(475.0 / 5.0, rel=0.05)


def test_time_to_go_waits_for_a_vessel_across_the_canal(strip):
    grid, rest = strip
    across = np.array([[[300.0, 50.0, 0.5 * np.pi, 0.0]]])
    gone = np.full((1, 1, 4), np.nan)
    poses = np.concatenate([across] * 25 + [gone] * 15)

    togo = time_to_go(grid, rest, poses, np.array([[120.0, 10.0]]), POINT)

    wait_s = 25 * POINT.step_s
    assert at(grid, togo[0], 105.0, 55.0) > wait_s + 270.0 / 5.0
    assert at(grid, togo[0], 405.0, 55.0) == pytest.approx(175.0 / 5.0, rel=0.1)


@pytest.mark.parametrize('name', ['head_on', 'crossing', 'overtaking', 'buoy', 'narrows', 'no_traffic'])
def test_solves_named_scenarios(name, sail):
    world, _ = sail(SpaceTime(), [load_scenario(name)])

    assert world.outcome[0] == Outcome.SUCCESS


def test_world_ends_as_planned(sail):
    difficulty = load_difficulty('paper')
    scenarios = [make_scenario(difficulty, seed) for seed in range(4)]
    narrow = SpaceTimeParams(tries=((20.0, 2),))

    world, _ = sail(SpaceTime(narrow), scenarios)

    planned = [plan_episode(scenario, narrow).arrives for scenario in scenarios]
    assert (world.outcome == Outcome.SUCCESS).tolist() == planned


def test_reset_recites_from_the_start(canal, sail):
    scenario, policy = canal(), SpaceTime()
    first, again = sail(policy, [scenario])[1], sail(policy, [scenario])[1]

    assert np.array_equal(first, again)


def test_goal_out_of_reach_gives_a_partial_plan(canal):
    plan = plan_episode(canal(time_limit_s=60.0))

    assert not plan.arrives
    assert len(plan.setpoints) > 0
    assert np.isfinite(plan.setpoints).all()


def test_empty_search_is_refused():
    with pytest.raises(ParamError, match='tries'):
        SpaceTimeParams(tries=())
