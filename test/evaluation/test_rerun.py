"""The command that sails an episode again is one that the command line takes, and asks for the same."""

import argparse
import json
import shlex
from dataclasses import asdict
from pathlib import Path

import pytest

from portnav_ros.evaluation import evaluate
from portnav_ros.evaluation.planners import PLANNERS, WITHOUT_NODE, ModelOptions
from portnav_ros.evaluation.rerun import rerun_command
from portnav_ros.evaluation.trial import Trial

MODEL = Path('my model.safetensors')


def words(log):
    """What follows `portnav`, as a shell splits it."""
    portnav, *others = shlex.split(rerun_command(log))
    assert portnav == 'portnav'
    return others


def options(**given):
    return {'options': json.dumps(given, default=str)}


def test_a_log_without_options_has_a_command_too(straight):
    assert rerun_command(straight()) == 'portnav demo --seed 7 --difficulty easy --planner dwa'


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'scenario': 'head_on', 'chart': None}, ['--scenario', 'head_on']),
        ({'model': str(MODEL)}, ['--model', str(MODEL)]),
        ({'allow_mismatch': True}, ['--allow-mismatch']),
        ({'mode': 'real_time'}, ['--real-time']),
        ({'mode': 'real_time', 'rate': 4.0}, ['--rate', '4']),
    ],
)
def test_a_run_of_the_graph_is_repeated_by_the_demo(straight, given, expected):
    pytest.importorskip('rclpy')
    from portnav_ros.nodes import demo

    metadata = options(planner='muzero', difficulty='harbour', **given)
    command, *others = words(straight(metadata=metadata))
    assert command == 'demo'
    assert ' '.join(expected) in ' '.join(others)
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    parsed = parser.parse_args(others)
    assert (parsed.seed, parsed.planner, parsed.difficulty) == (7, 'muzero', 'harbour')


def test_every_planner_has_a_node_or_is_known_to_have_none():
    table = pytest.importorskip('portnav_ros.nodes.table')
    assert set(PLANNERS) == {*WITHOUT_NODE, *table.LOCAL_PLANNERS}


def test_a_configuration_has_to_be_given_again(straight):
    configuration = {'bringup': {'planner': 'dwa'}, 'safety_monitor': {'zone': {'margin_s': 1.0}}}
    metadata = options(planner='dwa', difficulty='easy') | {'configuration': json.dumps(configuration)}
    assert rerun_command(straight(metadata=metadata)).endswith('--config FILE')


@pytest.mark.parametrize(
    'trial',
    [
        Trial('prior', 'paper', model=ModelOptions(MODEL, None, allow_mismatch=True)),
        Trial('ceiling', 'easy', chart=Path('port.geojson')),
        Trial('muzero', 'paper', route='clearance', model=ModelOptions(simulations=8)),
    ],
)
def test_a_planner_without_a_node_is_repeated_by_an_evaluation(straight, trial):
    log = straight(seed=1_000_004, planner=trial.planner, metadata=options(**asdict(trial)))
    command, *others = words(log)
    assert command == 'evaluate'
    parser = argparse.ArgumentParser()
    evaluate.add_arguments(parser)
    parsed = parser.parse_args(others)
    assert (parsed.split, parsed.seed, parsed.episodes) == ('validation', 4, 1)
    assert (parsed.planner, parsed.chart, parsed.route) == (trial.planner, trial.chart, trial.route)
    model = ModelOptions(parsed.model, parsed.simulations, parsed.allow_mismatch)
    assert model == trial.model


@pytest.mark.parametrize(
    'changes', [{'planner': ''}, {'difficulty': ''}, {'metadata': options(without=['sim', 'dwa_planner'])}]
)
def test_no_command_repeats_a_trip_of_a_vessel(straight, changes):
    assert rerun_command(straight(**changes)) == ''
