"""Monte-Carlo tree search over a learned model, for a whole batch of environments at once.

Rules: POZero (Grill et al. 2020, "Monte-Carlo tree search as regularized policy optimization"), PUCT
(MuZero, Schrittwieser et al. 2020) and Gumbel MuZero (Danihelka et al. 2022).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, TypeVar

import numpy as np

from portnav_ros.muzero import rules
from portnav_ros.muzero.inference import Model, NumpyModel
from portnav_ros.muzero.simulation import Root, conclude, descend, new_root, simulate
from portnav_ros.muzero.tree import (
    LEAST_PRIOR,
    Leaves,
    Step,
    Tree,
    best_path,
    grow,
    new_leaves,
    new_step,
    new_tree,
    plant,
)
from portnav_ros.params import ParamError, Ranges, check_range, check_ranges
from portnav_ros.types import Array32, BoolArray, IntArray

CHUNK = 64  # rows whose trees fit the second level of the cache together
RULES = {'pozero': rules.POZERO, 'puct': rules.PUCT, 'gumbel': rules.GUMBEL}


@dataclass(frozen=True)
class SearchParams:
    """A search. Widths of q are in units of reward.

    simulations: nodes added to each tree.
    rule: pozero, puct or gumbel.
    act, search, learn: where POZero takes its policy, in place of visit counts and PUCT: to act, inside
        the tree, as the target of learning. All three are ALL of Grill et al.
    c: of POZero's lambda = c sqrt(N) / (A + N).
    q_floor: least width by which q is normalised at a node, so that a model's noise is not blown up.
    q_ceiling: greatest width; anything further below the best counts as that, so that one collision among
        the children does not hide a small difference between the others.
    dirichlet_fraction, dirichlet_alpha: noise on the root's prior where visits act; none where POZero acts.
    pb_c_init, pb_c_base: of PUCT.
    gumbel_scale: 0 takes the best action, 1 samples.
    max_considered: actions that sequential halving starts with.
    value_scale, visit_offset: of Gumbel's sigma(q) = (visit_offset + max n) value_scale q.
    """

    simulations: int = 25
    rule: Literal['pozero', 'puct', 'gumbel'] = 'pozero'
    act: bool = True
    search: bool = True
    learn: bool = True
    c: float = 1.25
    q_floor: float = 0.0
    q_ceiling: float = math.inf
    dirichlet_fraction: float = 0.25
    dirichlet_alpha: float = 0.3
    pb_c_init: float = 1.25
    pb_c_base: float = 19652.0
    gumbel_scale: float = 1.0
    max_considered: int = 16
    value_scale: float = 0.1
    visit_offset: float = 50.0
    ranges: ClassVar[Ranges] = {
        'simulations': (1, 10_000),
        'c': (1e-6, 1e6),
        'q_floor': (0.0, math.inf),
        'dirichlet_fraction': (0.0, 1.0),
        'dirichlet_alpha': (1e-6, 1e6),
        'pb_c_init': (0.0, 1e6),
        'pb_c_base': (1.0, 1e9),
        'gumbel_scale': (0.0, 1e6),
        'max_considered': (1, 10_000),
        'value_scale': (0.0, 1e6),
        'visit_offset': (0.0, 1e6),
    }

    def __post_init__(self) -> None:
        """Refuse what no search can run with."""
        if self.rule not in RULES:
            raise ParamError(f'rule = {self.rule!r} must be one of {", ".join(RULES)}')
        check_ranges(self)
        check_range(self, q_ceiling=(max(self.q_floor, 1e-6), math.inf))

    def quiet(self) -> SearchParams:
        """The same search without what it explores with, so that at temperature 0 it draws nothing."""
        return replace(self, gumbel_scale=0.0, dirichlet_fraction=0.0)

    @property
    def acts_by_policy(self) -> bool:
        """Whether actions are drawn from the rule's policy rather than from visits."""
        return self.rule == 'gumbel' or (self.rule == 'pozero' and self.act)

    @property
    def learns_policy(self) -> bool:
        """Whether the rule's policy is the target rather than visits."""
        return self.rule == 'gumbel' or (self.rule == 'pozero' and self.learn)

    def compiled(self, actions: int) -> rules.Rule:
        """The rule inside the tree and its constants, for compiled code."""
        plain = self.rule == 'pozero' and not self.search
        constants = (self.c, self.q_floor, self.q_ceiling, self.pb_c_init, self.pb_c_base)
        scales = (self.value_scale, self.visit_offset)
        code = rules.PUCT if plain else RULES[self.rule]
        return rules.Rule(code, actions, *(np.float32(value) for value in constants + scales))


