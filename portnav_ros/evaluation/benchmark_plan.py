"""`portnav benchmark plan`: how long the first path takes, and how the path shortens with time."""

from __future__ import annotations

import argparse
import itertools
import resource
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from portnav_ros.charts import read_chart
from portnav_ros.evaluation.options import check_at_least
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.planning.plan_space import PlanSpace, Point, find_ends, prepare
from portnav_ros.planning.route import route_length
from portnav_ros.planning.rrt_star import CHUNK, RouteSearch, RrtStarParams, plan_in, refine
from portnav_ros.resources import config_path
from portnav_ros.types import Array

CHECKPOINTS_S = (0.5, 1.0, 2.0, 5.0, 10.0)


class Growth(NamedTuple):
    """One plan over time: when the first path stood, and its length in m at each checkpoint (nan: none)."""

    first_s: float
    lengths_m: list[float]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        '--chart',
        type=Path,
        default=config_path('charts', 'river_docks.geojson'),
        help='chart with berths (default: the shipped river_docks)',
    )
    parser.add_argument('--pairs', type=int, default=20, help='start-goal pairs (default: %(default)s)')
    parser.add_argument(
        '--clearance', type=float, default=30.0, metavar='M', help='of the hull, in m (default: %(default)s)'
    )
    parser.add_argument('--seed', type=int, default=0, help='of pairs and plans (default: %(default)s)')


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and return the figures.

    Raises:
        EvaluationError: a number cannot be, or the chart has no two berths.
        PlanError: a pair of berths is not connected.
    """
    check_at_least(arguments, pairs=1, clearance=0, seed=0)
    return benchmark_plan(arguments.chart, arguments.pairs, arguments.clearance, arguments.seed)


def benchmark_plan(
    chart: Path,
    pairs: int,
    hull_clearance_m: float,
    seed: int,
    checkpoints_s: Sequence[float] = CHECKPOINTS_S,
) -> dict[str, Any]:
    """Grow a tree for each of several pairs of berths and time what it gives.

    Times are CPU-seconds of this process; lengths are those of the finished path, shortened and
    smoothed. Keys ``length_ratio_*`` compare with the length at the last checkpoint.

    Raises:
        EvaluationError: the chart has no two berths.
        PlanError: a pair of berths is not connected.
    """
    params = RrtStarParams()
    harbour = read_chart(chart)
    if len(harbour.berths) < 2:
        raise EvaluationError(
            f'--chart {chart}: has {len(harbour.berths)} berths; name a chart with two or more'
        )
    space, prepare_s = _timed(lambda: prepare(harbour, params.resolution_m, hull_clearance_m))
    berths = [(float(x), float(y)) for x, y, _ in harbour.berths]
    ends = _draw_pairs(berths, pairs, np.random.default_rng(seed))
    plan_in(space, *ends[0], params, seed)  # kernels load here
    memory_mb = _memory_mb()
    budget_s = np.array([_timed(lambda a=a, b=b: plan_in(space, a, b, params, seed))[1] for a, b in ends])
    growths = [
        _grow(space, a, b, params, seed, checkpoints_s) for a, b in tqdm(ends, desc='plan', unit='pair')
    ]
    first_s = np.array([growth.first_s for growth in growths])
    lengths = np.array([growth.lengths_m for growth in growths])
    return {
        'chart': chart.stem,
        'pairs': len(ends),
        'hull_clearance_m': hull_clearance_m,
        'prepare_s': prepare_s,
        'first_path_p50_s': float(np.quantile(first_s, 0.5)),
        'first_path_p95_s': float(np.quantile(first_s, 0.95)),
        'budget_iterations': params.iterations,
        'budget_p50_s': float(np.quantile(budget_s, 0.5)),
        'budget_p95_s': float(np.quantile(budget_s, 0.95)),
        'mean_length_m': float(lengths[:, -1].mean()),
        **_ratios(lengths, checkpoints_s),
        'memory_mb': memory_mb,
        'memory_after_mb': _memory_mb(),
    }


def _draw_pairs(berths: list[Point], count: int, rng: np.random.Generator) -> list[tuple[Point, Point]]:
    every = list(itertools.permutations(berths, 2))
    chosen = rng.choice(len(every), size=min(count, len(every)), replace=False)
    return [every[k] for k in chosen]


def _grow(
    space: PlanSpace,
    start: Point,
    goal: Point,
    params: RrtStarParams,
    seed: int,
    checkpoints_s: Sequence[float],
) -> Growth:
    """Grow one tree up to the last checkpoint; finishing the path for a measurement is not counted."""
    ends = find_ends(space, start, goal, params.snap_m)
    search, spent_s = _timed(lambda: RouteSearch(space, ends, params, seed))
    first_s = np.inf
    lengths: list[float] = []
    while len(lengths) < len(checkpoints_s):
        spent_s += _timed(lambda: search.grow(CHUNK))[1]
        due = spent_s >= checkpoints_s[len(lengths)]
        if search.solved and (due or first_s == np.inf):
            path, finish_s = _timed(lambda: refine(space, ends, search.path(), params))
            first_s = min(first_s, spent_s + finish_s)
        if due:
            lengths.append(route_length(path) if search.solved else float('nan'))
    return Growth(first_s, lengths)


def _ratios(lengths: Array, checkpoints_s: Sequence[float]) -> dict[str, float]:
    """Mean and worst length at each checkpoint over that at the last."""
    ratios = lengths / lengths[:, -1:]
    figures = {}
    for k, at_s in enumerate(checkpoints_s):
        figures[f'length_ratio_{at_s:g}s_mean'] = float(ratios[:, k].mean())
        figures[f'length_ratio_{at_s:g}s_max'] = float(ratios[:, k].max())
    return figures


def _timed(call: Any) -> tuple[Any, float]:
    began = time.process_time()
    result = call()
    return result, time.process_time() - began


def _memory_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
