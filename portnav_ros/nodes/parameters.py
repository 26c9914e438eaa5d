"""ROS parameters from a frozen dataclass and back, so that configuration has one source."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from portnav_ros.params import ParamError, override
from portnav_ros.sim.difficulty import load_vessel

P = TypeVar('P', bound=Any)

FOREIGN = re.compile(r'use_sim_time|start_type_description_service|qos_overrides\..*')
UNITS = {
    'm': 'm',
    's': 's',
    'rad': 'rad',
    'mps': 'm/s',
    'radps': 'rad/s',
    'n': 'N',
    'nps': 'N/s',
    'kg': 'kg',
    'hz': 'Hz',
}


def given_parameters(node: Node) -> dict[str, Any]:
    """Parameters from the command line and files, nested by their dots; ROS's own are left out.

    The node must declare its parameters from overrides: that makes visible those it does not know, and
    takes ``50`` for a double.
    """
    nested: dict[str, Any] = {}
    for name, parameter in node.get_parameters_by_prefix('').items():
        if FOREIGN.fullmatch(name):
            continue
        *groups, leaf = name.split('.')
        level = nested
        for group in groups:
            level = level.setdefault(group, {})
        level[leaf] = parameter.value
    return nested


def declare(node: Node, defaults: P) -> P:
    """Declare every field of a dataclass, nested ones with dots, and return it with what was given.

    Where a parameter ``preset`` is given, ``vessel`` starts from that vessel instead of the default.

    Raises:
        ParamError: an unknown parameter, a wrong type or a value out of range.
    """
    given = given_parameters(node)
    if 'preset' in given:
        defaults = dataclasses.replace(defaults, vessel=load_vessel(str(given['preset'])))
    params = override(defaults, given, f'{node.get_name()}: parameters')
    for name, value in _flatten(params):
        if node.has_parameter(name):
            node.undeclare_parameter(name)
        node.declare_parameter(name, value, _descriptor(name), ignore_override=True)
    return params


def _flatten(params: Any, prefix: str = '') -> Iterator[tuple[str, Any]]:
    for field in dataclasses.fields(params):
        value = getattr(params, field.name)
        if dataclasses.is_dataclass(value):
            yield from _flatten(value, f'{prefix}{field.name}.')
        elif isinstance(value, Mapping):
            raise ParamError(f'{prefix}{field.name}: a mapping cannot be a ROS parameter')
        else:
            yield prefix + field.name, list(value) if isinstance(value, tuple) else value


def _descriptor(name: str) -> ParameterDescriptor:
    unit = UNITS.get(name.rpartition('_')[2], '') if '_' in name else ''
    return ParameterDescriptor(
        description=f'unit {unit}' if unit else '',
        additional_constraints='set at start; restart the node to change it',
        read_only=True,
    )
