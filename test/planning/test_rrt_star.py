import gc
import subprocess
import sys

import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError
from portnav_ros.planning import rrt_star
from portnav_ros.planning.plan_space import PlanError, PlanSpace, prepare
from portnav_ros.planning.route import PATH_SPACING_M, route_clearance, route_length
from portnav_ros.planning.rrt_star import (
    PlanCancelledError,
    RrtStarParams,
    plan_in,
    plan_route,
)

PARAMS = RrtStarParams(iterations=2000)
HULL_M = 20.0
START, GOAL = (100.0, 900.0), (1900.0, 900.0)


def docks() -> Harbour:
    """A canal with two basins to its north, a quay wall of 20 m between them, and one charted buoy."""
    water = box(0, 0, 2000, 300) | box(0, 290, 400, 1000) | box(1600, 290, 2000, 1000)
    buoys = np.array([[1000.0, 150.0, 5.0], [1500.0, 150.0, 5.0]])
    return Harbour('docks', water, buoys, charted=np.array([True, False]))


@pytest.fixture(scope='module')
def space() -> PlanSpace:
    return prepare(docks(), PARAMS.resolution_m, HULL_M)


def reason(space: PlanSpace, start: tuple[float, float], goal: tuple[float, float]) -> str:
    with pytest.raises(PlanError) as caught:
        plan_in(space, start, goal, PARAMS, 0)
    assert str(caught.value).startswith(caught.value.reason)
    return str(caught.value.reason)


def test_a_plan_joins_the_ends_and_keeps_clear(space: PlanSpace) -> None:
    path = plan_in(space, START, GOAL, PARAMS, 0)
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    assert np.hypot(*np.diff(path, axis=0).T).max() <= PATH_SPACING_M + 1e-9
    assert route_clearance(space.grid, path) >= HULL_M - 0.5


def test_a_plan_is_close_to_the_shortest_way(space: PlanSpace) -> None:
    taut = np.hypot(310.0, 630.0) * 2 + 1180.0  # round the two inner corners at the hull's clearance
    for seed in range(5):
        assert route_length(plan_in(space, START, GOAL, PARAMS, seed)) < 1.05 * taut


def test_a_thin_quay_is_never_crossed() -> None:
    harbour = Harbour('wall', box(0, 0, 3000, 1000) - box(1490, 100, 1510, 1000))
    for seed in range(12):
        path = plan_route(harbour, (1300.0, 800.0), (1700.0, 800.0), PARAMS, HULL_M, seed)
        assert harbour.contains(path).all()
        assert path[:, 1].min() < 100.0


def test_charted_buoys_are_avoided_and_uncharted_ones_are_not_known(space: PlanSpace) -> None:
    path = plan_in(space, (50.0, 150.0), (1950.0, 150.0), PARAMS, 0)
    charted, uncharted = (np.hypot(*(path - buoy[:2]).T).min() for buoy in space.harbour.buoys)
    assert charted >= HULL_M + 4.5
    assert uncharted < HULL_M


def test_the_same_seed_gives_the_same_plan_in_another_process(space: PlanSpace) -> None:
    script = (
        'import sys, importlib.util as u\n'
        f's = u.spec_from_file_location("t", {__file__!r})\n'
        't = u.module_from_spec(s)\n'
        's.loader.exec_module(t)\n'
        'path = t.plan_route(t.docks(), t.START, t.GOAL, t.PARAMS, t.HULL_M, 7)\n'
        'sys.stdout.write(path.tobytes().hex())'
    )
    other = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True, check=True)
    plan_in(space, GOAL, START, PARAMS, 3)  # what was planned before does not matter
    assert plan_in(space, START, GOAL, PARAMS, 7).tobytes().hex() == other.stdout


