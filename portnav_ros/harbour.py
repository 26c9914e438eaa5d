"""A harbour: what is fixed in a port. Water polygon, quay walls, buoys, berths, clearance grid."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from numba import njit
from scipy.ndimage import distance_transform_edt
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from portnav_ros.types import Array, Array32, BoolArray

MAX_WALLS = 20_000


class ChartError(ValueError):
    """A chart cannot be used; the message names the file, the feature and the mend."""


class ClearanceGrid(NamedTuple):
    """Distance to the nearest non-water point, sampled at cell centres.

    distance: [H, W] m, float32; row 0 is the southernmost, 0 on land.
    The centre of cell [i, j] lies at ``x0 + (j + 0.5) * resolution, y0 + (i + 0.5) * resolution``.
    """

    distance: Array32
    x0_m: float
    y0_m: float
    resolution_m: float


@dataclass(frozen=True)
class Harbour:
    """A static chart in the map frame (metres, ENU).

    water: navigable area; holes are islands. buoys: [K, 3] x, y, radius in m. berths: [D, 3] x, y
    in m and the yaw in rad in which a vessel lies there. charted: [K], False for a buoy that the
    global planner does not know. origin: latitude and longitude in degrees of the map's origin, or
    None for a chart without one.
    """

    name: str
    water: Polygon | MultiPolygon
    buoys: Array = field(default_factory=lambda: np.zeros((0, 3)))
    berths: Array = field(default_factory=lambda: np.zeros((0, 3)))
    charted: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    origin: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.water.is_empty or not self.water.is_valid:
            why = shapely.is_valid_reason(self.water)
            raise ChartError(f'{self.name}: the water polygon is empty or not valid ({why})')
        count = shapely.get_num_coordinates(self.water)
        if count > MAX_WALLS:
            raise ChartError(
                f'{self.name}: {count} vertices, at most {MAX_WALLS} are sensed; '
                'simplify the chart, as with the chart key simplify_m'
            )
        if len(self.charted) != len(self.buoys):
            raise ChartError(
                f'{self.name}: charted has {len(self.charted)} flags for {len(self.buoys)} buoys'
            )

    @cached_property
    def walls(self) -> Array:
        """Quay edges [E, 4] as x0, y0, x1, y1 in m, with the water on the left of each."""
        parts = shapely.get_parts(self.water)
        rings = [ring for part in parts for ring in _rings(orient(part))]
        return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max in m."""
        x_min, y_min, x_max, y_max = self.water.bounds
        return x_min, y_min, x_max, y_max

    def clearance(self, resolution_m: float, buoys: str = 'none') -> ClearanceGrid:
        """Rasterise the distance to the nearest quay and, as asked, buoy.

        Args:
            resolution_m: edge of a cell.
            buoys: ``none``, ``charted`` or ``all``.
        """
        x_min, y_min, x_max, y_max = self.bounds
        x0, y0 = x_min - 2.0 * resolution_m, y_min - 2.0 * resolution_m
        columns = int(np.ceil((x_max - x0) / resolution_m)) + 2
        rows = int(np.ceil((y_max - y0) / resolution_m)) + 2
        free = np.zeros((rows, columns), dtype=np.bool_)
        _fill(self.walls, x0, y0, resolution_m, free)
        distance = distance_transform_edt(free).astype(np.float32) * np.float32(resolution_m)
        distance = np.maximum(distance - np.float32(0.5 * resolution_m), 0.0)
        chosen = {'none': self.buoys[:0], 'charted': self.buoys[self.charted], 'all': self.buoys}[buoys]
        if len(chosen):
            _stamp(chosen, x0, y0, resolution_m, distance)
        return ClearanceGrid(distance, x0, y0, resolution_m)

    def contains(self, points: Array) -> BoolArray:
        """Whether each map point [N, 2] lies on water."""
        inside: BoolArray = shapely.contains_xy(self.water, points[:, 0], points[:, 1])
        return inside


def _rings(polygon: Polygon) -> list[Array]:
    return [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]


@njit(cache=True)
def _fill(walls: Array, x0: float, y0: float, resolution: float, free: BoolArray) -> None:
    """Even-odd scan-line fill at cell centres."""
    rows, columns = free.shape
    crossings = np.empty(len(walls))
    for row in range(rows):
        y = y0 + (row + 0.5) * resolution
        count = 0
        for e in range(len(walls)):
            ya, yb = walls[e, 1], walls[e, 3]
            if (ya <= y) != (yb <= y):
                crossings[count] = walls[e, 0] + (y - ya) / (yb - ya) * (walls[e, 2] - walls[e, 0])
                count += 1
        inside = np.sort(crossings[:count])
        for k in range(0, count - 1, 2):
            first = int(np.ceil((inside[k] - x0) / resolution - 0.5))
            last = int(np.floor((inside[k + 1] - x0) / resolution - 0.5))
            for column in range(max(first, 0), min(last, columns - 1) + 1):
                free[row, column] = True


@njit(cache=True)
def _stamp(buoys: Array, x0: float, y0: float, resolution: float, distance: Array32) -> None:
    rows, columns = distance.shape
    for row in range(rows):
        for column in range(columns):
            x, y = x0 + (column + 0.5) * resolution, y0 + (row + 0.5) * resolution
            for k in range(len(buoys)):
                gap = np.hypot(x - buoys[k, 0], y - buoys[k, 1]) - buoys[k, 2]
                distance[row, column] = min(distance[row, column], max(gap, 0.0))


@njit(cache=True)
def clearance_at(grid: ClearanceGrid, x_m: float, y_m: float) -> float:
    """Bilinear look-up of the distance field in m; 0 outside the grid."""
    column = (x_m - grid.x0_m) / grid.resolution_m - 0.5
    row = (y_m - grid.y0_m) / grid.resolution_m - 0.5
    j, i = int(np.floor(column)), int(np.floor(row))
    if i < 0 or j < 0 or i + 1 >= grid.distance.shape[0] or j + 1 >= grid.distance.shape[1]:
        return 0.0
    u, v = column - j, row - i
    d = grid.distance
    below = d[i, j] * (1.0 - u) + d[i, j + 1] * u
    above = d[i + 1, j] * (1.0 - u) + d[i + 1, j + 1] * u
    return below * (1.0 - v) + above * v
