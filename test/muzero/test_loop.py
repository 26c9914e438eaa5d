"""What the parts of a run must have in common."""

import pytest

pytest.importorskip('torch')

from portnav_ros.muzero.loop import Loop, Params
from portnav_ros.params import ParamError, override

TINY = {
    'scenarios': {'testbed': 'one_buoy'},
    'selfplay': {'environments': 4, 'segment': 3},
    'replay': {'capacity': 100, 'warmup': 0},
    'search': {'simulations': 2},
}


def params(**parts):
    return override(override(Params(), TINY, 'test'), parts, 'test')


def test_a_replay_that_never_holds_enough_is_refused():
    unroll = {'learner': {'unroll': 24}}
    assert params(**unroll).least_held == 100
    with pytest.raises(ParamError, match=r'replay\.capacity = 100: 4 environments keep 100 .* needs 104'):
        params(learner={'unroll': 25})
    with pytest.raises(ParamError, match=r'replay\.capacity = 101: .* keep 100 .* needs 101'):
        params(replay={'capacity': 101, 'warmup': 101})
    with pytest.raises(ParamError, match=r'replay\.capacity = 100: .* keep 110 .* needs 330'):
        params(selfplay={'environments': 55})


def test_a_replay_that_just_holds_enough_learns():
    loop = Loop(params(learner={'unroll': 24, 'batch': 2}), seed=0)
    for _ in range(9):
        loop.replay.append(loop.play(loop.model, 0))
    assert loop.updates_due() > 0
    loop.learner.update(loop.draw())


def test_convolutions_need_scans_that_they_fit():
    network = {'scan_channels': [4], 'scan_shape': [2, 12]}
    aligned = {'layout': 'aligned', 'ages': [0, 3], 'sectors': 12}
    assert params(network=network, task={'observation': aligned}).network.scan_channels == (4,)
    with pytest.raises(ParamError, match=r'network\.scan_channels = \(4,\): .*layout = aligned, not stacked'):
        params(network=network)
    with pytest.raises(
        ParamError, match=r'network\.scan_shape = \(2, 12\), but the observation has \(1, 12\)'
    ):
        params(network=network, task={'observation': aligned | {'ages': [0]}})
