"""All parameters of all nodes as Markdown tables, made from their declarations: docs/parameters.md."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

from portnav_ros.declarations import Declaration, declarations, descriptions
from portnav_ros.nodes.parameters import defaults_of
from portnav_ros.nodes.table import NAMES

HEAD = """# Parameters

<!-- Made by `portnav check-params --tables > docs/parameters.md`; what to change stands in the code. -->

Every node and its parameters, as the code declares them. A parameter is set at start and stays: in a file
(`portnav up --config FILE`, or ROS's `--params-file`), or on the command line: `-p age_s:=1.0`, in a group
`-p vessel.length_m:=12.0`. Unknown names, wrong types and values out of range are refused.
`portnav check-params FILE...` finds them in files of both kinds before anything starts, one line for each,
and returns 2 where there is one. Ranges include their ends.
"""
COLUMNS = '| parameter | default | unit | range | what it is |\n|---|---|---|---|---|\n'


def tables() -> str:
    """Return the page: a table for each node, and one for each group that nodes share."""
    nodes = {name: defaults_of(name) for name in NAMES}
    groups = {
        (field.name, value)
        for defaults in nodes.values()
        for field in dataclasses.fields(defaults)
        if dataclasses.is_dataclass(value := getattr(defaults, field.name))
    }
    parts = [table_of(name) for name in nodes]
    parts += [_section(f'Group `{name}`', group) for name, group in sorted(groups, key=lambda pair: pair[0])]
    return '\n'.join([HEAD, *parts])


def table_of(node: str) -> str:
    """Return the table of one node."""
    return _section(f'`{node}`', defaults_of(node))


def _section(title: str, params: Any) -> str:
    return f'## {title}\n\n{COLUMNS}{"".join(_rows(params))}'


def _rows(params: Any) -> Iterator[str]:
    described = descriptions(type(params))
    declared = {declaration.name: declaration for declaration in declarations(params)}
    for field in dataclasses.fields(params):
        if field.name in declared:
            yield _row(declared[field.name])
        else:
            text = _cell(described.get(field.name, ''))
            yield f'| [`{field.name}.*`](#group-{field.name}) | | | | {text} |\n'


def _row(declaration: Declaration) -> str:
    default = f'`{_value(declaration.value)}`'
    return (
        f'| `{declaration.name}` | {default} | {declaration.unit} | {_allowed(declaration)} '
        f'| {_cell(declaration.description)} |\n'
    )


def _allowed(declaration: Declaration) -> str:
    if declaration.choices:
        return ', '.join(f'`{choice}`' for choice in declaration.choices)
    return ' to '.join(map(_value, declaration.interval)) if declaration.interval else ''


def _value(value: Any) -> str:
    """As YAML and ROS want it: a double has a point, and no more digits than anybody would write."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, list):
        return f'[{", ".join(map(_value, value))}]'
    return str(value) if isinstance(value, int) else f"'{value}'"


def _number(value: float) -> str:
    digits = f'{value:.5g}'
    mantissa, mark, exponent = digits.partition('e')
    whole = mantissa if '.' in mantissa else f'{mantissa}.0'
    return f'{whole}e{int(exponent)}' if mark else whole


def _cell(text: str) -> str:
    return text.replace('|', r'\|')
