"""Charts on disk: GeoJSON in metres or in longitude and latitude, and nav2 maps. See docs/charts.md."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import shapely
from pyproj import Transformer
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from portnav_ros.chart_features import Feature, Projection, read_feature
from portnav_ros.harbour import ChartError, ChartWarning, Harbour
from portnav_ros.nav2_map import read_nav2_map, write_nav2_map
from portnav_ros.params import ParamError, Ranges, check_ranges, override
from portnav_ros.types import Array

__all__ = ['read_chart', 'read_geojson', 'read_nav2_map', 'write_geojson', 'write_nav2_map']

GRID_M = 0.01
EXTENT_MAX_DEG = 1.0
EXTENT_MAX_M = 100e3
LONLAT_CRS = ('CRS84', 'EPSG::4326', 'EPSG:4326')


@dataclass(frozen=True)
class ChartOptions:
    """The collection's member ``portnav``.

    units: of the coordinates, metres in the map frame or degrees of longitude and latitude.
    simplify_m: the most that a quay may move when vertices are dropped; 0 keeps all of them.
    origin_lat_lon_deg: where the map frame has its origin; by default the middle of a chart in degrees.
    """

    units: Literal['m', 'deg'] = 'deg'
    simplify_m: float = 0.0
    origin_lat_lon_deg: tuple[float, float] | None = None
    ranges: ClassVar[Ranges] = {'simplify_m': (0.0, 100.0)}

    def __post_init__(self) -> None:
        check_ranges(self)
        latitude, longitude = self.origin_lat_lon_deg or (0.0, 0.0)
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            raise ParamError('origin_lat_lon_deg: latitude first, within +-90, then longitude, within +-180')


def read_chart(path: str | Path) -> Harbour:
    """Read a chart: GeoJSON (.geojson, .json) or a nav2 map (.yaml, .yml).

    Raises:
        ChartError: the file cannot be used; the message names the file, the feature and the mend.
    """
    path = Path(path)
    if path.suffix in ('.geojson', '.json'):
        return read_geojson(path)
    if path.suffix in ('.yaml', '.yml'):
        return read_nav2_map(path)
    raise ChartError(f'{path}: unknown kind of chart; give a .geojson file or the .yaml file of a nav2 map')


def read_geojson(path: Path) -> Harbour:
    """Read a GeoJSON FeatureCollection (RFC 7946); coordinates become map metres (ENU).

    Raises:
        ChartError: as for read_chart.
    """
    collection = _read_collection(path)
    try:
        options = override(ChartOptions(), collection.get('portnav', {}), f'{path}: portnav')
    except ParamError as error:
        raise ChartError(str(error)) from None
    members = collection['features']
    features = [read_feature(member, f'{path}: feature {i}') for i, member in enumerate(members)]
    origin = options.origin_lat_lon_deg
    if options.units == 'deg':
        _check_degrees(collection, features, path)
        origin = origin or _middle(features)
        projection = local_projection(origin)
        features = [feature.projected(projection) for feature in features]
    return _assemble(features, options, origin, str(collection.get('name') or path.stem), path)


def write_geojson(harbour: Harbour, path: str | Path, units: Literal['m', 'deg'] = 'm') -> None:
    """Write a harbour as GeoJSON that read_geojson turns into the same harbour, to the centimetre.

    Raises:
        ChartError: units ``deg`` for a harbour without an origin.
    """
    options: dict[str, Any] = {'units': units}
    if harbour.origin is not None:
        options['origin_lat_lon_deg'] = list(harbour.origin)
    elif units == 'deg':
        raise ChartError(f'{harbour.name}: has no origin, so it cannot be written in degrees; use units "m"')
    features = _features(harbour)
    if units == 'deg' and harbour.origin is not None:
        back = local_projection(harbour.origin, inverse=True)
        features = [feature.projected(back) for feature in features]
    decimals = 2 if units == 'm' else 8
    rows = ',\n'.join('  ' + json.dumps(feature.as_json(decimals)) for feature in features)
    head = f'"type": "FeatureCollection",\n "name": {json.dumps(harbour.name)},\n "portnav": '
    Path(path).write_text(f'{{{head}{json.dumps(options)},\n "features": [\n{rows}\n]}}\n', encoding='utf-8')


def local_projection(origin: tuple[float, float], inverse: bool = False) -> Projection:
    """Longitude, latitude in degrees [N, 2] -> local metres ENU [N, 2], or back.

    Transverse Mercator about the origin (latitude, longitude): it keeps angles, and lengths to 1e-6
    within 9 km of the origin's meridian.
    """
    latitude, longitude = origin
    metric = f'+proj=tmerc +lat_0={latitude!r} +lon_0={longitude!r} +k=1 +ellps=WGS84 +units=m'
    ends = (metric, 'OGC:CRS84') if inverse else ('OGC:CRS84', metric)
    transformer = Transformer.from_crs(*ends, always_xy=True)

    def project(points: Array) -> Array:
        return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))

    return project


def _read_collection(path: Path) -> dict[str, Any]:
    try:
        collection = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ChartError(f'{path}: cannot be read ({error.strerror})') from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ChartError(f'{path}: not valid JSON: {error}') from error
    if not isinstance(collection, dict) or collection.get('type') != 'FeatureCollection':
        raise ChartError(f'{path}: expected a GeoJSON object of type FeatureCollection')
    if not isinstance(collection.get('features'), list) or not collection['features']:
        raise ChartError(f'{path}: "features" must be a list with at least one feature of kind water')
    if not isinstance(collection.get('portnav', {}), Mapping):
        raise ChartError(f'{path}: "portnav" must be an object, as {{"units": "m"}}')
    return collection


def _check_degrees(collection: dict[str, Any], features: list[Feature], path: Path) -> None:
    crs = json.dumps(collection.get('crs', LONLAT_CRS[0]))
    if not any(name in crs for name in LONLAT_CRS):
        raise ChartError(
            f'{path}: crs {crs} is not longitude and latitude; export in EPSG:4326, or, if its units '
            'are metres, add the member "portnav": {"units": "m"}'
        )
    for feature in features:
        west, south, east, north = feature.geometry.bounds
        if max(abs(west), abs(east)) > 180.0 or max(abs(south), abs(north)) > 90.0:
            raise ChartError(
                f'{feature.where}: {west, south} is no longitude and latitude in degrees; longitude comes '
                'first, and a chart in metres needs the member "portnav": {"units": "m"}'
            )
    low, high = _corners(features)
    if (high - low).max() > EXTENT_MAX_DEG:
        raise ChartError(
            f'{path}: spans {high[0] - low[0]:.1f} x {high[1] - low[1]:.1f} degrees, a port at most '
            f'{EXTENT_MAX_DEG}; look for a feature with latitude and longitude swapped'
        )


def _corners(features: list[Feature]) -> tuple[Array, Array]:
    boxes = np.array([feature.geometry.bounds for feature in features])
    return boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)


def _middle(features: list[Feature]) -> tuple[float, float]:
    low, high = _corners(features)
    longitude, latitude = np.round(0.5 * (low + high), 6).tolist()
    return latitude, longitude


def _assemble(
    features: list[Feature],
    options: ChartOptions,
    origin: tuple[float, float] | None,
    name: str,
    path: Path,
) -> Harbour:
    low, high = _corners(features)
    reach_m = float(np.abs([low, high]).max())
    if reach_m > EXTENT_MAX_M:
        raise ChartError(
            f'{path}: coordinates up to {reach_m:.0f} m from the origin of the map, at most '
            f'{EXTENT_MAX_M:.0f}; export in EPSG:4326, or subtract an offset from all of them'
        )
    kinds = {kind: [f for f in features if f.kind == kind] for kind in ('water', 'land', 'buoy', 'berth')}
    buoys, berths = kinds['buoy'], kinds['berth']
    water = _water(kinds['water'], kinds['land'], options.simplify_m, path)
    try:
        harbour = Harbour(
            name=name,
            water=water,
            buoys=np.array([[f.geometry.x, f.geometry.y, f.radius_m] for f in buoys]).reshape(-1, 3),
            berths=np.array([[f.geometry.x, f.geometry.y, f.yaw_rad] for f in berths]).reshape(-1, 3),
            charted=np.array([f.charted for f in buoys], dtype=bool),
            origin=origin,
        )
    except ChartError as error:
        raise ChartError(f'{path}: {error}') from None
    for feature in buoys + berths:
        if not shapely.covers(harbour.water, feature.geometry):
            raise ChartError(
                f'{feature.where}: this {feature.kind} lies on land or off the chart; move it or leave it out'
            )
    return harbour


def _water(
    water: list[Feature], land: list[Feature], simplify_m: float, path: Path
) -> Polygon | MultiPolygon:
    if not water:
        raise ChartError(
            f'{path}: no feature of kind water; draw one, or a rectangle for the land to be cut out of'
        )
    area = shapely.union_all([feature.geometry for feature in water], grid_size=GRID_M)
    if land:
        ground = shapely.union_all([feature.geometry for feature in land], grid_size=GRID_M)
        area = shapely.difference(area, ground, grid_size=GRID_M)
    if simplify_m > 0.0:
        area = area.simplify(simplify_m, preserve_topology=True)
    parts = [
        part for part in shapely.get_parts(area.normalize()) if isinstance(part, Polygon) and part.area > 0.0
    ]
    if not parts:
        raise ChartError(f'{path}: no water is left once the land is cut out; check which feature is which')
    if len(parts) > 1:
        warnings.warn(
            f'{path}: the water falls into {len(parts)} parts, and no vessel gets from one to another; '
            'join them with a feature of kind water if that is not meant',
            ChartWarning,
            stacklevel=4,
        )
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _features(harbour: Harbour) -> list[Feature]:
    water = [Feature('water', orient(part)) for part in shapely.get_parts(harbour.water)]
    buoys = [
        Feature('buoy', shapely.Point(x, y), radius_m=float(radius_m), charted=bool(charted))
        for (x, y, radius_m), charted in zip(harbour.buoys, harbour.charted, strict=True)
    ]
    berths = [Feature('berth', shapely.Point(x, y), yaw_rad=float(yaw)) for x, y, yaw in harbour.berths]
    return water + buoys + berths
