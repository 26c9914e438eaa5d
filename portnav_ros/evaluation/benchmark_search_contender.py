"""One contender of `portnav benchmark search`, in a process of its own: prints its figures as JSON."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from portnav_ros.muzero.inference import NumpyModel, numpy_model, weights_of
from portnav_ros.muzero.search import Search, SearchParams
from portnav_ros.types import AnyArray, Array32

FEATURES, LATENT, HEADINGS, SPEEDS = 290, 32, 9, 3
ACTIONS = HEADINGS * SPEEDS
DISCOUNT = 0.997
SINGLE_DECISIONS = 400
Decide = Callable[[Array32], object]  # plans from observations [B, F]


def main() -> None:
    """Measure the contender that the argument tells of."""
    job: dict[str, Any] = json.loads(sys.argv[1])
    os.sched_setaffinity(0, {job['core']})
    print(json.dumps(contend(job)))


def contend(job: dict[str, Any]) -> dict[str, Any]:
    """Figures of a contender, or why it is missing."""
    rng = np.random.default_rng(0)
    state = random_state(rng, FEATURES, LATENT, (job['hidden'],), job['bins'], (HEADINGS, SPEEDS))
    features = FEATURES
    try:
        if job['name'] == 'released':
            decide, features = released_decider(job['simulations'], job['batch'])
        else:
            decide = decider(job['name'], state, job['simulations'], job['batch'])
    except ImportError as error:
        return {'missing': str(error)}
    observation = rng.standard_normal((job['batch'], features)).astype(np.float32)
    return timed(decide, observation, job['repeats'])


def decider(name: str, state: dict[str, Array32], simulations: int, batch: int) -> Decide:
    """How a contender plans.

    Raises:
        ImportError: it is not installed.
    """
    if name.startswith('ours'):
        rule = name.removeprefix('ours').removeprefix('_') or 'pozero'
        params = SearchParams(simulations=simulations, rule=rule)  # type: ignore[arg-type]
        return _ours(NumpyModel(weights_of(state, SPEEDS), DISCOUNT), params, batch)
    from portnav_ros.evaluation import benchmark_search_peers as peers

    if name == 'lightzero':
        return peers.lightzero(state, (HEADINGS, SPEEDS), DISCOUNT, simulations)
    return peers.mctx(name, weights_of(state, SPEEDS), DISCOUNT, simulations)


def released_decider(simulations: int, batch: int) -> tuple[Decide, int]:
    """How the released policy plans, and the width of its observation."""
    from portnav_ros.muzero.model_file import load_model
    from portnav_ros.params import override
    from portnav_ros.resources import share_directory

    model = load_model(share_directory() / 'models' / 'muzero.safetensors')
    values = {**model.card.search, 'simulations': simulations}
    networks = numpy_model(model.tensors, len(model.card.task.actions.speed_mps), model.card.discount)
    params = override(SearchParams(), values, str(model.path))
    return _ours(networks, params, batch), model.card.task.observation.size


def _ours(model: NumpyModel, params: SearchParams, batch: int) -> Decide:
    searches = {size: Search(params, size, model.actions, model.latent) for size in (1, batch)}
    rng = np.random.default_rng(0)
    return lambda observation: searches[len(observation)].run(model, observation, rng)


def timed(decide: Decide, observation: Array32, repeats: int) -> dict[str, float]:
    """Throughput of the fastest batch per second of CPU time, and latency of single observations."""
    decide(observation)
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        decide(observation)
        spent.append(time.process_time() - start)
    decide(observation[:1])
    single = []
    for i in range(SINGLE_DECISIONS):
        row = i % len(observation)
        start = time.perf_counter()
        decide(observation[row : row + 1])
        single.append(1e3 * (time.perf_counter() - start))
    return {
        'decisions_per_s': len(observation) / min(spent),
        'batch1_p50_ms': float(np.percentile(single, 50)),
        'batch1_p99_ms': float(np.percentile(single, 99)),
    }


def random_state(
    rng: np.random.Generator,
    features: int,
    latent: int,
    hidden: tuple[int, ...],
    bins: int,
    grid: tuple[int, int],
    alive: bool = True,
) -> dict[str, Array32]:
    """Draw random weights by the names of `muzero.networks`.

    Args:
        rng: draws them.
        features: F of the observation.
        latent: L.
        hidden: widths of the hidden layers of each network.
        bins: atoms of a head.
        grid: headings and speeds of the actions.
        alive: whether there is a head for the episode's going on.
    """
    state: dict[str, AnyArray] = {}

    def linear(name: str, inputs: int, outputs: int) -> None:
        state[f'{name}.weight'] = rng.standard_normal((outputs, inputs)) / np.sqrt(inputs)
        state[f'{name}.bias'] = 0.1 * rng.standard_normal(outputs)

    def norm(name: str, size: int) -> None:
        state[f'{name}.weight'] = 1.0 + 0.1 * rng.standard_normal(size)
        state[f'{name}.bias'] = 0.1 * rng.standard_normal(size)

    inputs = {'representation': features, 'dynamics': latent + sum(grid), 'prediction': latent}
    for part, size in inputs.items():
        for i, (before, after) in enumerate(zip((size, *hidden), hidden, strict=False)):
            linear(f'{part}.body.{i}.linear', before, after)
            norm(f'{part}.body.{i}.norm', after)
    heads = {'representation.out': latent, 'dynamics.out': latent, 'dynamics.reward': bins}
    heads |= {'prediction.policy': grid[0] * grid[1], 'prediction.value': bins}
    for name, outputs in (heads | ({'dynamics.alive': 1} if alive else {})).items():
        linear(name, hidden[-1], outputs)
    norm('representation.norm', latent)
    norm('dynamics.norm', latent)
    state['reward_atoms'] = state['value_atoms'] = np.linspace(-1500.0, 1500.0, bins)
    return {name: array.astype(np.float32) for name, array in state.items()}


if __name__ == '__main__':
    main()
