"""What a run needs before a node starts: scenario, chart, parameters, metadata, commands; in one folder."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from portnav_ros import __version__
from portnav_ros.charts import write_geojson
from portnav_ros.evaluation import bag_episode
from portnav_ros.evaluation.provenance import git_commit
from portnav_ros.muzero.model_file import check_sensor, check_vessel, file_hash, load_model, released_model
from portnav_ros.nodes.graph_options import GraphOptions
from portnav_ros.nodes.parameter_files import check_configuration, flat
from portnav_ros.nodes.parameters import nested
from portnav_ros.nodes.process import Command
from portnav_ros.nodes.table import LEARNED_PLANNERS, PLANNER_SUFFIX, RECORDER, NodeSpec, OnDeath
from portnav_ros.params import ParamError, override, read_yaml
from portnav_ros.resources import config_path
from portnav_ros.sim.difficulty import load_difficulty
from portnav_ros.sim.generator import find_scenario
from portnav_ros.sim.scenario import LidarParams, Scenario
from portnav_ros.vessel import VesselParams

BRINGUP = 'bringup'  # key of the configuration; the others are names of nodes
PARAMETERS, METADATA, BAG, LOG = 'params.yaml', 'run.json', 'bag', 'log'
LIBRARIES = ('numpy', 'numba', 'ompl', 'rosbags', 'ros-jazzy-rclpy')
DISCOVERY = ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
ENVIRONMENT = {
    DISCOVERY[0]: DISCOVERY[1],
    'PYTHONUNBUFFERED': '1',
    **dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS'), '1'),
}
Configuration = dict[str, dict[str, Any]]


def read_configuration(file: Path | None) -> Configuration:
    """The package's config/portnav.yaml with a file of differences on top.

    Raises:
        ParamError: a file cannot be read, a key is neither ``bringup`` nor the name of a node, or a value
            below it is unknown, of the wrong type or out of range.
    """
    merged: Configuration = {}
    for source in (config_path('portnav.yaml'), *([file] if file else [])):
        values = read_yaml(source)
        if wrong := check_configuration(values, str(source), {BRINGUP: GraphOptions()}):
            raise ParamError('\n'.join(wrong))
        for key, section in values.items():
            merged[key] = _merge(merged.get(key, {}), section)
    return merged


def make_options(
    configuration: Configuration, source: str, defaults: Mapping[str, Any], given: Mapping[str, Any]
) -> GraphOptions:
    """Options of a command, below those of the configuration, below those of the command line.

    Args:
        configuration: as read_configuration gives it.
        source: the configuration's name in an error.
        defaults: of the command.
        given: on the command line; None for what was not.

    Raises:
        ParamError: an unknown key, a wrong type or a value out of range.
    """
    options = override(GraphOptions(), defaults, 'defaults')
    options = override(options, configuration.get(BRINGUP, {}), f'{source}: {BRINGUP}')
    return override(
        options, {key: value for key, value in given.items() if value is not None}, 'command line'
    )


def load(options: GraphOptions) -> Scenario:
    """Make the scenario that the options name.

    Raises:
        ScenarioError, ChartError, ParamError: it cannot be made.
    """
    return find_scenario(options.difficulty, options.seed, options.scenario, options.chart)


def prepare(
    options: GraphOptions, configuration: Configuration, scenario: Scenario, out: Path
) -> tuple[Command, ...]:
    """Fill the folder of a run; returns what to start.

    Args:
        options: what to run.
        configuration: parameters of the nodes by name, which go before the run's own.
        scenario: what is sailed.
        out: folder, made if it is not there.

    Raises:
        ParamError: the folder holds a recording already.
        ModelError: a learned planner's model is missing or does not fit; nothing is written then.
    """
    if (out / BAG).exists():
        raise ParamError(f'{out}: holds a recording already; choose another folder with --out')
    if options.learned:
        configuration = _merge(configuration, {options.planner + PLANNER_SUFFIX: options.learned})
    parameters = _parameters(options, configuration, scenario, out)
    _check_model(options, parameters)
    out.mkdir(parents=True, exist_ok=True)
    write_geojson(scenario.harbour, out / bag_episode.CHART)
    metadata = _metadata(options, configuration, scenario)
    (out / METADATA).write_text(json.dumps(metadata, indent=1) + '\n', encoding='utf-8')
    # a wildcard, because nodes may live in a namespace
    document = {f'/**/{name}': {'ros__parameters': values} for name, values in parameters.items()}
    (out / PARAMETERS).write_text(yaml.dump(document, Dumper=_PlainDumper, sort_keys=False), encoding='utf-8')
    return tuple(_command(spec, options, out) for spec in options.nodes)


def _check_model(options: GraphOptions, parameters: Configuration) -> None:
    """Refuse what the learned planner's node would refuse, before any node has started."""
    node = options.planner + PLANNER_SUFFIX
    if options.planner not in LEARNED_PLANNERS or node not in parameters:
        return
    given = nested(dict(flat(parameters[node])), node)
    model = load_model(_model_file(options.planner, given))
    if not given.get('allow_mismatch'):
        check_vessel(
            model, override(VesselParams(), given['vessel'], f'{node}: vessel'), allow_mismatch=False
        )
    check_sensor(model, override(LidarParams(), given['lidar'], f'{node}: lidar'))


