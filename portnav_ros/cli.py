"""The command line ``portnav``: one table of subcommands, each imported only when it is called."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from typing import NamedTuple

from portnav_ros import __version__

EXIT_ERROR = 2
EXIT_INTERRUPTED = 130


class Command(NamedTuple):
    """A subcommand: its module has ``add_arguments(parser)`` and ``run(arguments) -> int``."""

    module: str
    help: str


COMMANDS = {
    'demo': Command(
        'nodes.demo', 'sail a vessel through a random port or a chart; leaves a bag and a report'
    ),
    'up': Command('nodes.bringup', 'start the whole graph of nodes and keep it running'),
    'run': Command('nodes.run', 'start one node, as `ros2 run portnav_ros NODE` does'),
    'plan': Command('planning.command', 'plan a path on a chart'),
    'evaluate': Command(
        'evaluation.evaluate', 'success rate and other metrics of a planner over many episodes'
    ),
    'train': Command('training_command', 'train a policy by MuZero or PPO; can be stopped and resumed'),
    'average': Command('average_command', 'make one model of the mean weights of several'),
    'reproduce': Command(
        'evaluation.reproduce', "make the paper's figure, table and pictures, and an ablation"
    ),
    'report': Command('evaluation.report', 'write the report of a recorded bag'),
    'benchmark': Command('evaluation.benchmark', 'measure speed, and survive faults and bringups'),
    'check-driver': Command(
        'nodes.check_driver', 'check the driver of a vessel, or the sim, against the contract'
    ),
    'check-params': Command(
        'nodes.check_params', 'find what is wrong in files of parameters, without starting anything'
    ),
    'doctor': Command('doctor', 'check this installation and say how to mend it'),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns the exit code: 0 done, 2 a mistake in the input, 130 interrupted."""
    names = list(sys.argv[1:] if arguments is None else arguments)
    command = _parser().parse_args(names[:1]).command
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _run(command, names[1:])
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except Exception as error:
        message = _explain(error)
        if message is None:
            raise
        print(f'portnav: error: {message}', file=sys.stderr)
        return EXIT_ERROR


def _parser() -> argparse.ArgumentParser:
    table = '\n'.join(f'  {name:12} {command.help}' for name, command in COMMANDS.items())
    parser = argparse.ArgumentParser(
        prog='portnav',
        usage='portnav COMMAND ...',
        description='Autonomous port navigation with ranging sensors.',
        epilog=f'commands:\n{table}\n\n`portnav COMMAND --help` shows the options of one command.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'portnav {__version__}')
    parser.add_argument('command', choices=COMMANDS, metavar='COMMAND', help=argparse.SUPPRESS)
    return parser


def _run(name: str, arguments: Sequence[str]) -> int:
    command = COMMANDS[name]
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # read as numpy loads; all products here are small
    module = importlib.import_module(f'portnav_ros.{command.module}')
    parser = argparse.ArgumentParser(prog=f'portnav {name}', description=command.help)
    module.add_arguments(parser)
    return int(module.run(parser.parse_args(arguments)))


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f'portnav: warning: {message}', file=sys.stderr)


def _explain(error: Exception) -> str | None:
    """One line for a mistake that the user can mend; None for a defect, which keeps its traceback."""
    if isinstance(error, ImportError):
        return _explain_import(error)
    if isinstance(error, OSError) and error.filename:
        return f'{error.filename}: {error.strerror}'
    if isinstance(error, OSError) or type(error).__module__.startswith('portnav_ros.'):
        return str(error)
    return None


def _explain_import(error: ImportError) -> str | None:
    library = (error.name or '').partition('.')[0]
    if library == 'rclpy' or library.endswith('_msgs'):
        return (
            f'{library} is missing: source your ROS 2 Jazzy (`. /opt/ros/jazzy/setup.bash`), '
            "or take it from wheels: pip install 'portnav_ros[ros]'"
        )
    if library in ('torch', 'stable_baselines3', 'tensorboard'):
        return f"{library} is missing: pip install 'portnav_ros[train]'"
    if library in ('portnav_ros', ''):
        return None
    return f'{library} cannot be imported ({error}): pip install portnav_ros, and see `portnav doctor`'
