"""Means between two lines of metrics."""

import json

from portnav_ros.training.running_means import RunningMeans


def test_names_are_averaged_apart_and_forgotten_when_taken():
    means = RunningMeans()
    means.add({'a': 1.0, 'b': 10.0})
    means.add({'a': 3.0})
    assert means.take() == {'a': 2.0, 'b': 10.0}
    assert means.take() == {}


def test_a_checkpoint_through_json_changes_no_bit():
    first, second = RunningMeans(), RunningMeans()
    first.add({'a': 0.1})
    first.add({'a': 0.2})
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    for means in (first, second):
        means.add({'a': 1e-17})
    assert first.take() == second.take()