class SearchResult(NamedTuple):
    """What a search found, in arrays of its own."""

    action: IntArray  # [B] taken
    policy: Array32  # [B, A] that the action was drawn from
    target: Array32  # [B, A] to train the policy on; knows nothing of root noise and temperature
    value: Array32  # [B] mean return of the root
    q: Array32  # [B, A] of the root's actions, the mixed value where unvisited
    visits: IntArray  # [B, A]
    prior: Array32  # [B, A] of the network
    best_path: IntArray  # [B, N] the action taken, then the most visited ones; -1 behind the end


class Search:
    """Preallocated trees for up to `batch` rows."""

    def __init__(self, params: SearchParams, batch: int, actions: int, latent: int) -> None:
        """Allocate trees of a root and `params.simulations` nodes over A actions and L latent values."""
        self.params = params
        self.actions = actions
        self.tree = new_tree(batch, params.simulations + 1, actions, latent)
        self.root = new_root(batch, params.simulations, actions)
        self.leaves = new_leaves(batch, latent)
        self.step = new_step(batch, actions, latent)
        self.table = rules.halving_table(min(params.max_considered, actions), params.simulations)
        self.rule = params.compiled(actions)

    def run(
        self,
        model: Model,
        observation: Array32,
        rng: np.random.Generator,
        valid: BoolArray | None = None,
        temperature: float | Array32 = 1.0,
    ) -> SearchResult:
        """Plan from each observation.

        Args:
            model: networks.
            observation: [B, F], no more rows than allocated.
            rng: draws noise and actions.
            valid: [B, A] actions allowed at the root, at least one a row; all where None.
            temperature: [B] or one for all: actions are drawn from policy^(1 / temperature), 0 is greedy.
        """
        batch = len(observation)
        tree, root = _rows(self.tree, slice(batch)), _rows(self.root, slice(batch))
        self._plant(model, observation, rng, valid, tree, root)
        if isinstance(model, NumpyModel):
            self._run_compiled(model, batch)
        else:
            self._run_stages(model, batch)
        conclude(tree, root, self.rule)
        return self._result(tree, root, rng, temperature)

    def _run_compiled(self, model: NumpyModel, batch: int) -> None:
        """Run all simulations of some rows, then of the next, so that their trees stay in the cache."""
        for start in range(0, batch, CHUNK):
            rows = slice(start, min(start + CHUNK, batch))
            buffers = model.reserve(rows.stop - start)
            tree, root = _rows(self.tree, rows), _rows(self.root, rows)
            leaves, step = _rows(self.leaves, rows), _rows(self.step, rows)
            simulate(tree, root, self.rule, leaves, step, model.weights, buffers, model.discount)

    def _run_stages(self, model: Model, batch: int) -> None:
        """Run the simulations around a model that is not compiled."""
        rows = slice(0, batch)
        tree, root, leaves = _rows(self.tree, rows), _rows(self.root, rows), _rows(self.leaves, rows)
        for node in range(1, self.params.simulations + 1):
            descend(tree, root, self.rule, node - 1, leaves)
            grow(tree, node, leaves, model.step(leaves.latent, leaves.action))

    def _plant(
        self,
        model: Model,
        observation: Array32,
        rng: np.random.Generator,
        valid: BoolArray | None,
        tree: Tree,
        root: Root,
    ) -> None:
        """Plant the roots: masked prior, noise, and the schedule of sequential halving."""
        latent, logits, value = model.begin(observation)
        allowed = np.ones(logits.shape, bool) if valid is None else valid
        root.valid[:, : self.actions] = allowed
        root.prior[:, : self.actions] = masked_softmax(logits, allowed)
        root.considered[:] = self.table[np.minimum(allowed.sum(1), len(self.table) - 1)]
        prior = root.prior
        if self.params.rule == 'gumbel':
            root.noise[:, : self.actions] = self.params.gumbel_scale * rng.gumbel(size=logits.shape)
        elif not self.params.acts_by_policy:
            prior = self._noisy(root, rng)
        plant(tree, prior, value, latent)

    def _noisy(self, root: Root, rng: np.random.Generator) -> Array32:
        fraction, alpha = self.params.dirichlet_fraction, self.params.dirichlet_alpha
        noise = np.zeros_like(root.prior)
        noise[:, : self.actions] = rng.dirichlet(np.full(self.actions, alpha), len(noise))
        noise *= root.valid
        noise /= np.maximum(noise.sum(1, keepdims=True), np.finfo(np.float32).tiny)
        return ((1.0 - fraction) * root.prior + fraction * noise).astype(np.float32)

    def _result(
        self, tree: Tree, root: Root, rng: np.random.Generator, temperature: float | Array32
    ) -> SearchResult:
        visits = tree.visits[:, 0, : self.actions].astype(np.int64)
        share = (visits / self.params.simulations).astype(np.float32)
        improved = root.policy[:, : self.actions].copy()
        policy = sharpen(improved if self.params.acts_by_policy else share, temperature)
        action = draw(policy, rng)
        if self.params.rule == 'gumbel':
            action = root.choice.astype(np.int64)
        path = np.empty((len(action), self.params.simulations), np.int64)
        best_path(tree, action, path)
        return SearchResult(
            action=action,
            policy=policy,
            target=improved if self.params.learns_policy else share,
            value=tree.value[:, 0].copy(),
            q=root.q[:, : self.actions].copy(),
            visits=visits,
            prior=root.prior[:, : self.actions].copy(),
            best_path=path,
        )


