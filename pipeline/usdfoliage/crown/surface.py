"""The crown's base surface: its silhouette inflated by a bi-Laplacian system in three dimensions (thesis 4.3.2).

Frame: x right, y up, z towards the camera, in units of grid cells; the silhouette's centre is the origin and the
silhouette lies in the plane z = 0.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import lsq_linear
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from usdfoliage.crown.silhouette import StarSilhouette
from usdfoliage.errors import FitError

# Discrete bi-Laplacian. The thesis prints 16 in the middle, with which a plane is not a solution; 20 makes the rows
# sum to zero.
BILAPLACIAN: dict[tuple[int, int], float] = {
    (0, 0): 20.0,
    **dict.fromkeys([(0, 1), (1, 0), (0, -1), (-1, 0)], -8.0),
    **dict.fromkeys([(1, 1), (1, -1), (-1, 1), (-1, -1)], 2.0),
    **dict.fromkeys([(0, 2), (2, 0), (0, -2), (-2, 0)], 1.0),
}

# The bi-Laplacian surface of a disc of radius R with vertical tangents of slope k at its rim is, in cylindrical
# coordinates over the disc's radius ρR, (R (3ρ − ρ³)/2, R k (1 − ρ²)/2). With k = 2 its pole is at height R and it
# stays within 2 % of the sphere; the thesis found 2 by trial (fig. 4.13).
SPHERE_TANGENT = 2.0


@dataclass(frozen=True, kw_only=True)
class SurfaceSettings:
    """How the silhouette is inflated."""

    grid: int = 256  # cells along the longer side of the silhouette
    tangent: float | None = None  # k, fall of z per cell just outside the silhouette; None: as deep as wide
    tangent_nodes: int = 10  # heights between which the automatic tangent is linear
    outline_excess: float = 0.02  # how far the outermost shoots of a rough silhouette overstate its depth, at most
    smoothing: float = (
        1.5  # cells, or pixels where those are larger; the stairs of a mask would make the tangents at the rim too flat
    )

    def __post_init__(self) -> None:
        if not 16 <= self.grid <= 2048:
            raise ValueError(f"grid must be from 16 to 2048, not {self.grid}")
        if self.tangent is not None and not (np.isfinite(self.tangent) and self.tangent > 0):
            raise ValueError(f"tangent must be a positive number, not {self.tangent}")
        if self.tangent_nodes < 2:
            raise ValueError(f"tangent_nodes must be at least 2, not {self.tangent_nodes}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownSurface:
    """The front half of the inflated crown; its mirror image in z = 0 closes it."""

    points: NDArray[np.float64]  # (V, 3), in cells
    triangles: NDArray[np.int32]  # (T, 3), anticlockwise seen from +z
    cell_px: float  # pixels of the photograph per cell


def inflate_silhouette(
    silhouette: StarSilhouette,
    settings: SurfaceSettings = SurfaceSettings(),
    tangent_map: NDArray[np.floating] | None = None,
) -> CrownSurface:
    """Solve for the thin-plate surface over the silhouette with given tangents at its rim.

    Args:
        silhouette: The star-shaped curve in the photograph.
        settings: Grid and tangent.
        tangent_map: (h, w) float > 0, k(i, j) over the bounding box of the silhouette from its upper left corner
            (fig. 4.14); overrides settings.tangent.

    Raises:
        ValueError: tangent_map is not two-dimensional, positive and finite.
        FitError: The silhouette is too thin for the grid.

    Source:
        Argudo, section 4.3.2, eq. 4.2, with the half-way trick and 8-connected silhouettes.
    """
    if tangent_map is not None and (
        tangent_map.ndim != 2 or not np.isfinite(tangent_map).all() or tangent_map.min() <= 0
    ):
        raise ValueError("tangent_map must be a (h, w) array of positive numbers")
    cell_px = float(np.ptp(silhouette.curve_px(), axis=0).max() / settings.grid)
    depth_share = _depth_share(silhouette, settings)
    curve = (silhouette.curve_px() - silhouette.center_px) * [1, -1] / cell_px
    curve = _smooth_curve(curve, settings.smoothing * max(1.0, 1.0 / cell_px))
    bounds = curve.min(axis=0), curve.max(axis=0)
    low = np.floor(bounds[0]) - 3
    width, height = (np.ceil(bounds[1]) + 4 - low).astype(int)
    # Grid cell (row, column) has its centre at low + (column, row); rows run upwards.
    cells = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) + low
    within = _cells_within(curve - low, (height, width))
    tree = KDTree(_resample(curve, 0.1))
    inside = _largest_part(within)
    eroded = cv2.erode(inside.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > 0
    rim = inside & ~eroded  # 8-connected: every side neighbour of an inner cell is inside
    if np.count_nonzero(eroded) < 9:
        raise FitError("the silhouette is too thin to inflate: it has fewer than 9 inner cells", "give a finer mask")

    rows, columns = np.nonzero(inside)
    flat = cells[rows, columns]
    number = np.full(inside.shape, -1, np.int64)
    number[rows, columns] = np.arange(len(rows))
    is_rim = rim[rows, columns]
    points = np.zeros((len(flat), 3))
    # The thesis puts rim cells at z = 0 and outer cells at z = −k wherever stairs of the grid leave them, which makes
    # the effective slope depend on the grid. Here both lie at their own distance from the curve along a plane of
    # slope k, and the rim on the curve itself: the surface has no stairs and the closed form of a disc is met.
    rim_distance, points[is_rim, :2] = _nearest(tree, flat[is_rim])
    # z is linear in k: one solution for each function of a basis of tangents along the silhouette.
    basis = _tangent_basis(settings, tangent_map, curve)
    rim_height = np.zeros((len(flat), basis(flat[:1]).shape[1]))
    rim_height[is_rim] = rim_distance[:, None] * basis(points[is_rim, :2])
    unknown = np.full(len(flat), -1, np.int64)
    unknown[~is_rim] = np.arange(np.count_nonzero(~is_rim))
    inner = np.nonzero(~is_rim)[0]
    right = np.zeros((len(inner), 2 + rim_height.shape[1]))
    entries: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    for (d_row, d_column), weight in BILAPLACIAN.items():
        neighbor = number[rows[inner] + d_row, columns[inner] + d_column]
        met = neighbor >= 0
        free = np.nonzero(met & (unknown[neighbor] >= 0))[0]
        entries.append((free, unknown[neighbor[free]], np.full(len(free), weight)))
        fixed = np.nonzero(met & (unknown[neighbor] < 0))[0]
        right[fixed] -= weight * np.hstack([points[neighbor[fixed], :2], rim_height[neighbor[fixed]]])
        # Outer cells: half-way to the inner cell that asks, which is on the silhouette; there z falls by k.
        outer = np.nonzero(~met)[0]
        if len(outer):
            offset = np.array([d_column, d_row])
            _, on_curve = _nearest(tree, flat[inner[outer]] + 0.5 * offset)
            distance, _ = _nearest(tree, flat[inner[outer]] + offset)
            distance[within[rows[inner[outer]] + d_row, columns[inner[outer]] + d_column]] *= -1  # a hair cut off
            right[outer] -= weight * np.hstack([on_curve, -distance[:, None] * basis(on_curve)])
    row, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = sparse.csc_matrix((value, (row, column)), shape=(len(inner), len(inner)))
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solution = factor.solve(right)
    points[inner, :2] = solution[:, :2]
    heights = solution[:, 2:]
    tangent = np.ones(1)
    if heights.shape[1] > 1:
        tangent = _fit_tangent(inside, low, points[inner, :2], heights, depth_share)
    points[inner, 2] = heights @ tangent  # the rim stays at 0, down the vertical tangent
    points[:, 2] = np.maximum(points[:, 2], 0)  # eq. 4.1: z ≥ 0
    return CrownSurface(points=points, triangles=_triangulate(number), cell_px=cell_px)


def _smooth_curve(curve: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """The closed curve averaged along its length, so that a stem or a shoot keeps its length."""
    step = 0.25
    dense = _resample(curve, step)
    return np.asarray(gaussian_filter1d(dense, sigma / step, axis=0, mode="wrap"))


def _cells_within(curve: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Cells (rows, columns) whose centre, at (column, row), is inside the closed curve (A, 2)."""
    fine = 8  # drawing includes the border's pixels, so draw finely and look at centres only
    drawn = np.zeros((shape[0] * fine, shape[1] * fine), np.uint8)
    cv2.fillPoly(drawn, [np.rint(curve * fine).astype(np.int32)], 1)
    return np.asarray(drawn[::fine, ::fine] > 0)


