"""The one table of nodes: what `portnav up`, the launch file and `portnav run` start, and how.

Its order is that of activation: who listens comes before who speaks to it, and the driver last, so that
nothing is lost and no vessel sails before all is there. Nodes are deactivated in reverse.

Executable = node name = YAML key = module in portnav_ros.nodes.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class OnDeath(Enum):
    """What the bringup does when a node dies."""

    END = 'end'  # nothing makes sense without it: the graph ends
    RESTART = 'restart'  # start it again, a bounded number of times
    GO_ON = 'go on'  # say so; the rest runs on


class NodeSpec(NamedTuple):
    """One executable.

    in_loop: lock-step waits for its answers, so in lock-step its death always ends the graph.
    finishes: may end by itself with exit code 0, which ends the graph in good order.
    stops_last: is stopped after all others, because it writes down what they say.
    """

    name: str
    on_death: OnDeath
    in_loop: bool = False
    finishes: bool = False
    stops_last: bool = False

    @property
    def module(self) -> str:
        """Where ``python -m`` finds it."""
        return f'portnav_ros.nodes.{self.name}'


PLANNER_SUFFIX = '_planner'
RECORDER = 'bag_recorder'

NODES = (
    NodeSpec(RECORDER, OnDeath.GO_ON, stops_last=True),
    NodeSpec('pid_controller', OnDeath.RESTART, in_loop=True),
    NodeSpec('safety_monitor', OnDeath.RESTART, in_loop=True),
    NodeSpec('muzero_planner', OnDeath.RESTART, in_loop=True),
    NodeSpec('dwa_planner', OnDeath.RESTART, in_loop=True),
    NodeSpec('ppo_planner', OnDeath.RESTART, in_loop=True),
    NodeSpec('line_of_sight_planner', OnDeath.RESTART, in_loop=True),
    NodeSpec('global_planner', OnDeath.RESTART),
    NodeSpec('sim', OnDeath.END, in_loop=True, finishes=True),
)
NAMES = tuple(spec.name for spec in NODES)
LOCAL_PLANNERS = tuple(
    name.removesuffix(PLANNER_SUFFIX)
    for name in NAMES
    if name.endswith(PLANNER_SUFFIX) and name != 'global_planner'
)
LEARNED_PLANNERS = ('muzero', 'ppo')


def graph(planner: str, without: tuple[str, ...] = ()) -> tuple[NodeSpec, ...]:
    """The nodes of one graph, in the order of the table.

    Args:
        planner: the local planner, one of LOCAL_PLANNERS.
        without: names to leave out, because something else plays their part.

    Raises:
        ValueError: a name that is not in the table.
    """
    if planner not in LOCAL_PLANNERS:
        raise ValueError(f'no local planner {planner!r}; there are {", ".join(LOCAL_PLANNERS)}')
    if unknown := set(without) - set(NAMES):
        raise ValueError(f'no node {", ".join(sorted(unknown))}; there are {", ".join(NAMES)}')
    others = {name + PLANNER_SUFFIX for name in LOCAL_PLANNERS if name != planner}
    return tuple(spec for spec in NODES if spec.name not in others and spec.name not in without)
