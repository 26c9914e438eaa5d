from dataclasses import dataclass, field
from typing import ClassVar, Literal

import pytest

from portnav_ros.declarations import Declaration, declarations, descriptions, unit_of
from portnav_ros.params import ParamError, Ranges


@dataclass(frozen=True)
class Gains:
    """Of a loop.

    kp: rad for
    each rad; more is faster. ki: none by default: it rings. limit_rad, floor_rad: of the output.

    The end of the docstring belongs to no field.
    """

    kp: float = 1.0
    ki: float = 0.0
    limit_rad: float = 0.5
    floor_rad: float = 0.0
    ranges: ClassVar[Ranges] = {'kp': (0.0, 10.0)}


@dataclass(frozen=True)
class Node:
    """Parameters. rays: of a scan; layout: how they are laid out. gains.*: see Gains."""

    rays: tuple[int, ...] = (1, 2)
    layout: Literal['a', 'b'] = 'a'
    gains: Gains = field(default_factory=Gains)


@dataclass(frozen=True)
class Learned(Node):
    """A node with a model. model: file of the weights. rays: of this node."""

    model: str = ''


def test_a_docstring_describes_its_fields():
    assert descriptions(Gains) == {
        'kp': 'rad for each rad; more is faster',
        'ki': 'none by default: it rings',
        'limit_rad': 'of the output',
        'floor_rad': 'of the output',
    }


def test_descriptions_are_inherited_and_replaced():
    assert descriptions(Learned) == {
        'rays': 'of this node',
        'layout': 'how they are laid out',
        'gains': 'see Gains',
        'model': 'file of the weights',
    }


def test_nested_fields_are_named_with_dots():
    assert list(declarations(Node()))[:3] == [
        Declaration('rays', [1, 2], 'of a scan', '', None, ()),
        Declaration('layout', 'a', 'how they are laid out', '', None, ('a', 'b')),
        Declaration('gains.kp', 1.0, 'rad for each rad; more is faster', '', (0.0, 10.0), ()),
    ]


def test_a_dataclass_without_a_docstring_describes_nothing():
    @dataclass(frozen=True)
    class Bare:
        age_s: float = 1.0

    assert list(declarations(Bare())) == [Declaration('age_s', 1.0, '', 's', None, ())]


def test_a_mapping_is_no_parameter():
    @dataclass(frozen=True)
    class Bag:
        things: dict[str, int] = field(default_factory=dict)

    with pytest.raises(ParamError, match='things: a mapping'):
        list(declarations(Bag()))


@pytest.mark.parametrize(
    ('name', 'unit'),
    [
        ('drag_kg_per_m', 'kg/m'),
        ('rate_radps', 'rad/s'),
        ('age_s', 's'),
        ('thrust_min_n', 'N'),
        ('gain', ''),
        ('paths', ''),
    ],
)
def test_a_name_ends_in_its_unit(name, unit):
    assert unit_of(name) == unit