def test_reasons(space: PlanSpace) -> None:
    assert reason(space, START, (1000.0, 600.0)) == 'GOAL_OCCUPIED'
    assert reason(space, (1000.0, 600.0), GOAL) == 'START_OCCUPIED'
    assert reason(space, (-500.0, 100.0), GOAL) == 'START_OCCUPIED'
    assert reason(space, START, (9000.0, 100.0)) == 'GOAL_OUTSIDE_MAP'
    assert reason(space, START, (1000.0, 151.0)) == 'GOAL_OCCUPIED'


@pytest.mark.parametrize('bad', [(np.nan, 0.0), (np.inf, 0.0), (0.0, -np.inf)])
def test_ends_that_are_no_place_are_refused(space: PlanSpace, bad: tuple[float, float]) -> None:
    assert reason(space, bad, GOAL) == 'START_OCCUPIED'
    assert reason(space, START, bad) == 'GOAL_OUTSIDE_MAP'
    with pytest.raises(PlanError, match=r'the start .* is no place; give finite x and y'):
        plan_in(space, bad, bad, PARAMS, 0)


def test_water_that_is_not_connected_is_told_at_once() -> None:
    harbour = Harbour('lakes', box(0, 0, 1000, 400) | box(1100, 0, 2000, 400))
    endless = RrtStarParams(iterations_max=100_000_000, time_limit_s=3600.0)
    with pytest.raises(PlanError) as caught:
        plan_route(harbour, (100.0, 200.0), (1900.0, 200.0), endless, HULL_M, 0)
    assert caught.value.reason == 'NO_VALID_PATH'


def test_a_passage_narrower_than_the_hull_is_no_path(space: PlanSpace) -> None:
    harbour = Harbour('lock', box(0, 0, 500, 400) | box(400, 180, 900, 215) | box(800, 0, 1300, 400))
    with pytest.raises(PlanError, match='NO_VALID_PATH'):
        plan_route(harbour, (100.0, 200.0), (1200.0, 200.0), PARAMS, HULL_M, 0)
    assert len(plan_route(harbour, (100.0, 200.0), (1200.0, 200.0), PARAMS, 10.0, 0)) > 100


def test_an_exhausted_budget_is_a_timeout(space: PlanSpace) -> None:
    few = RrtStarParams(iterations=1, iterations_max=1, range_m=20.0)
    with pytest.raises(PlanError) as caught:
        plan_in(space, START, GOAL, few, 0)
    assert caught.value.reason == 'TIMEOUT'


def test_berths_closer_to_the_quay_than_the_hull_clears(space: PlanSpace) -> None:
    start, goal = (4.0, 900.0), (1900.0, 993.0)
    path = plan_in(space, start, goal, PARAMS, 0)
    np.testing.assert_array_equal(path[[0, -1]], [start, goal])
    assert space.harbour.contains(path).all()
    assert route_clearance(space.grid, path[5:-5]) >= HULL_M - 0.5


def test_a_berth_across_a_quay_is_not_snapped_through_it() -> None:
    slot = box(0, 0, 1000, 300) | box(480, 320, 500, 400)
    assert (
        reason(prepare(Harbour('slot', slot), 5.0, HULL_M), (100.0, 150.0), (490.0, 360.0)) == 'GOAL_OCCUPIED'
    )


def test_start_equal_to_goal_is_a_path_of_two_points(space: PlanSpace) -> None:
    assert plan_in(space, START, START, PARAMS, 0).tolist() == [list(START), list(START)]


def test_a_caller_can_stop_a_search(space: PlanSpace) -> None:
    answers = iter([False, True])
    with pytest.raises(PlanCancelledError):
        plan_in(space, START, GOAL, RrtStarParams(iterations=10**8), 0, lambda: next(answers))


def test_params_are_checked() -> None:
    with pytest.raises(ParamError, match='goal_bias'):
        RrtStarParams(goal_bias=1.5)


def test_plans_do_not_pile_up_in_memory(space: PlanSpace) -> None:
    def alive() -> int:
        return sum(isinstance(thing, rrt_star._ClearSegment) for thing in gc.get_objects())

    before = alive()
    for seed in range(3):
        plan_in(space, START, GOAL, RrtStarParams(iterations=500), seed)
    assert alive() <= before
