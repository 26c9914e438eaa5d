import argparse

import numpy as np
import pytest

from portnav_ros.evaluation import benchmark_search, benchmark_search_contender
from portnav_ros.evaluation.benchmark_search_contender import contend, random_state
from portnav_ros.muzero.inference import NumpyModel, weights_of

JOB = {'simulations': 3, 'batch': 2, 'hidden': 8, 'bins': 3, 'repeats': 1}


@pytest.fixture(autouse=True)
def few_decisions(monkeypatch):
    monkeypatch.setattr(benchmark_search_contender, 'SINGLE_DECISIONS', 3)


def test_each_rule_is_timed():
    for name in ('ours', 'ours_puct', 'ours_gumbel'):
        figures = contend(JOB | {'name': name})
        assert set(figures) == {'decisions_per_s', 'batch1_p50_ms', 'batch1_p99_ms'}
        assert min(figures.values()) > 0.0


@pytest.mark.parametrize(('name', 'library'), [('mctx_gumbel', 'mctx'), ('lightzero', 'lzero')])
def test_a_missing_library_is_left_out_with_a_word(name, library, monkeypatch):
    monkeypatch.setitem(benchmark_search_contender.sys.modules, library, None)
    figures = contend(JOB | {'name': name})
    assert list(figures) == ['missing']
    assert 'pip install' in figures['missing']


def test_ratios_and_what_is_left_out(monkeypatch):
    rates = {
        'ours': 900.0,
        'ours_puct': 800.0,
        'ours_gumbel': 700.0,
        'mctx_gumbel': 300.0,
        'mctx_muzero': 100.0,
    }
    latency = {'batch1_p50_ms': 1.0, 'batch1_p99_ms': 2.0}

    def contender(name, _options, _core):
        return {'decisions_per_s': rates[name], **latency} if name in rates else {'missing': 'install it'}

    monkeypatch.setattr(benchmark_search, '_contend', contender)
    monkeypatch.setattr(benchmark_search, 'RELEASED', 'none.safetensors')
    parser = argparse.ArgumentParser()
    benchmark_search.add_arguments(parser)
    figures = benchmark_search.run(parser.parse_args([]))
    assert figures['batch'] == 256
    assert figures['simulations'] == 50
    assert figures['decisions_per_s'] == 900.0
    assert (figures['batch1_p50_ms'], figures['batch1_p99_ms']) == (1.0, 2.0)
    assert (figures['ratio_mctx_gumbel'], figures['ratio_mctx_muzero']) == (3.0, 9.0)
    assert figures['ratio_lightzero'] is None
    assert figures['lightzero_left_out'] == 'install it'


def test_peers_run_the_same_networks():
    """JAX's and torch's values are ours, so that the contenders differ in their search alone."""
    rng = np.random.default_rng(0)
    state = random_state(rng, 20, 16, (32,), 11, (9, 3))
    ours = NumpyModel(weights_of(state, 3), 0.9)
    observation, action = rng.standard_normal((4, 20)).astype(np.float32), np.array([0, 5, 26, 13])
    expected = ours.step(ours.represent(observation), action)
    jax, mctx = pytest.importorskip('jax'), pytest.importorskip('mctx')
    from portnav_ros.evaluation.benchmark_search_peers import JaxNetworks

    networks = JaxNetworks(jax, mctx, jax.tree.map(jax.numpy.asarray, weights_of(state, 3)), 0.9)
    root = networks.root(observation)
    output, latent = networks.recur(None, None, jax.numpy.asarray(action), root.embedding)
    found = latent, output.reward, output.discount, output.prior_logits, output.value
    for theirs, values in zip(found, expected, strict=True):
        np.testing.assert_allclose(theirs, values, rtol=1e-3, atol=1e-2)
