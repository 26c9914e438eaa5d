"""ROS parameters from a frozen dataclass and back, so that configuration has one source."""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from portnav_ros.declarations import Declaration, declarations
from portnav_ros.params import ParamError, override
from portnav_ros.sim.difficulty import load_vessel

FOREIGN = re.compile(r'use_sim_time|start_type_description_service|qos_overrides\..*')


@dataclass(frozen=True)
class NodeParams:
    """Parameters of every node.

    autostart: configure and activate without being asked to; false for a node that a manager looks after.
    """

    autostart: bool = True


P = TypeVar('P', bound=NodeParams)


def defaults_of(name: str) -> NodeParams:
    """Return the parameters that a node of the table starts from, the constant DEFAULTS of its module."""
    defaults: NodeParams = importlib.import_module(f'portnav_ros.nodes.{name}').DEFAULTS
    return defaults


def nested(flat: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Split names at their dots; ROS's own parameters are left out.

    Raises:
        ParamError: a name is given as a value and as a group of names.
    """
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        if FOREIGN.fullmatch(name):
            continue
        *groups, leaf = name.split('.')
        level = tree
        for group in groups:
            level = level.setdefault(group, {})
            if not isinstance(level, dict):
                raise ParamError(f'{source}: {name}: {group} has a value already and is no group')
        level[leaf] = value
    return tree


def declare(node: Node, defaults: P) -> P:
    """Declare every field of a dataclass, nested ones with dots, and return it with what was given.

    The node must declare its parameters from overrides: that makes visible those it does not know, and
    takes ``50`` for a double. Where a parameter ``preset`` is given, ``vessel`` starts from that vessel
    instead of the default.

    Raises:
        ParamError: an unknown parameter, a wrong type or a value out of range.
    """
    source = f'{node.get_name()}: parameters'
    parameters = node.get_parameters_by_prefix('')
    given = nested({name: one.value for name, one in parameters.items()}, source)
    params = override(with_preset(defaults, given), given, source)
    for declaration in declarations(params):
        if node.has_parameter(declaration.name):
            node.undeclare_parameter(declaration.name)
        node.declare_parameter(
            declaration.name, declaration.value, descriptor(declaration), ignore_override=True
        )
    return params


def with_preset(defaults: P, given: Mapping[str, Any]) -> P:
    """Return the defaults with the vessel that ``preset`` names, where it is given.

    Raises:
        ParamError: no such preset.
    """
    preset = given.get('preset')
    if not isinstance(preset, str) or not hasattr(defaults, 'preset'):
        return defaults
    return dataclasses.replace(defaults, vessel=load_vessel(preset))  # type: ignore[call-arg]


def descriptor(declaration: Declaration) -> ParameterDescriptor:
    """Return what ROS tools show of a parameter."""
    unit = f' [{declaration.unit}]' if declaration.unit else ''
    choices = f'one of {", ".join(declaration.choices)}; ' if declaration.choices else ''
    result = ParameterDescriptor(
        description=declaration.description + unit,
        additional_constraints=f'{choices}set at start; restart the node to change it',
        read_only=True,
    )
    if declaration.interval and isinstance(declaration.value, int):
        low, high = map(int, declaration.interval)
        result.integer_range = [IntegerRange(from_value=low, to_value=high)]
    elif declaration.interval:
        low, high = map(float, declaration.interval)
        result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return result
