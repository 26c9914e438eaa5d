"""Starts and ends in a row: none fails, none is in the way of the next, none leaves a process."""

import argparse
import os

import pytest

from portnav_ros.evaluation import benchmark
from portnav_ros.nodes.domain_lock import hold_domain
from portnav_ros.nodes.faults import benchmark_bringups
from portnav_ros.nodes.faults.benchmark_bringups import bring_up


@pytest.fixture(autouse=True)
def _domain(monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    monkeypatch.setenv('ROS_DOMAIN_ID', '65')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def test_three_in_a_row():
    parser = argparse.ArgumentParser()
    benchmark_bringups.add_arguments(parser)
    figures = benchmark_bringups.run(parser.parse_args(['--count', '3']))
    assert figures['bringups'] == 3
    assert not figures['failed']


def test_a_bringup_that_fails_is_told(tmp_path):
    held = hold_domain(65, '', tmp_path / 'portnav')
    complaint, *_ = bring_up(tmp_path / 'run', 'refused')
    assert 'it did not become active; it ended with code 3' in complaint
    assert 'another portnav graph runs on ROS domain 65' in complaint
    os.close(held)


def test_what_a_part_finds_wrong_makes_the_exit_code_1(monkeypatch, capsys):
    monkeypatch.setattr(benchmark_bringups, 'bring_up', lambda out, mark: ('2 processes were left', 1.0, 2.0))
    parser = argparse.ArgumentParser()
    benchmark.add_arguments(parser)
    assert benchmark.run(parser.parse_args(['bringups', '--count', '1'])) == 1
    assert '2 processes were left' in capsys.readouterr().out
