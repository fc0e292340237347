"""One coloured cloud out of the depth maps of many views, view after view: memory grows with the plant's surface alone.

Points of all views that fall into one cell of a grid become one, each weighed by how finely its view resolves it. Its
colour is that of the views that resolve it best.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.files.threads import map_ahead, map_threaded, share_cores
from usdfoliage.geometry.pinhole import Pinhole

CELL_BITS = 21  # of a cell's number along an axis: three of them fill 63 bits
MIN_COSINE = 0.1  # at which a surface is taken to be seen, for its weight
_BEST = 4  # power of a weight for colours: a view that sees half as finely counts a sixteenth


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenSurface:
    """What one view adds to a cloud."""

    camera: Pinhole
    depth_m: NDArray[np.float32]  # (H, W), along the optical axis, 0 where there is none
    normals: NDArray[np.float32]  # (H, W, 3), unit, in the world, towards the camera; not looked at without depth
    srgb: NDArray[np.uint8]  # (H, W, 3)
    confidence: NDArray[np.float32]  # (H, W), 0 to 1
    agreeing: NDArray[np.uint8] | None = None  # (H, W), other views whose depth agrees; None: not known


@dataclass(frozen=True, kw_only=True)
class CloudSettings:
    """How points of many views become one."""

    # Points are merged in cells with this side; auto is cell_footprints of a pixel of the median photograph. Unit:
    # metres. Range: above 0.
    cell_m: float | None = None
    # Cells have this side, in footprints of a pixel on the plant, where cell_m is auto. Unit: footprints. Range:
    # above 0.
    cell_footprints: float = 1.0
    min_views: int = 1  # A point is kept where at least this many photographs see it. Range: 1 or more.

    def __post_init__(self) -> None:
        if self.cell_m is not None and not (np.isfinite(self.cell_m) and self.cell_m > 0):
            raise ValueError(f"cell_m must be above 0, not {self.cell_m}")
        if not (np.isfinite(self.cell_footprints) and self.cell_footprints > 0) or self.min_views < 1:
            raise ValueError(f"cell_footprints must be above 0 and min_views at least 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Grid:
    """Which points become one, as the first view with depth has it."""

    origin_m: NDArray[np.float64]  # (3,), near the points: far from them offsets would lose digits
    cell_m: float
    unit_weight: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Sums over the points of each cell, in the order of the cells' keys; every quantity is a row of its own."""

    keys: NDArray[np.int64]  # (C,), rising
    sums: NDArray[np.float64]  # (11, C): weight; weighed offset and normal; weight of colour; weighed colour
    best: NDArray[np.float64]  # (2, C), the highest confidence, and the most views that agree with a point
    views: NDArray[np.int64]  # (C,), with a point in the cell


def merge_views(
    surfaces: Iterable[SeenSurface], settings: CloudSettings = CloudSettings(), *, threads: int = 0
) -> Cloud:
    """One cloud of what all views see, its points in the order of their cells.

    Args:
        surfaces: Taken one by one, a few ahead of the one that is joined, and not kept.
        settings: How; views are not known before they come, so that without a size of cells the first one decides.
        threads: At most so many beside this one, 0 for one per core; the results are the same.

    Raises:
        ValueError: The arrays of a view are not as large as its pictures, or its points lie more than a million cells
            from the first one's.
    """
    grid: _Grid | None = None

    def with_grid() -> Iterator[tuple[SeenSurface, _Grid]]:
        """From the first view with depth on, which lays the grid before any is summed up."""
        nonlocal grid
        for surface in surfaces:
            _check(surface)
            if grid is None:
                grid = _lay_grid(surface, settings)
            if grid is not None:
                yield surface, grid

    at_once, _ = share_cores(threads)
    joined: list[_Cells] = []  # each at most half as many as the one before it
    for own in map_ahead(lambda given: _sum_view(*given), with_grid(), at_once):
        if len(own.keys):
            joined.append(own)
        while len(joined) > 1 and len(joined[-2].keys) < 2 * len(joined[-1].keys):
            joined[-2:] = [_join(joined[-2], joined[-1], at_once)]
    cells = joined.pop() if joined else _no_cells()
    while joined:
        cells = _join(joined.pop(), cells, at_once)
    return _to_cloud(cells, np.zeros(3) if grid is None else grid.origin_m, settings.min_views)


