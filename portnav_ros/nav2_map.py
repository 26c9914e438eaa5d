"""Maps of nav2's map_server: a YAML file beside a PGM image, read into a Harbour and written from one.

The format is that of https://docs.nav2.org/configuration/packages/configuring-map-server.html: the
darkness of a pixel is its probability of being occupied; above ``occupied_thresh`` it is occupied,
below ``free_thresh`` free, in between unknown. Row 0 of the image is the northernmost.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import shapely
from scipy.ndimage import label
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from portnav_ros.harbour import MAX_CELLS, MAX_WALLS, ChartError, ChartWarning, ClearanceGrid, Harbour
from portnav_ros.params import ParamError, Ranges, check_ranges, override, read_yaml
from portnav_ros.types import Array, BoolArray, IntArray

POOL_CELLS_MIN = 9
STEP_CELLS = 2.0
STRAIGHTEN_CELLS = 1.1
FREE, OCCUPIED = 254, 0
PGM_HEADER = re.compile(rb'(P[25])' + 3 * rb'(?:\s|#[^\n]*\n)+(\d+)' + rb'\s')


@dataclass(frozen=True)
class Nav2MapParams:
    """The YAML file, with the keys that map_server gives them.

    image: PGM file, relative to the YAML file. resolution: edge of a cell in m. origin: x, y in m of
    the image's lower left corner, and its yaw in rad, which must be 0. negate: 1 where bright pixels
    are the occupied ones.
    """

    image: str = ''
    resolution: float = 1.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    negate: int = 0
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196
    mode: Literal['trinary'] = 'trinary'
    ranges: ClassVar[Ranges] = {
        'resolution': (1e-3, 100.0),
        'negate': (0, 1),
        'occupied_thresh': (0.0, 1.0),
        'free_thresh': (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.free_thresh >= self.occupied_thresh:
            raise ParamError(
                f'free_thresh = {self.free_thresh} must be below occupied_thresh = {self.occupied_thresh}'
            )
        if not np.isfinite(self.origin).all() or self.origin[2] != 0.0:
            raise ParamError(
                f'origin = {list(self.origin)}: a turned map (yaw not 0) cannot be read; turn it'
            )


def read_nav2_map(path: str | Path) -> Harbour:
    """Read a nav2 map; the free cells become water, occupied and unknown ones land.

    Quays follow the sides between free and other cells; stairs are made straight, which moves a quay by
    about a cell at most.

    Raises:
        ChartError: the YAML file or its image cannot be used.
    """
    path = Path(path)
    params = _read_params(path)
    image = path.parent / params.image
    brightness = read_pgm(image)
    occupancy = brightness if params.negate else 1.0 - brightness
    free = np.flipud(occupancy < params.free_thresh)
    if not free.any():
        raise ChartError(f'{image}: no cell is free; check negate and free_thresh in {path}')
    x0, y0, _ = params.origin
    cells = _trace(free, path)
    size = params.resolution
    water = shapely.transform(cells, lambda points: points * size + np.array([x0, y0]))
    try:
        return Harbour(path.stem, water)
    except ChartError as error:
        raise ChartError(f'{path}: {error}') from None


def write_nav2_map(harbour: Harbour, path: str | Path, resolution_m: float) -> None:
    """Write a harbour as a nav2 map: the YAML file, and the image beside it as .pgm.

    A cell is free where its centre is on water. Charted buoys are drawn as occupied cells; berths and
    the other buoys have no place in the format.

    Raises:
        ChartError: the image would be too large.
    """
    path = Path(path)
    grid = harbour.clearance(resolution_m)
    free = (grid.distance > 0.0) & ~_buoy_cells(grid, harbour.buoys[harbour.charted])
    image = path.with_suffix('.pgm')
    image.write_bytes(
        b'P5\n%d %d\n255\n' % free.shape[::-1]
        + np.where(np.flipud(free), FREE, OCCUPIED).astype('u1').tobytes()
    )
    path.write_text(
        f'image: {image.name}\nmode: trinary\nresolution: {float(resolution_m)!r}\n'
        f'origin: [{float(grid.x0_m)!r}, {float(grid.y0_m)!r}, 0.0]\n'
        'negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n',
        encoding='utf-8',
    )


def read_pgm(path: Path) -> Array:
    """Brightness [H, W] between 0 and 1 of a PGM image, binary (P5) or plain (P2).

    Raises:
        ChartError: the file is missing, is no PGM, or holds fewer pixels than it says.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ChartError(
            f'{path}: the image cannot be read ({error.strerror}); check the key image'
        ) from error
    header = PGM_HEADER.match(content)
    if header is None:
        raise ChartError(f'{path}: not a PGM image (P5 or P2); convert it, as with: convert map.png map.pgm')
    width, height, top = (int(number) for number in header.groups()[1:])
    if not 0 < width * height <= MAX_CELLS or not 0 < top < 65536:
        raise ChartError(
            f'{path}: {width} x {height} pixels of 0 to {top}; at most {MAX_CELLS} pixels can be read'
        )
    body = content[header.end() :]
    pixels = _plain(body, path) if header[1] == b'P2' else _binary(body, top)
    if len(pixels) < width * height:
        raise ChartError(
            f'{path}: cut off: {width} x {height} pixels announced, {len(pixels)} found; export it again'
        )
    brightness: Array = pixels[: width * height].reshape(height, width) / top
    return brightness


