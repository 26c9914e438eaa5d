"""The launch file, with stand-ins for launch itself, which has no wheel."""

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest
import yaml

from portnav_ros.muzero import ModelError
from portnav_ros.nodes.table import graph
from portnav_ros.params import ParamError
from portnav_ros.resources import share_directory


class Action:
    def __init__(self, *arguments, **keywords):
        self.arguments = arguments
        self.keywords = keywords


@pytest.fixture
def launch(monkeypatch, tmp_path):
    """Call the launch file with some launch arguments; returns the keywords of each Node action."""
    for name, members in {
        'launch': ('LaunchContext', 'LaunchDescription'),
        'launch.actions': ('DeclareLaunchArgument', 'OpaqueFunction', 'Shutdown'),
        'launch_ros': (),
        'launch_ros.actions': ('Node',),
    }.items():
        module = ModuleType(name)
        for member in members:
            setattr(module, member, type(member, (Action,), {}))
        monkeypatch.setitem(sys.modules, name, module)

    def call(**given):
        namespace = runpy.run_path(str(share_directory() / 'launch/portnav.launch.py'))
        (*declared, opaque) = namespace['generate_launch_description']().arguments[0]
        text = {action.arguments[0]: action.keywords['default_value'] for action in declared}
        assert set(given) <= set(text)
        context = SimpleNamespace(launch_configurations=text | {'out': str(tmp_path / 'out')} | given)
        return [node.keywords for node in opaque.keywords['function'](context)]

    return call


def test_launch_starts_the_nodes_of_the_table(launch):
    nodes = launch(planner='line_of_sight', difficulty='easy', seed='3')
    table = graph('line_of_sight')
    assert [node['executable'] for node in nodes] == [spec.name for spec in table]
    assert [node['name'] for node in nodes] == [spec.name for spec in table]
    assert {node['package'] for node in nodes} == {'portnav_ros'}


def test_launch_writes_the_parameters_that_its_nodes_read(launch):
    nodes = launch(planner='dwa', difficulty='easy', seed='3', mode='lock_step')
    (file,) = {node['parameters'][0] for node in nodes}
    with open(file, encoding='utf-8') as stream:
        parameters = yaml.safe_load(stream)
    assert parameters['/**/sim']['ros__parameters']['seed'] == 3
    assert parameters['/**/sim']['ros__parameters']['lock_step'] is True


def test_the_death_of_a_node_ends_or_restarts(launch):
    nodes = {node['name']: node for node in launch(planner='dwa', difficulty='easy')}
    assert nodes['sim']['on_exit'] is not None
    assert not nodes['sim']['respawn']
    assert nodes['pid_controller']['respawn']
    assert nodes['pid_controller']['respawn_max_retries'] > 0
    assert nodes['bag_recorder']['on_exit'] is None


def test_a_safety_monitor_that_may_have_been_told_to_stop_is_not_started_again(launch):
    nodes = {node['name']: node for node in launch(planner='dwa', difficulty='easy')}
    assert not nodes['safety_monitor']['respawn']
    assert nodes['safety_monitor']['on_exit'] is not None


def test_remaps_of_the_configuration_reach_every_node(launch, tmp_path):
    config = tmp_path / 'mine.yaml'
    config.write_text('bringup: {remaps: ["odom:=ship/odometry"]}')
    nodes = launch(planner='dwa', difficulty='easy', config=str(config))
    assert all(node['ros_arguments'] == ['-r', 'odom:=ship/odometry'] for node in nodes)


def test_a_real_vessel_takes_the_place_of_the_sim(launch):
    nodes = launch(difficulty='easy', planner='dwa', without='[sim]', record='false')
    names = ['pid_controller', 'safety_monitor', 'dwa_planner', 'global_planner']
    assert [node['name'] for node in nodes] == names


def test_a_model_must_fit_unless_it_need_not(launch):
    with pytest.raises(ModelError, match='trained for vessel'):
        launch(planner='muzero', difficulty='harbour')
    nodes = launch(planner='muzero', difficulty='harbour', allow_mismatch='true')
    assert 'muzero_planner' in {node['name'] for node in nodes}
    with pytest.raises(ModelError, match='nowhere'):
        launch(planner='muzero', model='nowhere.safetensors')


def test_a_mistake_is_refused(launch):
    with pytest.raises(ParamError, match='planner'):
        launch(planner='captain')
