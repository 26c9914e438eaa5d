import json
import os
import shutil
from pathlib import Path

import pytest

from portnav_ros import cli, doctor
from portnav_ros.params import ParamError
from portnav_ros.resources import model_path


def test_this_installation_is_fit_to_sail(tmp_path, capsys):
    file = tmp_path / 'doctor.json'
    assert cli.main(['doctor', '--json', str(file)]) == 0
    findings = json.loads(file.read_text(encoding='utf-8'))
    assert {'python', 'numpy', 'ompl', 'data files', 'model muzero', 'round trip'} <= {
        finding['check'] for finding in findings
    }
    assert all(finding['status'] == 'ok' or finding['mend'] for finding in findings)
    assert 'ready to sail' in capsys.readouterr().out


def test_json_on_standard_output(capsys):
    cli.main(['doctor', '--json'])
    assert isinstance(json.loads(capsys.readouterr().out), list)


def test_one_failure_sets_the_exit_code(monkeypatch, capsys):
    monkeypatch.setenv('ROS_DOMAIN_ID', 'harbour')
    assert cli.main(['doctor']) == 1
    assert '-> set a number from 0 to 101' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('version', 'status'), [((3, 10), 'fail'), ((3, 11), 'ok'), ((3, 12), 'ok'), ((3, 13), 'warn')]
)
def test_python(version, status):
    assert doctor.check_python(version).status == status


def test_missing_library_names_the_command():
    finding = doctor.check_library('no_such_library', 'no-such-library')
    assert finding.status == 'fail'
    assert finding.mend == 'pip install -c constraints.txt no-such-library'


def test_missing_data():
    def find(*parts):
        raise ParamError('difficulties: no such file')

    assert doctor.check_data(find).status == 'fail'


def test_the_released_model_is_whole():
    (finding,) = doctor.check_models(model_path)
    assert (finding.check, finding.status) == ('model muzero', 'ok')
    assert 'sha256' in finding.found


@pytest.mark.parametrize(
    ('damage', 'reason'),
    [
        (lambda folder: (folder / 'muzero.json').unlink(), 'no card to the model'),
        (lambda folder: (folder / 'muzero.safetensors').write_bytes(b'x'), 'sha256'),
        (lambda folder: (folder / 'muzero.json').write_text('{"schema": 9}'), 'schema 9'),
    ],
)
def test_a_damaged_model_is_named(tmp_path, damage, reason):
    for file in model_path().iterdir():
        shutil.copy(file, tmp_path)
    damage(tmp_path)
    (finding,) = doctor.check_models(lambda: tmp_path)
    assert (finding.status, reason in finding.found) == ('fail', True)
    assert 'take muzero.safetensors and its card again' in finding.mend


def test_no_model_is_a_warning(tmp_path):
    (finding,) = doctor.check_models(lambda: tmp_path)
    assert (finding.status, str(tmp_path) in finding.found) == ('warn', True)


def test_kernel_cache(tmp_path, monkeypatch):
    assert doctor.check_kernel_cache(tmp_path, {}).status == 'ok'
    missing = {'NUMBA_CACHE_DIR': str(tmp_path / 'none')}
    assert doctor.check_kernel_cache(tmp_path, missing).status == 'warn'


@pytest.mark.parametrize(
    ('environment', 'wheels', 'status'),
    [
        ({}, True, 'ok'),
        ({'ROS_DISTRO': 'jazzy'}, False, 'ok'),
        ({'ROS_DISTRO': 'jazzy'}, True, 'warn'),
        ({'ROS_DISTRO': 'humble'}, True, 'fail'),
        ({}, False, 'warn'),
    ],
)
def test_one_ros_at_a_time(monkeypatch, environment, wheels, status):
    monkeypatch.setattr(doctor, '_has_distribution', lambda name: wheels)
    finding = doctor.check_ros_distro(environment)
    assert finding.status == status
    assert bool(finding.mend) == (status != 'ok')


@pytest.mark.parametrize(
    ('text', 'status'),
    [('0', 'ok'), ('101', 'ok'), ('', 'ok'), ('102', 'warn'), ('233', 'fail'), ('-1', 'fail')],
)
def test_domain(text, status):
    assert doctor.check_domain({'ROS_DOMAIN_ID': text}).status == status


@pytest.mark.parametrize(('value', 'status'), [('LOCALHOST', 'ok'), ('OFF', 'fail'), ('localhost', 'fail')])
def test_discovery(value, status):
    assert doctor.check_discovery({'ROS_AUTOMATIC_DISCOVERY_RANGE': value}).status == status


def test_no_discovery_range_is_fine():
    assert doctor.check_discovery({}).status == 'ok'


def test_no_shared_memory(tmp_path):
    assert doctor.check_shared_memory(tmp_path / 'none').status == 'warn'
    assert doctor.check_shared_memory(Path('/')).check == 'shared memory'


def test_broken_middleware_is_reported():
    pytest.importorskip('rclpy')
    finding = doctor.check_loopback({**os.environ, 'RMW_IMPLEMENTATION': 'rmw_of_nobody'})
    assert finding.status == 'fail'
    assert 'RMW_IMPLEMENTATION' in finding.mend
