"""nav2 maps: tracing, round trips and refusals."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate
from shapely.geometry import box

from portnav_ros.charts import read_chart, write_nav2_map
from portnav_ros.harbour import ChartError, ChartWarning, Harbour
from portnav_ros.nav2_map import read_pgm

CHARTS = Path(__file__).parents[1] / 'config' / 'charts'
FREE, UNKNOWN, OCCUPIED = 254, 205, 0


def write(tmp_path, pixels, **keys):
    pixels = np.asarray(pixels, dtype=np.uint8)
    header = f'P5\n# made by a test\n{pixels.shape[1]} {pixels.shape[0]}\n255\n'
    (tmp_path / 'map.pgm').write_bytes(header.encode() + pixels.tobytes())
    values = {
        'image': 'map.pgm',
        'resolution': 2.0,
        'origin': [0.0, 0.0, 0.0],
        'negate': 0,
        'occupied_thresh': 0.65,
        'free_thresh': 0.196,
    } | keys
    path = tmp_path / 'map.yaml'
    path.write_text('\n'.join(f'{key}: {value}' for key, value in values.items() if value is not None))
    return path


def basin(rows=40, columns=60, fill=OCCUPIED):
    pixels = np.full((rows, columns), fill)
    pixels[5:15, 10:50] = FREE
    return pixels


def test_a_rectangle_of_free_cells_becomes_its_rectangle_in_metres(tmp_path):
    harbour = read_chart(write(tmp_path, basin(), origin=[-20.0, 100.0, 0.0]))
    truth = box(-20.0 + 10 * 2.0, 100.0 + 25 * 2.0, -20.0 + 50 * 2.0, 100.0 + 35 * 2.0)
    assert harbour.water.equals(truth)
    assert len(harbour.walls) <= 5


def test_unknown_cells_are_land(tmp_path):
    pixels = basin(fill=UNKNOWN)
    pixels[8:12, 20:30] = UNKNOWN
    harbour = read_chart(write(tmp_path, pixels))
    assert len(harbour.water.interiors) == 1
    assert not harbour.contains(np.array([[50.0, 60.0]]))[0]


def test_negate_turns_black_into_free(tmp_path):
    plain = read_chart(write(tmp_path, basin()))
    for negate in (1, 'true'):
        assert read_chart(write(tmp_path, 255 - basin(), negate=negate)).water.equals(plain.water)


def test_plain_and_16_bit_images_are_read(tmp_path):
    text = tmp_path / 'plain.pgm'
    text.write_text('P2 # comment\n3 2\n# another\n10\n0 5 10\n10 0\n0\n')
    np.testing.assert_array_equal(read_pgm(text), [[0.0, 0.5, 1.0], [1.0, 0.0, 0.0]])
    wide = tmp_path / 'wide.pgm'
    wide.write_bytes(b'P5 2 1 65535\n' + np.array([65535, 0], '>u2').tobytes())
    np.testing.assert_array_equal(read_pgm(wide), [[1.0, 0.0]])


@pytest.mark.parametrize('angle_deg', [0, 7, 30, 45])
@pytest.mark.parametrize('resolution_m', [1.0, 2.5])
def test_a_harbour_comes_back_within_a_cell(tmp_path, angle_deg, resolution_m):
    dock = box(0, 0, 500, 150).union(box(200, 100, 260, 400)).difference(shapely.Point(350, 80).buffer(25))
    water = rotate(dock, angle_deg, origin=(0, 0))
    write_nav2_map(Harbour('dock', water), tmp_path / 'dock.yaml', resolution_m)
    again = read_chart(tmp_path / 'dock.yaml')
    assert again.name == 'dock'
    gap = shapely.hausdorff_distance(again.water.boundary, water.boundary, densify=0.01)
    assert gap < np.sqrt(2.0) * resolution_m
    assert again.water.symmetric_difference(water).area / water.length < 0.5 * resolution_m
    assert len(again.walls) < 80


def test_charted_buoys_are_drawn_and_others_are_not(tmp_path):
    buoys = np.array([[50.0, 50.0, 0.5], [150.0, 50.0, 0.5]])
    harbour = Harbour('buoys', box(0, 0, 200, 100), buoys, charted=np.array([True, False]))
    write_nav2_map(harbour, tmp_path / 'buoys.yaml', 2.0)
    again = read_chart(tmp_path / 'buoys.yaml')
    assert len(again.water.interiors) == 1
    assert again.contains(buoys[:, :2]).tolist() == [False, True]


def test_small_pools_are_dropped_with_a_warning(tmp_path):
    pixels = basin()
    pixels[30, 30] = FREE
    pixels[33:35, 40:42] = FREE
    with pytest.warns(ChartWarning, match='2 pools of fewer than 9 cells'):
        harbour = read_chart(write(tmp_path, pixels))
    assert harbour.water.geom_type == 'Polygon'


def test_cells_that_touch_at_a_corner_make_valid_water(tmp_path):
    rng = np.random.default_rng(0)
    pixels = basin()
    pixels[6:14, 11:49] = np.where(rng.random((8, 38)) < 0.15, OCCUPIED, FREE)
    harbour = read_chart(write(tmp_path, pixels))
    assert harbour.water.is_valid
    assert len(harbour.water.interiors) > 10


@pytest.mark.parametrize(('ground', 'speck'), [(FREE, OCCUPIED), (OCCUPIED, FREE)])
def test_a_map_full_of_specks_is_refused_before_it_is_traced(tmp_path, ground, speck):
    pixels = np.full((300, 300), ground)
    pixels[::3, ::3] = speck
    with pytest.raises(ChartError, match='10000 separate obstacles or pools, at most 6666'):
        read_chart(write(tmp_path, pixels))


@pytest.mark.parametrize(
    ('keys', 'message'),
    [
        ({'image': None}, 'needs the key image'),
        ({'resolution': None}, 'needs the key resolution'),
        ({'origin': None}, 'needs the key origin'),
        ({'image': 'gone.pgm'}, r'gone\.pgm: the image cannot be read'),
        ({'resolution': -1.0}, 'resolution = -1.0 is outside'),
        ({'resolution': 'two'}, "resolution: expected float, got 'two'"),
        ({'origin': [0.0, 0.0]}, 'origin: expected 3 values, got 2'),
        ({'origin': [0.0, 0.0, 0.3]}, r'a turned map \(yaw not 0\) cannot be read'),
        ({'origin': [0.0, float('nan'), 0.0]}, 'origin: expected float'),
        ({'free_thresh': 0.7}, 'free_thresh = 0.7 must be below occupied_thresh = 0.65'),
        ({'occupied_thresh': 1.5}, 'occupied_thresh = 1.5 is outside'),
        ({'negate': 2}, 'negate = 2 is outside'),
        ({'negate': 'maybe'}, 'negate'),
        ({'mode': 'scale'}, "mode: 'scale' is not one of trinary"),
        ({'resolutoin': 2.0}, "unknown key 'resolutoin'; did you mean 'resolution'"),
        ({'free_thresh': 0.0}, 'no cell is free; check negate and free_thresh'),
    ],
)
def test_a_bad_key_is_named_with_its_mend(tmp_path, keys, message):
    path = write(tmp_path, basin(), **keys)
    with pytest.raises(ChartError, match=message) as caught:
        read_chart(path)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (b'\x89PNG\r\n', r'not a PGM image .*convert'),
        (b'P6 1 1 255\n000', 'not a PGM image'),
        (b'P5 60 40 255\n' + bytes(100), 'cut off: 60 x 40 pixels announced, 100 found'),
        (b'P5 99999 99999 255\n', 'at most 50000000 pixels'),
        (b'P5 2 2 0\n0000', '2 x 2 pixels of 0 to 0'),
        (b'P2 2 1 255\n1 x', 'a pixel is not a number'),
        (b'P5 2 2 255\n\xff\xff\xff\xff', 'no free area of at least 9 cells'),
    ],
)
def test_a_bad_image_is_refused(tmp_path, content, message):
    path = write(tmp_path, basin())
    (tmp_path / 'map.pgm').write_bytes(content)
    with pytest.raises(ChartError, match=message):
        read_chart(path)


def test_a_yaml_file_that_is_no_mapping_is_refused(tmp_path):
    path = tmp_path / 'map.yaml'
    path.write_text('- 1')
    with pytest.raises(ChartError, match='expected a mapping'):
        read_chart(path)


def test_the_shipped_basin_is_one_piece_with_an_island():
    harbour = read_chart(CHARTS / 'basin.yaml')
    assert harbour.water.geom_type == 'Polygon'
    assert len(harbour.water.interiors) == 1
    assert 15 < len(harbour.walls) < 40
    x_min, y_min, x_max, y_max = harbour.bounds
    assert -300.0 < x_min < x_max < 300.0
    assert -200.0 < y_min < y_max < 200.0
