"""What `portnav up` and `portnav demo` run: key ``bringup`` of the configuration, and the command line."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from portnav_ros.evaluation.bag_writer import Storage
from portnav_ros.nodes.table import LEARNED_PLANNERS, LOCAL_PLANNERS, NAMES, RECORDER, NodeSpec, graph
from portnav_ros.params import ParamError, Ranges, check_ranges

NAMESPACE = re.compile(r'([A-Za-z_]\w*(/[A-Za-z_]\w*)*)?', re.ASCII)
REMAP = re.compile(r'[^\s:=]+(:[^\s:=]+)?:=[^\s:=]+')


@dataclass(frozen=True)
class GraphOptions:
    """What to run: key ``bringup`` of the configuration, and the options of the command line.

    planner: local planner. difficulty, scenario, chart, seed: what to sail; a named scenario or a chart
    takes the place of the difficulty's random port. mode: lock_step advances when every node has answered,
    real_time by the clock, ``rate`` times as fast. namespace: of every node, such as ``boat_1``. without:
    nodes to leave out, because something else plays their part. remaps: OLD:=NEW for every node or
    NODE:OLD:=NEW for one, such as the topics of a driver that has other names. ready_s: patience with a node
    that starts. model, simulations, allow_mismatch: parameters of a learned planner's node, before those of
    the configuration.
    """

    planner: str = 'dwa'
    difficulty: str = 'harbour'
    scenario: str | None = None
    chart: Path | None = None
    seed: int = 0
    mode: Literal['lock_step', 'real_time'] = 'real_time'
    rate: float = 1.0
    record: bool = True
    storage: Storage = 'sqlite3'
    namespace: str = ''
    without: tuple[str, ...] = ()
    remaps: tuple[str, ...] = ()
    ready_s: float = 120.0
    model: Path | None = None
    simulations: int | None = None
    allow_mismatch: bool = False
    ranges: ClassVar[Ranges] = {'seed': (0, 2**63 - 1), 'rate': (0.01, 1000.0), 'ready_s': (1.0, 3600.0)}

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        check_ranges(self)
        if not NAMESPACE.fullmatch(self.namespace.strip('/')):
            raise ParamError(
                f'namespace {self.namespace!r}: write names of letters, digits and _, such as fleet/boat_1'
            )
        for remap in self.remaps:
            if not REMAP.fullmatch(remap):
                raise ParamError(f'remaps: {remap!r} is neither OLD:=NEW nor NODE:OLD:=NEW')
        if self.planner not in LOCAL_PLANNERS:
            raise ParamError(f'planner {self.planner!r} is not one of {", ".join(LOCAL_PLANNERS)}')
        if unknown := sorted(set(self.without) - set(NAMES)):
            raise ParamError(f'without: no node {unknown[0]!r}; there are {", ".join(NAMES)}')
        if self.scenario is not None and self.chart is not None:
            raise ParamError('scenario and chart exclude each other: a named scenario has its own chart')
        if self.learned and self.planner not in LEARNED_PLANNERS:
            learned = ' and '.join(LEARNED_PLANNERS)
            raise ParamError(f'{", ".join(self.learned)}: for the planners {learned}, not for {self.planner}')

    @property
    def learned(self) -> dict[str, Any]:
        """What is given of a learned planner's parameters."""
        values = {
            'model': str(self.model.resolve()) if self.model else None,
            'simulations': self.simulations,
            'allow_mismatch': self.allow_mismatch or None,
        }
        return {key: value for key, value in values.items() if value is not None}

    @property
    def lock_step(self) -> bool:
        """Whether time waits for the nodes."""
        return self.mode == 'lock_step'

    @property
    def nodes(self) -> tuple[NodeSpec, ...]:
        """Nodes of this graph."""
        return graph(self.planner, self.without + (() if self.record else (RECORDER,)))
