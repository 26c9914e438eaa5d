"""What a run needs before a node starts; what is refused."""

import hashlib
import json
from dataclasses import asdict, replace

import pytest
import yaml

from portnav_ros.charts import read_chart
from portnav_ros.muzero import ModelError
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.preparation import (
    BAG,
    METADATA,
    PARAMETERS,
    environment,
    load,
    make_options,
    prepare,
    read_configuration,
)
from portnav_ros.nodes.table import LOCAL_PLANNERS, OnDeath, graph
from portnav_ros.params import ParamError
from portnav_ros.sim.difficulty import load_vessel

EASY = GraphOptions(planner='dwa', difficulty='easy', seed=3, mode='lock_step')


@pytest.fixture(scope='module')
def scenario():
    return load(EASY)


def write(path, text: str):
    path.write_text(text)
    return path


def test_a_graph_has_one_local_planner():
    for planner in LOCAL_PLANNERS:
        names = [spec.name for spec in graph(planner)]
        assert [name for name in names if name.removesuffix('_planner') in LOCAL_PLANNERS] == [
            f'{planner}_planner'
        ]
        assert {'sim', 'global_planner', 'pid_controller', 'bag_recorder'} < set(names)
    assert 'sim' not in [spec.name for spec in graph('dwa', ('sim',))]


def test_options_are_layered(tmp_path):
    file = write(
        tmp_path / 'mine.yaml', 'bringup: {seed: 5, difficulty: easy}\nsim: {hold_until_plan: false}'
    )
    configuration = read_configuration(file)
    options = make_options(
        configuration, 'mine.yaml', {'seed': 4, 'rate': 2.0}, {'difficulty': 'paper', 'rate': None}
    )
    assert (options.seed, options.rate, options.difficulty) == (5, 2.0, 'paper')
    assert configuration['sim'] == {'hold_until_plan': False}


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('dwa: {}', r"unknown key 'dwa'; known keys: bringup, .*sim"),
        ('sim: 3', 'sim: expected a mapping'),
        ('- 1', 'expected a mapping'),
        ('{', 'not valid YAML'),
    ],
)
def test_a_configuration_that_is_wrong_is_refused_by_file_and_key(tmp_path, text, message):
    with pytest.raises(ParamError, match=rf'mine\.yaml.*{message}'):
        read_configuration(write(tmp_path / 'mine.yaml', text))


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'planer': 'dwa'}, "unknown key 'planer'; did you mean 'planner'"),
        ({'planner': 'mpc'}, 'not one of muzero, dwa'),
        ({'rate': 'fast'}, 'expected float'),
        ({'allow_mismatch': True}, 'allow_mismatch: for the planners muzero and ppo, not for dwa'),
        ({'rate': 0.0}, 'outside'),
        ({'without': ['radar']}, "no node 'radar'"),
        ({'scenario': 'head_on', 'chart': 'a.geojson'}, 'exclude each other'),
    ],
)
def test_options_that_are_wrong_are_refused(values, message):
    with pytest.raises(ParamError, match=f'mine.*{message}'):
        make_options({'bringup': values}, 'mine', {}, {})


def test_the_folder_holds_what_the_nodes_share(tmp_path, scenario):
    commands = prepare(EASY, {'sim': {'publish_goal': False}}, scenario, tmp_path)
    assert read_chart(tmp_path / 'chart.geojson').bounds == pytest.approx(scenario.harbour.bounds, abs=0.01)
    parameters = yaml.safe_load((tmp_path / PARAMETERS).read_text())
    assert set(parameters) == {f'/**/{command.name}' for command in commands}
    sim = parameters['/**/sim']['ros__parameters']
    assert (sim['seed'], sim['lock_step'], sim['publish_goal']) == (3, True, False)
    vessel = parameters['/**/pid_controller']['ros__parameters']['vessel']
    assert vessel['length_m'] == scenario.vessel.length_m
    metadata = json.loads((tmp_path / METADATA).read_text())
    assert json.loads(metadata['goal']) == pytest.approx(scenario.goal)
    assert metadata['planner'] == 'dwa'
    assert 'model_sha256' not in metadata
    assert all(isinstance(value, str) for value in metadata.values())


@pytest.fixture(scope='module')
def fitting(scenario, make_model):
    """A model that was trained for the vessel of the scenario."""
    return make_model(vessel=scenario.vessel)


def test_the_bag_is_told_of_hulls_that_the_sim_moves_and_of_a_sensor_elsewhere(tmp_path, scenario):
    mounting = {'x_m': 40.0, 'yaw_rad': 1.5}
    for name, options, configuration in (
        ('sim', GraphOptions('dwa'), {}),
        ('vessel', GraphOptions('dwa', without=('sim',)), {'dwa_planner': {'mounting': mounting}}),
    ):
        prepare(options, configuration, scenario, tmp_path / name)
    sim, vessel = (json.loads((tmp_path / name / METADATA).read_text()) for name in ('sim', 'vessel'))
    assert json.loads(sim['hulls']) == scenario.traffic.hull.tolist()
    assert 'hulls' not in vessel
    assert 'mounting' not in sim
    assert json.loads(vessel['mounting']) == mounting


def test_the_metadata_names_the_weights(tmp_path, scenario, fitting):
    options = replace(EASY, planner='muzero')
    prepare(options, {'muzero_planner': {'model': str(fitting)}}, scenario, tmp_path)
    metadata = json.loads((tmp_path / METADATA).read_text())
    assert metadata['model_sha256'] == hashlib.sha256(fitting.read_bytes()).hexdigest()


