"""What is wrong in files of parameters: configurations of the bringup, and those that ROS reads itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from portnav_ros.nodes.parameters import defaults_of, nested, with_preset
from portnav_ros.nodes.table import NAMES
from portnav_ros.params import ParamError, mistakes, override, suggest

PARAMETERS = 'ros__parameters'
WILDCARDS = ('*', '**')


def check_configuration(values: Mapping[Any, Any], source: str, others: Mapping[str, object]) -> list[str]:
    """Say what is wrong in a configuration, one line each with file and keys.

    Each parameter of a node is checked by itself: what two of them together make wrong is known when the
    scenario has completed them.

    Args:
        values: sections by the names of nodes, or of others.
        source: the file.
        others: sections that belong to no node, with a dataclass of their defaults.
    """
    found = []
    for key, section in values.items():
        where = f'{source}: {key}'
        if key not in (*others, *NAMES):
            found.append(f'{source}: unknown key {key!r}{suggest(key, (*others, *NAMES))}')
        elif not isinstance(section, Mapping):
            found.append(f'{where}: expected a mapping of keys to values')
        elif key in others:
            found += _refusals(others[key], section, where)
        else:
            found += _check_node(key, section, where, whole=False)
    return found


def check_ros(values: Mapping[Any, Any], source: str) -> list[str]:
    """Say what is wrong in a ROS parameter file, one line each with file, node and keys.

    What stands under a wildcard must suit every node.
    """
    found: list[str] = []
    for path, section in _sections(values):
        name = path.rpartition('/')[2]
        if name not in (*NAMES, *WILDCARDS):
            found.append(f'{source}: {path}: unknown node {name!r}{suggest(name, NAMES)}')
        elif not isinstance(section, Mapping):
            found.append(f'{source}: {path}: expected {PARAMETERS} with a mapping of names to values')
        elif name in NAMES:
            found += _check_node(name, section, f'{source}: {path}', whole=True)
        else:
            found += _check_all(section, f'{source}: {path}')
    return found


def is_ros(values: Mapping[Any, Any]) -> bool:
    """Whether a file holds parameters as ROS reads them."""
    parts = [value for value in values.values() if isinstance(value, Mapping)]
    return PARAMETERS in values or any(map(is_ros, parts))


def flat(section: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Names with dots and their values, as ROS knows them."""
    for key, value in section.items():
        if isinstance(value, Mapping):
            yield from flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def _check_node(name: str, section: Mapping[Any, Any], where: str, whole: bool) -> list[str]:
    found, defaults = [], defaults_of(name)
    try:
        given = nested(dict(flat(section)), where)
    except ParamError as error:
        return [str(error)]
    try:
        defaults = with_preset(defaults, given)
    except ParamError as error:
        found.append(f'{where}: preset: {error}')
    return found + (_refusals if whole else mistakes)(defaults, given, where)


def _refusals(base: object, values: Mapping[str, Any], where: str) -> list[str]:
    """As mistakes, and what __post_init__ refuses."""
    try:
        override(base, values, where)
    except ParamError as error:
        return str(error).splitlines()
    return []


def _check_all(section: Mapping[Any, Any], where: str) -> list[str]:
    """What some nodes refuse: the same complaint of several nodes in one line."""
    complaints: dict[str, list[str]] = {}
    for name in NAMES:
        for line in _check_node(name, section, where, whole=True):
            complaints.setdefault(line.removeprefix(where), []).append(name)
    return [f'{where} ({", ".join(names)}){line}' for line, names in complaints.items()]


def _sections(values: Mapping[Any, Any], path: str = '') -> Iterator[tuple[str, Any]]:
    """Each node's full name with what stands under its ros__parameters; anything else as it is."""
    for key, value in values.items():
        if key == PARAMETERS:
            yield path, value
        elif isinstance(value, Mapping):
            yield from _sections(value, f'{path}/{str(key).strip("/")}')
        else:
            yield f'{path}/{key}', value
