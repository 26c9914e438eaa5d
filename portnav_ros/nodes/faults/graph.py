"""The processes under test: a graph as `portnav up` starts it, and the sim as somebody else's driver."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Self

import yaml

from portnav_ros.evaluation.processes import family, process_name, read_usage
from portnav_ros.nodes.faults.injector import DRIVER, FROM_DRIVER, FROM_PLANNER, PLANNER, TO_DRIVER, remaps
from portnav_ros.nodes.preparation import environment
from portnav_ros.nodes.process import tail

LOCAL_PLANNER = 'line_of_sight_planner'
SCENARIO = 'rough_canal'
GOAL = 3900.0, 0.0  # of the scenario
LONG_SEARCH = 20_000  # iterations of a global plan, so that it can be killed in the middle of one
END_S = 30.0


class FaultError(RuntimeError):
    """The graph under test cannot be judged; the message says what was waited for, and its last words."""


class GraphUnderTest:
    """A graph and its driver; a context manager, so that neither outlives it.

    Args:
        out: folder for the run, its logs and its configuration.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        self._log, self._driver_log = out / 'up.log', out / 'driver.log'

    def __enter__(self) -> Self:
        """Start both."""
        self.out.mkdir(parents=True, exist_ok=True)
        planner_remaps = [f'{LOCAL_PLANNER}:{remap}' for remap in remaps(FROM_PLANNER, PLANNER)]
        bringup = {'without': ['sim'], 'mode': 'real_time', 'scenario': SCENARIO, 'remaps': planner_remaps}
        planning = {'rrt_star': {'iterations': LONG_SEARCH}}
        configuration = self.out / 'faults.yaml'
        configuration.write_text(yaml.safe_dump({'bringup': bringup, 'global_planner': planning}))
        planner = LOCAL_PLANNER.removesuffix('_planner')
        words = ('up', '--config', str(configuration), '--planner', planner, '--out', str(self.out / 'run'))
        self._graph = _start(self._log, *words)
        self.start_driver()
        return self

    def __exit__(self, *_: object) -> None:
        """End both, the graph as Ctrl-C does."""
        for process in (self._graph, self._driver):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in (self._graph, self._driver):
            process.wait(timeout=END_S)

    def start_driver(self) -> None:
        """Start the driver from the beginning of its voyage."""
        arguments = ['-p', f'scenario:={SCENARIO}', '-p', 'publish_goal:=false']
        for remap in remaps((*FROM_DRIVER, *TO_DRIVER), DRIVER):
            arguments += ['-r', remap]
        self._driver = _start(self._driver_log, 'run', 'sim', '--ros-args', *arguments)

    def kill_driver(self) -> None:
        """Kill the driver without a warning."""
        self._driver.kill()
        self._driver.wait()

    def signal(self, node: str, number: int) -> None:
        """Send a signal to the process of a node.

        Raises:
            FaultError: it does not run.
        """
        os.kill(self.pid(node), number)

    def pid(self, node: str) -> int:
        """Return the process of a node.

        Raises:
            FaultError: it does not run.
        """
        for pid in family(self._graph.pid):
            if process_name(pid) == node:
                return pid
        raise FaultError(f'{node} does not run; {self.last_words()}')

    def cpu_s(self, process: str) -> float:
        """Return the CPU time that a process of the graph has used.

        Raises:
            FaultError: it does not run.
        """
        used = read_usage(self.pid(process))
        return used.cpu_s if used is not None else 0.0

    @property
    def running(self) -> bool:
        """Whether the graph has not ended by itself."""
        return self._graph.poll() is None

    def said(self) -> list[str]:
        """What `portnav up` has printed so far."""
        return self._log.read_text(encoding='utf-8', errors='replace').splitlines()

    def last_words(self) -> str:
        """Return the ends of both logs."""
        return f'{tail(self._log)}\n{tail(self._driver_log)}'


def _start(log: Path, *words: str) -> subprocess.Popen[bytes]:
    with log.open('ab') as file:
        return subprocess.Popen(
            (sys.executable, '-m', 'portnav_ros', *words),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
