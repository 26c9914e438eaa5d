"""`portnav benchmark world|graph|plan|search`: measures one part and prints the figures with the machine."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from portnav_ros.evaluation.provenance import machine, provenance
from portnav_ros.evaluation.summary import write_json

PARTS = {
    'world': 'environment steps per CPU-second, and where the time goes',
    'graph': 'latency from scan to actuator, real-time factor and memory of the nodes',
    'plan': 'time to a path, and its length over time',
    'search': 'decisions per second of the tree search, beside other libraries',
    'train': 'environment steps and updates a second of MuZero training, and memory',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the parts; the options behind a part are its own."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = 'parts:\n' + '\n'.join(f'  {name:8} {about}' for name, about in PARTS.items())
    parser.add_argument('part', choices=PARTS, metavar='|'.join(PARTS), help='what to measure')
    parser.add_argument('options', nargs=argparse.REMAINDER, help='--json FILE, and those of the part')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print and, if asked to, write JSON.

    A part is a module ``benchmark_PART`` beside this one, with ``add_arguments(parser)`` and
    ``run(arguments) -> dict``; it is imported only when it is asked for.
    """
    name: str = arguments.part
    module = importlib.import_module(f'portnav_ros.evaluation.benchmark_{name}')
    parser = argparse.ArgumentParser(prog=f'portnav benchmark {name}', description=PARTS[name])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    module.add_arguments(parser)
    options = parser.parse_args(arguments.options)
    figures: dict[str, Any] = module.run(options)
    described = {**provenance(), **machine()}
    print(f'benchmark {name}\n{_table(figures)}\n{_table(described)}')
    if options.json:
        write_json(options.json, {**figures, **described})
    return 0


def _table(figures: Mapping[str, Any], indent: str = '  ') -> str:
    lines = []
    for key, value in figures.items():
        if isinstance(value, Mapping):
            lines.append(f'{indent}{key}\n{_table(value, indent + "  ")}')
        else:
            lines.append(f'{indent}{key:34}{_text(value)}')
    return '\n'.join(lines)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f'{value:,.0f}' if abs(value) >= 10_000.0 else f'{value:.4g}'
    if isinstance(value, (list, tuple)):
        return ', '.join(map(_text, value))
    return str(value)
