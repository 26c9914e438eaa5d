"""Other libraries' searches on this project's networks, for the benchmark: mctx in JAX, LightZero's C++ tree.

Each function raises ImportError, with a word on how to install it, where its library is missing.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np

from portnav_ros.muzero.layers import Weights
from portnav_ros.types import Array32

TREE = 'lzero.mcts.ctree.ctree_muzero.mz_tree'


def mctx(name: str, weights: Weights, discount: float, simulations: int) -> Any:
    """mctx_gumbel or mctx_muzero, networks and all in one compiled function."""
    try:
        import jax
        import mctx as library
    except ImportError as error:
        raise ImportError("mctx is not installed: pip install 'portnav_ros[peers]'") from error
    networks = JaxNetworks(jax, library, jax.tree.map(jax.numpy.asarray, weights), discount)
    search = library.gumbel_muzero_policy if name == 'mctx_gumbel' else library.muzero_policy

    @jax.jit  # type: ignore[untyped-decorator, unused-ignore]
    def plan(key: Any, observation: Any) -> Any:
        found = search(None, key, networks.root(observation), networks.recur, simulations)
        return found.action, found.action_weights

    key = jax.random.PRNGKey(0)
    return lambda observation: jax.block_until_ready(plan(key, observation))


class JaxNetworks:
    """`muzero.inference` once more, in JAX."""

    def __init__(self, jax: Any, mctx: Any, weights: Any, discount: float) -> None:
        """Take the modules, weights as JAX arrays, and the discount of one decision."""
        self.jax, self.mctx, self.weights, self.discount = jax, mctx, weights, discount

    def root(self, observation: Any) -> Any:
        """What mctx wants of the root."""
        w = self.weights
        out = self._body(observation, w.represent, 0) @ w.represent_out.weight + w.represent_out.bias
        latent = self._norm(out, w.represent_norm)
        logits, value = self._predict(latent)
        return self.mctx.RootFnOutput(prior_logits=logits, value=value, embedding=latent)

    def recur(self, _params: Any, _key: Any, action: Any, latent: Any) -> Any:
        """What mctx wants of a step, and the next latent."""
        w, bins, size = self.weights, len(self.weights.reward_atoms), latent.shape[1]
        out = self._body(latent, w.dynamics, action) @ w.dynamics_out.weight + w.dynamics_out.bias
        after = self._norm(latent + out[:, :size], w.dynamics_norm)
        logits, value = self._predict(after)
        reward = self.jax.nn.softmax(out[:, size : size + bins]) @ w.reward_atoms
        going_on = self.jax.nn.sigmoid(out[:, size + bins])
        output = self.mctx.RecurrentFnOutput(
            reward=reward, discount=self.discount * going_on, prior_logits=logits, value=value
        )
        return output, after

    def _predict(self, latent: Any) -> tuple[Any, Any]:
        w, actions = self.weights, self.weights.dynamics[0].bias.shape[0]
        out = self._body(latent, w.predict, 0) @ w.predict_out.weight + w.predict_out.bias
        return out[:, :actions], self.jax.nn.softmax(out[:, actions:]) @ w.value_atoms

    def _body(self, values: Any, layers: Any, first_row: Any) -> Any:
        row = first_row
        for layer in layers:
            values = self.jax.nn.relu(self._norm(values @ layer.weight + layer.bias[row], layer.norm))
            row = 0
        return values

    def _norm(self, values: Any, norm: Any) -> Any:
        return self.jax.nn.standardize(values, epsilon=1e-5) * norm[0] + norm[1]


def lightzero(state: dict[str, Array32], grid: tuple[int, int], discount: float, simulations: int) -> Any:
    """LightZero's C++ tree around a torch network, driven as its own MuZeroMCTSCtree.search drives it."""
    tree = _lightzero_tree()
    from portnav_ros.muzero.torch_model import TorchModel, network_of

    model = TorchModel(network_of(state, *grid), discount)
    actions = list(range(grid[0] * grid[1]))

    def plan(observation: Array32) -> Any:
        batch = len(observation)
        latent = model.represent(observation)
        logits, _ = model.predict(latent)
        roots = tree.Roots(batch, [actions] * batch)
        players = [-1] * batch
        roots.prepare_no_noise([0.0] * batch, logits.tolist(), players)
        ranges = tree.MinMaxStatsList(batch)
        ranges.set_delta(0.01)
        latents = [latent]
        for node in range(1, simulations + 1):
            results = tree.ResultsWrapper(num=batch)
            nodes, rows, chosen, turns = tree.batch_traverse(
                roots, 19652, 1.25, discount, ranges, results, list(players)
            )
            parents = np.asarray([latents[i][j] for i, j in zip(nodes, rows, strict=True)])
            step = model.step(parents, np.asarray(chosen))
            latents.append(step.latent)
            values = step.reward.tolist(), step.value.tolist(), step.logits.tolist()
            tree.batch_backpropagate(node, discount, *values, ranges, results, turns)
        return roots.get_distributions()

    return plan


def _lightzero_tree() -> Any:
    """LightZero's compiled tree by itself: importing the package would pull in its whole training stack."""
    package = importlib.util.find_spec('lzero')
    places = package.submodule_search_locations if package else None
    files = [f for place in places or () for f in Path(place).glob('mcts/ctree/ctree_muzero/mz_tree*.so')]
    if not files:
        raise ImportError('LightZero is not installed: pip install --no-deps LightZero (Python 3.11)')
    spec = importlib.util.spec_from_file_location(TREE, files[0])
    if spec is None or spec.loader is None:
        raise ImportError(f'{files[0]} cannot be loaded')
    module = importlib.util.module_from_spec(spec)
    sys.modules[TREE] = module
    spec.loader.exec_module(module)
    return module
