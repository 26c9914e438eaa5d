"""``portnav run NODE``: start one node of the graph, as ``ros2 run portnav_ros NODE`` does."""

from __future__ import annotations

import argparse
import importlib
import sys

from portnav_ros.nodes.parameter_tables import table_of
from portnav_ros.nodes.table import NAMES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the node's name; the rest of the line is the node's own."""
    parser.add_argument('node', choices=NAMES, metavar='NODE', help=', '.join(NAMES))
    parser.add_argument(
        'arguments',
        nargs=argparse.REMAINDER,
        metavar='...',
        help='for the node, e.g. --ros-args -p seed:=3 -r scan:=lidar/scan',
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the node in this process until it ends, or tell its parameters; returns the exit code."""
    if {'-h', '--help'} & set(arguments.arguments):
        usage = f'usage: portnav run {arguments.node} --ros-args -p NAME:=VALUE ... -r OLD:=NEW ...'
        print(f'{usage}\n\n{table_of(arguments.node)}\nGroups: docs/parameters.md', flush=True)
        return 0
    module = importlib.import_module(f'portnav_ros.nodes.{arguments.node}')
    sys.argv = [arguments.node, *arguments.arguments]
    return int(module.main() or 0)
