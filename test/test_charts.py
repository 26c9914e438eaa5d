"""GeoJSON charts: what is read, what comes back, and what is refused with which words."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.ndimage import label
from shapely.geometry import MultiPolygon, Polygon, box

from portnav_ros.charts import local_projection, read_chart, write_geojson
from portnav_ros.harbour import ChartError, ChartWarning, Harbour

CHARTS = Path(__file__).parents[1] / 'config' / 'charts'
SQUARE = [[0.0, 0.0], [400.0, 0.0], [400.0, 300.0], [0.0, 300.0], [0.0, 0.0]]


def feature(kind, coordinates, geometry='Polygon', **properties):
    return {
        'type': 'Feature',
        'properties': {'kind': kind, **properties},
        'geometry': {'type': geometry, 'coordinates': coordinates},
    }


def point(kind, x, y, **properties):
    return feature(kind, [x, y], 'Point', **properties)


WATER = feature('water', [SQUARE])


def rectangle(kind, x0, y0, x1, y1):
    return feature(kind, [[[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]])


def read(tmp_path, *features, units='m', **members):
    path = tmp_path / 'port.geojson'
    portnav = {'units': units} | members.pop('portnav', {})
    path.write_text(
        json.dumps({'type': 'FeatureCollection', 'portnav': portnav, 'features': features, **members})
    )
    return read_chart(path)


def test_land_is_cut_out_of_the_union_of_water(tmp_path):
    harbour = read(
        tmp_path,
        rectangle('water', 0, 0, 100, 50),
        rectangle('water', 100, 0, 200, 50),
        rectangle('land', 40, 20, 60, 30),
        rectangle('land', 180, -10, 210, 60),
    )
    assert harbour.water.equals(box(0, 0, 180, 50).difference(box(40, 20, 60, 30)))
    assert (harbour.name, harbour.origin) == ('port', None)


def test_parts_that_overlap_inside_a_multipolygon_are_joined(tmp_path):
    parts = [box(0, 0, 60, 40), box(50, 0, 100, 40)]
    member = feature('water', [[list(part.exterior.coords)] for part in parts], 'MultiPolygon')
    assert read(tmp_path, member).water.equals(box(0, 0, 100, 40))


def test_buoys_and_berths_take_their_properties(tmp_path):
    harbour = read(
        tmp_path,
        WATER,
        point('buoy', 50, 60),
        point('buoy', 70, 80, radius_m=2, charted=False),
        point('berth', 100, 30, yaw_rad=0.5),
        point('berth', 150, 30, heading_deg=90),
        point('berth', 200, 30, heading_deg=225.0),
        name='Named',
    )
    np.testing.assert_array_equal(harbour.buoys, [[50, 60, 1], [70, 80, 2]])
    np.testing.assert_array_equal(harbour.charted, [True, False])
    np.testing.assert_allclose(harbour.berths[:, 2], [0.5, 0.0, -0.75 * math.pi], atol=1e-12)
    assert harbour.name == 'Named'


def test_a_berth_needs_no_heading(tmp_path):
    harbour = read(tmp_path, WATER, point('berth', 100, 30))
    np.testing.assert_array_equal(harbour.berths, [[100, 30, 0]])


def test_an_empty_cell_of_an_attribute_table_is_no_property(tmp_path):
    empty = {'radius_m': None, 'charted': None, 'yaw_rad': None}
    harbour = read(
        tmp_path, WATER, point('buoy', 5, 6, **empty), point('berth', 7, 8, **empty, heading_deg=0)
    )
    np.testing.assert_array_equal(harbour.buoys, [[5, 6, 1]])
    assert harbour.berths[0, 2] == pytest.approx(math.pi / 2.0)


def test_degrees_become_local_metres_east_and_north(tmp_path):
    ring = [[4.0, 51.0], [4.02, 51.0], [4.02, 51.01], [4.0, 51.01], [4.0, 51.0]]
    harbour = read(tmp_path, feature('water', [ring]), point('buoy', 4.01, 51.005), units='deg')
    assert harbour.origin == (51.005, 4.01)
    np.testing.assert_allclose(harbour.buoys[0, :2], 0.0, atol=1e-6)
    x_min, y_min, x_max, y_max = harbour.bounds
    east_m_per_deg = (
        math.pi / 180.0 * 6378137.0 / math.sqrt(1.0 - 0.00669438 * math.sin(math.radians(51.005)) ** 2)
    )
    assert x_max - x_min == pytest.approx(0.02 * east_m_per_deg * math.cos(math.radians(51.0)), abs=0.1)
    assert y_max - y_min == pytest.approx(1112.6, abs=0.5)
    assert y_min < 0.0 < y_max


def test_the_origin_can_be_given(tmp_path):
    ring = [[4.0, 51.0], [4.02, 51.0], [4.02, 51.01], [4.0, 51.01], [4.0, 51.0]]
    options = {'origin_lat_lon_deg': [51.0, 4.0]}
    harbour = read(tmp_path, feature('water', [ring]), units='deg', portnav=options)
    assert harbour.origin == (51.0, 4.0)
    assert min(np.hypot(*harbour.walls[:, :2].T)) < 0.02


def test_the_projection_keeps_lengths_and_goes_back():
    origin = (51.9, 2.95)
    points = np.random.default_rng(0).uniform((2.92, 51.88), (2.98, 51.92), (50, 2))
    metres = local_projection(origin)(points)
    np.testing.assert_allclose(local_projection(origin, inverse=True)(metres), points, atol=1e-9)


def random_harbour(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 30))
    radius = rng.uniform(300.0, 600.0, 30)
    ring = Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    basin = ring.union(shapely.Point(0, 0).buffer(250.0)).difference(box(-40, -30, 35, 45))
    xy = rng.uniform(80.0, 150.0, (9, 2))
    return Harbour(
        f'random {seed}',
        MultiPolygon([basin, box(2000, 0, 2100, 80)]) if seed % 2 else basin,
        buoys=np.column_stack([xy[:4], rng.uniform(0.5, 3.0, 4)]),
        berths=np.column_stack([xy[4:], rng.uniform(-np.pi, np.pi, 5)]),
        charted=rng.random(4) < 0.5,
        origin=(51.2, 4.3) if seed % 3 else None,
    )


@pytest.mark.filterwarnings('ignore::portnav_ros.harbour.ChartWarning')
@pytest.mark.parametrize('units', ['m', 'deg'])
@pytest.mark.parametrize('seed', [1, 2, 4, 5])
def test_what_is_written_is_read_back(tmp_path, seed, units):
    harbour = random_harbour(seed)
    write_geojson(harbour, tmp_path / 'a.geojson', units)
    again = read_chart(tmp_path / 'a.geojson')
    assert again.name == harbour.name
    assert again.origin == harbour.origin
    assert again.water.symmetric_difference(harbour.water).area < 0.02 * harbour.water.length
    assert len(again.walls) == len(harbour.walls)
    np.testing.assert_allclose(again.buoys, harbour.buoys, atol=0.02)
    np.testing.assert_allclose(again.berths, harbour.berths, atol=0.02)
    np.testing.assert_array_equal(again.charted, harbour.charted)


def test_reading_and_writing_settle_at_once(tmp_path):
    write_geojson(random_harbour(4), tmp_path / 'a.geojson')
    write_geojson(read_chart(tmp_path / 'a.geojson'), tmp_path / 'b.geojson')
    write_geojson(read_chart(tmp_path / 'b.geojson'), tmp_path / 'c.geojson')
    assert (tmp_path / 'c.geojson').read_text() == (tmp_path / 'b.geojson').read_text()


def test_degrees_cannot_be_written_without_an_origin(tmp_path):
    with pytest.raises(ChartError, match='no origin'):
        write_geojson(random_harbour(0), tmp_path / 'a.geojson', 'deg')


BOWTIE = [[0, 0], [10, 10], [10, 0], [0, 10], [0, 0]]
BAD_FEATURES = [
    (feature('water', [BOWTIE]), 'feature 1: the polygon crosses or touches itself .*Fix geometries'),
    (feature('land', [SQUARE[:-1]]), 'feature 1, ring 0: not closed; repeat the first position'),
    (
        feature('land', [SQUARE, [[1, 1], [2, 2], [1, 1]]]),
        'feature 1, ring 1: 3 positions; a ring needs at least 4',
    ),
    (
        feature('land', [10, 20], 'Point'),
        'kind land needs a geometry of type Polygon or MultiPolygon, got Point',
    ),
    (feature('buoy', [SQUARE]), 'kind buoy needs a geometry of type Point, got Polygon'),
    (
        {'type': 'Feature', 'properties': {}, 'geometry': None},
        'property "kind" is missing; give one of water',
    ),
    ({'type': 'Feature', 'properties': [], 'geometry': None}, 'property "kind" is missing'),
    ({'type': 'Feature', 'properties': 'x', 'geometry': None}, '"properties" must be an object'),
    ({'type': 'Feature', 'properties': {'kind': 'buoy'}, 'geometry': None}, 'type Point, got None'),
    ({'type': 'Polygon'}, 'feature 1: expected a GeoJSON object of type Feature'),
    (feature('bouy', [1, 2], 'Point'), "kind 'bouy' is not one of .*did you mean 'buoy'"),
    (feature(['water'], [SQUARE]), 'is not one of water, land'),
    (point('buoy', math.nan, 2), 'position 0 is not finite'),
    (point('buoy', 10**400, 2), 'each position must be two numbers'),
    (point('buoy', '10', 2), 'each position must be two numbers'),
    (feature('buoy', [1], 'Point'), 'each position must be two numbers'),
    (feature('land', [[[0, 0], [1], [1, 1], [0, 0]]]), 'each position must be two numbers'),
    (feature('land', []), 'the geometry has no coordinates'),
    (feature('land', [[]]), 'each position must be two numbers'),
    (point('buoy', 50, 50, radius_m='2'), r"radius_m = '2' must be a finite number"),
    (point('buoy', 50, 50, radius_m=0), r'radius_m = 0.0 is outside \(0, 100\]'),
    (point('buoy', 50, 50, charted='no'), "charted = 'no' must be true or false"),
    (point('berth', 50, 50, yaw_rad=0.1, heading_deg=1), 'a berth has either yaw_rad .* or heading_deg'),
    (point('berth', 50, 50, yaw_rad=math.inf), 'yaw_rad = inf must be a finite number'),
    (point('berth', 50, 50, yaw_rad=10**400), 'yaw_rad = 1000.* must be a finite number'),
    (point('berth', 450, 50, yaw_rad=0), 'feature 1: this berth lies on land or off the chart'),
    (point('buoy', 450, 50) | {'id': 'G3'}, r"feature 1 \('G3'\): this buoy lies on land"),
    (point('buoy', 5e6, 50), 'coordinates up to 5000000 m from the origin .*EPSG:4326'),
    (rectangle('land', -10, -10, 500, 500), 'no water is left once the land is cut out'),
]


@pytest.mark.parametrize(('member', 'message'), BAD_FEATURES, ids=range(len(BAD_FEATURES)))
def test_a_bad_feature_is_named_with_its_mend(tmp_path, member, message):
    with pytest.raises(ChartError, match=message) as caught:
        read(tmp_path, WATER, member)
    assert str(tmp_path / 'port.geojson') in str(caught.value)


LONLAT_RING = [[4.0, 51.0], [4.02, 51.0], [4.02, 51.01], [4.0, 51.01], [4.0, 51.0]]
FAR_RING = [[51.0, 4.0], [51.0, 4.02], [51.01, 4.02], [51.01, 4.0], [51.0, 4.0]]


@pytest.mark.parametrize(
    ('members', 'message'),
    [
        ([WATER], 'is no longitude and latitude in degrees; longitude comes first'),
        ([feature('water', [LONLAT_RING]), feature('land', [FAR_RING])], 'latitude and longitude swapped'),
    ],
)
def test_degrees_that_are_none_are_refused(tmp_path, members, message):
    with pytest.raises(ChartError, match=message):
        read(tmp_path, *members, units='deg')


def test_another_crs_is_refused(tmp_path):
    crs = {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:EPSG::28992'}}
    with pytest.raises(ChartError, match=r'28992.*export in EPSG:4326'):
        read(tmp_path, feature('water', [LONLAT_RING]), units='deg', crs=crs)
    crs['properties']['name'] = 'urn:ogc:def:crs:OGC:1.3:CRS84'
    assert read(tmp_path, feature('water', [LONLAT_RING]), units='deg', crs=crs).origin == (51.005, 4.01)


@pytest.mark.parametrize(
    ('portnav', 'message'),
    [
        ({'unit': 'm'}, "unknown key 'unit'; did you mean 'units'"),
        ({'units': 'km'}, "'km' is not one of m, deg"),
        ({'simplify_m': -1.0}, r'simplify_m = -1.0 is outside'),
        ({'origin_lat_lon_deg': [200.0, 4.0]}, 'latitude first'),
        ({'origin_lat_lon_deg': [51.0]}, 'expected 2 values'),
    ],
)
def test_a_bad_option_is_named(tmp_path, portnav, message):
    with pytest.raises(ChartError, match=message):
        read(tmp_path, WATER, portnav=portnav)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('{"type": ', 'not valid JSON: .*line 1'),
        ('[]', 'type FeatureCollection'),
        ('{"type": "FeatureCollection"}', '"features" must be a list'),
        ('{"type": "FeatureCollection", "features": []}', 'at least one feature of kind water'),
        ('{"type": "FeatureCollection", "features": [1], "portnav": 1}', '"portnav" must be an object'),
        ('{"type": "FeatureCollection", "features": [1]}', 'feature 0: expected a GeoJSON object'),
    ],
)
def test_a_file_that_is_no_chart_is_refused(tmp_path, text, message):
    path = tmp_path / 'port.geojson'
    path.write_text(text)
    with pytest.raises(ChartError, match=message):
        read_chart(path)


def test_a_chart_without_water_a_missing_file_and_a_strange_suffix(tmp_path):
    with pytest.raises(ChartError, match='no feature of kind water; draw one, or a rectangle'):
        read(tmp_path, rectangle('land', 0, 0, 10, 10))
    with pytest.raises(ChartError, match=r'gone\.geojson: cannot be read \(No such file'):
        read_chart(tmp_path / 'gone.geojson')
    with pytest.raises(ChartError, match='unknown kind of chart'):
        read_chart(tmp_path / 'port.shp')


def test_water_in_parts_is_kept_with_a_warning(tmp_path):
    with pytest.warns(ChartWarning, match='falls into 2 parts'):
        harbour = read(tmp_path, rectangle('water', 0, 0, 10, 10), rectangle('water', 20, 0, 30, 10))
    assert harbour.water.area == 200.0


def coastline(vertices):
    """A closed ring of so many vertices with 10 cm of digitising noise."""
    angle = np.linspace(0.0, 2.0 * np.pi, vertices, endpoint=False)
    radius = 1500.0 * (1.0 + 0.1 * np.sin(7.0 * angle))
    radius += np.random.default_rng(0).uniform(-0.05, 0.05, vertices)
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]).tolist()
    return [*ring, ring[0]]


def test_a_port_of_100000_vertices_is_refused_or_simplified_as_told(tmp_path):
    member = feature('water', [coastline(100_000)])
    with pytest.raises(
        ChartError, match=r'port\.geojson: port: 100000 quay edges, at most 20000 can be sensed.*simplify_m'
    ):
        read(tmp_path, member)
    harbour = read(tmp_path, member, portnav={'simplify_m': 0.5})
    assert 50 < len(harbour.walls) < 1000
    vertices = shapely.points(member['geometry']['coordinates'][0][::20])
    assert shapely.distance(harbour.water.boundary, vertices).max() < 0.51


@pytest.mark.parametrize(('name', 'berths', 'buoys'), [('river_docks', 15, 8), ('example_lonlat', 6, 4)])
def test_every_berth_of_a_shipped_chart_is_safe_and_within_reach(name, berths, buoys):
    harbour = read_chart(CHARTS / f'{name}.geojson')
    assert len(harbour.berths) >= berths
    assert len(harbour.buoys) == buoys
    quay_m = shapely.distance(harbour.water.boundary, shapely.points(harbour.berths[:, :2]))
    assert quay_m.min() >= 20.0
    grid = harbour.clearance(2.0, 'all')
    regions, _ = label(grid.distance >= 20.0)
    columns = ((harbour.berths[:, 0] - grid.x0_m) / grid.resolution_m).astype(int)
    rows = ((harbour.berths[:, 1] - grid.y0_m) / grid.resolution_m).astype(int)
    assert len(set(regions[rows, columns])) == 1
    assert regions[rows[0], columns[0]] > 0


def test_the_river_docks_have_a_port_s_proportions():
    harbour = read_chart(CHARTS / 'river_docks.geojson')
    x_min, y_min, x_max, y_max = harbour.bounds
    assert 3500.0 < x_max - x_min < 4500.0
    assert 2000.0 < y_max - y_min < 3500.0
    assert 100 <= len(harbour.walls) <= 250
    assert harbour.charted.sum() == 7


def test_the_example_of_the_documentation_is_a_chart(tmp_path):
    text = (CHARTS.parents[1] / 'docs' / 'charts.md').read_text(encoding='utf-8')
    path = tmp_path / 'example.geojson'
    path.write_text(text.split('```json\n')[1].split('```')[0])
    harbour = read_chart(path)
    assert (harbour.name, len(harbour.buoys), len(harbour.berths)) == ('My port', 1, 1)
    assert harbour.water.area == 900.0 * 200.0 - 20.0 * 50.0
