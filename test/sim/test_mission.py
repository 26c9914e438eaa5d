import numpy as np
import pytest
from shapely.geometry import LineString, box

from portnav_ros.harbour import Harbour
from portnav_ros.sim import mission
from portnav_ros.sim.difficulty import load_difficulty
from portnav_ros.sim.mission import chart_nodes, grid_resolution
from portnav_ros.sim.ports import GRID_M
from portnav_ros.sim.scenario import ScenarioError


def diagonal_canal() -> Harbour:
    """25 km long and 110 m wide, in a bounding box of 316 square kilometres."""
    return Harbour('canal', LineString([(0, 0), (17_700, 17_700)]).buffer(55.0, cap_style='flat'))


def test_a_long_diagonal_canal_has_places_to_sail_between():
    nodes = chart_nodes(diagonal_canal(), load_difficulty('easy'), np.random.default_rng(0))
    assert len(nodes) >= 2


def test_cells_grow_with_the_water_and_with_its_bounding_box():
    assert grid_resolution(Harbour('port', box(0, 0, 5000, 5000))) == GRID_M
    assert grid_resolution(diagonal_canal()) == GRID_M
    assert grid_resolution(Harbour('lake', box(0, 0, 40_000, 40_000))) == pytest.approx(80.0)
    apart = Harbour('ponds', box(0, 0, 100, 100) | box(79_900, 79_900, 80_000, 80_000))
    assert grid_resolution(apart) == pytest.approx(40.0)


def test_water_lost_in_coarse_cells_is_told_with_their_size(monkeypatch):
    monkeypatch.setattr(mission, 'MAX_CELLS', 250_000)
    with pytest.raises(ScenarioError, match=r'cells of 35\.6 m, not 10 m, .*cut it to the part to sail in'):
        chart_nodes(diagonal_canal(), load_difficulty('easy'), np.random.default_rng(0))
