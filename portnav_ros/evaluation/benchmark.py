"""`portnav benchmark PART`: measures one part and prints the figures with the machine."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from portnav_ros.evaluation.markdown import markdown
from portnav_ros.evaluation.parts import declare_parts, open_part
from portnav_ros.evaluation.provenance import machine, provenance
from portnav_ros.evaluation.signals import terminable
from portnav_ros.evaluation.summary import write_json

PARTS = {
    'world': 'environment steps per CPU-second, and where the time goes',
    'graph': 'latency from scan to actuator, real-time factor and memory of the nodes',
    'plan': 'time to a path, and its length over time',
    'search': 'decisions per second of the tree search, beside other libraries',
    'train': 'environment steps and updates a second of MuZero training, and memory',
    'faults': 'time from a fault to a safe command, for every fault of the table',
    'bringups': 'starts and ends of the graph in a row, and what they leave behind',
}
PACKAGES = {'faults': 'nodes.faults', 'bringups': 'nodes.faults'}  # of parts that need ROS
FAILED = 'failed'  # key of what a part has found wrong


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the parts; each has ``--json FILE``, too."""
    declare_parts(parser, PARTS, 'what to measure')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print and, if asked to, write JSON; returns 1 where a part has found something wrong.

    A part has ``add_arguments(parser)`` and ``run(arguments) -> dict``.
    """
    name: str = arguments.part
    module, parser = open_part('benchmark', name, PARTS[name], PACKAGES.get(name, 'evaluation'))
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    options = parser.parse_args(arguments.options)
    with terminable():  # with all that it has started
        figures: dict[str, Any] = module.run(options)
    described = {**provenance(), **machine()}
    print(f'benchmark {name}\n{_table(figures)}\n{_table(described)}')
    if options.json:
        write_json(options.json, {**figures, **described})
    return 1 if figures.get(FAILED) else 0


def _table(figures: Mapping[str, Any], indent: str = '  ') -> str:
    lines = []
    for key, value in figures.items():
        if isinstance(value, Mapping) and value:
            lines.append(f'{indent}{key}\n{_table(value, indent + "  ")}')
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            lines.append('\n' + markdown(list(value[0]), [list(map(_text, row.values())) for row in value]))
        else:
            lines.append(f'{indent}{key:34}{_text(value)}')
    return '\n'.join(lines)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    if isinstance(value, float) and math.isnan(value):
        return '-'
    if isinstance(value, float):
        return f'{value:,.0f}' if abs(value) >= 10_000.0 else f'{value:.4g}'
    if isinstance(value, Mapping):
        return 'none'
    if isinstance(value, (list, tuple)):
        return ', '.join(map(_text, value))
    return str(value)
