"""One coloured cloud out of the depth maps of many views, view after view: memory grows with the plant's surface alone.

Points of all views that fall into one cell of a grid become one, each weighed by how finely its view resolves it. Its
colour is that of the views that resolve it best.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole

CELL_BITS = 21  # of a cell's number along an axis: three of them fill 63 bits
LEAST_COSINE = 0.1  # at which a surface is taken to be seen, for its weight
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """N points in the world of their cameras."""

    points_m: NDArray[np.float64]  # (N, 3)
    normals: NDArray[np.float32]  # (N, 3), unit, towards those that saw the point
    srgb: NDArray[np.uint8]  # (N, 3)
    confidence: NDArray[np.float32]  # (N,), 0 to 1, of the view that was surest
    views: NDArray[np.int32]  # (N,), how many saw it: those with a point in its cell, or that agree with one of these

    def __len__(self) -> int:
        return len(self.points_m)

    def take(self, chosen: NDArray[np.generic]) -> "Cloud":
        """Those of these numbers, or where a mask (N,) is True."""
        return Cloud(**{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__})


@dataclass(frozen=True, kw_only=True)
class CloudSettings:
    """How points of many views become one."""

    cell_m: float | None = None  # side of the cells; None: so many footprints of a pixel of the median view
    cell_footprints: float = 1.0
    least_views: int = 1  # that a point must be seen by

    def __post_init__(self) -> None:
        if self.cell_m is not None and not (np.isfinite(self.cell_m) and self.cell_m > 0):
            raise ValueError(f"cell_m must be above 0, not {self.cell_m}")
        if not (np.isfinite(self.cell_footprints) and self.cell_footprints > 0) or self.least_views < 1:
            raise ValueError(f"cell_footprints must be above 0 and least_views at least 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cells:
    """Sums over the points of each cell, in the order of the cells' keys."""

    keys: NDArray[np.int64]  # (C,)
    sums: NDArray[np.float64]  # (C, 11): weight; weighed offset and normal; weight of colour; weighed colour
    best: NDArray[np.float64]  # (C, 2), the highest confidence, and the most views that agree with a point
    views: NDArray[np.int64]  # (C,), with a point in the cell


def merge_views(surfaces: Iterable[SeenSurface], settings: CloudSettings = CloudSettings()) -> Cloud:
    """One cloud of what all views see, its points in the order of their cells.

    Args:
        surfaces: Taken one by one, and not kept.
        settings: How; views are not known before they come, so that without a size of cells the first one decides.

    Raises:
        ValueError: The arrays of a view are not as large as its pictures, or its points lie more than a million cells
            from the first one's.
    """
    cell_m = settings.cell_m
    origin_m: NDArray[np.float64] | None = None
    unit_weight = 1.0
    joined: list[_Cells] = []  # each at most half as many as the one before it
    for surface in surfaces:
        _check(surface)
        rows, columns = np.nonzero(np.isfinite(surface.depth_m) & (surface.depth_m > 0))
        if not len(rows):
            continue
        depth_m = surface.depth_m[rows, columns].astype(np.float64)
        points_m = surface.camera.unproject(np.column_stack([columns + 0.5, rows + 0.5]), depth_m)
        footprint_m = depth_m / float(np.sqrt(np.prod(surface.camera.focal_px)))
        if origin_m is None:
            origin_m = points_m[0]
            unit_weight = 1 / float(np.median(footprint_m)) ** 2
        if cell_m is None:
            cell_m = settings.cell_footprints * float(np.median(footprint_m))
        normals = surface.normals[rows, columns].astype(np.float64)
        towards = surface.camera.position_m - points_m
        cosine = np.einsum("nc,nc->n", normals, towards) / np.linalg.norm(towards, axis=1)
        weight = np.maximum(cosine, LEAST_COSINE) / np.square(footprint_m) / unit_weight
        best = np.clip(weight**_BEST, 1e-30, 1e30)
        keys = _number_cells(points_m - origin_m, cell_m)
        others = np.zeros(len(rows)) if surface.agreeing is None else surface.agreeing[rows, columns]
        own = _sum_up(
            keys,
            np.column_stack(
                [
                    weight, (points_m - origin_m) * weight[:, None], normals * weight[:, None],
                    best, surface.srgb[rows, columns] * best[:, None],
                ]
            ),
            np.column_stack([surface.confidence[rows, columns], others]).astype(np.float64),
            np.ones(len(keys), np.int64),
        )  # fmt: skip
        own = _Cells(keys=own.keys, sums=own.sums, best=own.best, views=np.ones_like(own.views))
        joined.append(own)
        while len(joined) > 1 and len(joined[-2].keys) < 2 * len(joined[-1].keys):
            joined[-2:] = [_join(joined[-2], joined[-1])]
    cells = _no_cells()
    for part in reversed(joined):
        cells = _join(part, cells)
    seen_by = np.maximum(cells.views, cells.best[:, 1].astype(np.int64) + 1)
    seen = seen_by >= settings.least_views
    sums, confidence, views = cells.sums[seen], cells.best[seen, 0], seen_by[seen]
    means = np.column_stack([sums[:, 1:7] / sums[:, :1], sums[:, 8:] / sums[:, 7:8]])
    length = np.linalg.norm(means[:, 3:6], axis=1, keepdims=True)
    return Cloud(
        points_m=means[:, :3] + (np.zeros(3) if origin_m is None else origin_m),
        normals=np.divide(means[:, 3:6], length, out=np.zeros_like(means[:, 3:6]), where=length > 0).astype(np.float32),
        srgb=np.rint(means[:, 6:9]).astype(np.uint8),
        confidence=confidence.astype(np.float32),
        views=views.astype(np.int32),
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


def _sum_up(
    keys: NDArray[np.int64], sums: NDArray[np.float64], best: NDArray[np.float64], views: NDArray[np.int64]
) -> _Cells:
    """The rows of each key as one."""
    if not len(keys):
        return _no_cells()
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    return _Cells(
        keys=ordered[first],
        sums=np.add.reduceat(sums[order], first, axis=0),
        best=np.maximum.reduceat(best[order], first, axis=0),
        views=np.add.reduceat(views[order], first),
    )


def _join(first: _Cells, second: _Cells) -> _Cells:
    return _sum_up(
        np.concatenate([first.keys, second.keys]),
        np.concatenate([first.sums, second.sums]),
        np.concatenate([first.best, second.best]),
        np.concatenate([first.views, second.views]),
    )


def _no_cells() -> _Cells:
    return _Cells(
        keys=np.zeros(0, np.int64), sums=np.zeros((0, 11)), best=np.zeros((0, 2)), views=np.zeros(0, np.int64)
    )
