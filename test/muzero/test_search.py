from types import SimpleNamespace

import numpy as np
import pytest

from portnav_ros.muzero.inference import NumpyModel, weights_of
from portnav_ros.muzero.search import RULES, Search, SearchParams, draw, sharpen
from portnav_ros.params import ParamError

QUIET = {'dirichlet_fraction': 0.0, 'gumbel_scale': 0.0}


def rng(seed=0):
    return np.random.default_rng(seed)


def run(model, starts, params, valid=None, temperature=0.0, seed=0):
    observation = np.array(starts, np.float32)[:, None]
    search = Search(params, len(starts), model.logits.shape[1], 1)
    return search.run(model, observation, rng(seed), valid, temperature)


@pytest.fixture
def chain(tabular):
    """Ten states; action 1 goes on and action 0 stays; the last step pays 100 and ends."""
    states = np.arange(10)
    following = np.column_stack([states, np.minimum(states + 1, 9)])
    reward, discount = np.zeros((10, 2)), np.full((10, 2), 0.9)
    reward[8, 1], discount[8, 1] = 100.0, 0.0
    logits = np.column_stack([np.full(10, 1.0), np.zeros(10)])  # the prior prefers to stay
    return tabular(logits, np.zeros(10), reward, discount, following)


@pytest.mark.parametrize('rule', RULES)
def test_the_optimum_of_a_chain_is_found_against_the_prior(rule, chain):
    result = run(chain, [6, 7, 8], SearchParams(simulations=400, rule=rule, **QUIET))
    assert result.action.tolist() == [1, 1, 1]
    assert (result.target[:, 1] > 0.7).all()  # the prior says 0.27
    assert result.q[2, 1] == pytest.approx(100.0)
    assert result.best_path[0, :3].tolist() == [1, 1, 1]


@pytest.mark.parametrize('rule', RULES)
def test_the_optimum_of_random_processes(rule, tabular):
    """The search's greedy action is worth what value iteration says, from a network that knows nothing."""
    model = tabular.random(rng(5), 8, 4)
    model.logits[:] = 0.0
    model.discount[model.discount > 0.0] = 0.7
    best = np.zeros(8)
    for _ in range(200):
        best = (q := model.reward + model.discount * best[model.following]).max(1)
    model.value[:] = best + rng(1).normal(0.0, 0.1, 8)
    result = run(model, range(8), SearchParams(simulations=300, rule=rule, c=0.3, **QUIET))
    lost = best - q[np.arange(8), result.action]
    assert lost.max() < 0.1
    assert np.ptp(q, axis=1).min() > 0.3


@pytest.mark.parametrize('rule', RULES)
def test_rows_are_independent(rule, tabular):
    model, starts = tabular.random(rng(2), 12, 27), [3, 7, 1]
    params = SearchParams(simulations=40, rule=rule, **QUIET)
    together = run(model, starts, params)
    for i, start in enumerate(starts):
        alone = run(model, [start], params)
        for name in ('visits', 'target', 'q', 'value', 'action', 'best_path'):
            np.testing.assert_array_equal(getattr(together, name)[i], getattr(alone, name)[0])


@pytest.mark.parametrize('rule', RULES)
def test_the_compiled_loop_is_the_stages(rule, network_state):
    """65 rows: more than go through the compiled loop at once; the results of the rows before stay."""
    model = NumpyModel(weights_of(network_state(rng(3)), 3), 0.95)
    stages = SimpleNamespace(begin=model.begin, step=model.step)
    observation = rng(4).standard_normal((65, 20)).astype(np.float32)
    search = Search(SearchParams(simulations=12, rule=rule, **QUIET), 70, 27, 16)
    compiled, plain = (search.run(each, observation, rng()) for each in (model, stages))
    same = (compiled.visits == plain.visits).all(1)
    assert same.mean() > 0.95  # a near tie may fall either way
    for name in ('target', 'q', 'value'):
        ours, theirs = getattr(compiled, name)[same], getattr(plain, name)[same]
        np.testing.assert_allclose(ours, theirs, rtol=1e-3, atol=1e-3)


def test_noise_stays_out_of_the_target(tabular):
    """With one simulation a visit cannot tell noise from prior, and the policy is all but the prior."""
    model = tabular.random(rng(0), 6, 5)
    params = SearchParams(simulations=1, act=False, dirichlet_fraction=1.0, q_floor=1e6)
    results = [run(model, [2], params, seed=seed) for seed in range(20)]
    assert len({int(result.visits[0].argmax()) for result in results}) > 1  # noise moves the search
    for result in results:
        np.testing.assert_allclose(result.target, result.prior, atol=1e-4)
        np.testing.assert_array_equal(result.prior, results[0].prior)


def test_acting_by_policy_adds_no_noise(tabular):
    model = tabular.random(rng(0), 6, 5)
    params = SearchParams(simulations=10, dirichlet_fraction=1.0)
    visits = [run(model, [2], params, seed=seed).visits for seed in range(5)]
    assert all((other == visits[0]).all() for other in visits)


