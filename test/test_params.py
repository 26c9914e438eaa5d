from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import pytest

from portnav_ros.params import (
    ParamError,
    Ranges,
    check_range,
    check_ranges,
    mistakes,
    override,
    read_yaml,
)


@dataclass(frozen=True)
class Inner:
    gain: float = 1.0
    least: float = 0.0
    ranges: ClassVar[Ranges] = {'gain': (0.0, 10.0)}

    def __post_init__(self) -> None:
        check_ranges(self)
        check_range(self, least=(-1.0, self.gain))


@dataclass(frozen=True)
class Outer:
    speed_mps: float = 5.0
    rays: int = 180
    layout: Literal['sections', 'basins'] = 'sections'
    mount_m: tuple[float, float] = (0.0, 0.0)
    weights: tuple[float, ...] = ()
    chart: Path | None = None
    reactive: bool = False
    inner: Inner = field(default_factory=Inner)


def test_nothing_given_changes_nothing():
    assert override(Outer(), {}, 'file') == Outer()


def test_values_are_converted_to_the_declared_types():
    values = {
        'speed_mps': 3,
        'mount_m': [1, 2.5],
        'weights': [1, 2, 3],
        'chart': 'a.geojson',
        'inner': {'gain': 2},
    }
    changed = override(Outer(), values, 'file')
    assert changed == Outer(
        speed_mps=3.0, mount_m=(1.0, 2.5), weights=(1.0, 2.0, 3.0), chart=Path('a.geojson'), inner=Inner(2.0)
    )
    assert isinstance(changed.speed_mps, float)
    assert isinstance(changed.mount_m[0], float)


def test_null_is_none_where_allowed():
    assert override(Outer(chart=Path('x')), {'chart': None}, 'file').chart is None


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'sped_mps': 1.0}, r"port\.yaml: unknown key 'sped_mps'; did you mean 'speed_mps'\?"),
        ({'zzz': 1.0}, r"unknown key 'zzz'; known keys: speed_mps, rays"),
        ({'speed_mps': 'fast'}, r"port\.yaml: speed_mps: expected float, got 'fast'"),
        ({'speed_mps': True}, 'expected float, got True'),
        ({'speed_mps': None}, 'expected float, got None'),
        ({'rays': 1.5}, r'rays: expected int, got 1\.5'),
        ({'rays': True}, 'expected int, got True'),
        ({'reactive': 1}, 'expected bool, got 1'),
        ({'layout': 'maze'}, "layout: 'maze' is not one of sections, basins"),
        ({'mount_m': [1.0]}, 'mount_m: expected 2 values, got 1'),
        ({'mount_m': 1.0}, r'mount_m: expected a list, got 1\.0'),
        ({'weights': ['a']}, "weights: expected float, got 'a'"),
        ({'inner': {'gain': 11.0}}, r'port\.yaml: inner: gain = 11\.0 is outside \[0\.0, 10\.0\]'),
        ({'inner': {'gian': 1.0}}, r"port\.yaml: inner: unknown key 'gian'; did you mean 'gain'\?"),
    ],
)
def test_mistakes_name_file_key_and_value(values, message):
    with pytest.raises(ParamError, match=message):
        override(Outer(), values, 'port.yaml')


WRONG = {'sped_mps': 1.0, 'rays': 1.5, 'inner': {'gain': -1.0, 'gian': 1.0}}
TOLD = [
    "port.yaml: unknown key 'sped_mps'; did you mean 'speed_mps'?",
    'port.yaml: rays: expected int, got 1.5',
    'port.yaml: inner: gain = -1.0 is outside [0.0, 10.0]',
    "port.yaml: inner: unknown key 'gian'; did you mean 'gain'?",
]


def test_all_mistakes_are_told_at_once():
    assert mistakes(Outer(), WRONG, 'port.yaml') == TOLD
    with pytest.raises(ParamError) as refused:
        override(Outer(), WRONG, 'port.yaml')
    assert str(refused.value).splitlines() == TOLD


def test_what_two_keys_make_wrong_is_no_mistake_of_one_key():
    values = {'inner': {'least': 2.0}}
    assert mistakes(Outer(), values, 'port.yaml') == []
    with pytest.raises(ParamError, match=r'port\.yaml: inner: least = 2\.0 is outside \[-1\.0, 1\.0\]'):
        override(Outer(), values, 'port.yaml')


def test_ranges_are_no_key():
    with pytest.raises(ParamError, match=r"unknown key 'ranges'"):
        override(Inner(), {'ranges': {}}, 'port.yaml')


def test_not_a_number_is_out_of_range():
    with pytest.raises(ParamError, match='gain = nan'):
        Inner(float('nan'))


def test_read_yaml(tmp_path):
    file = tmp_path / 'a.yaml'
    file.write_text('speed_mps: 2.0\ninner: {gain: 3.0}\n', encoding='utf-8')
    assert override(Outer(), read_yaml(file), str(file)) == Outer(speed_mps=2.0, inner=Inner(3.0))


@pytest.mark.parametrize('text', ['1e-3', '+1E-3', '1.0e-3', '0.001'])
def test_a_number_needs_no_point(tmp_path, text):
    file = tmp_path / 'a.yaml'
    file.write_text(f'gain: {text}\nname: 1e-3m', encoding='utf-8')
    assert read_yaml(file) == {'gain': 0.001, 'name': '1e-3m'}


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (b'a: [1', 'not valid YAML'),
        (b'\xff\xfe', 'not valid YAML'),
        (b'- a\n- b\n', 'expected a mapping'),
        (b'', 'expected a mapping'),
        (b'a: {b: 1, c: 2, b: 3}', "not valid YAML: key 'b' stands there twice"),
    ],
)
def test_broken_yaml_names_the_file(tmp_path, text, message):
    file = tmp_path / 'broken.yaml'
    file.write_bytes(text)
    with pytest.raises(ParamError, match=rf'broken\.yaml: {message}'):
        read_yaml(file)


def test_missing_yaml_names_the_file(tmp_path):
    with pytest.raises(ParamError, match=r'none\.yaml: cannot be read'):
        read_yaml(tmp_path / 'none.yaml')
