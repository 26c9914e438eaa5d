"""`portnav reproduce figure|table|pictures|ablation`: the paper's results, made again from nothing."""

from __future__ import annotations

import argparse
import importlib

PARTS = {
    'figure': 'learning curves of MuZero and PPO, with the DWA as a line',
    'table': 'mean reward of MuZero and PPO each 500,000 steps, beside the numbers of the paper',
    'pictures': 'a free path, evading vessels, evading a buoy, with what the sensor saw',
    'ablation': 'search rules, simulations, discount and heads of MuZero, cell by cell',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the parts; the options behind a part are its own."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = 'parts:\n' + '\n'.join(f'  {name:9} {about}' for name, about in PARTS.items())
    parser.add_argument('part', choices=PARTS, metavar='|'.join(PARTS), help='what to make')
    parser.add_argument('options', nargs=argparse.REMAINDER, help='those of the part; see PART --help')


def run(arguments: argparse.Namespace) -> int:
    """Make a part.

    A part is a module ``reproduce_PART`` beside this one, with ``add_arguments(parser)`` and
    ``run(arguments) -> int``; it is imported only when it is asked for.
    """
    name: str = arguments.part
    module = importlib.import_module(f'portnav_ros.evaluation.reproduce_{name}')
    parser = argparse.ArgumentParser(prog=f'portnav reproduce {name}', description=PARTS[name])
    module.add_arguments(parser)
    return int(module.run(parser.parse_args(arguments.options)))
