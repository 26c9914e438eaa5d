import dataclasses

import numpy as np
import pytest
import yaml
from shapely.geometry import box

from portnav_ros.charts import read_chart, write_geojson
from portnav_ros.geometry import polyline_lengths
from portnav_ros.harbour import Harbour
from portnav_ros.params import ParamError
from portnav_ros.planning.clearance_route import least_clearance
from portnav_ros.sim.difficulty import OF_A_HULL, Difficulty, TrafficParams, load_difficulty, load_vessel
from portnav_ros.sim.generator import ScenarioPool, chart_scenario, make_scenario
from portnav_ros.sim.ports import PortParams
from portnav_ros.sim.scenario import Arrival, ScenarioError
from portnav_ros.sim.tracks import pose_on_track
from portnav_ros.vessel import VesselParams

DIFFICULTIES = ('paper', 'harbour', 'easy')
VESSELS = ('workboat', 'shuttle', 'cemt_i', 'cemt_iv', 'cemt_va', 'paper_literal')


def _clearance(name):
    """A named difficulty with paths that take no RRT*."""
    return dataclasses.replace(load_difficulty(name), route='clearance')


@pytest.fixture(scope='module')
def harbour_difficulty():
    return _clearance('harbour')


@pytest.fixture(scope='module')
def pool(harbour_difficulty):
    return ScenarioPool(harbour_difficulty, 3, seed=4)


def positions(traffic, time_s=0.0):
    tracks = traffic.tracks
    starts = zip(traffic.track, traffic.progress + traffic.speed * time_s, strict=True)
    return np.array([pose_on_track(tracks.points, tracks.offsets, n, at)[:2] for n, at in starts])


def same(a, b):
    return (
        a.start == b.start
        and a.goal == b.goal
        and np.array_equal(a.path, b.path)
        and np.array_equal(a.harbour.buoys, b.harbour.buoys)
        and np.array_equal(a.traffic.tracks.points, b.traffic.tracks.points)
        and np.array_equal(a.traffic.progress, b.traffic.progress)
        and np.array_equal(a.traffic.hull, b.traffic.hull)
        and a.traffic.seed == b.traffic.seed
    )


def check_mission(scenario, difficulty):
    low, high = difficulty.path_length_m
    length = polyline_lengths(scenario.path)[-1]
    assert 0.9 * low <= length <= high
    assert np.allclose(scenario.path[0], scenario.start[:2])
    assert np.allclose(scenario.path[-1], scenario.goal)
    ahead = scenario.path[6] - scenario.path[0]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(scenario.start[2])
    grid = scenario.harbour.clearance(10.0, buoys='charted')
    assert least_clearance(grid, scenario.path) >= difficulty.path.least_m - 5.0


def check_traffic(scenario, params):
    own = np.array(scenario.start[:2])
    begin = positions(scenario.traffic)
    gaps = np.hypot(*(begin[:, None] - begin[None]).T)[~np.eye(len(begin), dtype=bool)]
    assert gaps.min() >= params.start_gap_m
    assert np.hypot(*(begin - own).T).min() >= params.start_gap_m
    for time_s in np.arange(0.0, params.clear_start_s + 1.0, 5.0):
        gap = np.hypot(*(positions(scenario.traffic, time_s) - own).T)
        assert gap.min() >= params.clear_start_m
    assert np.all(scenario.traffic.hull[:, 0] >= params.length_m[0])
    assert np.all(scenario.traffic.hull[:, 0] <= params.length_m[1])
    assert np.all(scenario.traffic.speed >= params.speed_mps[0])
    assert np.all(scenario.traffic.speed <= params.speed_mps[1])


@pytest.mark.parametrize('name', DIFFICULTIES)
@pytest.mark.parametrize('seed', range(4))
def test_scenarios_keep_what_their_difficulty_promises(name, seed):
    difficulty = _clearance(name)
    scenario = make_scenario(difficulty, seed)
    assert (scenario.name, scenario.seed, len(scenario.traffic)) == (name, seed, 6)
    assert scenario.vessel == load_vessel(difficulty.vessel)
    check_mission(scenario, difficulty)
    check_traffic(scenario, difficulty.traffic)


