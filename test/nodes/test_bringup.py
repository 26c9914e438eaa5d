"""How a graph ends, told by exit codes and messages: small scripts stand in for the nodes."""

import argparse
import os
import signal
import sys
from dataclasses import replace

import pytest

from portnav_ros.nodes import bringup
from portnav_ros.nodes.bringup import Exit, add_arguments, options_from, sail
from portnav_ros.nodes.domain_lock import DomainBusyError, hold_domain
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.process import Command
from portnav_ros.nodes.table import OnDeath
from portnav_ros.params import ParamError
from portnav_ros.types import Outcome

READY = """
import os, signal, sys, time
from portnav_ros.nodes.status_pipe import report, report_ready
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
report_ready()
"""
WAIT = READY + 'signal.pause()'
SAIL = READY + 'report(time_s=1.0, distance_m=9.0)\nreport(time_s=2.0, outcome={!r})\nsignal.pause()'
OPTIONS = GraphOptions(mode='lock_step')
NODE = """
import os, signal, time
from dataclasses import dataclass
from pathlib import Path
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import PortNode, run_node
from portnav_ros.nodes.status_pipe import report
from portnav_ros.params import ParamError

@dataclass(frozen=True)
class Params(NodeParams):
    pass

class Stand(PortNode):
    def interrupt(self):
        os.kill(os.getppid(), signal.SIGINT)

    def configure(self):
        {configure}

    def activate(self):
        {activate}

    def deactivate(self):
        print('the end is near', flush=True)
        {deactivate}

raise SystemExit(run_node(lambda: Stand({name!r}, Params())))
"""


@pytest.fixture
def start(monkeypatch, tmp_path):
    """Sail with scripts in the place of nodes."""
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    monkeypatch.setenv('ROS_DOMAIN_ID', '60')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('PORTNAV_TEST_MARK', str(tmp_path))
    monkeypatch.setattr(bringup, 'load', lambda options: None)

    def sail_scripts(said=None, **scripts: str):
        commands = tuple(
            Command(
                name,
                (sys.executable, '-c', script),
                tmp_path / 'log' / f'{name}.log',
                on_death=OnDeath.GO_ON if name == 'bag_recorder' else OnDeath.END,
                finishes=name == 'sim',
                stops_last=name == 'bag_recorder',
            )
            for name, script in scripts.items()
        )
        monkeypatch.setattr(bringup, 'prepare', lambda *_: commands)
        said = [] if said is None else said
        return sail(OPTIONS, {}, tmp_path, said.append, said.append)

    return sail_scripts


@pytest.mark.parametrize(
    ('outcome', 'code'),
    [
        ('SUCCESS', Exit.SUCCESS),
        ('COLLISION_BUOY', Exit.COLLISION),
        ('COLLISION_VESSEL', Exit.COLLISION),
        ('TIMEOUT', Exit.TIMEOUT),
    ],
)
def test_the_exit_code_tells_the_outcome(start, outcome, code):
    said: list = []
    result = start(said, sim=SAIL.format(outcome), pid_controller=WAIT)
    assert (result.code, result.outcome.name, result.time_s) == (code, outcome, 2.0)
    assert result.wall_s > 0.0
    assert {'time_s': 1.0, 'distance_m': 9.0} in [report.values for report in said]


def test_a_sim_that_ends_in_good_order_ends_the_graph(start):
    result = start(sim=READY, pid_controller=WAIT)
    assert (result.code, result.outcome) == (Exit.SUCCESS, Outcome.RUNNING)


def test_a_planner_that_dies_ends_the_graph_with_its_last_words(start):
    dying = READY + 'print("no path left", flush=True)\nos._exit(3)'
    result = start(sim=WAIT, dwa_planner=dying)
    assert result.code == Exit.NODE_DIED
    assert 'dwa_planner ended with code 3' in result.message
    assert 'no path left' in result.message


def test_a_node_that_refuses_its_parameters_is_quoted(start):
    result = start(sim=WAIT, dwa_planner='raise SystemExit("error: unknown key")')
    assert result.code == Exit.NODE_DIED
    assert 'while starting' in result.message
    assert 'error: unknown key' in result.message


@pytest.mark.parametrize('code', [2, 3])
def test_a_node_that_cannot_use_its_input_makes_it_a_mistake(start, code):
    result = start(sim=WAIT, dwa_planner=f'raise SystemExit({code})')
    assert result.code == Exit.MISTAKE
    assert f'ended with code {code} while starting' in result.message


def test_a_recorder_that_fails_is_told_and_the_rest_sails_on(start):
    said: list = []
    failing = READY + 'report(failure="no space left")\nos._exit(1)'
    slow = READY + 'time.sleep(0.5)\nreport(outcome="SUCCESS")\nsignal.pause()'
    assert start(said, sim=slow, bag_recorder=failing).code == Exit.SUCCESS
    lines = [line for line in said if isinstance(line, str)]
    assert 'bag_recorder: no space left' in lines
    assert any('the rest runs on' in line for line in lines)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('phase', ['starting', 'sailing'])
def test_a_signal_ends_every_phase(start, number, phase):
    begin = READY if phase == 'sailing' else 'import os, signal\n'
    result = start(sim=f'{begin}os.kill(os.getppid(), {int(number)})\nsignal.pause()')
    assert result.code == 128 + number
    assert number.name in result.message


