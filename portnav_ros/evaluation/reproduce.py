"""`portnav reproduce figure|table|pictures|ablation`: the paper's results, made again from nothing."""

from __future__ import annotations

import argparse

from portnav_ros.evaluation.parts import declare_parts, open_part

PARTS = {
    'figure': 'learning curves of MuZero and PPO, with the DWA as a line',
    'table': 'mean reward of MuZero and PPO each 500,000 steps, beside the numbers of the paper',
    'pictures': 'a free path, evading vessels, evading a buoy, with what the sensor saw',
    'ablation': 'search rules, simulations, discount and heads of MuZero, cell by cell',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the parts."""
    declare_parts(parser, PARTS, 'what to make')


def run(arguments: argparse.Namespace) -> int:
    """Make a part, which has ``add_arguments(parser)`` and ``run(arguments) -> int``."""
    module, parser = open_part('reproduce', arguments.part, PARTS[arguments.part])
    return int(module.run(parser.parse_args(arguments.options)))
