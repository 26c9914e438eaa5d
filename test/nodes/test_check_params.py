"""Files of parameters, without a graph: every mistake is told, with file and keys."""

from pathlib import Path

import pytest

from portnav_ros.cli import main
from portnav_ros.nodes.check_params import check_file
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.parameter_tables import tables
from portnav_ros.nodes.parameters import defaults_of
from portnav_ros.nodes.preparation import load, prepare, read_configuration
from portnav_ros.nodes.table import NAMES
from portnav_ros.params import ParamError
from portnav_ros.resources import config_path

ROOT = Path(__file__).parents[2]


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding='utf-8')
    return path


def complaints(tmp_path: Path, text: str) -> list[str]:
    """What is said of a file with this text, without the file's name."""
    file = write(tmp_path / 'mine.yaml', text)
    lines = check_file(file)
    assert all(line.startswith(f'{file}: ') for line in lines)
    return [line.removeprefix(f'{file}: ') for line in lines]


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('sim: {neutral_s: 2, rate: 1e1}', []),
        ('bringup: {planer: dwa}', ["bringup: unknown key 'planer'; did you mean 'planner'?"]),
        ('bringup: {rate: 0.0}', ['bringup: rate = 0.0 is outside [0.01, 1000.0]']),
        ('bringup: {planner: mpc}', ["bringup: planner 'mpc' is not one of"]),
        ('pid_controler: {}', ["unknown key 'pid_controler'; did you mean 'pid_controller'?"]),
        ('sim: 3', ['sim: expected a mapping']),
        ('sim: {raet: 1.0}', ["sim: unknown key 'raet'; did you mean 'rate'?"]),
        ('sim: {rate: fast}', ["sim: rate: expected float, got 'fast'"]),
        ('dwa_planner: {vessel: {turn_gain: 0}}', ['dwa_planner: vessel: turn_gain = 0.0 is outside']),
        ('dwa_planner: {vessel.turn_gain: 0}', ['dwa_planner: vessel: turn_gain = 0.0 is outside']),
        ('dwa_planner: {vessel: 1, vessel.turn_gain: 1}', ['dwa_planner: vessel.turn_gain: vessel has']),
        ('dwa_planner: {observation: {layout: maze}}', ["dwa_planner: observation: layout: 'maze' is not"]),
        ('dwa_planner: {preset: raft, age_s: 0}', ['dwa_planner: preset: ', 'dwa_planner: age_s = 0.0 is']),
        ('dwa_planner: {preset: [1]}', ['dwa_planner: preset: expected str']),
        ('sim: {preset: shuttle}', ["sim: unknown key 'preset'"]),
        ('1: {}', ['unknown key 1; known keys: ']),
        (
            'sim: {1: 2, seed: 1e3, rate: .nan}',
            ["sim: unknown key '1'", 'sim: seed: expected int', 'sim: rate = nan is'],
        ),
        ('dwa_planner: {mounting: {yaw_rad: -3.1416}}', []),
        ('sim: {use_sim_time: true, qos_overrides./odom.publisher.depth: 5}', []),
    ],
)
def test_a_configuration_is_checked_to_its_last_key(tmp_path, text, expected):
    found = complaints(tmp_path, text)
    assert [line[: len(start)] for line, start in zip(found, expected, strict=True)] == expected


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('sim: {ros__parameters: {rate: 2.0}}', []),
        ('/**/sim: {ros__parameters: {rate: 0.0}}', ['/**/sim: rate = 0.0 is outside']),
        ('/tug: {sim: {ros__parameters: {rate: 0.0}}}', ['/tug/sim: rate = 0.0 is outside']),
        ('/tug/sim: {ros__parameters: {raet: 1.0}}', ["/tug/sim: unknown key 'raet'; did you mean 'rate'?"]),
        ('sim: {ros__parameters: {scenario: a, chart: b}}', ['/sim: scenario and chart exclude each other']),
        ('sim: {ros__parameters: 3}', ['/sim: expected ros__parameters with']),
        ('sin: {ros__parameters: {}}', ["/sin: unknown node 'sin'; did you mean 'sim'?"]),
        ('sim: {ros__parameters: {}}\nrate: 3', ["/rate: unknown node 'rate'"]),
        ('/**: {ros__parameters: {use_sim_time: true, lock_step: true}}', []),
        (
            '/**: {ros__parameters: {lock_stpe: true}}',
            [f"/** ({', '.join(NAMES)}): unknown key 'lock_stpe'; did you mean 'lock_step'?"],
        ),
    ],
)
def test_a_ros_file_is_checked_by_node(tmp_path, text, expected):
    found = complaints(tmp_path, text)
    assert [line[: len(start)] for line, start in zip(found, expected, strict=True)] == expected


def test_what_only_some_nodes_know_does_not_suit_all(tmp_path):
    found = complaints(tmp_path, '/**: {ros__parameters: {goal_radius_m: 50.0}}')
    assert any(line.startswith('/** (sim): unknown key') for line in found)
    assert not any('dwa_planner' in line.partition(':')[0] for line in found)


def test_what_the_bringup_writes_is_right(tmp_path):
    options = GraphOptions(planner='dwa', difficulty='easy', seed=3)
    prepare(options, {}, load(options), tmp_path)
    assert check_file(tmp_path / 'params.yaml') == []


def test_the_exit_code_tells_whether_there_is_a_mistake(tmp_path, capsys):
    wrong = write(tmp_path / 'wrong.yaml', 'sim: {rate: 0.0, seed: -1}')
    assert main(['check-params', str(config_path('portnav.yaml'))]) == 0
    assert capsys.readouterr().out == ''
    assert main(['check-params', str(config_path('portnav.yaml')), str(wrong), str(tmp_path / 'no')]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(': ')[0] for line in lines] == [str(wrong), str(wrong), str(tmp_path / 'no')]


def test_no_file_is_a_mistake(capsys):
    assert main(['check-params']) == 2
    assert 'name a FILE' in capsys.readouterr().err


def test_the_bringup_refuses_the_same_before_it_starts_anything(tmp_path):
    file = write(tmp_path / 'mine.yaml', 'sim: {raet: 1.0}\ndwa_planner: {age_s: 0.0}')
    with pytest.raises(ParamError) as refused:
        read_configuration(file)
    assert str(refused.value).splitlines() == check_file(file)


def test_the_page_is_what_the_code_declares():
    page = (ROOT / 'docs' / 'parameters.md').read_text(encoding='utf-8')
    assert page == tables(), 'portnav check-params --tables > docs/parameters.md'


def test_a_group_is_the_same_in_every_node():
    groups = [line for line in tables().splitlines() if line.startswith('## Group')]
    assert len(groups) == len(set(groups)) > 0
    assert all(f'## `{name}`' in tables() for name in NAMES)
    assert all(defaults_of(name).autostart for name in NAMES)
