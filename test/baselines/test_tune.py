import numpy as np

from portnav_ros.baselines.dwa import DwaParams
from portnav_ros.baselines.tune import draw, halve, success_rate


def test_success_rate_counts_arrivals(canal):
    scenarios = [canal(), canal(time_limit_s=10.0)]

    assert success_rate(DwaParams(), scenarios) == 0.5


def test_blind_weights_come_last(canal):
    scenarios = [canal(buoys=[(x, 0.0, 2.0)]) for x in np.linspace(400.0, 600.0, 8)]
    blind = DwaParams(clearance_weight=0.0, room_weight=0.0)

    trials = halve([blind, blind, blind, DwaParams(), blind], scenarios)

    assert [trial.params for trial in trials] == [DwaParams()]
    assert trials[0].episodes == 8


def test_candidates_come_again_with_the_seed():
    def drawn(seed):
        return [draw(DwaParams(), rng) for rng in [np.random.default_rng(seed)] for _ in range(5)]

    assert drawn(3) == drawn(3)
    assert drawn(3) != drawn(4)
