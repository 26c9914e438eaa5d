import argparse
import json
import re
import sys
from types import ModuleType

import pytest

from portnav_ros.cli import main
from portnav_ros.evaluation import benchmark, benchmark_world
from portnav_ros.evaluation.provenance import command_line, git_commit, machine


@pytest.fixture
def part(monkeypatch):
    module = ModuleType('portnav_ros.evaluation.benchmark_plan')
    module.add_arguments = lambda parser: parser.add_argument('--rounds', type=int, default=1)
    module.run = lambda arguments: {
        'rounds': arguments.rounds,
        'rate': 123456.7,
        'shares': {'scan': 0.25},
        'unknown': float('nan'),
        'failed': {'scan': 'was lost'} if arguments.rounds == 0 else {},
    }
    monkeypatch.setitem(sys.modules, module.__name__, module)


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    benchmark.add_arguments(parser)
    return benchmark.run(parser.parse_args(list(words)))


def test_a_part_takes_its_options_and_leaves_its_figures(part, tmp_path, capsys):
    file = tmp_path / 'plan.json'
    assert run('plan', '--rounds', '3', '--json', str(file)) == 0
    values = json.loads(file.read_text())
    assert values['rounds'] == 3
    assert values['shares'] == {'scan': 0.25}
    assert values['unknown'] is None
    assert {'processor', 'cores', 'version', 'command'} <= set(values)
    printed = capsys.readouterr().out
    assert '123,457' in printed
    assert re.search(r'failed +none\n', printed)


def test_what_a_part_has_found_wrong_is_told_and_fails(part, capsys):
    assert run('plan', '--rounds', '0') == 1
    assert re.search(r'failed\n +scan +was lost\n', capsys.readouterr().out)


def test_an_unknown_part_or_option_is_refused(part, capsys):
    for words in (('engine',), ('plan', '--laps', '3')):
        with pytest.raises(SystemExit):
            run(*words)
    assert '--laps' in capsys.readouterr().err


@pytest.mark.parametrize(
    'words',
    [
        'plan --pairs 0',
        'plan --clearance nan',
        'plan --seed -1',
        'world --steps 1',
        'world --batch 0',
        'world --ports 0',
        'world --seed -1',
        'search --batch 0',
        'search --hidden 0',
        'search --bins 0',
        'search --repeats 0',
        'search --simulations 0',
        'search --core 100000',
    ],
)
def test_numbers_that_cannot_be_are_refused_by_option(words, capsys):
    assert main(['benchmark', *words.split()]) == 2
    said = capsys.readouterr()
    assert said.err.startswith(f'portnav: error: {words.split()[1]}')
    assert said.out == ''


def test_the_fewest_steps_of_the_world_are_enough():
    parser = argparse.ArgumentParser()
    benchmark_world.add_arguments(parser)
    words = '--difficulty easy --batch 1 --ports 1 --steps 2'
    assert benchmark_world.run(parser.parse_args(words.split()))['steps'] == 2


def test_provenance_of_this_process(monkeypatch):
    monkeypatch.setattr(sys, 'argv', ['/usr/bin/portnav', 'evaluate', '--scenario', 'two words'])
    assert command_line() == "portnav evaluate --scenario 'two words'"
    assert int(machine()['cores']) >= 1
    assert git_commit()
