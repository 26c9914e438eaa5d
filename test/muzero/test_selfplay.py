"""Self-play: what a segment holds, and that it can be resumed and repeated."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from portnav_ros.muzero.inference import NumpyModel, weights_of  # noqa: E402
from portnav_ros.muzero.networks import Network, NetworkParams  # noqa: E402
from portnav_ros.muzero.search import SearchParams  # noqa: E402
from portnav_ros.muzero.selfplay import SelfPlay, SelfPlayParams, value_of  # noqa: E402
from portnav_ros.muzero.targets import RUNNING, TERMINATED, TRUNCATED  # noqa: E402
from portnav_ros.params import ParamError  # noqa: E402
from portnav_ros.sim.scenario_files import load_scenario  # noqa: E402
from portnav_ros.task.actions import ActionParams  # noqa: E402
from portnav_ros.task.env import PortVectorEnv, TaskParams  # noqa: E402

SCENARIO = dataclasses.replace(load_scenario('one_buoy'), time_limit_s=40.0)
TASK = TaskParams(actions=ActionParams(hold=8))


def model(seed=0):
    torch.manual_seed(seed)
    network = Network(TASK.observation.size, 9, 3, NetworkParams(8, (16,), (16,), (16,)))
    torch.nn.init.normal_(network.prediction.value.weight, std=0.5)
    state = {name: tensor.numpy().copy() for name, tensor in network.state_dict().items()}
    return NumpyModel(weights_of(state, 3), 0.98)


def player(seed=0, **params):
    env = PortVectorEnv(3, source=lambda _: SCENARIO, task=TASK)
    params = SelfPlayParams(environments=3, segment=12, **params)
    return SelfPlay(env, params, SearchParams(simulations=4), 8, np.random.SeedSequence(seed))


def assert_same(first, second):
    for name, a, b in zip(first._fields, first, second, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


def test_time_outs_keep_the_value_of_what_was_seen_last():
    networks = model()
    segment = player().play(networks, version=7)
    assert (segment.version == 7).all()
    assert set(np.unique(segment.end)) == {RUNNING, TRUNCATED}
    assert (segment.end == TRUNCATED).sum() == 6  # 12 decisions of 8 s, 40 s an episode, 3 environments
    assert (segment.final_value[segment.end == TRUNCATED] != 0.0).all()
    assert (segment.final_value[segment.end == RUNNING] == 0.0).all()
    np.testing.assert_allclose(segment.policy.sum(-1), 1.0, atol=1e-5)
    values = value_of(networks, segment.features[5])
    assert np.abs(values).max() > 0.0


def test_a_collision_terminates():
    players = player(temperature=(1.0, 1.0))
    ashore = dataclasses.replace(load_scenario('one_buoy'), start=(30.0, 0.0, np.pi), start_speed_mps=4.0)
    players._env._source = lambda _: ashore
    players._features, _ = players._env.reset(seed=0)
    segment = players.play(model(), 0)
    assert TERMINATED in segment.end
    assert (segment.reward[segment.end == TERMINATED] < -900.0).all()
    assert (segment.final_value == 0.0).all()


def test_the_same_seed_plays_the_same():
    assert_same(player(3).play(model(), 0), player(3).play(model(), 0))


def test_a_restored_player_goes_on_alike():
    first, second = player(1), player(2)
    networks = model()
    first.play(networks, 0)
    second.load_state_dict({name: array.copy() for name, array in first.state_dict().items()})
    assert_same(first.play(networks, 1), second.play(networks, 1))
    assert first.statistics.summary() == second.statistics.summary()


def test_a_ladder_that_touches_zero_is_refused():
    with pytest.raises(ParamError, match='temperature'):
        SelfPlayParams(temperature=(0.0, 1.0))
