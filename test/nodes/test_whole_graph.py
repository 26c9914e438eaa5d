"""The graph as the user starts it: repeats itself bit for bit, and leaves a bag and no process."""

import fcntl
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from portnav_ros.evaluation.bag_episode import read_episode
from portnav_ros.nodes import preparation
from portnav_ros.nodes.bringup import Exit, sail
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.resources import config_path
from portnav_ros.types import Outcome

MARK = 'PORTNAV_TEST_MARK'
TIME_LIMIT_S = 30.0


@pytest.fixture(scope='module')
def short_difficulty(tmp_path_factory):
    """Difficulty easy, out of time after half a minute."""
    values = yaml.safe_load(config_path('difficulties', 'easy.yaml').read_text())
    file = tmp_path_factory.mktemp('difficulty') / 'short.yaml'
    file.write_text(yaml.safe_dump(values | {'time_limit_s': TIME_LIMIT_S}))
    return str(file)


@pytest.fixture(autouse=True)
def _domain(monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path / 'runtime'))
    monkeypatch.setenv('ROS_DOMAIN_ID', '63')


def test_equal_seeds_give_equal_bags(short_difficulty, tmp_path, monkeypatch):
    monkeypatch.setattr(preparation, 'git_commit', lambda: 'abc')
    options = GraphOptions(planner='line_of_sight', difficulty=short_difficulty, seed=3, mode='lock_step')
    said: list = []
    for name in ('one', 'two'):
        result = sail(options, {}, tmp_path / name, said.append, said.append)
        assert (result.code, result.outcome) == (Exit.TIMEOUT, Outcome.TIMEOUT), result.message
    bags = [(tmp_path / name / 'bag' / 'bag.db3').read_bytes() for name in ('one', 'two')]
    assert bags[0] == bags[1]
    log = read_episode(tmp_path / 'one')
    assert log.outcome is Outcome.TIMEOUT
    assert len(log) == TIME_LIMIT_S / 0.05 + 1
    assert not log.metadata.get('lost')
    assert any(getattr(item, 'values', {}).get('distance_m') for item in said)


def start_demo(folder: Path, difficulty: str, mark: str) -> subprocess.Popen:
    """Start a demo at the pace of the clock and wait until it sails."""
    words = (
        'demo',
        '--planner',
        'dwa',
        '--difficulty',
        difficulty,
        '--seed',
        '3',
        '--real-time',
        '--out',
        str(folder),
    )
    process = subprocess.Popen(
        (sys.executable, '-m', 'portnav_ros', *words),
        stderr=subprocess.PIPE,
        env=os.environ | {MARK: mark},
        text=True,
    )
    assert process.stderr is not None
    seen = ''
    while 't = 2 s' not in seen:
        character = process.stderr.read(1)
        assert character, seen
        seen += character
    return process


def test_ctrl_c_leaves_a_readable_bag_and_no_process(short_difficulty, tmp_path, marked):
    process = start_demo(tmp_path, short_difficulty, 'interrupted')
    process.send_signal(signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 128 + signal.SIGINT
    assert f'portnav report {tmp_path}' in said
    assert not marked('interrupted')
    log = read_episode(tmp_path)
    assert log.outcome is Outcome.RUNNING
    assert log.time_s[-1] >= 2.0


def test_no_process_survives_a_killed_demo(short_difficulty, tmp_path, marked):
    process = start_demo(tmp_path, short_difficulty, 'killed')
    assert len(marked('killed')) >= 6
    process.kill()
    process.communicate(timeout=60)
    with (tmp_path / 'runtime' / 'portnav' / 'domain-63-.lock').open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # which the guardian gives back when all have ended
    assert not marked('killed')
    assert read_episode(tmp_path).time_s[-1] > 0.0
