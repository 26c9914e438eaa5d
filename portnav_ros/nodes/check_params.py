"""``portnav check-params FILE...``: what is wrong in files of parameters, without starting anything."""

from __future__ import annotations

import argparse
from pathlib import Path

from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.parameter_files import check_configuration, check_ros, is_ros
from portnav_ros.nodes.parameter_tables import tables
from portnav_ros.nodes.preparation import BRINGUP
from portnav_ros.params import ParamError, read_yaml

WRONG = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare files and tables."""
    parser.add_argument(
        'files',
        nargs='*',
        type=Path,
        metavar='FILE',
        help='YAML as `portnav up --config` reads it, or with ros__parameters as ROS does',
    )
    parser.add_argument(
        '--tables', action='store_true', help='print all parameters as docs/parameters.md has them'
    )


def run(arguments: argparse.Namespace) -> int:
    """Print one line for each mistake; returns 2 where there is one."""
    if arguments.tables:
        print(tables(), end='')
    elif not arguments.files:
        raise ParamError('name a FILE, or give --tables')
    found = [line for file in arguments.files for line in check_file(file)]
    for line in found:
        print(line)
    return WRONG if found else 0


def check_file(file: Path) -> list[str]:
    """Say what is wrong in a file of either kind, one line each."""
    try:
        values = read_yaml(file)
    except ParamError as error:
        return [str(error)]
    if is_ros(values):
        return check_ros(values, str(file))
    return check_configuration(values, str(file), {BRINGUP: GraphOptions()})
