"""What a frozen dataclass declares of its fields: description, unit, range. ROS descriptors and docs read it.

Descriptions stand in the class's docstring, as in ``age_s: of the scan. period_s: between decisions.``
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from portnav_ros.params import ParamError, ranges_of

UNITS = {
    'kg_per_m': 'kg/m',
    'radps': 'rad/s',
    'mps2': 'm/s^2',
    'mps': 'm/s',
    'nps': 'N/s',
    'rad': 'rad',
    'deg': 'deg',
    'kg': 'kg',
    'hz': 'Hz',
    'm': 'm',
    's': 's',
    'n': 'N',
}


class Declaration(NamedTuple):
    """One field.

    name: with dots where it is nested. value: a tuple as a list. description, unit: empty where none is
    declared. interval: closed, or None. choices: the values that a Literal allows.
    """

    name: str
    value: Any
    description: str
    unit: str
    interval: tuple[float, float] | None
    choices: tuple[str, ...]


def declarations(params: Any, prefix: str = '') -> Iterator[Declaration]:
    """Walk the fields of a dataclass and of those nested in it.

    Raises:
        ParamError: a field is a mapping, which no parameter can be.
    """
    described, hints = descriptions(type(params)), get_type_hints(type(params))
    for field in dataclasses.fields(params):
        value, name = getattr(params, field.name), prefix + field.name
        if dataclasses.is_dataclass(value):
            yield from declarations(value, f'{name}.')
        elif isinstance(value, Mapping):
            raise ParamError(f'{name}: a mapping cannot be a ROS parameter')
        else:
            hint = hints[field.name]
            yield Declaration(
                name,
                list(value) if isinstance(value, tuple) else value,
                described.get(field.name, ''),
                unit_of(field.name),
                ranges_of(params).get(field.name),
                get_args(hint) if get_origin(hint) is Literal else (),
            )


def descriptions(kind: type) -> dict[str, str]:
    """Return what the docstrings of a dataclass and its bases say of each field that they name."""
    names = '|'.join(field.name for field in dataclasses.fields(kind))
    label = re.compile(rf'(?:^|(?<=[.;] ))((?:(?:{names})(?:\.\*)?(?:, |(?=: )))+): ')
    found = {}
    for base in reversed(kind.__mro__):
        for paragraph in re.split(r'\n\s*\n', vars(base).get('__doc__') or ''):
            _, *parts = label.split(' '.join(paragraph.split()))
            for fields, text in zip(parts[::2], parts[1::2], strict=True):
                found.update(dict.fromkeys(re.findall(r'\w+', fields), text.rstrip('.; ')))
    return found


def unit_of(name: str) -> str:
    """Return the unit that a name ends in; none is empty."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(f'_{suffix}')), '')
