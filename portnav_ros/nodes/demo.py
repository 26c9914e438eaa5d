"""``portnav demo``: sail one episode through the whole graph, watch it, and get a bag and a report."""

from __future__ import annotations

import argparse
import random
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

from tqdm import tqdm

from portnav_ros.evaluation.bag_episode import read_episode
from portnav_ros.nodes.bringup import (
    Exit,
    GraphResult,
    add_graph_arguments,
    default_folder,
    options_from,
    sail,
)
from portnav_ros.nodes.domain_lock import DomainBusyError
from portnav_ros.nodes.preparation import BAG
from portnav_ros.nodes.supervisor import Report
from portnav_ros.types import Outcome

SEEDS = 1_000_000


class ProgressBar:
    """Distance sailed towards the goal, speed, simulated time and how much faster than real time."""

    def __init__(self) -> None:
        self._bar: tqdm | None = None
        self._start_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def say(self, line: str) -> None:
        """Print a line above the bar."""
        tqdm.write(line, file=sys.stderr)

    def follow(self, report: Report) -> None:
        """Move on by a report of the sim."""
        values = report.values
        if 'distance_m' not in values:
            return
        remaining_m, time_s = values['distance_m'], values['time_s']
        if self._bar is None:
            self._start_s = time.monotonic() - 1e-3
            layout = '{percentage:3.0f}%|{bar}| {n:.0f}/{total:.0f} m [{elapsed}<{remaining}{postfix}]'
            self._bar = tqdm(total=remaining_m, bar_format=layout, dynamic_ncols=True)
        factor = time_s / (time.monotonic() - self._start_s)
        shown = f'{values["speed_mps"]:.1f} m/s, t = {time_s:.0f} s, {factor:.0f} x real time'
        self._bar.set_postfix_str(shown, refresh=False)
        self._bar.update(max(self._bar.total - remaining_m, 0.0) - self._bar.n)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``portnav demo``."""
    add_graph_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Sail one episode; 0 where it came to its end, whatever the end, else an exit code as in bringup."""
    options, configuration = options_from(
        arguments, {'mode': 'lock_step', 'seed': random.randrange(SEEDS)}, record=True
    )
    out = arguments.out or default_folder(options.seed)
    world = options.scenario or options.chart or options.difficulty
    print(f'{options.planner} sails {world}, seed {options.seed}; everything goes to {out}', flush=True)
    try:
        with ProgressBar() as bar:
            result = sail(options, configuration, out, bar.follow, bar.say)
    except DomainBusyError as error:
        print(f'portnav: error: {error}', file=sys.stderr)
        return Exit.DOMAIN_BUSY
    return _finish(result, out)


def _finish(result: GraphResult, out: Path) -> int:
    if result.outcome is Outcome.RUNNING:
        print(result.message, file=sys.stderr)
        if result.time_s > 0.0:
            print(f'the bag up to here is in {out / BAG}: portnav report {out}', file=sys.stderr)
        return result.code
    from portnav_ros.evaluation.report import headline, write_report  # matplotlib loads slowly

    log = replace(read_episode(out / BAG), wall_s=result.wall_s)
    page = write_report(log, out)
    factor = result.time_s / result.wall_s
    print(f'{headline(log)} ({factor:.0f} x real time)\n{page}')
    return 0