def test_a_learned_planner_sails_with_the_model_of_the_command_line(tmp_path, scenario, make_model):
    file = make_model()
    options = replace(EASY, planner='muzero', model=file, simulations=3, allow_mismatch=True)
    prepare(options, {'muzero_planner': {'model': 'another', 'age_s': 0.4}}, scenario, tmp_path)
    parameters = yaml.safe_load((tmp_path / PARAMETERS).read_text())
    planner = parameters['/**/muzero_planner']['ros__parameters']
    given = {key: planner[key] for key in ('model', 'simulations', 'allow_mismatch', 'age_s')}
    assert given == {'model': str(file), 'simulations': 3, 'allow_mismatch': True, 'age_s': 0.4}
    metadata = json.loads((tmp_path / METADATA).read_text())
    assert metadata['model_sha256'] == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'vessel': {'turn_gain': 0.5}}, 'trained for vessel cemt_i, not cemt_i .turn_gain 0.5 instead of'),
        ({'vessel.turn_gain': 0.5}, 'turn_gain 0.5 instead of'),
        ({'lidar': {'rays': 90}, 'allow_mismatch': True}, 'trained with 180 rays'),
        ({'model': 'nowhere.safetensors'}, r'nowhere\.safetensors: no such model'),
    ],
)
def test_a_model_that_does_not_fit_is_refused_and_nothing_is_written(
    tmp_path, scenario, fitting, changes, reason
):
    options = replace(EASY, planner='muzero')
    configuration = {'muzero_planner': {'model': str(fitting)} | changes}
    with pytest.raises(ModelError, match=reason):
        prepare(options, configuration, scenario, tmp_path / 'run')
    assert not (tmp_path / 'run').exists()
    prepare(replace(options, without=('muzero_planner',)), configuration, scenario, tmp_path / 'run')


def test_the_vessel_of_the_configuration_is_the_one_that_must_fit(tmp_path, scenario, make_ppo_model):
    barge = load_vessel('cemt_va')
    options = replace(EASY, planner='ppo', model=make_ppo_model(vessel=barge))
    with pytest.raises(ModelError, match='trained for vessel cemt_va, not cemt_i'):
        prepare(options, {}, scenario, tmp_path / 'run')
    prepare(options, {'ppo_planner': {'vessel': asdict(barge)}}, scenario, tmp_path / 'run')


def test_a_configuration_changes_one_key_of_many(tmp_path, scenario):
    prepare(EASY, {'dwa_planner': {'vessel': {'turn_gain': 0.5}}}, scenario, tmp_path)
    parameters = yaml.safe_load((tmp_path / PARAMETERS).read_text())
    vessel = parameters['/**/dwa_planner']['ros__parameters']['vessel']
    assert (vessel['turn_gain'], vessel['length_m']) == (0.5, scenario.vessel.length_m)


def test_a_folder_that_holds_a_recording_is_not_touched(tmp_path, scenario):
    (tmp_path / BAG).mkdir()
    with pytest.raises(ParamError, match=r'holds a recording already.*--out'):
        prepare(EASY, {}, scenario, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [BAG]


def test_in_lock_step_the_loop_cannot_lose_a_node(tmp_path, scenario):
    policies = {
        options.mode: {c.name: c.on_death for c in prepare(options, {}, scenario, tmp_path / options.mode)}
        for options in (EASY, GraphOptions(difficulty='easy', mode='real_time'))
    }
    assert policies['lock_step']['dwa_planner'] is OnDeath.END
    assert policies['real_time']['dwa_planner'] is OnDeath.RESTART
    assert policies['lock_step']['bag_recorder'] is OnDeath.GO_ON


def test_a_namespace_reaches_every_node(tmp_path, scenario):
    options = GraphOptions(difficulty='easy', namespace='tug/one/', without=('pid_controller',))
    commands = prepare(options, {}, scenario, tmp_path)
    assert all('__ns:=/tug/one' in command.argv for command in commands)
    assert 'pid_controller' not in [command.name for command in commands]


@pytest.mark.parametrize('namespace', ['my-boat', 'a//b', '1st', 'a b'])
def test_a_namespace_that_ros_would_refuse_is_refused_before_a_node_starts(namespace):
    with pytest.raises(ParamError, match='write names of letters'):
        GraphOptions(namespace=namespace)


@pytest.mark.parametrize('remap', ['odom', 'odom:=', ':=odom', 'a:b:c:=d', 'odom=ship/odometry'])
def test_a_remap_that_renames_nothing_is_refused(remap):
    with pytest.raises(ParamError, match='neither OLD:=NEW nor NODE:OLD:=NEW'):
        GraphOptions(remaps=(remap,))


def test_remaps_reach_every_node(tmp_path, scenario):
    remaps = ('odom:=ship/odometry', 'pid_controller:cmd_actuators:=ship/command')
    commands = prepare(replace(EASY, remaps=remaps), {}, scenario, tmp_path)
    assert all(command.argv[-4:] == ('-r', remaps[0], '-r', remaps[1]) for command in commands)


def test_nodes_get_one_thread_and_stay_on_this_machine(monkeypatch):
    monkeypatch.delenv('OMP_NUM_THREADS', raising=False)
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    assert environment()['OMP_NUM_THREADS'] == '1'
    assert environment()['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SUBNET'
