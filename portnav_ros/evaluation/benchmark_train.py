"""`portnav benchmark train`: speed of self-play, of the learner and of both together, and memory."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from portnav_ros.muzero.learner import limit_threads
from portnav_ros.muzero.loop import Loop, Params
from portnav_ros.params import override, read_yaml
from portnav_ros.resources import config_path
from portnav_ros.task.env import PortVectorEnv
from portnav_ros.training.device import check_device
from portnav_ros.training.scenarios import training_source

RUN_STEPS = 5_000_000  # of the paper's longest run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument('--preset', default='best', help='in config/train (default: %(default)s)')
    parser.add_argument('--difficulty', default='paper', help='name or file (default: %(default)s)')
    parser.add_argument('--ports', type=int, default=16, help='ports in the pool')
    parser.add_argument('--seconds', type=float, default=30.0, help='to run the whole loop for')
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--threads', type=int, default=1, help="of the learner's")


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure and return the figures."""
    check_device(arguments.device)
    limit_threads(arguments.threads)
    file = config_path('train', f'{arguments.preset}.yaml')
    params = override(Params(), read_yaml(file), str(file))
    worlds = {'difficulty': arguments.difficulty, 'testbed': '', 'ports': arguments.ports}
    params = replace(params, scenarios=override(params.scenarios, worlds, 'command line'))
    loop = Loop(params, seed=0, device=arguments.device)
    self_play = _fill(loop)
    update_s, sample_s = _seconds(lambda: loop.learner.update(loop.draw())), _seconds(loop.draw)
    before_mb = _resident_mb()
    whole = _run_loop(loop, arguments.seconds)
    return {
        'preset': arguments.preset,
        'difficulty': arguments.difficulty,
        'environments': params.selfplay.environments,
        'simulations': params.search.simulations,
        'batch': params.learner.batch,
        'samples_per_step': params.replay.samples_per_step,
        'selfplay_steps_per_s': self_play,
        'updates_per_s': 1.0 / update_s,
        'sample_ms': 1e3 * sample_s,
        **whole,
        'hours_for_5M_steps': RUN_STEPS / whole['steps_per_s'] / 3600.0,
        **_shares(loop),
        'memory_before_mb': before_mb,
        'memory_after_mb': _resident_mb(),
        'replay_full_mb': loop.replay.nbytes / 2**20,
    }


def _fill(loop: Loop) -> float:
    """Play until the first update is due, kernels warm; return environment steps a second."""
    loop.replay.append(loop.play(loop.model, 0))
    first, start = loop.steps, time.perf_counter()
    with tqdm(total=loop.params.replay.warmup, desc='self-play', unit='decision', leave=False) as bar:
        while not loop.updates_due():
            loop.replay.append(loop.play(loop.model, 0))
            bar.update(len(loop.replay) - bar.n)
    return (loop.steps - first) / (time.perf_counter() - start)


def _run_loop(loop: Loop, seconds: float) -> dict[str, float]:
    """Train for a while; steps and updates a second, and how busy both threads were."""
    busy, steps, updates = dict(loop.busy_s), loop.steps, loop.learner.updates
    start = now = time.perf_counter()
    with ThreadPoolExecutor(1) as worker, tqdm(desc='whole loop', unit='step', leave=False) as bar:
        while now - start < seconds:
            loop.iterate(worker)
            bar.update(loop.steps - steps - bar.n)
            now = time.perf_counter()
    wall_s = now - start
    shares = {f'busy_{name}': (loop.busy_s[name] - busy[name]) / wall_s for name in busy}
    rates = {'steps': loop.steps - steps, 'loop_updates': loop.learner.updates - updates}
    return {f'{name}_per_s': count / wall_s for name, count in rates.items()} | shares


def _shares(loop: Loop) -> dict[str, float]:
    """Time of a decision of all environments, in ms, by what it goes into."""
    params = loop.params
    env = PortVectorEnv(
        params.selfplay.environments, source=training_source(params.scenarios, 0), task=params.task
    )
    features, _ = env.reset(seed=0)
    search, rng = loop.selfplay.search, np.random.default_rng(0)
    actions = search.run(loop.model, features, rng).action
    return {
        'search_ms': 1e3 * _seconds(lambda: search.run(loop.model, features, rng)),
        'environment_ms': 1e3 * _seconds(lambda: env.step(actions)),
    }


def _seconds(function: Callable[[], object], repeats: int = 30) -> float:
    """Wall time of one call in s, the median of `repeats`."""
    function()
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        samples.append(time.perf_counter() - start)
    return float(np.median(samples))


def _resident_mb() -> float:
    """Memory that the process holds now."""
    pages = int(Path('/proc/self/statm').read_text(encoding='ascii').split()[1])
    return pages * 4096 / 2**20
