"""`portnav benchmark search`: decisions per second of the tree search, beside other libraries' searches.

Each contender runs in a process of its own, on one core and with one thread, with the same random
networks; throughput is per second of CPU time, latency by the clock.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from typing import Any

from tqdm import tqdm

from portnav_ros.evaluation.options import check_at_least
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.muzero.search import SearchParams
from portnav_ros.params import override
from portnav_ros.resources import share_directory

CONTENDERS = ('ours', 'ours_puct', 'ours_gumbel', 'mctx_gumbel', 'mctx_muzero', 'lightzero')
RELEASED = 'muzero.safetensors'
ONE_THREAD = {
    'OMP_NUM_THREADS': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'MKL_NUM_THREADS': '1',
    'NUMBA_NUM_THREADS': '1',
    'JAX_PLATFORMS': 'cpu',
    'XLA_FLAGS': '--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--batch', type=int, default=256, help='environments B (default: %(default)s)')
    parser.add_argument('--simulations', type=int, default=50, help='of each decision (default: %(default)s)')
    parser.add_argument(
        '--hidden', type=int, default=128, help='width of the networks (default: %(default)s)'
    )
    parser.add_argument('--bins', type=int, default=81, help='atoms of a head (default: %(default)s)')
    parser.add_argument(
        '--repeats', type=int, default=9, help='batches timed, the fastest counts (default: %(default)s)'
    )
    parser.add_argument('--core', type=int, help='core to run on (default: the last one)')


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and return the figures; None for a contender that is not installed.

    Raises:
        EvaluationError, ParamError: a number cannot be.
    """
    _check(arguments)
    options = {
        name: getattr(arguments, name) for name in ('batch', 'simulations', 'hidden', 'bins', 'repeats')
    }
    found = {name: _contend(name, options, arguments.core) for name in tqdm(CONTENDERS, leave=False)}
    ours = found['ours']
    figures: dict[str, Any] = {**options, 'actions': 27, 'latent': 32, **ours}
    for name in CONTENDERS[1:]:
        figures[f'{name}_decisions_per_s'] = found[name].get('decisions_per_s')
        figures[f'{name}_batch1_p50_ms'] = found[name].get('batch1_p50_ms')
    for name in CONTENDERS[3:]:
        rate = found[name].get('decisions_per_s')
        figures[f'ratio_{name}'] = ours['decisions_per_s'] / rate if rate else None
        if 'missing' in found[name]:
            figures[f'{name}_left_out'] = found[name]['missing']
    if (share_directory() / 'models' / RELEASED).exists():
        released = _contend('released', options, arguments.core)
        figures |= {f'released_{key}': value for key, value in released.items()}
    return figures


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what every contender would die of."""
    check_at_least(arguments, batch=1, hidden=1, bins=1, repeats=1)
    override(SearchParams(), {'simulations': arguments.simulations}, '--simulations')
    cores = sorted(os.sched_getaffinity(0))
    if arguments.core is not None and arguments.core not in cores:
        raise EvaluationError(
            f'--core {arguments.core}: this process may run on {", ".join(map(str, cores))}'
        )


def _contend(name: str, options: dict[str, int], core: int | None) -> dict[str, Any]:
    """Figures of one contender, from a process of its own."""
    cores = sorted(os.sched_getaffinity(0))
    job = json.dumps({'name': name, 'core': cores[-1] if core is None else core, **options})
    command = [sys.executable, '-m', 'portnav_ros.evaluation.benchmark_search_contender', job]
    done = subprocess.run(command, env=os.environ | ONE_THREAD, stdout=subprocess.PIPE, text=True, check=True)
    figures: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return figures
