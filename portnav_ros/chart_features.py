"""One feature of a GeoJSON chart: from JSON, checked, and back."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from portnav_ros.geometry import wrap_angle
from portnav_ros.harbour import ChartError
from portnav_ros.types import Array

Projection = Callable[[Array], Array]

GEOMETRY_TYPES = {
    'water': ('Polygon', 'MultiPolygon'),
    'land': ('Polygon', 'MultiPolygon'),
    'buoy': ('Point',),
    'berth': ('Point',),
}


@dataclass(frozen=True)
class Feature:
    """A feature of kind water, land, buoy or berth. ``where`` names it in errors."""

    kind: str
    geometry: BaseGeometry
    where: str = ''
    radius_m: float = 1.0
    charted: bool = True
    yaw_rad: float = 0.0

    def projected(self, projection: Projection) -> Feature:
        """The same feature in another frame."""
        return replace(self, geometry=shapely.transform(self.geometry, projection))

    def as_json(self, decimals: int) -> dict[str, Any]:
        """The GeoJSON object, with coordinates rounded to so many decimals."""
        properties: dict[str, Any] = {'kind': self.kind}
        if self.kind == 'buoy':
            properties |= {'radius_m': self.radius_m, 'charted': self.charted}
        if self.kind == 'berth':
            properties |= {'yaw_rad': self.yaw_rad}
        rounded = shapely.transform(self.geometry, lambda points: np.round(points, decimals))
        geometry = shapely.geometry.mapping(rounded)
        return {'type': 'Feature', 'properties': properties, 'geometry': geometry}


def read_feature(member: Any, where: str) -> Feature:
    """Check one member of ``features``.

    Args:
        member: parsed JSON.
        where: file and index, to name in an error; the feature's id is added where it has one.

    Raises:
        ChartError: it is not a feature of a chart.
    """
    if not isinstance(member, Mapping) or member.get('type') != 'Feature':
        raise ChartError(f'{where}: expected a GeoJSON object of type Feature')
    properties = member.get('properties') or {}
    if not isinstance(properties, Mapping):
        raise ChartError(f'{where}: "properties" must be an object')
    properties = {key: value for key, value in properties.items() if value is not None}
    label = member.get('id', properties.get('name'))
    where = where if label is None else f'{where} ({label!r})'
    kind = _kind(properties, where)
    geometry = _geometry(member.get('geometry'), kind, where)
    if kind == 'buoy':
        radius_m = _number(properties, 'radius_m', where, 1.0)
        if not 0.0 < radius_m <= 100.0:
            raise ChartError(f'{where}: radius_m = {radius_m} is outside (0, 100]')
        charted = properties.get('charted', True)
        if not isinstance(charted, bool):
            raise ChartError(f'{where}: charted = {charted!r} must be true or false')
        return Feature(kind, geometry, where, radius_m=radius_m, charted=charted)
    if kind == 'berth':
        return Feature(kind, geometry, where, yaw_rad=_yaw(properties, where))
    return Feature(kind, geometry, where)


def _kind(properties: Mapping[str, Any], where: str) -> str:
    kinds = ', '.join(GEOMETRY_TYPES)
    if 'kind' not in properties:
        raise ChartError(f'{where}: property "kind" is missing; give one of {kinds}')
    kind = properties['kind']
    if not isinstance(kind, str) or kind not in GEOMETRY_TYPES:
        close = difflib.get_close_matches(str(kind), GEOMETRY_TYPES, n=1)
        hint = f'; did you mean {close[0]!r}?' if close else ''
        raise ChartError(f'{where}: kind {kind!r} is not one of {kinds}{hint}')
    return kind


def _yaw(properties: Mapping[str, Any], where: str) -> float:
    """Yaw in rad from ``yaw_rad``, or from the compass course ``heading_deg``: yaw = pi/2 - heading.

    0 where the berth has neither.
    """
    given = [key for key in ('yaw_rad', 'heading_deg') if key in properties]
    if len(given) == 0:
        return 0.0
    if len(given) > 1:
        raise ChartError(
            f'{where}: a berth has either yaw_rad (counter-clockwise from east) or heading_deg '
            '(clockwise from north); leave one out'
        )
    value = _number(properties, given[0], where)
    if given[0] == 'heading_deg':
        value = math.pi / 2.0 - math.radians(value)
    return float(wrap_angle(value))


def _number(properties: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    value = properties.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e12:
        raise ChartError(f'{where}: {key} = {value!r} must be a finite number')
    return float(value)


def _geometry(member: Any, kind: str, where: str) -> BaseGeometry:
    allowed = GEOMETRY_TYPES[kind]
    found = member.get('type') if isinstance(member, Mapping) else None
    if found not in allowed:
        raise ChartError(f'{where}: kind {kind} needs a geometry of type {" or ".join(allowed)}, got {found}')
    coordinates = member.get('coordinates')
    if not isinstance(coordinates, list) or not coordinates:
        raise ChartError(f'{where}: the geometry has no coordinates')
    if found == 'Point':
        return Point(_positions([coordinates], where)[0])
    if found == 'Polygon':
        return _polygon(coordinates, where)
    return shapely.union_all([_polygon(part, where) for part in coordinates])


def _polygon(rings: Any, where: str) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise ChartError(f'{where}: a polygon is a list of rings, the outer one first')
    loops = [_ring(ring, f'{where}, ring {i}') for i, ring in enumerate(rings)]
    polygon = Polygon(loops[0], loops[1:])
    if not polygon.is_valid:
        why = shapely.is_valid_reason(polygon)
        raise ChartError(
            f'{where}: the polygon crosses or touches itself ({why}); redraw it there, or mend it with '
            'the tool "Fix geometries" of QGIS'
        )
    return polygon


def _ring(ring: Any, where: str) -> Array:
    points = _positions(ring, where)
    if len(points) < 4:
        raise ChartError(f'{where}: {len(points)} positions; a ring needs at least 4, the first one repeated')
    if (points[0] != points[-1]).any():
        raise ChartError(f'{where}: not closed; repeat the first position at the end')
    return points


def _positions(positions: Any, where: str) -> Array:
    """Positions [N, 2]; heights are left out."""
    try:
        points = np.array([position[:2] for position in positions])
    except (TypeError, ValueError, KeyError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in 'iuf':
        raise ChartError(f'{where}: each position must be two numbers, [x, y] or [longitude, latitude]')
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        raise ChartError(f'{where}: position {int(np.argmin(finite))} is not finite')
    return points.astype(np.float64)