@pytest.fixture
def lead(monkeypatch, start, tmp_path):
    """Sail with nodes whose transitions do what a line of Python each says."""

    def sail_nodes(said=None, ready_s=60.0, on_death=OnDeath.END, **nodes: dict[str, str]):
        commands = tuple(
            Command(
                name,
                (sys.executable, '-c', node(name, **lines), '--ros-args', '-p', 'autostart:=false'),
                tmp_path / 'log' / f'{name}.log',
                on_death=on_death,
                managed=True,
            )
            for name, lines in nodes.items()
        )
        monkeypatch.setattr(bringup, 'prepare', lambda *_: commands)
        options, said = replace(OPTIONS, ready_s=ready_s), [] if said is None else said
        return sail(options, {}, tmp_path, said.append, said.append)

    return sail_nodes


def node(name: str, configure='pass', activate='pass', deactivate='pass', process='') -> str:
    return process or NODE.format(name=name, configure=configure, activate=activate, deactivate=deactivate)


@pytest.mark.parametrize(
    ('lines', 'code', 'active'),
    [
        ({'process': 'import os, signal\nos.kill(os.getppid(), 2)\nsignal.pause()'}, 130, False),
        ({'configure': 'self.interrupt(); time.sleep(60)'}, 130, False),
        ({'activate': 'self.interrupt()'}, 130, True),
        ({'configure': 'self.timer(0.1, self.interrupt)'}, 130, True),
        ({'activate': 'report(outcome="SUCCESS")', 'deactivate': 'self.interrupt()'}, 0, True),
    ],
    ids=['starting', 'configuring', 'activating', 'sailing', 'deactivating'],
)
def test_ctrl_c_in_any_state_ends_the_nodes_in_good_order(lead, marked, tmp_path, lines, code, active):
    result = lead(pid_controller={}, sim=lines)
    assert result.code == code
    assert not marked(str(tmp_path))
    logs = {name: (tmp_path / 'log' / f'{name}.log').read_text() for name in ('pid_controller', 'sim')}
    broken = [log for log in logs.values() if 'Traceback' in log]
    assert all(log.endswith('KeyboardInterrupt\n') for log in broken), 'while Python itself starts'
    assert not (active and broken)
    assert ('the end is near' in logs['pid_controller']) == active


def test_a_node_that_died_is_made_active_again(lead, tmp_path):
    said: list = []
    once = f'Path({str(tmp_path / "once")!r})'
    end = f'report(outcome="SUCCESS") if {once}.exists() else ({once}.touch(), os._exit(7))'
    when = f'self.subscribe("managed_nodes_activated", lambda told: told.data and ({end}), always=True)'
    result = lead(said, on_death=OnDeath.RESTART, pid_controller={}, dwa_planner={'configure': when})
    assert (result.code, result.outcome) == (Exit.SUCCESS, Outcome.SUCCESS)
    became_active = [report.node for report in said if 'active_after_s' in getattr(report, 'values', {})]
    assert became_active == ['pid_controller', 'dwa_planner', 'dwa_planner']


def test_what_a_node_refuses_while_configuring_makes_it_a_mistake(lead):
    result = lead(pid_controller={}, sim={'configure': 'raise ParamError("no such port")'})
    assert result.code == Exit.MISTAKE
    assert 'sim ended with code 2 while starting' in result.message
    assert 'no such port' in result.message


def test_a_node_that_hangs_is_named(lead, marked, tmp_path):
    result = lead(ready_s=4.0, sim={'configure': 'time.sleep(60)'})
    assert result.code == Exit.NOT_READY
    assert result.message.startswith('sim is not ready after')
    assert not marked(str(tmp_path))


def test_a_second_graph_on_the_domain_is_refused(start, tmp_path):
    held = hold_domain(60, '', tmp_path / 'portnav')
    with pytest.raises(DomainBusyError, match='ROS domain 60'):
        start(sim=WAIT)
    os.close(held)
    assert start(sim=SAIL.format('SUCCESS')).code == Exit.SUCCESS


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(words)


def test_the_command_line_goes_before_the_configuration(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('bringup: {seed: 5, planner: line_of_sight}')
    options, _ = options_from(parse('--config', str(file), '--rate', '4', '--planner', 'dwa'), {'seed': 1})
    assert (options.seed, options.planner, options.mode, options.rate) == (5, 'dwa', 'real_time', 4.0)
    assert options_from(parse('--lock-step'), {})[0].lock_step


@pytest.mark.parametrize(
    ('words', 'odd'),
    [
        ([], False),
        (['--without', 'sim'], True),
        (['--without', 'sim', '--chart', 'a.geojson'], False),
        (['--without', 'sim', '--scenario', 'crossing'], False),
    ],
)
def test_a_vessel_on_a_random_port_is_warned_of(monkeypatch, tmp_path, capsys, words, odd):
    monkeypatch.setattr(
        bringup, 'sail', lambda *_: bringup.GraphResult(Exit.SUCCESS, Outcome.SUCCESS, '', 0.0, 0.0)
    )
    assert bringup.run(parse('--out', str(tmp_path), *words)) == Exit.SUCCESS
    assert ('no --chart' in capsys.readouterr().err) == odd


def test_an_unknown_key_of_the_configuration_is_refused(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('bringup: {sed: 5}')
    with pytest.raises(ParamError, match=r"mine\.yaml: bringup: unknown key 'sed'; did you mean 'seed'"):
        options_from(parse('--config', str(file)), {})
