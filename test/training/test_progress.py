"""The bars that a run shows."""

import functools

import pytest
from tqdm import tqdm

from portnav_ros.training import progress
from portnav_ros.training.progress import Progress, preparing


@pytest.fixture(autouse=True)
def every_update_is_shown(monkeypatch):
    monkeypatch.setattr(progress, 'tqdm', functools.partial(tqdm, mininterval=0.0))


def test_a_last_segment_that_goes_too_far_ends_at_100_percent(capsys):
    bar = Progress(100, title='MuZero')
    bar.show(60, {'success': None})
    bar.show(130, {'success': 0.5, 'reward': -3.0})
    bar.close()
    last = capsys.readouterr().err.split('\r')[-1]
    assert 'MuZero: 100%' in last
    assert 'success 50%, reward -3' in last


def test_a_run_that_is_over_shows_its_end(capsys):
    Progress(100, 130).close()
    assert '100%' in capsys.readouterr().err


def test_worlds_are_counted_as_they_are_made(capsys, monkeypatch):
    monkeypatch.setattr(progress, 'DELAY_S', 0.0)
    with preparing('ports') as ready:
        for count in (1, 2, 3):
            ready(count, 3)
    said = capsys.readouterr().err
    assert all(f'| {count}/3 [' in said for count in (1, 2, 3))


def test_worlds_that_are_made_at_once_show_no_bar(capsys):
    with preparing('ports') as ready:
        ready(1, 1)
    assert not capsys.readouterr().err.strip()
