import numpy as np
import pytest

from portnav_ros.muzero.exponential import exp_negative
from portnav_ros.muzero.inference import NumpyModel, numpy_model, weights_of
from portnav_ros.muzero.layers import expectation
from portnav_ros.task.tracking import TRACK_KNOWN, TRACK_SIZE


def test_exponential():
    x = -np.random.default_rng(0).uniform(0.0, 87.0, 3000).astype(np.float32)
    values = np.array([exp_negative(value) for value in (*x, np.float32(0.0))])
    np.testing.assert_allclose(values, np.exp(np.append(x, 0.0).astype(np.float64)), rtol=4e-7)
    assert 0.0 < exp_negative(np.float32(-np.inf)) < 2e-38


def test_a_rare_disaster_keeps_its_weight():
    atoms = np.array([-1000.0, 0.0, 1000.0], np.float32)
    logits = np.array([9.0, np.log(0.3), np.log(0.7), -30.0], np.float32)  # the first is another head's
    assert expectation(logits, 1, atoms) == pytest.approx(-300.0, abs=0.01)


def test_expectation_of_peaked_and_huge_logits():
    atoms = np.array([-5.0, 2.0, 7.0], np.float32)
    assert expectation(np.array([-1e30, 3e4, -3e4], np.float32), 0, atoms) == pytest.approx(2.0)
    assert expectation(np.full(3, 1e30, np.float32), 0, atoms) == pytest.approx(4.0 / 3.0)


@pytest.mark.parametrize(('hidden', 'alive'), [((32,), True), ((24, 40), False)])
def test_same_as_torch(hidden, alive, network_state):
    pytest.importorskip('torch')
    from portnav_ros.muzero.torch_model import TorchModel, network_of

    rng = np.random.default_rng(1)
    state = network_state(rng, hidden=hidden, alive=alive)
    oracle, model = TorchModel(network_of(state, 9, 3), 0.9), NumpyModel(weights_of(state, 3), 0.9)
    observation, action = rng.standard_normal((5, 20)).astype(np.float32), np.array([0, 26, 4, 13, 22])
    latent = oracle.represent(observation)
    expected = latent, *oracle.predict(latent), *oracle.step(latent, action)
    found = model.represent(observation), *model.predict(latent), *model.step(latent, action)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-4)
    assert np.ptp(found[5]) > 0.01 if alive else (found[5] == np.float32(0.9)).all()  # discount


def test_a_missing_array_is_named(network_state):
    state = network_state(np.random.default_rng(0))
    for name in ('dynamics.body.0.linear.weight', 'prediction.value.bias', 'value_atoms'):
        with pytest.raises(KeyError, match=name):
            weights_of({key: array for key, array in state.items() if key != name}, 3)


def test_steps_do_not_share_memory(network_state):
    model = NumpyModel(weights_of(network_state(np.random.default_rng(0)), 3), 1.0)
    first = model.step(np.zeros((2, 16), np.float32), np.array([0, 1]))
    before = [array.copy() for array in first]
    model.step(np.ones((2, 16), np.float32), np.array([5, 9]))
    for array, copy in zip(first, before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_convolutions_are_those_of_torch():
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import Network, NetworkParams

    torch.manual_seed(0)
    params = NetworkParams(latent=8, scan_channels=(6, 10), scan_shape=(2, 24))
    oracle = Network(2 * 24 + 5, 9, 3, params)
    state = {name: tensor.numpy() for name, tensor in oracle.state_dict().items()}
    observation = np.random.default_rng(0).standard_normal((3, 53)).astype(np.float32)
    model = numpy_model(state, 3, 0.9)
    with torch.no_grad():
        expected = oracle.represent(torch.from_numpy(observation))
    np.testing.assert_allclose(model.represent(observation), expected, rtol=1e-4, atol=1e-5)


def test_tracks_are_seen_as_torch_does():
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import Network, NetworkParams

    torch.manual_seed(0)
    params = NetworkParams(
        8, scan_channels=(6,), scan_shape=(2, 24), tracks=3, context_hidden=(20, 16), track_hidden=(12, 14)
    )
    oracle = Network(2 * 24 + 5 + 3 * TRACK_SIZE, 9, 3, params)
    state = {name: tensor.numpy() for name, tensor in oracle.state_dict().items()}
    observation = np.random.default_rng(0).standard_normal((5, 89)).astype(np.float32)
    known = observation[:, 53:].reshape(5, 3, TRACK_SIZE)[:, :, TRACK_KNOWN]
    known[0], known[1] = -1.0, 0.5  # none, and all
    model = numpy_model(state, 3, 0.9)
    with torch.no_grad():
        expected = oracle.represent(torch.from_numpy(observation))
    np.testing.assert_allclose(model.represent(observation), expected, rtol=1e-4, atol=1e-5)
    alone = np.concatenate([model.represent(row[None]) for row in observation])
    np.testing.assert_allclose(alone, expected, rtol=1e-4, atol=1e-5)


def test_neither_the_order_of_tracks_nor_what_unknown_ones_hold_matters():
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import Network, NetworkParams

    torch.manual_seed(0)
    oracle = Network(5 + 3 * TRACK_SIZE, 9, 3, NetworkParams(8, tracks=3))
    model = numpy_model({name: tensor.numpy() for name, tensor in oracle.state_dict().items()}, 3, 0.9)
    observation = np.random.default_rng(0).standard_normal((1, 5 + 3 * TRACK_SIZE)).astype(np.float32)
    tracks = observation[:, 5:].reshape(3, TRACK_SIZE)
    tracks[:, TRACK_KNOWN] = 1.0, 0.0, 0.4
    before = model.represent(observation)
    tracks[:] = tracks[[2, 0, 1]]
    tracks[2, :TRACK_KNOWN] = 5.0
    np.testing.assert_allclose(model.represent(observation), before, rtol=1e-4, atol=1e-5)
    tracks[0, 0] += 1.0
    assert np.abs(model.represent(observation) - before).max() > 1e-3


def test_a_turn_of_the_scan_turns_what_the_convolutions_say():
    torch = pytest.importorskip('torch')
    from portnav_ros.muzero.networks import NetworkParams, Scan

    torch.manual_seed(1)
    scan = Scan(NetworkParams(scan_channels=(4, 7), scan_shape=(2, 24)))
    seen = torch.randn(1, 2, 24)
    turned = torch.roll(seen, 3, dims=2)
    said, after = (scan(values.reshape(1, -1)).detach().view(7, 8) for values in (seen, turned))
    torch.testing.assert_close(torch.roll(said, 1, dims=1), after)