def test_a_scenario_is_a_function_of_its_seed(harbour_difficulty):
    scenario = make_scenario(harbour_difficulty, 11)
    assert same(scenario, make_scenario(harbour_difficulty, 11))
    assert not same(scenario, make_scenario(harbour_difficulty, 12))


def test_traffic_does_not_change_port_and_mission(harbour_difficulty):
    quiet = dataclasses.replace(harbour_difficulty, traffic=TrafficParams(vessels=0))
    with_traffic, without = make_scenario(harbour_difficulty, 2), make_scenario(quiet, 2)
    assert len(without.traffic) == 0
    assert with_traffic.start == without.start
    assert np.array_equal(with_traffic.path, without.path)


def test_another_planners_path_leaves_the_rest_alone(harbour_difficulty):
    asked = []

    def straight(harbour, start, goal, seed):
        asked.append((start, goal, seed))
        return np.array([start, goal])

    drawn, planned = make_scenario(harbour_difficulty, 3), make_scenario(harbour_difficulty, 3, straight)
    assert asked == [(drawn.start[:2], drawn.goal, 3)]
    assert planned.start == drawn.start
    assert np.array_equal(planned.traffic.progress, drawn.traffic.progress)
    assert np.ptp(np.hypot(*np.diff(planned.path, axis=0).T)) < 1e-6


def test_impossible_scenario_names_difficulty_seed_and_mend():
    crowded = Difficulty(name='crowded', traffic=TrafficParams(vessels=90))
    with pytest.raises(ScenarioError, match=r'crowded, seed 5: .* lower vessels or start_gap_m'):
        make_scenario(crowded, 5)
    endless = Difficulty(name='endless', path_length_m=(9000.0, 9900.0))
    with pytest.raises(ScenarioError, match=r'endless, seed 0: .* widen path_length_m'):
        make_scenario(endless, 0)
    with pytest.raises(ScenarioError, match='seed = -1'):
        make_scenario(endless, -1)


def test_pool_draws_depend_on_the_generator_alone(pool):
    drawn = [pool.draw(np.random.default_rng(1)) for _ in range(2)]
    assert same(*drawn)


def test_pool_mixes_ports_missions_and_traffic(pool, harbour_difficulty):
    rng = np.random.default_rng(0)
    drawn = [pool.draw(rng) for _ in range(60)]
    assert len({id(scenario.harbour) for scenario in drawn}) == len(pool) == 3
    assert len({(scenario.start, scenario.goal) for scenario in drawn}) > 6
    assert len({scenario.traffic.seed for scenario in drawn}) == 60
    for scenario in drawn[:10]:
        check_mission(scenario, harbour_difficulty)
        check_traffic(scenario, harbour_difficulty.traffic)


QUIET = Difficulty(traffic=TrafficParams(vessels=0), path_length_m=(500.0, 3000.0), route='clearance')


def test_pool_draws_a_seed_also_without_traffic():
    pool = ScenarioPool(QUIET, 1, seed=0)
    seeds = [pool.draw(rng).seed for rng in [np.random.default_rng(1)] * 20]
    assert len(set(seeds)) == 20
    assert pool.draw(np.random.default_rng(1)).seed == seeds[0]


def test_pool_takes_the_seed_of_its_traffic(pool):
    scenario = pool.draw(np.random.default_rng(1))
    assert scenario.seed == scenario.traffic.seed


def test_pool_reports_its_progress():
    seen = []
    ScenarioPool(QUIET, 2, seed=0, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]


def test_chart_with_berths_is_sailed_between_them(harbour_difficulty):
    berths = np.array([[200.0, 0.0, 0.0], [2400.0, 0.0, 0.0], [1300.0, 190.0, 0.0]])
    chart = Harbour('canal', box(0, -200, 2600, 200), berths=berths)
    scenario = chart_scenario(chart, harbour_difficulty, 1)
    ends = {scenario.start[:2], scenario.goal}
    assert all(min(np.hypot(*(np.array(end) - b[:2])) for b in berths) < 200.0 for end in ends)
    assert same(scenario, chart_scenario(chart, harbour_difficulty, 1))
    assert scenario.harbour is chart


