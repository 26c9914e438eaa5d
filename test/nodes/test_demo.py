"""The demo: progress while it sails, and what is said at the end."""

import pytest

from portnav_ros import cli
from portnav_ros.nodes import demo
from portnav_ros.nodes.bringup import GraphResult
from portnav_ros.nodes.supervisor import Report
from portnav_ros.types import Outcome


def report(time_s: float, distance_m: float) -> Report:
    return Report('sim', {'time_s': time_s, 'distance_m': distance_m, 'speed_mps': 4.0, 'outcome': 'RUNNING'})


def test_the_bar_shows_distance_speed_and_time(capsys):
    with demo.ProgressBar() as bar:
        bar.follow(Report('pid_controller', {'ready': True}))
        for time_s, distance_m in ((0.0, 800.0), (1.0, 810.0), (60.0, 200.0)):
            bar.follow(report(time_s, distance_m))
        bar.say('a line')
    shown = capsys.readouterr().err
    assert '600/800 m' in shown
    assert '4.0 m/s, t = 60 s' in shown
    assert 'x real time' in shown
    assert 'a line' in shown


@pytest.mark.parametrize('message', ['stopped by SIGINT', 'pid_controller died'])
def test_an_unfinished_episode_tells_where_the_bag_is(tmp_path, capsys, message):
    result = GraphResult(130, Outcome.RUNNING, message, 12.0, float('nan'))
    assert demo._finish(result, tmp_path) == 130
    said = capsys.readouterr().err
    assert message in said
    assert f'portnav report {tmp_path}' in said


def test_a_model_of_another_vessel_is_refused_before_a_node_starts(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    assert cli.main(['demo', '--scenario', 'head_on', '--out', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert 'trained for vessel cemt_va, not cemt_iv' in said
    assert said.count('\n') == 1
    assert not (tmp_path / 'out').exists()
