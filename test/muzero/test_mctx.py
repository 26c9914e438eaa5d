"""PUCT and Gumbel against mctx, an independent implementation: recorded trees, and mctx where installed."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from portnav_ros.muzero.search import Search, SearchParams

GOLDEN = Path(__file__).parent.parent / 'golden' / 'mctx_trees.json'
CASES = json.loads(GOLDEN.read_text()) if GOLDEN.exists() else []
DRAWS = [
    ('puct', 5, 25),
    ('puct', 27, 50),
    ('gumbel', 5, 8),
    ('gumbel', 27, 50),
]  # rule, actions, simulations


def searched(model, observation, valid, rule, simulations, noise):
    params = SearchParams(simulations=simulations, rule=rule, dirichlet_fraction=0.0)
    search = Search(params, len(observation), model.logits.shape[1], 1)
    random = np.random.default_rng(0)
    rng = SimpleNamespace(gumbel=lambda size: noise, dirichlet=random.dirichlet, random=random.random)
    return search, search.run(model, observation, rng, valid)


def with_mctx(model, observation, valid, rule, simulations):
    """Search of mctx; returns parents, actions, visits, weights, value and Gumbel noise as arrays."""
    mctx = pytest.importorskip('mctx', reason='mctx is not installed: pip install mctx')
    import jax
    import jax.numpy as jnp

    tables = (model.logits, model.value, model.reward, model.discount, model.following)
    logits, value, reward, discount, following = map(jnp.array, tables)

    def recurrent(_params, _key, action, state):
        after = following[state, action]
        edge = {'reward': reward[state, action], 'discount': discount[state, action]}
        return mctx.RecurrentFnOutput(prior_logits=logits[after], value=value[after], **edge), after

    state = jnp.array(observation[:, 0].astype(int))
    root = mctx.RootFnOutput(prior_logits=logits[state], value=value[state], embedding=state)
    options = {'num_simulations': simulations, 'invalid_actions': jnp.array(~valid)}
    if rule == 'gumbel':
        options |= {'max_num_considered_actions': min(16, logits.shape[1])}
        output = mctx.gumbel_muzero_policy(None, jax.random.PRNGKey(3), root, recurrent, **options)
    else:
        options |= {'dirichlet_fraction': 0.0}
        output = mctx.muzero_policy(None, jax.random.PRNGKey(3), root, recurrent, **options)
    tree, summary = output.search_tree, output.search_tree.summary()
    noise = tree.extra_data.root_gumbel if rule == 'gumbel' else jnp.zeros_like(root.prior_logits)
    found = {
        'parent': tree.parents[:, 1:],
        'edge': tree.action_from_parent[:, 1:],
        'visits': summary.visit_counts,
        'weights': output.action_weights,
        'value': summary.value,
        'noise': noise,
    }
    if rule == 'gumbel':
        found['action'] = output.action
    return {name: np.array(values) for name, values in found.items()}


def assert_same(search, result, found):
    np.testing.assert_array_equal(search.tree.parent[:, 1:], found['parent'])
    np.testing.assert_array_equal(search.tree.action[:, 1:], found['edge'])
    np.testing.assert_array_equal(result.visits, found['visits'])
    np.testing.assert_allclose(result.policy, found['weights'], atol=1e-6)
    np.testing.assert_allclose(result.value, found['value'], rtol=1e-5, atol=1e-5)
    if 'action' in found:
        np.testing.assert_array_equal(result.action, found['action'])


def drawn(tabular, seed, actions):
    """A random decision process, where to start, and the valid actions."""
    rng = np.random.default_rng(seed)
    model = tabular.random(rng, 12, actions)
    valid = rng.random((2, actions)) < 0.8
    valid[:, 0] = True
    return model, rng.integers(0, 12, (2, 1)).astype(np.float32), valid


def write_golden(tabular):
    cases = []
    for seed, (rule, actions, simulations) in enumerate(DRAWS):
        model, observation, valid = drawn(tabular, seed, actions)
        found = with_mctx(model, observation, valid, rule, simulations)
        tables = {name: getattr(model, name).tolist() for name in ('logits', 'value', 'reward', 'discount')}
        start = {'observation': observation.tolist(), 'valid': valid.tolist()}
        case = {'rule': rule, 'simulations': simulations, **start}
        case['model'] = tables | {'following': model.following.tolist()}
        cases.append(case | {'found': {name: values.tolist() for name, values in found.items()}})
    GOLDEN.write_text(json.dumps(cases, indent=None) + '\n')


@pytest.mark.parametrize('case', CASES, ids=lambda case: f'{case["rule"]}-{case["simulations"]}')
def test_recorded_trees(case, tabular):
    found = {name: np.array(values) for name, values in case['found'].items()}
    model, observation = tabular(**case['model']), np.array(case['observation'], np.float32)
    options = case['rule'], case['simulations'], found['noise']
    assert_same(*searched(model, observation, np.array(case['valid']), *options), found)


def test_every_rule_is_recorded():
    assert [(case['rule'], case['simulations']) for case in CASES] == [(rule, n) for rule, _, n in DRAWS]


@pytest.mark.parametrize(('rule', 'actions', 'simulations'), [('puct', 27, 25), ('gumbel', 5, 25)])
def test_trees_of_mctx_itself(rule, actions, simulations, tabular):
    model, observation, valid = drawn(tabular, 11, actions)
    found = with_mctx(model, observation, valid, rule, simulations)
    assert_same(*searched(model, observation, valid, rule, simulations, found['noise']), found)


@pytest.mark.skipif(
    'PORTNAV_WRITE_GOLDEN' not in os.environ, reason='set PORTNAV_WRITE_GOLDEN to record anew'
)
def test_record(tabular):
    write_golden(tabular)
    assert len(json.loads(GOLDEN.read_text())) == len(DRAWS)
