"""Configuration: YAML over frozen dataclasses. An unknown key or a wrong type is an error."""

from __future__ import annotations

import dataclasses
import difflib
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

T = TypeVar('T')


class ParamError(ValueError):
    """A configuration value is unknown, of the wrong type or out of range."""


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ParamError: the file is missing, is not YAML or is not a mapping.
    """
    try:
        values = yaml.safe_load(path.read_text(encoding='utf-8'))
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
        ParamError: an unknown key, a wrong type, or a value that ``__post_init__`` refuses.
    """
    hints = get_type_hints(type(base))
    changes: dict[str, Any] = {}
    for key, value in values.items():
        if key not in hints:
            raise ParamError(f'{source}: unknown key {key!r}{_suggest(key, hints)}')
        current = getattr(base, key)
        if dataclasses.is_dataclass(current) and isinstance(value, Mapping):
            changes[key] = override(current, value, f'{source}: {key}')
        else:
            changes[key] = _convert(value, hints[key], f'{source}: {key}')
    try:
        return dataclasses.replace(base, **changes)  # type: ignore[type-var]
    except ParamError as error:
        raise ParamError(f'{source}: {error}') from None


def check_range(owner: object, **limits: tuple[float, float]) -> None:
    """Raise ParamError unless each named field lies inside its closed interval."""
    for name, (low, high) in limits.items():
        value = getattr(owner, name)
        if not low <= value <= high:
            raise ParamError(f'{name} = {value!r} is outside [{low}, {high}]')


def _suggest(key: str, known: Mapping[str, Any]) -> str:
    close = difflib.get_close_matches(str(key), known, n=1)
    return f'; did you mean {close[0]!r}?' if close else f'; known keys: {", ".join(known)}'


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