def test_chart_without_berths_and_small_water_still_gives_a_scenario(harbour_difficulty):
    pond = Harbour('pond', box(0, 0, 700, 500))
    scenario = chart_scenario(pond, harbour_difficulty, 0)
    assert pond.contains(scenario.path).all()
    assert len(scenario.traffic) <= 6


def test_chart_without_room_is_refused(harbour_difficulty):
    ditch = Harbour('ditch', box(0, 0, 3000, 20))
    with pytest.raises(ScenarioError, match='ditch'):
        chart_scenario(ditch, harbour_difficulty, 0)


@pytest.mark.parametrize('name', VESSELS)
def test_presets_reach_five_metres_per_second(name):
    vessel = load_vessel(name)
    assert vessel.name == name
    assert vessel.speed_max_mps == pytest.approx(5.0, rel=1e-3)
    if not vessel.paper_literal:
        diameter = 2.0 / (vessel.turn_gain * vessel.rudder_max_rad)
        assert 2.9 <= diameter <= 4.0
        assert vessel.thrust_min_n == pytest.approx(-0.4 * vessel.thrust_max_n)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('vesel: cemt_iv', "unknown key 'vesel'; did you mean 'vessel'"),
        ('traffic: {vessels: many}', "traffic: vessels: expected int, got 'many'"),
        ('port: {layout: islands}', "port: layout: 'islands' is not one of sections, basins"),
        ('traffic: {speed_mps: [5.0, 1.0]}', 'traffic: speed_mps'),
        ('path_length_m: [100.0]', 'path_length_m: expected 2 values, got 1'),
        ('goal_radius_m: -1.0', 'goal_radius_m = -1.0 is outside'),
    ],
)
def test_bad_difficulty_names_file_and_key(tmp_path, text, message):
    file = tmp_path / 'own.yaml'
    file.write_text(text)
    with pytest.raises(ParamError) as caught:
        load_difficulty(file)
    assert str(file) in str(caught.value)
    assert message in str(caught.value)


def test_own_difficulty_overrides_only_what_it_names(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('traffic: {vessels: 2, arrival: vanish}\nport: {layout: sections}\n')
    difficulty = _clearance(str(file))
    assert difficulty.name == 'own'
    assert difficulty.port == PortParams(layout='sections')
    assert difficulty.traffic.vessels == 2
    assert make_scenario(difficulty, 1).traffic.arrival is Arrival.VANISH


def test_unknown_names_list_what_there_is():
    with pytest.raises(ParamError, match=r'paper\.yaml'):
        load_difficulty('papre')
    with pytest.raises(ParamError, match=r'cemt_va\.yaml'):
        load_vessel('tanker')


def test_vessel_file_says_all_that_no_two_hulls_have_alike(tmp_path):
    file = tmp_path / 'tug.yaml'
    values = {key: getattr(VesselParams(), key) for key in OF_A_HULL} | {'length_m': 30.0, 'beam_m': 11.0}
    file.write_text(yaml.safe_dump(values))
    assert load_vessel(file) == VesselParams(name='tug', length_m=30.0, beam_m=11.0)
    del values['mass_kg'], values['thrust_min_n']
    file.write_text(yaml.safe_dump(values))
    with pytest.raises(ParamError, match=r'tug\.yaml: mass_kg, thrust_min_n: missing'):
        load_vessel(file)


def test_rrt_star_changes_the_path_alone():
    difficulty = load_difficulty('paper')
    planned, cleared = make_scenario(difficulty, 3), make_scenario(_clearance('paper'), 3)
    assert difficulty.route == 'rrt_star'
    assert same(dataclasses.replace(planned, path=cleared.path), cleared)
    assert not np.array_equal(planned.path, cleared.path)
    grid = planned.harbour.clearance(10.0, buoys='charted')
    assert least_clearance(grid, planned.path) >= difficulty.path.least_m - 5.0
    assert np.array_equal(planned.path, make_scenario(difficulty, 3).path)


def test_a_port_and_its_chart_file_have_the_same_walls(tmp_path):
    harbour = make_scenario(_clearance('paper'), 1).harbour
    write_geojson(harbour, tmp_path / 'chart.geojson')
    written, made = (
        {tuple(wall) for wall in np.round(h.walls, 6)}
        for h in (read_chart(tmp_path / 'chart.geojson'), harbour)
    )
    assert written == made