@pytest.mark.parametrize(
    'options', [{'rule': rule, 'act': act} for rule in RULES for act in (True, False)], ids=str
)
def test_a_quiet_search_at_temperature_0_depends_on_no_draw(options, tabular):
    model, starts = tabular.random(rng(0), 12, 27), range(12)
    params = SearchParams(simulations=12, **options)
    first, second = (run(model, starts, params.quiet(), seed=seed) for seed in (0, 1))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)
    loud = [run(model, starts, params, seed=seed) for seed in range(5)]
    differs = any((other.action != loud[0].action).any() for other in loud)
    assert differs == (options != {'rule': 'pozero', 'act': True})


def test_quiet_leaves_pozero_as_it_is(tabular):
    model, params = tabular.random(rng(0), 12, 27), SearchParams(simulations=12)
    for one, other in zip(*(run(model, range(12), each) for each in (params, params.quiet())), strict=True):
        np.testing.assert_array_equal(one, other)


def test_switches_choose_between_policy_and_visits(tabular):
    model = tabular.random(rng(1), 6, 5)
    everything = run(model, [2], SearchParams(rule='pozero'), temperature=1.0)
    np.testing.assert_array_equal(everything.policy, everything.target)
    share = everything.visits / everything.visits.sum()
    assert np.abs(everything.policy - share).max() > 1e-3
    learn = run(model, [2], SearchParams(act=False, search=False, dirichlet_fraction=0.0), temperature=1.0)
    puct = run(model, [2], SearchParams(rule='puct', dirichlet_fraction=0.0), temperature=1.0)
    np.testing.assert_array_equal(learn.visits, puct.visits)
    np.testing.assert_allclose(learn.policy, puct.visits / 25.0, rtol=1e-6)
    np.testing.assert_array_equal(puct.target, puct.policy)
    assert np.abs(learn.target - puct.target).max() > 1e-3


@pytest.mark.parametrize('rule', RULES)
def test_invalid_actions_are_never_taken(rule, tabular):
    model = tabular.random(rng(1), 9, 6)
    valid = np.array([[True, False, True, False, False, True]] * 9)
    result = run(model, range(9), SearchParams(simulations=30, rule=rule), valid, temperature=5.0)
    for name in ('visits', 'policy', 'target', 'prior'):
        assert not getattr(result, name)[~valid].any(), name
    assert valid[np.arange(9), result.action].all()
    assert result.visits.sum() == 9 * 30


@pytest.mark.parametrize('rule', RULES)
def test_results_are_finite_with_extreme_networks(rule, tabular):
    model = tabular.random(rng(1), 9, 6)
    model.logits[:] *= 1000.0
    model.value[:] *= 1e6
    result = run(model, range(9), SearchParams(simulations=30, rule=rule), temperature=1.0)
    for values in result:
        assert np.isfinite(values).all()
    np.testing.assert_allclose(result.target.sum(1), 1.0, rtol=1e-5)


def test_temperature_of_each_row():
    policy = np.array([[0.5, 0.25, 0.25]] * 4, np.float32)
    heat = np.array([0.0, 0.5, 1.0, np.inf], np.float32)
    expected = [[1.0, 0.0, 0.0], [4 / 6, 1 / 6, 1 / 6], [0.5, 0.25, 0.25], [1 / 3, 1 / 3, 1 / 3]]
    np.testing.assert_allclose(sharpen(policy, heat), expected, rtol=1e-5)
    assert sharpen(np.array([[0.0, 1.0]], np.float32), 0.5).tolist() == [[0.0, 1.0]]


def test_actions_are_drawn_in_proportion():
    policy = np.tile(np.array([[0.0, 0.7, 0.0, 0.3]], np.float32), (20_000, 1))
    share = np.bincount(draw(policy, rng()), minlength=4) / 20_000
    assert share[0] == share[2] == 0.0
    assert share[1] == pytest.approx(0.7, abs=0.015)


def test_a_run_repeats_after_another_and_leaves_results_alone(tabular):
    model = tabular.random(rng(1), 9, 6)
    search = Search(SearchParams(), 3, 6, 1)
    starts = np.array([[1.0], [2.0], [3.0]], np.float32)
    first = search.run(model, starts, rng())
    kept = [values.copy() for values in first]
    search.run(model, starts[:2] + 4.0, rng(1))
    for values, before in zip(first, kept, strict=True):
        np.testing.assert_array_equal(values, before)
    for values, again in zip(first, search.run(model, starts, rng()), strict=True):
        np.testing.assert_array_equal(values, again)


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        ({'rule': 'greedy'}, "rule = 'greedy' must be one of pozero, puct, gumbel"),
        ({'simulations': 0}, 'simulations = 0 is outside'),
        ({'q_floor': 10.0, 'q_ceiling': 5.0}, 'q_ceiling = 5.0 is outside'),
        ({'dirichlet_fraction': 1.5}, 'dirichlet_fraction = 1.5 is outside'),
        ({'c': 0.0}, 'c = 0.0 is outside'),
    ],
)
def test_wrong_parameters_are_refused(wrong, message):
    with pytest.raises(ParamError, match=message):
        SearchParams(**wrong)