def _largest_part(within: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells without hairs (which have no inner cells) and islands."""
    square = within[:-1, :-1] & within[1:, :-1] & within[:-1, 1:] & within[1:, 1:]
    cells = np.zeros_like(within)
    for part in (cells[:-1, :-1], cells[1:, :-1], cells[:-1, 1:], cells[1:, 1:]):
        part |= square
    count, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=4)
    if count < 2:
        raise FitError("the silhouette is too thin to inflate", "give a finer mask")
    return np.asarray(labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]))


def _resample(curve: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """The closed polyline with points at most step apart."""
    closed = np.vstack([curve, curve[:1]])
    length = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    along = np.concatenate([[0], np.cumsum(length)])
    wanted = np.linspace(0, along[-1], int(np.ceil(along[-1] / step)), endpoint=False)
    return np.column_stack([np.interp(wanted, along, closed[:, k]) for k in range(2)])


def _nearest(tree: KDTree, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of points (M, 2) to the nearest point of the tree, and that point."""
    distance, index = tree.query(points)
    return np.asarray(distance), np.asarray(tree.data)[np.asarray(index)]


def _tangent_basis(
    settings: SurfaceSettings, tangent_map: NDArray[np.floating] | None, curve: NDArray[np.float64]
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Functions of points (M, 2) on the silhouette, (M, B), whose combination k is.

    A given tangent is one function; the automatic one is piecewise linear in height.
    """
    low, high = curve.min(axis=0), curve.max(axis=0)
    if tangent_map is not None:
        values, size = np.asarray(tangent_map, dtype=np.float64), np.array(tangent_map.shape[::-1])

        def from_map(points: NDArray[np.float64]) -> NDArray[np.float64]:
            share = (points - low) / (high - low)
            cell = np.column_stack([share[:, 0], 1 - share[:, 1]]) * size
            column, row = np.clip(cell, 0, size - 1).astype(np.intp).T
            return np.asarray(values[row, column][:, None])

        return from_map
    if settings.tangent is not None:
        constant = settings.tangent
        return lambda points: np.full((len(points), 1), constant)
    nodes = np.linspace(low[1], high[1], settings.tangent_nodes)

    def by_height(points: NDArray[np.float64]) -> NDArray[np.float64]:
        distance = np.abs(points[:, 1, None] - nodes) / (nodes[1] - nodes[0])
        return np.asarray(np.maximum(1 - distance, 0))

    return by_height


def _fit_tangent(
    inside: NDArray[np.bool_],
    low: NDArray[np.float64],
    points: NDArray[np.float64],
    heights: NDArray[np.float64],
    depth_share: float,
) -> NDArray[np.float64]:
    """The tangent at each node, (B,), that makes level cross-sections of the crown as deep as they are wide.

    One photograph has no depth, and a round cross-section is what stands against it least. For a disc k = 2
    comes out at every height.

    Args:
        inside: (rows, columns), the cells of the crown, rows upwards.
        low: (2,), x and y of cell (0, 0).
        points: (M, 2), x and y of the inner vertices.
        heights: (M, B), their z for a unit tangent at each node.
        depth_share: depth over width.
    """
    first = np.argmax(inside, axis=1)
    last = inside.shape[1] - 1 - np.argmax(inside[:, ::-1], axis=1)
    met = np.nonzero(inside.any(axis=1))[0]
    row = points[:, 1] - low[1]
    half = np.interp(row, met, ((last - first + 1) / 2)[met])
    middle = np.interp(row, met, ((first + last) / 2)[met]) + low[0]
    depth = np.sqrt(np.maximum(half**2 - (points[:, 0] - middle) ** 2, 0))
    weight = (depth / half) ** 2  # near the rim an error of z is hardly one of the radius
    # A mild pull to neighbours, for nodes that hardly any vertex depends on.
    count = heights.shape[1]
    pull = 0.05 * np.sqrt(np.mean(heights.sum(axis=1) ** 2) * len(points))
    smooth = pull * np.diff(np.eye(count), axis=0)
    bounds = (0.25 * SPHERE_TANGENT, 2.5 * SPHERE_TANGENT)
    fitted = lsq_linear(
        np.vstack([heights * weight[:, None], smooth]),
        np.concatenate([depth_share * depth * weight, np.zeros(count - 1)]),
        bounds=bounds,
    )
    return np.asarray(fitted.x)


def _depth_share(silhouette: StarSilhouette, settings: SurfaceSettings) -> float:
    """How deep a crown is against its width, judged from its silhouette alone.

    The silhouette is that of the outermost shoots along every line of sight, the depth that of one: the rougher the
    silhouette, the more it overstates. And a crown wider than tall is likely to show its broad side: the mean, in the
    geometric sense, of its width and its height is taken. A smooth disc is as deep as it is wide.
    """
    radius = silhouette.radius_px
    mean = gaussian_filter1d(radius, 8 / 360 * len(radius), mode="wrap")
    roughness = float(np.std(radius / mean))
    stairs = 0.5 / float(np.median(radius))  # half a pixel means nothing for the crown
    excess = np.clip(8 * (roughness - stairs - 0.002), 0, settings.outline_excess)
    width, height = np.ptp(silhouette.curve_px(), axis=0)
    return float((1 - excess) * np.sqrt(min(1, height / width)))


def _triangulate(number: NDArray[np.int64]) -> NDArray[np.int32]:
    """Two triangles in every square of four cells, one where three of them are inside."""
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]  # anticlockwise, rows upwards
    triangles = []
    for corners, without in (((a, b, c), None), ((a, c, d), None), ((a, b, d), c), ((b, c, d), a)):
        whole = np.all([k >= 0 for k in corners], axis=0)
        if without is not None:  # the square's other diagonal, only where one corner is missing
            whole &= without < 0
        triangles.append(np.stack([k[whole] for k in corners], axis=-1))
    return np.concatenate(triangles).astype(np.int32)
