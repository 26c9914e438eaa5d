"""`portnav benchmark faults`: tries every fault of the table on a running graph."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from tqdm import tqdm

from portnav_ros.nodes.faults.rig import Rig
from portnav_ros.nodes.faults.table import BY_NAME, FAULTS
from portnav_ros.nodes.faults.verdict import Row


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        '--only',
        action='append',
        choices=BY_NAME,
        metavar='NAME',
        help=f'try this fault; repeatable: {", ".join(BY_NAME)}',
    )
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='folder for the logs and the bag of the graph'
    )


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    """Try the faults, one after the other; return a row for each, and the complaints of those that failed.

    Raises:
        FaultError: the graph does not sail at all.
    """
    with tempfile.TemporaryDirectory(prefix='portnav_') as folder, Rig(arguments.out or Path(folder)) as rig:
        faults = [fault for fault in FAULTS if not arguments.only or fault.name in arguments.only]
        rows = []
        with tqdm(faults, unit='fault') as bar:
            for fault in bar:
                bar.set_description(fault.name)
                rows.append(rig.run(fault))
    return {
        'faults': [figures(row) for row in rows],
        'failed': {row.name: row.complaint for row in rows if not row.passed},
    }


def figures(row: Row) -> dict[str, Any]:
    """Return what is told of a fault."""
    values = row._asdict() | {'measured_s': round(row.measured_s, 3), 'passed': row.passed}
    values['reason'] = row.reason.partition(';')[0]
    return {key: value for key, value in values.items() if key != 'complaint'}