def _seen_points(
    surface: SeenSurface,
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Rows and columns of the pixels with depth, their points (N, 3) in the world, and how wide each is seen there."""
    rows, columns = np.nonzero(np.isfinite(surface.depth_m) & (surface.depth_m > 0))
    depth_m = surface.depth_m[rows, columns].astype(np.float64)
    points_m = surface.camera.unproject(np.column_stack([columns + 0.5, rows + 0.5]), depth_m)
    return rows, columns, points_m, depth_m / float(np.sqrt(np.prod(surface.camera.focal_px)))


def _lay_grid(surface: SeenSurface, settings: CloudSettings) -> _Grid | None:
    """None for a view without depth."""
    rows, _, points_m, footprint_m = _seen_points(surface)
    if not len(rows):
        return None
    median_m = float(np.median(footprint_m))
    cell_m = settings.cell_footprints * median_m if settings.cell_m is None else settings.cell_m
    return _Grid(origin_m=points_m[0], cell_m=cell_m, unit_weight=1 / median_m**2)


def _sum_view(surface: SeenSurface, grid: _Grid) -> _Cells:
    """The cells of one view."""
    rows, columns, points_m, footprint_m = _seen_points(surface)
    if not len(rows):
        return _no_cells()
    normals = surface.normals[rows, columns].astype(np.float64)
    towards = surface.camera.position_m - points_m
    cosine = np.einsum("nc,nc->n", normals, towards) / np.linalg.norm(towards, axis=1)
    weight = np.maximum(cosine, MIN_COSINE) / np.square(footprint_m) / grid.unit_weight
    best = np.clip(weight**_BEST, 1e-30, 1e30)
    offsets_m = points_m - grid.origin_m
    srgb = surface.srgb[rows, columns]
    others = np.zeros(len(rows)) if surface.agreeing is None else surface.agreeing[rows, columns]

    keys = _number_cells(offsets_m, grid.cell_m)
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))

    def total(quantity: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.add.reduceat(quantity[order], first))

    sums = np.empty((11, len(first)))  # row by row: the terms of all at once are many times as large as a view
    sums[0], sums[7] = total(weight), total(best)
    for axis in range(3):
        sums[1 + axis] = total(offsets_m[:, axis] * weight)
        sums[4 + axis] = total(normals[:, axis] * weight)
        sums[8 + axis] = total(srgb[:, axis] * best)
    largest = np.stack(
        [np.maximum.reduceat(values[order], first) for values in (surface.confidence[rows, columns], others)]
    )
    return _Cells(keys=ordered[first], sums=sums, best=largest.astype(np.float64), views=np.ones(len(first), np.int64))


def _to_cloud(cells: _Cells, origin_m: NDArray[np.float64], min_views: int) -> Cloud:
    """The means of the cells that enough views have seen."""
    seen_by = np.maximum(cells.views, cells.best[1].astype(np.int64) + 1)
    seen = seen_by >= min_views
    weight, best = cells.sums[0, seen], cells.sums[7, seen]
    points_m, normals = np.empty((len(weight), 3)), np.empty((len(weight), 3))
    srgb = np.empty((len(weight), 3), np.uint8)
    for axis in range(3):
        points_m[:, axis] = cells.sums[1 + axis, seen] / weight + origin_m[axis]
        normals[:, axis] = cells.sums[4 + axis, seen] / weight
        srgb[:, axis] = np.rint(cells.sums[8 + axis, seen] / best)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Cloud(
        points_m=points_m,
        normals=np.divide(normals, length, out=np.zeros_like(normals), where=length > 0).astype(np.float32),
        srgb=srgb,
        confidence=cells.best[0, seen].astype(np.float32),
        views=seen_by[seen].astype(np.int32),
    )


def _check(surface: SeenSurface) -> None:
    size = surface.camera.height_px, surface.camera.width_px
    arrays: tuple[tuple[str, NDArray[np.generic], tuple[int, ...]], ...] = (
        ("depth_m", surface.depth_m, size),
        ("normals", surface.normals, (*size, 3)),
        ("srgb", surface.srgb, (*size, 3)),
        ("confidence", surface.confidence, size),
        *(() if surface.agreeing is None else (("agreeing", surface.agreeing, size),)),
    )
    for name, array, shape in arrays:
        if array.shape != shape:
            raise ValueError(f"{name} must be {shape}, not {array.shape}")


def _number_cells(offsets_m: NDArray[np.float64], cell_m: float) -> NDArray[np.int64]:
    """One number (N,) for the cell of each offset (N, 3)."""
    half = 1 << (CELL_BITS - 1)
    cell = np.floor(offsets_m / cell_m).astype(np.int64) + half
    if ((cell < 0) | (cell >= 2 * half)).any():
        raise ValueError(f"points lie more than {half:,} cells of {cell_m:g} m apart")
    return np.asarray((cell[:, 0] << (2 * CELL_BITS)) | (cell[:, 1] << CELL_BITS) | cell[:, 2])


def _join(first: _Cells, second: _Cells, threads: int) -> _Cells:
    """The cells of both; those that both have as one, the first's sums before the second's."""
    before = np.searchsorted(first.keys, second.keys)  # of the first's cells, for each of the second's
    shared = first.keys[np.minimum(before, len(first.keys) - 1)] == second.keys
    alone, twin = np.flatnonzero(~shared), before[shared]
    put_between = np.cumsum(np.bincount(before[alone], minlength=len(first.keys) + 1))[: len(first.keys)]
    old = np.arange(len(first.keys)) + put_between  # where the first's cells go
    new = before[alone] + np.arange(len(alone))  # where those go that only the second has
    twin = old[twin]

    count = len(old) + len(new)
    keys, views = np.empty(count, np.int64), np.empty(count, np.int64)
    sums, best = np.empty((11, count)), np.empty((2, count))
    keys[old], keys[new] = first.keys, second.keys[alone]

    def put(rows: tuple[NDArray[Any], NDArray[Any], NDArray[Any], Callable[..., NDArray[Any]]]) -> None:
        row, ours, theirs, both = rows
        row[old], row[new] = ours, theirs[alone]
        row[twin] = both(row[twin], theirs[shared])

    rows = [
        (views, first.views, second.views, np.add),
        *((*each, np.add) for each in zip(sums, first.sums, second.sums, strict=True)),
        *((*each, np.maximum) for each in zip(best, first.best, second.best, strict=True)),
    ]
    for _ in map_threaded(put, rows, threads=threads):
        pass
    return _Cells(keys=keys, sums=sums, best=best, views=views)


def _no_cells() -> _Cells:
    return _Cells(
        keys=np.zeros(0, np.int64), sums=np.zeros((11, 0)), best=np.zeros((2, 0)), views=np.zeros(0, np.int64)
    )