T = TypeVar('T', Tree, Root, Leaves, Step)


def _rows(arrays: T, rows: slice) -> T:
    return type(arrays)(*(array[rows] for array in arrays))


def masked_softmax(logits: Array32, valid: BoolArray) -> Array32:
    """Probabilities of logits [B, A] over the valid actions, LEAST_PRIOR or more there and 0 elsewhere."""
    top = np.max(logits, axis=1, keepdims=True, where=valid, initial=-np.inf)
    weights = np.exp(np.where(valid, logits - top, -np.inf))
    return np.asarray(np.where(valid, np.maximum(weights / weights.sum(1, keepdims=True), LEAST_PRIOR), 0.0))


def sharpen(policy: Array32, temperature: float | Array32) -> Array32:
    """Raise policies [B, A] to the power 1 / temperature [B]; 0 leaves the greatest alone."""
    heat = np.broadcast_to(np.asarray(temperature, np.float32), len(policy))[:, None]
    if (heat == 1.0).all():
        return policy
    with np.errstate(divide='ignore'):
        logits = np.log(policy / policy.max(1, keepdims=True))
    greedy = (np.arange(policy.shape[1]) == policy.argmax(1)[:, None]).astype(np.float32)
    weights = np.where(heat > 0.0, np.exp(logits / np.where(heat > 0.0, heat, 1.0)), greedy)
    return np.asarray(weights / weights.sum(1, keepdims=True))


def draw(policy: Array32, rng: np.random.Generator) -> IntArray:
    """Draw an action [B] from each policy [B, A]."""
    below = np.cumsum(policy, 1, dtype=np.float64)
    chance = rng.random(len(policy)) * below[:, -1]
    return np.asarray((below <= chance[:, None]).sum(1))
