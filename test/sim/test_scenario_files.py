import numpy as np
import pytest

from portnav_ros.charts import write_geojson
from portnav_ros.params import ParamError
from portnav_ros.planning.clearance_route import least_clearance
from portnav_ros.sim.difficulty import preset_path
from portnav_ros.sim.generator import load_scenario
from portnav_ros.sim.scenario import Arrival, ScenarioError

NAMES = ('head_on', 'crossing', 'overtaking', 'buoy', 'narrows', 'no_traffic')
CANAL = 'water: [[0, -200], [3000, -200], [3000, 200], [0, 200]]\n'
PIER = (
    'water: [[0, -200], [1450, -200], [1450, 100], [1550, 100], [1550, -200], [3000, -200],'
    ' [3000, 200], [0, 200]]\n'
)
ENDS = 'start: [200, 0, 0.0]\ngoal: [2700, 0]\n'


def load_text(tmp_path, text, seed=0):
    file = tmp_path / 'own.yaml'
    file.write_text(text)
    return load_scenario(file, seed)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('seed', [0, 1, 7])
def test_named_scenarios_are_sound(name, seed):
    scenario = load_scenario(name, seed)
    assert (scenario.name, scenario.seed) == (name, seed)
    grid = scenario.harbour.clearance(5.0)
    assert least_clearance(grid, scenario.path) > 0.5 * scenario.vessel.beam_m + 15.0
    assert np.allclose(scenario.path[[0, -1]], [scenario.start[:2], scenario.goal])
    points = scenario.traffic.tracks.points[:, :2].astype(float)
    assert len(scenario.traffic) == 0 or scenario.harbour.contains(points).all()


def test_seeds_vary_the_other_vessel_and_nothing_else():
    a, again, b = (load_scenario('head_on', seed) for seed in (1, 1, 2))
    assert np.array_equal(a.traffic.progress, again.traffic.progress)
    assert np.array_equal(a.traffic.tracks.points, again.traffic.tracks.points)
    assert a.traffic.progress[0] != b.traffic.progress[0]
    assert a.traffic.speed[0] != b.traffic.speed[0]
    assert a.start == b.start
    assert np.array_equal(a.path, b.path)


def test_buoys_of_a_scenario_are_unknown_to_the_planner():
    scenario = load_scenario('buoy')
    assert len(scenario.harbour.buoys) == 3
    assert not scenario.harbour.charted.any()


def test_chart_may_stand_in_for_the_water(tmp_path):
    write_geojson(load_scenario('narrows').harbour, tmp_path / 'chart.geojson')
    scenario = load_text(tmp_path, 'chart: chart.geojson\nstart: [200, 0, 0.0]\ngoal: [3000, 0]\n')
    assert scenario.harbour.water.area == pytest.approx(load_scenario('narrows').harbour.water.area)
    assert scenario.path is not None


