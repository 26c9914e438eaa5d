"""`portnav benchmark world`: how fast the batched environment steps, and where the time goes."""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numba import njit
from tqdm import tqdm

from portnav_ros.evaluation.options import check_at_least
from portnav_ros.sim.world import World
from portnav_ros.task.actions import setpoints_of
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.types import YAW, Array, Array32, IntArray, Outcome

STEPS_LEAST = 2  # half of them are timed part by part


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--difficulty', default='paper', help='name or file (default: %(default)s)')
    parser.add_argument('--batch', type=int, default=256, help='environments B (default: %(default)s)')
    parser.add_argument(
        '--steps', type=int, default=400, help='decisions of each environment (default: %(default)s)'
    )
    parser.add_argument('--ports', type=int, default=16, help='ports in the pool (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='of ports and actions (default: %(default)s)')


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and return the figures.

    Raises:
        EvaluationError: a number cannot be.
    """
    check_at_least(arguments, batch=1, steps=STEPS_LEAST, ports=1, seed=0)
    env = PortVectorEnv(arguments.batch, arguments.difficulty, arguments.ports, arguments.seed)
    rng = np.random.default_rng(arguments.seed)
    actions = rng.choice(_gentle(env), size=(arguments.steps, arguments.batch))
    env.reset(seed=arguments.seed)
    env.step(actions[0])
    cpu_s, wall_s, ended = _drive(env, actions)
    steps = arguments.steps * arguments.batch
    shares = _shares(env, actions[: len(actions) // 2])
    return {
        'difficulty': arguments.difficulty,
        'batch': arguments.batch,
        'steps': steps,
        'episodes_ended': ended,
        'steps_per_cpu_s': steps / cpu_s,
        'steps_per_wall_s': steps / wall_s,
        'us_per_step': 1e6 * cpu_s / steps,
        **shares,
        'ratio_scan_brute_force': _ratio_brute_force(env.world),
        'memory_mb': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def _gentle(env: PortVectorEnv) -> IntArray:
    """Number the actions that turn by 7.5 degrees at most, so that episodes last."""
    return np.flatnonzero(np.abs(env.task.actions.table()[:, 0]) < 0.14)


def _drive(env: PortVectorEnv, actions: IntArray) -> tuple[float, float, int]:
    ended = 0
    cpu, wall = time.process_time(), time.perf_counter()
    for row in tqdm(actions, desc='steps', leave=False):
        _, _, terminated, truncated, _ = env.step(row)
        ended += int((terminated | truncated).sum())
    return time.process_time() - cpu, time.perf_counter() - wall, ended


def _cpu_s(function: Callable[[], object], repeats: int = 50) -> float:
    """CPU time of one call in s, the median of `repeats`."""
    function()
    samples = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        samples.append(time.process_time() - start)
    return float(np.median(samples))


def _shares(env: PortVectorEnv, actions: IntArray) -> dict[str, float]:
    """CPU time of a step by part, each part timed where it runs in the loop."""
    world, table = env.world, env.task.actions.table()
    spent = dict.fromkeys(('motion_and_scan', 'scan', 'observation', 'reset'), 0.0)

    def timed(part: str, function: Callable[[], object]) -> None:
        start = time.process_time()
        function()
        spent[part] += time.process_time() - start

    for row in actions:
        setpoints = setpoints_of(row, world.own[:, YAW], table)
        timed('motion_and_scan', partial(world.step, setpoints))
        timed('scan', world.sense)
        timed('observation', env.observe)
        ended = world.outcome != Outcome.RUNNING
        if ended.any():
            timed('reset', partial(env.reset, options={'reset_mask': ended}))
    spent['motion'] = spent.pop('motion_and_scan') - spent['scan']
    total = sum(spent.values())
    scan = {'scan_us': 1e6 * spent['scan'] / actions.size}
    return scan | {f'share_{part}': value / total for part, value in spent.items()}


def _ratio_brute_force(world: World) -> float:
    """Cost of testing every ray against every wall, over the cost of the whole scan."""
    walls, count = world.walls, world.wall_counts
    rays = np.linspace(-np.pi, np.pi, world.lidar.rays, endpoint=False)
    out = np.zeros(world.ranges.shape, np.float32)
    brute = _cpu_s(lambda: _brute_force(world.own, walls, count, rays, out), 5)
    return brute / _cpu_s(world.sense)


@njit(cache=True)
def _brute_force(own: Array, walls: Array, count: IntArray, rays: Array, out: Array32) -> None:
    for b in range(len(own)):
        for i in range(len(rays)):
            cosine, sine = np.cos(own[b, 2] + rays[i]), np.sin(own[b, 2] + rays[i])
            nearest = np.inf
            for e in range(count[b]):
                x0, y0 = walls[b, e, 0] - own[b, 0], walls[b, e, 1] - own[b, 1]
                ex, ey = walls[b, e, 2] - walls[b, e, 0], walls[b, e, 3] - walls[b, e, 1]
                toward = cosine * ey - sine * ex
                if toward != 0.0:
                    t, u = (x0 * ey - y0 * ex) / toward, (x0 * sine - y0 * cosine) / toward
                    if t > 0.0 and 0.0 <= u <= 1.0:
                        nearest = min(nearest, t)
            out[b, i] = nearest
