"""Configuration: YAML over frozen dataclasses. An unknown key or a wrong type is an error."""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

T = TypeVar('T')
Ranges = Mapping[str, tuple[float, float]]  # closed interval of each field that has one


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Takes 1e-3 for a number, as YAML 1.2 and ROS do, and refuses a key that stands there twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    problem = f'key {key.value!r} stands there twice; make one of the two'
                    raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
                seen.add((key.tag, key.value))
        return dict(super().construct_mapping(node, deep))


_Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float', re.compile(r'[-+]?[0-9]+[eE][-+]?[0-9]+$'), list('+-0123456789')
)


class ParamError(ValueError):
    """A configuration value is unknown, of the wrong type or out of range."""


def parse_yaml(text: str) -> Any:
    """Read YAML as the project's files are read.

    Raises:
        yaml.YAMLError: it is none, or has a key twice.
    """
    return yaml.load(text, _Loader)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ParamError: the file is missing, is not YAML, is not a mapping or has a key twice.
    """
    try:
        values = parse_yaml(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ParamError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParamError(f'{path}: not valid YAML: {error}') from error
    if not isinstance(values, dict):
        raise ParamError(f'{path}: expected a mapping of keys to values')
    return values


def override(base: T, values: Mapping[str, Any], source: str) -> T:
    """Return a copy of a dataclass with the given keys replaced, nested dataclasses too.

    Args:
        base: any frozen dataclass instance.
        values: keys to replace; a nested mapping overrides a nested dataclass.
        source: what to name in an error, usually a file.

    Raises:
        ParamError: unknown keys, wrong types, values out of range, one line for each; or what
            ``__post_init__`` refuses.
    """
    if wrong := mistakes(base, values, source):
        raise ParamError('\n'.join(wrong))
    hints = _hints(base)
    changes: dict[str, Any] = {}
    for key, value in values.items():
        current, where = getattr(base, key), f'{source}: {key}'
        nested = _is_nested(current, value)
        changes[key] = override(current, value, where) if nested else _convert(value, hints[key], where)
    try:
        return dataclasses.replace(base, **changes)  # type: ignore[type-var]
    except ParamError as error:
        raise ParamError(f'{source}: {error}') from None


def mistakes(base: Any, values: Mapping[str, Any], source: str) -> list[str]:
    """Say what is wrong with each key by itself: unknown, of the wrong type, out of range.

    Takes the arguments of override. What two keys together make wrong is left to ``__post_init__``.
    """
    hints = _hints(base)
    found = []
    for key, value in values.items():
        if key not in hints:
            found.append(f'{source}: unknown key {key!r}{suggest(key, hints)}')
        elif _is_nested(current := getattr(base, key), value):
            found += mistakes(current, value, f'{source}: {key}')
        else:
            found += _mistake(value, hints[key], ranges_of(base).get(key), source, key)
    return found


def ranges_of(base: Any) -> Ranges:
    """Return the intervals that a dataclass, or an instance of one, declares as ``ranges``."""
    return getattr(base, 'ranges', {})


def check_ranges(owner: object) -> None:
    """Raise ParamError unless each field that the class has in ``ranges`` lies inside its closed interval."""
    check_range(owner, **ranges_of(owner))


def check_range(owner: object, **limits: tuple[float, float]) -> None:
    """Raise ParamError unless each named field lies inside its closed interval.

    For what depends on another field; everything else stands in ``ranges``.
    """
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            raise ParamError(_outside(name, value, low, high))


def suggest(key: object, known: Iterable[str]) -> str:
    """Return the mend for an unknown key: the closest known one, or else all of them."""
    names = list(known)
    close = difflib.get_close_matches(str(key), names, n=1)
    return f'; did you mean {close[0]!r}?' if close else f'; known keys: {", ".join(names)}'


def _hints(base: Any) -> dict[str, Any]:
    hints = get_type_hints(type(base))
    return {field.name: hints[field.name] for field in dataclasses.fields(base)}


def _mistake(value: Any, hint: Any, interval: tuple[float, float] | None, source: str, key: str) -> list[str]:
    try:
        converted = _convert(value, hint, f'{source}: {key}')
    except ParamError as error:
        return [str(error)]
    if interval is None:
        return []
    low, high = interval
    return [] if low <= converted <= high else [f'{source}: {_outside(key, converted, low, high)}']


def _outside(name: str, value: Any, low: float, high: float) -> str:
    return f'{name} = {value!r} is outside [{low}, {high}]'


def _is_nested(current: Any, value: Any) -> bool:
    return dataclasses.is_dataclass(current) and isinstance(value, Mapping)


def _convert(value: Any, hint: Any, where: str) -> Any:
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (types.UnionType,) or str(origin) == 'typing.Union':
        if value is None and type(None) in arguments:
            return None
        return _convert(value, next(a for a in arguments if a is not type(None)), where)
    if origin is tuple:
        return _convert_tuple(value, arguments, where)
    if origin is not None and str(origin) == 'typing.Literal':
        if value not in arguments:
            raise ParamError(f'{where}: {value!r} is not one of {", ".join(map(str, arguments))}')
        return value
    if hint is float and isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if hint is Path and isinstance(value, (str, Path)):
        return Path(value)
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise ParamError(f'{where}: expected {hint.__name__}, got {value!r}')
    return value


def _convert_tuple(value: Any, arguments: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ParamError(f'{where}: expected a list, got {value!r}')
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return tuple(_convert(item, arguments[0], where) for item in value)
    if len(value) != len(arguments):
        raise ParamError(f'{where}: expected {len(arguments)} values, got {len(value)}')
    return tuple(_convert(item, hint, where) for item, hint in zip(value, arguments, strict=True))
