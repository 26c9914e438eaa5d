"""What a packager looks at: one version, one list of executables, a pin and a reason for each dependency."""

import re
import runpy
import sys
from xml.etree import ElementTree

import pytest
import setuptools

import portnav_ros
from portnav_ros.nodes.table import NAMES
from portnav_ros.resources import share_directory

ROOT = share_directory()


@pytest.fixture
def setup_arguments(monkeypatch):
    """Arguments that setup.py gives to setuptools when called with a command."""

    def call(command):
        captured = {}
        monkeypatch.setattr(setuptools, 'setup', lambda **keywords: captured.update(keywords))
        monkeypatch.setattr(sys, 'argv', ['setup.py', command])
        monkeypatch.chdir(ROOT)
        runpy.run_path(str(ROOT / 'setup.py'))
        return captured

    return call


def requirement_name(requirement):
    return re.split(r'[\[<>=~! ]', requirement)[0].lower()


def test_one_version_everywhere(setup_arguments):
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    changes = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    version = portnav_ros.__version__
    assert package.get('format') == '3'
    assert package.findtext('version') == setup_arguments('bdist_wheel')['version'] == version
    assert re.search(rf'^{re.escape(version)} ', changes, flags=re.MULTILINE)


def test_package_is_built_by_ament_python():
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.findtext('export/build_type') == 'ament_python'
    assert package.findtext('name') == portnav_ros.__name__
    assert (ROOT / 'resource' / portnav_ros.__name__).is_file()


@pytest.mark.parametrize('command', ['install', 'develop'])
def test_colcon_gets_a_script_for_each_node(setup_arguments, command):
    scripts = setup_arguments(command)['entry_points']['console_scripts']
    assert [script.partition(' ')[0] for script in scripts] == ['portnav', *NAMES]
    assert all(
        f'portnav_ros.nodes.{name}:main' in script for name, script in zip(NAMES, scripts[1:], strict=True)
    )


@pytest.mark.parametrize('command', ['bdist_wheel', 'editable_wheel', 'egg_info'])
def test_pip_gets_one_script(setup_arguments, command):
    scripts = setup_arguments(command)['entry_points']['console_scripts']
    assert scripts == ['portnav = portnav_ros.cli:main']


def test_every_config_file_is_installed(setup_arguments):
    installed = {name for _, names in setup_arguments('install')['data_files'] for name in names}
    present = {str(path.relative_to(ROOT)) for path in (ROOT / 'config').rglob('*') if path.is_file()}
    assert present <= installed
    assert present


def test_every_dependency_is_pinned_and_explained(setup_arguments):
    keywords = setup_arguments('install')
    required = keywords['install_requires'] + [
        name for extra in keywords['extras_require'].values() for name in extra
    ]
    pins = (ROOT / 'constraints.txt').read_text(encoding='utf-8')
    pinned = {line.partition('==')[0].lower() for line in pins.splitlines() if '==' in line}
    assert {requirement_name(name) for name in required} <= pinned
    reasons = (ROOT / 'docs/installation.md').read_text(encoding='utf-8')
    for name in required:
        assert f'| `{requirement_name(name)}' in reasons, f'{name}: no reason in docs/installation.md'


def test_installing_for_ros_pulls_no_torch(setup_arguments):
    keywords = setup_arguments('install')
    light = (
        keywords['install_requires'] + keywords['extras_require']['ros'] + keywords['extras_require']['test']
    )
    assert not {requirement_name(name) for name in light} & {'torch', 'stable-baselines3', 'tensorboard'}
