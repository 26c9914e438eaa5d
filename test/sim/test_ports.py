import itertools

import numpy as np
import pytest
import shapely
from scipy import stats

from portnav_ros.params import ParamError
from portnav_ros.planning.clearance_route import RouteCost, clearance_field, reachable
from portnav_ros.sim.ports import GRID_M, PortParams, basin_docks, make_port, section_docks
from portnav_ros.sim.scenario import ScenarioError

SEEDS = range(12)
LAYOUTS = ('sections', 'basins')


def port(layout, seed, **params):
    return make_port(PortParams(layout=layout, **params), np.random.default_rng(seed))


def draw_sections(count):
    """Lengths, centres and widths of the first section of each of ``count`` ports."""
    rng = np.random.default_rng(1)
    bounds = [section_docks(PortParams(), rng)[i].bounds for _ in range(count) for i in range(5)]
    x_min, y_min, x_max, y_max = np.array(bounds).T
    return x_max - x_min, 0.5 * (y_min + y_max), y_max - y_min


def test_marginals_of_the_sections_are_the_papers_uniform_draws():
    lengths, centres, widths = draw_sections(400)
    for values, low, high in ((lengths, 300, 900), (centres, -600, 600), (widths, 300, 900)):
        assert stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 0.01


def test_connectors_span_both_intervals_at_each_joint():
    docks = section_docks(PortParams(), np.random.default_rng(3))
    sections, connectors = docks[:5], docks[5:]
    assert len(connectors) == 4
    for left, right, connector in zip(sections[:-1], sections[1:], connectors, strict=True):
        x_min, y_min, x_max, y_max = connector.bounds
        assert x_max - x_min == pytest.approx(100.0)
        assert 0.5 * (x_min + x_max) == pytest.approx(left.bounds[2])
        assert y_min == min(left.bounds[1], right.bounds[1])
        assert y_max == max(left.bounds[3], right.bounds[3])


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('layout', LAYOUTS)
def test_every_port_is_connected_water_with_its_berths_off_the_quays(layout, seed):
    harbour = port(layout, seed)
    assert harbour.water.geom_type == 'Polygon'
    assert harbour.water.is_valid
    assert len(harbour.berths) == 10
    assert harbour.contains(harbour.berths[:, :2]).all()
    quays = harbour.water.boundary
    for x, y in harbour.berths[:, :2]:
        assert quays.distance(shapely.Point(x, y)) >= 80.0 - GRID_M
    apart = np.hypot(*(harbour.berths[:, None, :2] - harbour.berths[None, :, :2]).T)
    assert apart[~np.eye(10, dtype=bool)].min() >= 220.0 - 1e-6


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('layout', LAYOUTS)
def test_buoys_are_uncharted_in_open_water_and_seal_nothing(layout, seed):
    harbour = port(layout, seed)
    buoys = harbour.buoys
    assert 4 <= len(buoys) <= 10
    assert not harbour.charted.any()
    assert harbour.contains(buoys[:, :2]).all()
    quays = harbour.water.boundary
    assert min(quays.distance(shapely.Point(x, y)) for x, y, _ in buoys) >= 25.0
    to_berths = np.hypot(*(buoys[:, None, :2] - harbour.berths[None, :, :2]).T)
    assert to_berths.min() >= 120.0
    grid = harbour.clearance(GRID_M, buoys='all')
    goal = tuple(harbour.berths[0, :2])
    field = clearance_field(grid, goal, RouteCost(25.0, weight=0.0))
    assert all(reachable(grid, field, tuple(xy)) for xy in harbour.berths[:, :2])


def test_basins_lie_on_alternating_sides_of_the_canal():
    params = PortParams(canal_bend_rad=(0.0, 0.0))
    *basins, canal = basin_docks(params, np.random.default_rng(5))
    sides = [np.sign(basin.difference(canal).centroid.y) for basin in basins]
    assert all(a == -b for a, b in itertools.pairwise(sides))
    assert all(basin.intersects(canal) for basin in basins)
    assert 6 <= len(basins) <= 8


def test_a_port_is_a_function_of_its_generator():
    for layout in LAYOUTS:
        a, b, other = port(layout, 3), port(layout, 3), port(layout, 4)
        assert a.water.equals_exact(b.water, 0.0)
        assert np.array_equal(a.berths, b.berths)
        assert np.array_equal(a.buoys, b.buoys)
        assert not a.water.equals_exact(other.water, 1.0)


def test_port_without_room_says_what_to_change():
    with pytest.raises(ScenarioError, match='lower berths, berth_spacing_m or berth_clearance_m'):
        port('basins', 0, berths=40)
    with pytest.raises(ScenarioError, match='lower berth_clearance_m'):
        port('basins', 0, berth_clearance_m=450.0)
    with pytest.raises(ScenarioError, match='lower buoys, buoy_spacing_m'):
        port('basins', 0, buoys=(60, 60), buoy_spacing_m=900.0)


@pytest.mark.parametrize(
    'bad',
    [
        {'width_m': (900.0, 300.0)},
        {'basins': (-1, 2)},
        {'sections': 0},
        {'basin_skew_rad': (0.2, -0.2)},
        {'canal_bend_rad': (np.nan, np.nan)},
        {'canal_width_m': (300.0, np.inf)},
        {'centre_offset_m': (-np.inf, 0.0)},
        {'basin_depth_m': (550.0, np.nan)},
    ],
)
def test_bad_parameters_are_refused(bad):
    with pytest.raises(ParamError, match=next(iter(bad))):
        PortParams(**bad)
