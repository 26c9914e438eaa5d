"""The harbour's geometry against closed forms and brute-force distances."""

import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPolygon, Polygon, box

from portnav_ros.harbour import MAX_WALLS, ChartError, Harbour, clearance_at


def ragged_ring(vertices, seed, radius_m=400.0):
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2.0 * np.pi, vertices, endpoint=False)
    radius = radius_m * (1.0 + 0.2 * np.sin(5.0 * angle) + rng.uniform(-0.05, 0.05, vertices))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def islands(seed):
    return Polygon(
        ragged_ring(40, seed), [ragged_ring(9, seed + 1, 60.0)[::-1], box(150, 0, 180, 90).exterior]
    )


def sample(harbour, count, seed=0):
    x_min, y_min, x_max, y_max = harbour.bounds
    return np.random.default_rng(seed).uniform((x_min, y_min), (x_max, y_max), (count, 2))


@pytest.mark.parametrize('seed', range(4))
def test_water_lies_on_the_left_of_every_wall(seed):
    water = MultiPolygon([islands(seed), box(1000, 0, 1100, 80)])
    harbour = Harbour('two basins', shapely.reverse(water) if seed % 2 else water)
    start, end = harbour.walls[:, :2], harbour.walls[:, 2:]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    left = np.column_stack([-along[:, 1], along[:, 0]])
    middle = 0.5 * (start + end)
    assert harbour.contains(middle + 0.01 * left).all()
    assert not harbour.contains(middle - 0.01 * left).any()
    assert np.hypot(*(end - start).T).sum() == pytest.approx(water.length)


@pytest.mark.parametrize('resolution_m', [1.5, 4.0])
@pytest.mark.parametrize('seed', range(3))
def test_clearance_agrees_with_brute_force_within_a_cell(seed, resolution_m):
    harbour = Harbour('islands', islands(seed))
    grid = harbour.clearance(resolution_m)
    points = sample(harbour, 2000, seed)
    inside = harbour.contains(points)
    truth = np.where(inside, shapely.distance(harbour.water.boundary, shapely.points(points)), 0.0)
    found = np.array([clearance_at(grid, x, y) for x, y in points])
    assert np.abs(found - truth).max() < resolution_m
    assert np.abs(found - truth).mean() < 0.05 * resolution_m


def test_clearance_in_a_box_is_exact_at_cell_centres():
    grid = Harbour('box', box(0.0, 0.0, 103.0, 41.0)).clearance(2.0)
    rows, columns = np.indices(grid.distance.shape)
    x = grid.x0_m + (columns + 0.5) * grid.resolution_m
    y = grid.y0_m + (rows + 0.5) * grid.resolution_m
    truth = np.minimum.reduce([x, 103.0 - x, y, 41.0 - y])
    np.testing.assert_allclose(grid.distance, np.maximum(truth, 0.0), atol=1e-4)


def test_a_jetty_thinner_than_a_cell_still_counts():
    jetty = box(48.6, -1.0, 49.0, 60.0)
    grid = Harbour('jetty', box(0.0, 0.0, 100.0, 100.0).difference(jetty)).clearance(5.0)
    assert clearance_at(grid, 48.8, 30.0) < 5.0
    assert clearance_at(grid, 20.0, 30.0) == pytest.approx(20.0, abs=0.1)


def test_clearance_is_zero_outside_the_grid():
    grid = Harbour('box', box(0.0, 0.0, 50.0, 50.0)).clearance(5.0)
    assert clearance_at(grid, -1000.0, 20.0) == 0.0
    assert clearance_at(grid, 20.0, 1e9) == 0.0


def test_buoys_count_as_asked():
    buoys = np.array([[100.0, 100.0, 3.0], [300.0, 100.0, 3.0]])
    harbour = Harbour('buoys', box(0.0, 0.0, 400.0, 200.0), buoys, charted=np.array([True, False]))
    for kind, first, second in (('none', 100.0, 100.0), ('charted', 7.0, 100.0), ('all', 7.0, 7.0)):
        grid = harbour.clearance(2.0, kind)
        assert clearance_at(grid, 100.0, 110.0) == pytest.approx(min(first, 90.0), abs=0.3)
        assert clearance_at(grid, 300.0, 110.0) == pytest.approx(min(second, 90.0), abs=0.3)
    assert clearance_at(harbour.clearance(2.0, 'all'), 100.0, 100.0) == 0.0


def test_contains_tells_water_from_land():
    harbour = Harbour('ring', box(0, 0, 90, 90).difference(box(30, 30, 60, 60)))
    assert harbour.contains(np.array([[10.0, 10.0], [45.0, 45.0], [-5.0, 10.0]])).tolist() == [
        True,
        False,
        False,
    ]


def test_as_many_walls_as_the_limit_are_fine_and_one_more_is_refused():
    harbour = Harbour('large', Polygon(ragged_ring(MAX_WALLS, 0, 1500.0)))
    grid = harbour.clearance(5.0)
    assert clearance_at(grid, 0.0, 0.0) > 500.0
    with pytest.raises(ChartError, match=r'too fine: 20001 quay edges, at most 20000.*simplify_m'):
        Harbour('too fine', Polygon(ragged_ring(MAX_WALLS + 1, 0)))


@pytest.mark.parametrize(
    ('fields', 'message'),
    [
        ({'water': Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])}, 'Self-intersection'),
        ({'water': Polygon()}, 'empty'),
        ({'buoys': np.zeros((2, 3))}, 'charted has 0 flags for 2 buoys'),
        ({'buoys': np.zeros((2, 2)), 'charted': np.ones(2, bool)}, 'buoys must be rows of three'),
        ({'berths': np.array([[1.0, np.nan, 0.0]])}, 'berths must be rows of three finite'),
    ],
)
def test_a_harbour_that_cannot_be_is_refused(fields, message):
    with pytest.raises(ChartError, match=message):
        Harbour(**({'name': 'bad', 'water': box(0, 0, 10, 10)} | fields))


def test_a_grid_that_would_fill_the_memory_is_refused():
    with pytest.raises(ChartError, match='take larger cells'):
        Harbour('wide', box(0, 0, 1e5, 1e5)).clearance(0.1)