def _plain(body: bytes, path: Path) -> IntArray:
    try:
        return np.array(body.split(), dtype=np.int64)
    except ValueError as error:
        raise ChartError(f'{path}: a pixel is not a number ({error}); export the image again') from None


def _binary(body: bytes, top: int) -> IntArray:
    size = 1 if top < 256 else 2
    return np.frombuffer(body[: len(body) // size * size], dtype=f'>u{size}').astype(np.int64)


def _read_params(path: Path) -> Nav2MapParams:
    try:
        values = read_yaml(path)
        missing = [key for key in ('image', 'resolution', 'origin') if values.get(key) is None]
        if missing:
            raise ParamError(f'{path}: a nav2 map needs the key {missing[0]}')
        if isinstance(values.get('negate'), bool):
            values['negate'] = int(values['negate'])
        return override(Nav2MapParams(), values, str(path))
    except ParamError as error:
        raise ChartError(str(error)) from None


def _trace(free: BoolArray, path: Path) -> Polygon | MultiPolygon:
    """The free cells [H, W] as an area in cells, with the stairs of oblique quays made straight."""
    pieces = max(label(~free, structure=np.ones((3, 3)))[1], label(free)[1])
    if 3 * pieces > MAX_WALLS:
        raise ChartError(
            f'{path}: {pieces} separate obstacles or pools, at most {MAX_WALLS // 3} can be sensed; '
            'clean the image of specks, as with: convert map.pgm -median 2 clean.pgm'
        )
    stairs = shapely.union_all([shapely.box(first, row, last, row + 1) for row, first, last in _runs(free)])
    parts = [
        Polygon(_cut_stairs(part.exterior), [_cut_stairs(ring) for ring in part.interiors])
        for part in _drop_pools(stairs.simplify(0.0), path)
    ]
    area: Polygon | MultiPolygon = shapely.union_all(parts).simplify(STRAIGHTEN_CELLS)
    return area


def _cut_stairs(ring: BaseGeometry) -> Array:
    """Replace each side of at most STEP_CELLS by its middle; longer ones keep their ends."""
    corners = shapely.get_coordinates(ring)
    first, last = corners[:-1], corners[1:]
    step = (np.abs(last - first).sum(axis=1) <= STEP_CELLS)[:, None]
    middle = 0.5 * (first + last)
    points: Array = np.stack([np.where(step, middle, first), np.where(step, middle, last)], axis=1)
    return points.reshape(-1, 2)


def _runs(free: BoolArray) -> IntArray:
    """Row, first column and column past the last [N, 3] of each run of free cells."""
    padded = np.pad(free, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    rows, first = np.nonzero(change == 1)
    last = np.nonzero(change == -1)[1]
    return np.column_stack([rows, first, last])


def _drop_pools(water: BaseGeometry, path: Path) -> list[Polygon]:
    parts = shapely.get_parts(water)
    kept = [part for part in parts if part.area >= POOL_CELLS_MIN]
    if not kept:
        raise ChartError(f'{path}: no free area of at least {POOL_CELLS_MIN} cells')
    if len(kept) < len(parts):
        warnings.warn(
            f'{path}: {len(parts) - len(kept)} pools of fewer than {POOL_CELLS_MIN} cells were taken as land',
            ChartWarning,
            stacklevel=4,
        )
    return kept


def _buoy_cells(grid: ClearanceGrid, buoys: Array) -> BoolArray:
    """Cells [H, W] that a buoy, enlarged by half a cell's diagonal, covers with their centre."""
    rows, columns = grid.distance.shape
    x = grid.x0_m + (np.arange(columns) + 0.5) * grid.resolution_m
    y = grid.y0_m + (np.arange(rows) + 0.5) * grid.resolution_m
    covered = np.zeros((rows, columns), dtype=bool)
    for buoy_x, buoy_y, radius_m in buoys:
        gap = np.hypot(x[None, :] - buoy_x, y[:, None] - buoy_y)
        covered |= gap <= radius_m + np.sqrt(0.5) * grid.resolution_m
    return covered