def _model_file(planner: str, parameters: Mapping[str, Any]) -> Path:
    """The weights of a planner: those that its parameters name, or else the released ones."""
    return Path(parameters['model']) if parameters.get('model') else released_model(planner)


class _PlainDumper(yaml.SafeDumper):
    """ROS cannot read YAML that refers back to what it has said before."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def environment() -> dict[str, str]:
    """Environment of the nodes: what the user has set goes before the defaults."""
    return ENVIRONMENT | dict(os.environ)


def _parameters(
    options: GraphOptions, configuration: Configuration, scenario: Scenario, out: Path
) -> Configuration:
    world = {
        'difficulty': _absolute(options.difficulty),
        'scenario': options.scenario or '',
        'chart': str(options.chart.resolve()) if options.chart else '',
        'seed': options.seed,
    }
    vessel = {
        'vessel': dataclasses.asdict(scenario.vessel),
        'autopilot': dataclasses.asdict(scenario.autopilot),
    }
    sensing = {**vessel, 'lidar': dataclasses.asdict(scenario.lidar)}
    pace = {'rate': options.rate}
    route = load_difficulty(options.difficulty).path
    own: Configuration = {
        'sim': {
            **world,
            'rate': options.rate,
            'wait_for_recorder': any(spec.name == RECORDER for spec in options.nodes),
        },
        'global_planner': {
            'chart': str((out / bag_episode.CHART).resolve()),
            'seed': options.seed,
            'hull_clearance_m': route.least_m,
            'rrt_star': {'comfort_m': route.comfort_m},
        },
        f'{options.planner}{PLANNER_SUFFIX}': {**sensing, **pace, 'goal_radius_m': scenario.goal_radius_m},
        'safety_monitor': {**sensing, **pace},
        'pid_controller': {**vessel, **pace},
        RECORDER: {
            'bag': str((out / BAG).resolve()),
            'storage': options.storage,
            'run_file': str((out / METADATA).resolve()),
            'chart': str((out / bag_episode.CHART).resolve()),
            'reliable': 'sim' not in options.without,
        },
    }
    common = {'lock_step': options.lock_step}
    return {
        spec.name: _merge(common | own[spec.name], configuration.get(spec.name, {})) for spec in options.nodes
    }


def _merge(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested mappings key by key, everything else replaced."""
    merged = dict(base)
    for key, value in changes.items():
        nested = isinstance(value, Mapping) and isinstance(base.get(key), Mapping)
        merged[key] = _merge(base[key], value) if nested else value
    return merged


def _metadata(options: GraphOptions, configuration: Configuration, scenario: Scenario) -> dict[str, str]:
    """Custom data of the bag: what repeats the run; nothing that would differ if it were repeated."""
    return {
        bag_episode.SEED: str(options.seed),
        bag_episode.SCENARIO: scenario.name,
        bag_episode.DIFFICULTY: options.difficulty,
        bag_episode.PLANNER: options.planner,
        bag_episode.GOAL: json.dumps(scenario.goal),
        bag_episode.GOAL_RADIUS: str(scenario.goal_radius_m),
        bag_episode.VESSEL: json.dumps(dataclasses.asdict(scenario.vessel)),
        **_sensed(options, configuration, scenario),
        'options': json.dumps(dataclasses.asdict(options), default=str),
        'configuration': json.dumps(configuration),
        'version': __version__,
        'git_commit': git_commit(),
        'libraries': json.dumps({'python': platform.python_version(), **_versions()}),
        **_model(options, configuration),
    }


def _sensed(options: GraphOptions, configuration: Configuration, scenario: Scenario) -> dict[str, str]:
    """Hulls of the sim's traffic, of nobody else's, and where the sensor is, if not in the middle."""
    told = {} if 'sim' in options.without else {bag_episode.HULLS: scenario.traffic.hull.tolist()}
    for node in (f'{options.planner}{PLANNER_SUFFIX}', 'safety_monitor'):
        given = nested(dict(flat(configuration.get(node, {}))), node)
        if mounting := given.get('mounting'):
            told[bag_episode.MOUNTING] = mounting
            break
    return {key: json.dumps(value) for key, value in told.items()}


def _model(options: GraphOptions, configuration: Configuration) -> dict[str, str]:
    """SHA-256 of the planner's model; nothing for a planner that needs none."""
    path = _model_file(options.planner, configuration.get(options.planner + PLANNER_SUFFIX, {}))
    return {'model_sha256': file_hash(path)} if path.is_file() else {}


def _versions() -> Mapping[str, str]:
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # ROS from apt has no Python metadata
    return found


def _command(spec: NodeSpec, options: GraphOptions, out: Path) -> Command:
    arguments = ['--ros-args', '--params-file', str((out / PARAMETERS).resolve())]
    arguments += ['-p', 'autostart:=false']  # not in the file, which serves to start a node by hand, too
    if options.namespace:
        arguments += ['-r', f'__ns:=/{options.namespace.strip("/")}']
    arguments += [part for remap in options.remaps for part in ('-r', remap)]
    return Command(
        name=spec.name,
        argv=(sys.executable, '-m', spec.module, *arguments),
        log=out / LOG / f'{spec.name}.log',
        on_death=OnDeath.END if options.lock_step and spec.in_loop else spec.on_death,
        finishes=spec.finishes,
        stops_last=spec.stops_last,
        managed=True,
    )


def _absolute(name_or_path: str) -> str:
    path = Path(name_or_path)
    return str(path.resolve()) if path.suffix else name_or_path
