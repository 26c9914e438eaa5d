import json
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.charts import write_geojson
from portnav_ros.cli import main
from portnav_ros.evaluation.benchmark_plan import benchmark_plan
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.harbour import Harbour

BERTHS = np.array([[100.0, 900.0, 0.0], [1900.0, 900.0, 0.0], [1000.0, 100.0, 0.0]])


@pytest.fixture(scope='module')
def chart(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp('chart') / 'basin.geojson'
    write_geojson(Harbour('basin', box(0, 0, 2000, 1000) - box(900, 300, 1100, 1001), berths=BERTHS), file)
    return str(file)


def plan(chart: str, *options: str) -> int:
    return main(['plan', '--chart', chart, '--from', '100', '900', *options])


def test_the_path_is_printed_and_written(
    chart: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ('plan.csv', 'plan.geojson'):
        assert plan(chart, '--to', '1900', '900', '--seed', '3', '--out', str(tmp_path / name)) == 0
    assert 'least clearance' in capsys.readouterr().out
    table = np.loadtxt(tmp_path / 'plan.csv', delimiter=',', skiprows=1)
    feature = json.loads((tmp_path / 'plan.geojson').read_text())['features'][0]
    np.testing.assert_array_equal(feature['geometry']['coordinates'], table)
    np.testing.assert_array_equal(table[[0, -1]], [[100.0, 900.0], [1900.0, 900.0]])


def test_what_cannot_be_planned_is_one_line_with_the_reason(
    chart: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert plan(chart, '--to', '1000', '900') == 2
    assert 'GOAL_OCCUPIED' in capsys.readouterr().err
    assert plan(chart, '--to', '1900', '900', '--out', 'plan.png') == 2
    assert '.geojson or .csv' in capsys.readouterr().err
    assert plan(chart, '--to', '1900', '900', '--clearance', '-5') == 2
    assert '--clearance' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('--from nan 0', '--from nan 0.0: give finite numbers'),
        ('--to 0 inf', '--to 0.0 inf: give finite numbers'),
        ('--clearance nan', '--clearance nan: give 0 or more'),
        ('--seed -1', '--seed -1: give 0 or more'),
        ('--iterations 0', '--iterations: iterations = 0 is outside'),
        ('--turn-radius nan', '--turn-radius: turn_radius_m = nan is outside'),
    ],
)
def test_numbers_that_cannot_be_are_refused_by_option(
    chart: str, words: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert plan(chart, '--to', '1900', '900', *words.split()) == 2
    assert capsys.readouterr().err.startswith(f'portnav: error: {reason}')


def test_the_benchmark_counts_the_pairs_that_there_are(chart: str) -> None:
    assert benchmark_plan(Path(chart), 50, 30.0, 0, (0.01,))['pairs'] == 6


def test_the_benchmark_needs_two_berths(tmp_path: Path) -> None:
    file = tmp_path / 'lonely.geojson'
    write_geojson(Harbour('lonely', box(0, 0, 2000, 1000), berths=BERTHS[:1]), file)
    with pytest.raises(EvaluationError, match='has 1 berths; name a chart with two or more'):
        benchmark_plan(file, 2, 30.0, 0)


def test_the_benchmark_relates_every_length_to_the_last(chart: str) -> None:
    figures = benchmark_plan(Path(chart), 2, 30.0, 0, (0.2, 0.4))
    assert figures['length_ratio_0.4s_mean'] == 1.0
    assert 0.95 < figures['length_ratio_0.2s_max'] < 1.05
    assert 0.0 < figures['first_path_p50_s'] <= figures['first_path_p95_s']
