"""A harbour: what is fixed in a port. Water polygon, quay walls, buoys, berths, clearance grid."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import shapely
from numba import njit
from scipy.ndimage import distance_transform_edt
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from portnav_ros.geometry import segment_distance_squared
from portnav_ros.types import Array, Array32, BoolArray, IntArray

MAX_WALLS = 20_000
MAX_CELLS = 50_000_000


class ChartError(ValueError):
    """A chart cannot be used; the message names the file, the feature and the mend."""


class ChartWarning(UserWarning):
    """A chart can be used, but perhaps not as it was meant."""


class ClearanceGrid(NamedTuple):
    """Distance to the nearest quay (and buoy, if asked for), sampled at cell centres.

    distance: [H, W] m, float32; row 0 is the southernmost, 0 on land and inside a buoy.
    The centre of cell [i, j] lies at ``x0 + (j + 0.5) * resolution, y0 + (i + 0.5) * resolution``.
    """

    distance: Array32
    x0_m: float
    y0_m: float
    resolution_m: float


@dataclass(frozen=True, eq=False)
class Harbour:
    """A static chart in the map frame (metres, ENU).

    water: navigable area; holes are islands. buoys: [K, 3] x, y, radius in m. berths: [D, 3] x, y
    in m and the yaw in rad in which a vessel lies there. charted: [K], False for a buoy that the
    global planner does not know. origin: latitude and longitude in degrees of the map's origin, or
    None for a chart without one.

    Raises:
        ChartError: water that is empty, not valid or has more than MAX_WALLS edges; arrays of a wrong
            shape or with non-finite values.
    """

    name: str
    water: Polygon | MultiPolygon
    buoys: Array = field(default_factory=lambda: np.zeros((0, 3)))
    berths: Array = field(default_factory=lambda: np.zeros((0, 3)))
    charted: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    origin: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.water.is_empty or not self.water.is_valid:
            why = 'it is empty' if self.water.is_empty else shapely.is_valid_reason(self.water)
            raise ChartError(f'{self.name}: the water is not a valid area: {why}')
        if len(self.walls) > MAX_WALLS:
            raise ChartError(
                f'{self.name}: {len(self.walls)} quay edges, at most {MAX_WALLS} can be sensed; '
                'simplify the chart, as with the GeoJSON member "portnav": {"simplify_m": 0.5}'
            )
        for key, rows in (('buoys', self.buoys), ('berths', self.berths)):
            if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
                raise ChartError(f'{self.name}: {key} must be rows of three finite numbers')
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

    def clearance(
        self, resolution_m: float, buoys: Literal['none', 'charted', 'all'] = 'none'
    ) -> ClearanceGrid:
        """Rasterise the distance to the nearest quay and, as asked, buoy.

        A quay thinner than a cell still counts: the distance is taken to the edges themselves.

        Args:
            resolution_m: edge of a cell.
            buoys: which buoys count as obstacles.

        Raises:
            ChartError: the grid would have more than MAX_CELLS cells.
        """
        x0, y0, rows, columns = self._grid(resolution_m)
        nearest = np.full((rows, columns), -1, dtype=np.int64)
        _mark(self.walls, x0, y0, resolution_m, nearest)
        row, column = distance_transform_edt(nearest < 0, return_distances=False, return_indices=True)
        distance = np.zeros((rows, columns), dtype=np.float32)
        free = np.zeros((rows, columns), dtype=np.bool_)
        _fill(self.walls, x0, y0, resolution_m, free)
        _measure(self.walls, x0, y0, resolution_m, nearest[row, column], free, distance)
        chosen = {'none': self.buoys[:0], 'charted': self.buoys[self.charted], 'all': self.buoys}[buoys]
        _stamp(chosen, x0, y0, resolution_m, distance)
        return ClearanceGrid(distance, x0, y0, resolution_m)

    def _grid(self, resolution_m: float) -> tuple[float, float, int, int]:
        """Corner in m, rows and columns of a grid with a rim of land two cells wide."""
        x_min, y_min, x_max, y_max = self.bounds
        columns = int(np.ceil((x_max - x_min) / resolution_m)) + 4
        rows = int(np.ceil((y_max - y_min) / resolution_m)) + 4
        if rows * columns > MAX_CELLS:
            raise ChartError(
                f'{self.name}: {rows} x {columns} cells of {resolution_m} m, at most {MAX_CELLS} in all; '
                'take larger cells or a smaller chart'
            )
        return x_min - 2.0 * resolution_m, y_min - 2.0 * resolution_m, rows, columns

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
def _mark(walls: Array, x0: float, y0: float, resolution: float, nearest: IntArray) -> None:
    """Write into each cell that an edge runs through the edge closest to the cell's centre."""
    for e in range(len(walls)):
        xa, ya, xb, yb = walls[e, 0], walls[e, 1], walls[e, 2], walls[e, 3]
        steps = int(np.ceil(2.0 * np.hypot(xb - xa, yb - ya) / resolution))
        for k in range(steps + 1):
            along = k / max(steps, 1)
            column = int((xa + along * (xb - xa) - x0) / resolution)
            row = int((ya + along * (yb - ya) - y0) / resolution)
            other = nearest[row, column]
            if other == e:
                continue
            x, y = x0 + (column + 0.5) * resolution, y0 + (row + 0.5) * resolution
            if other < 0 or _squared(walls, e, x, y) < _squared(walls, other, x, y):
                nearest[row, column] = e


@njit(cache=True)
def _measure(
    walls: Array,
    x0: float,
    y0: float,
    resolution: float,
    nearest: IntArray,
    free: BoolArray,
    distance: Array32,
) -> None:
    """Distance from each free cell's centre to the closest of its own and its neighbours' edges."""
    rows, columns = free.shape
    for row in range(1, rows - 1):
        y = y0 + (row + 0.5) * resolution
        for column in range(1, columns - 1):
            if free[row, column]:
                x = x0 + (column + 0.5) * resolution
                least = np.inf
                for i in range(row - 1, row + 2):
                    for j in range(column - 1, column + 2):
                        least = min(least, _squared(walls, nearest[i, j], x, y))
                distance[row, column] = np.sqrt(least)


@njit(cache=True)
def _squared(walls: Array, e: int, x: float, y: float) -> float:
    squared: float = segment_distance_squared(x, y, walls[e, 0], walls[e, 1], walls[e, 2], walls[e, 3])
    return squared


@njit(cache=True)
def _stamp(buoys: Array, x0: float, y0: float, resolution: float, distance: Array32) -> None:
    """Lower the distances around each buoy, no further out than it can matter."""
    rows, columns = distance.shape
    reach = distance.max()
    for k in range(len(buoys)):
        bx, by, span = buoys[k, 0], buoys[k, 1], buoys[k, 2] + reach
        first_row = max(int((by - span - y0) / resolution), 0)
        last_row = min(int((by + span - y0) / resolution), rows - 1)
        first_column = max(int((bx - span - x0) / resolution), 0)
        last_column = min(int((bx + span - x0) / resolution), columns - 1)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                x, y = x0 + (column + 0.5) * resolution, y0 + (row + 0.5) * resolution
                gap = np.hypot(x - bx, y - by) - buoys[k, 2]
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
    distance_m: float = below * (1.0 - v) + above * v
    return distance_m