def test_vessels_stop_or_vanish_as_told(tmp_path):
    traffic = 'arrival: vanish\ntraffic: [{waypoints: [[2500, 0], [500, 0]], speed_mps: 3}]\n'
    scenario = load_text(tmp_path, CANAL + ENDS + traffic)
    assert scenario.traffic.arrival is Arrival.VANISH
    assert scenario.traffic.speed.tolist() == [3.0]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (CANAL + ENDS + 'gaol: [1, 2]\n', "unknown key 'gaol'; did you mean 'goal'"),
        (CANAL + ENDS + 'vessel: 5\n', 'vessel: expected str, got 5'),
        (CANAL + ENDS + 'traffic: 3\n', 'traffic: expected a list of mappings'),
        (CANAL + ENDS + 'traffic: [{waypoint: []}]\n', "traffic[0]: unknown key 'waypoint'"),
        (CANAL + ENDS + 'traffic: [{waypoints: [[1, 0]]}]\n', 'traffic[0]: waypoints: at least two'),
        (CANAL + ENDS + 'arrival: respawn\n', "arrival: 'respawn' is not one of stop, vanish"),
        (CANAL + 'start: [200, 0, .nan]\ngoal: [2700, 0]\n', 'start: holds a number that is not finite'),
        (CANAL + ENDS + 'path: [[.nan, 0]]\n', 'path: holds a number that is not finite'),
        (CANAL + ENDS + 'buoys: [[1000, .inf, 2]]\n', 'buoys: holds a number that is not finite'),
        (CANAL + ENDS + 'jitter: {buoys_m: [.inf, 0]}\n', 'jitter: buoys_m: holds a number'),
        (CANAL + ENDS + 'traffic: [{waypoints: [[1, 0], [.nan, 0]]}]\n', 'traffic[0]: waypoints: holds'),
        (CANAL + ENDS + 'buoys: [[900, 0, 2], [1000, 0, -50]]\n', 'buoys[1]: radius -50.0 m is outside'),
        (CANAL + ENDS + 'buoys: [[1000, 0, 0]]\n', 'buoys[0]: radius 0.0 m is outside'),
    ],
)
def test_bad_keys_name_file_and_key(tmp_path, text, message):
    with pytest.raises(ParamError) as caught:
        load_text(tmp_path, text)
    assert str(tmp_path / 'own.yaml') in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (CANAL, 'start and goal are missing'),
        (ENDS, 'give either water'),
        ('water: [[0, 0], [1, 1]]\n' + ENDS, 'at least three corners'),
        (CANAL + 'start: [200, 900, 0.0]\ngoal: [2700, 0]\n', 'lies on land; move it onto the water'),
        (CANAL + ENDS + 'traffic: [{waypoints: [[1, 0], [1, 999]]}]\n', 'traffic[0]: waypoints'),
        (CANAL + 'start: [200, 0, 0.0]\ngoal: [200, 0]\n', 'goal: (200.0, 0.0) is 0.0 m from the start'),
        (CANAL + 'start: [200, 0, 0.0]\ngoal: [250, 0]\n', 'or lower goal_radius_m'),
        (CANAL + ENDS + 'path: [[1500, 5000]]\n', 'path: a leg crosses land at'),
        (PIER + ENDS + 'path: [[1000, 0], [2000, 0]]\n', 'path: a leg crosses land at (1500.0, '),
        (
            CANAL + ENDS + 'buoys: [[1000, 0, 5], [1200, 9000, 5]]\n',
            'buoys[1]: (1200.0, 9000.0) lies on land',
        ),
        (
            CANAL + ENDS + 'buoys: [[1000, 150, 5]]\njitter: {buoys_m: [0, 60]}\n',
            'move the buoy onto the water or lower jitter: buoys_m',
        ),
        (
            PIER + ENDS + 'path: [[1500, 150]]\ntraffic: [{waypoints: [[2500, 0], [500, 0]]}]\n',
            'traffic[0]: waypoints: the track crosses land at (1500.0, ',
        ),
        (CANAL + ENDS + 'route: {least_m: 250.0}\n', 'give path or lower route: least_m'),
    ],
)
def test_scenarios_that_cannot_be_sailed_are_refused(tmp_path, text, message):
    with pytest.raises(ScenarioError) as caught:
        load_text(tmp_path, text)
    assert str(tmp_path / 'own.yaml') in str(caught.value)
    assert message in str(caught.value)


def test_lines_along_a_quay_and_a_moored_vessel_lie_on_water(tmp_path):
    bent = 'water: [[0, -200], [3000, -200], [3000, 200], [1500, 33.3], [0, 200]]\n'
    quay = 'path: [[900, 99.985], [1500, 33.3], [2100, 99.985]]\n'
    moored = 'traffic: [{waypoints: [[1000, -100], [1000, -100]], speed_mps: 0}]\n'
    scenario = load_text(tmp_path, bent + ENDS + quay + moored)
    assert len(scenario.traffic) == 1


@pytest.mark.parametrize('file', sorted(preset_path('scenarios', 'head_on').parent.glob('*.yaml')), ids=str)
def test_every_seed_of_a_shipped_scenario_lies_on_water(file):
    for seed in range(30):
        assert load_scenario(file, seed).seed == seed


def test_unknown_scenario_lists_what_there_is():
    with pytest.raises(ParamError, match=r'head_on\.yaml'):
        load_scenario('headon')
