"""Training runs that a result is made of: what each was begun with, and how far it has got."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import yaml

from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import Trial
from portnav_ros.params import read_yaml
from portnav_ros.resources import config_path
from portnav_ros.training.run_directory import RunDirectory, flat, plain, read_metrics, write_atomically
from portnav_ros.training.scenarios import TESTBEDS

Values = Mapping[str, Any]
INTERVALS = ('schedule/log_every', 'schedule/validate_every', 'schedule/save_every')


class Place(NamedTuple):
    """Where is sailed: random ports of a difficulty (name or file), or a test bed."""

    difficulty: str = 'paper'
    testbed: str = ''

    @property
    def name(self) -> str:
        """As folders are named."""
        return Path(self.testbed or self.difficulty).stem

    def trial(self, planner: str, route: Literal['difficulty', 'clearance', 'rrt_star']) -> Trial:
        """A planner on the worlds of a validation with that ScenarioParams.validation_route."""
        if self.testbed and TESTBEDS[self.testbed]:
            return Trial(planner, self.difficulty, scenario=TESTBEDS[self.testbed])
        laid = None if route == 'difficulty' else route
        return Trial(planner, self.testbed or self.difficulty, route=laid)


class Preset(NamedTuple):
    """Parameters over an algorithm's defaults, nested as in their YAML file."""

    name: str
    values: Values


def read_preset(name: str) -> Preset:
    """Read a preset of config/train by name, or any YAML file.

    Raises:
        ParamError: there is no such preset or file.
    """
    file = Path(name) if name.endswith('.yaml') else config_path('train', f'{name}.yaml')
    return Preset(file.stem, read_yaml(file))


def merged(values: Values, over: Values) -> dict[str, Any]:
    """Values with those of `over` in their place, nested mappings too."""
    result = dict(values)
    for key, value in over.items():
        below = result.get(key)
        nested = isinstance(below, Mapping) and isinstance(value, Mapping)
        result[key] = merged(below, value) if nested else value  # type: ignore[arg-type]
    return result


@dataclass(frozen=True)
class Run:
    """One training run, in the folder `name` below `root`.

    values: parameters over the algorithm's defaults, the schedule's steps among them.
    """

    root: Path
    name: str
    algorithm: str
    seed: int
    values: Values

    @property
    def directory(self) -> RunDirectory:
        """Its files."""
        return RunDirectory(self.root / self.name)

    @property
    def steps(self) -> int:
        """Environment steps of the whole run."""
        return int(self.values['schedule']['steps'])

    @property
    def log(self) -> Path:
        """What `portnav train` said."""
        return self.root / f'{self.name}.log'

    def metrics(self) -> list[dict[str, Any]]:
        """Lines of its metrics.jsonl; none before it began."""
        return read_metrics(self.directory.metrics)

    def steps_done(self) -> int:
        """Steps of the last line of metrics, no more than those asked for."""
        lines = self.metrics()
        return min(int(lines[-1]['steps']), self.steps) if lines else 0

    def finished(self) -> bool:
        """Whether it has validated after its last step, which is the last thing but saving."""
        return any('validation' in line and line['steps'] >= self.steps for line in self.metrics())

    def command(self) -> list[str]:
        """Options of `portnav train` that begin it or go on with it; writes its parameters first."""
        out = ['--out', str(self.directory.path)]
        if self.directory.config.exists():
            return ['--resume', *out]
        file = self.root / f'{self.name}.yaml'
        self.root.mkdir(parents=True, exist_ok=True)
        write_atomically(file, yaml.safe_dump(plain(self.values), sort_keys=False).encode())
        options = ['--algorithm', self.algorithm, '--config', str(file), '--seed', str(self.seed)]
        return [*options, *out]

    def check(self) -> None:
        """Refuse a folder that holds a run of other parameters; how often it writes changes no run.

        Raises:
            EvaluationError: names the folder, the key, both values and the mend.
        """
        if not self.directory.config.exists():
            return
        begun = flat(self.directory.read_config())
        asked = {'algorithm': self.algorithm, 'seed': self.seed, **flat(plain(self.values))}
        for key, value in asked.items():
            if key in INTERVALS or (key not in begun and not value):  # younger than the run, and off
                continue
            if begun.get(key) != value:
                raise EvaluationError(
                    f'{self.directory.path}: this run was begun with {key} = {begun.get(key)!r}, '
                    f'not {value!r}; choose another --out or remove the folder'
                )


def checked(runs: Sequence[Run]) -> Sequence[Run]:
    """The same runs, once none of their folders holds another.

    Raises:
        EvaluationError: one does.
    """
    for run in runs:
        run.check()
    return runs
