"""`portnav plan`: one path on a chart, printed and written as GeoJSON or CSV."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from portnav_ros.charts import read_chart
from portnav_ros.params import ParamError, override
from portnav_ros.planning.plan_space import prepare
from portnav_ros.planning.route import route_clearance, route_length
from portnav_ros.planning.rrt_star import RrtStarParams, plan_in
from portnav_ros.types import Array

HULL_CLEARANCE_M = 30.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--chart', type=Path, required=True, metavar='FILE', help='GeoJSON or nav2 map YAML')
    for option, destination in (('--from', 'start'), ('--to', 'goal')):
        parser.add_argument(
            option,
            dest=destination,
            type=float,
            nargs=2,
            required=True,
            metavar=('X', 'Y'),
            help='m, map frame',
        )
    parser.add_argument(
        '--clearance',
        type=float,
        default=HULL_CLEARANCE_M,
        metavar='M',
        help='of the hull (default: %(default)s)',
    )
    parser.add_argument(
        '--iterations',
        type=int,
        default=RrtStarParams.iterations,
        metavar='N',
        help='of RRT* (default: %(default)s)',
    )
    parser.add_argument(
        '--turn-radius',
        type=float,
        default=RrtStarParams.turn_radius_m,
        metavar='M',
        help='what corners are widened to where there is room (default: %(default)s)',
    )
    parser.add_argument(
        '--seed', type=int, default=0, metavar='S', help='of the search (default: %(default)s)'
    )
    parser.add_argument('--out', type=Path, metavar='FILE', help='path as .geojson or .csv (x, y in m)')


def run(arguments: argparse.Namespace) -> int:
    """Plan, print what came of it and write the file.

    Raises:
        PlanError, ChartError, ParamError: there is no path, or the input cannot be used.
    """
    write = _writer(arguments.out) if arguments.out else None
    params = _params(arguments)
    began_s = time.perf_counter()
    space = prepare(read_chart(arguments.chart), params.resolution_m, arguments.clearance)
    prepared_s = time.perf_counter()
    path = plan_in(space, tuple(arguments.start), tuple(arguments.goal), params, arguments.seed)
    planned_s = time.perf_counter()
    print(
        f'{route_length(path):.0f} m in {len(path)} points, '
        f'least clearance {route_clearance(space.grid, path):.1f} m; '
        f'chart {prepared_s - began_s:.2f} s, search {planned_s - prepared_s:.2f} s'
    )
    if write is not None:
        write(path, arguments.out)
    return 0


def _params(arguments: argparse.Namespace) -> RrtStarParams:
    """How the route is searched, once every number can be.

    Raises:
        ParamError: names the option and the mend.
    """
    for option, place in (('--from', arguments.start), ('--to', arguments.goal)):
        if not np.isfinite(place).all():
            raise ParamError(f'{option} {place[0]} {place[1]}: give finite numbers, in m of the map frame')
    for option, value in (('--clearance', arguments.clearance), ('--seed', arguments.seed)):
        if not 0.0 <= value < math.inf:
            raise ParamError(f'{option} {value}: give 0 or more, and a finite number')
    params = override(RrtStarParams(), {'iterations': arguments.iterations}, '--iterations')
    return override(params, {'turn_radius_m': arguments.turn_radius}, '--turn-radius')


def _writer(out: Path) -> Callable[[Array, Path], None]:
    writers = {'.geojson': _write_geojson, '.json': _write_geojson, '.csv': _write_csv}
    if out.suffix not in writers:
        raise ParamError(f'{out}: unknown kind of file; write .geojson or .csv')
    return writers[out.suffix]


def _write_geojson(path: Array, out: Path) -> None:
    line = {'type': 'LineString', 'coordinates': path.round(3).tolist()}
    feature = {'type': 'Feature', 'properties': {'kind': 'path'}, 'geometry': line}
    collection = {'type': 'FeatureCollection', 'portnav': {'units': 'm'}, 'features': [feature]}
    out.write_text(json.dumps(collection) + '\n', encoding='utf-8')


def _write_csv(path: Array, out: Path) -> None:
    np.savetxt(out, path, fmt='%.3f', delimiter=',', header='x_m,y_m', comments='')
