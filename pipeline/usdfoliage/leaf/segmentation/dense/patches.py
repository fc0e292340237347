"""Patches: connected pieces of one smooth surface in a depth map, each a leaf, a part of one, or something else.

Neighbouring pixels belong together where the planes around them meet; what shows a leaf's silhouette are the edges at
which the surface behind begins. Our own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.view import View
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE
from usdfoliage.leaf.segmentation.dense.depth_view import depth_view

UNKNOWN_EDGE = 3  # kind of a pixel beside one without depth, besides those of segmentation.model


@dataclass(frozen=True, kw_only=True)
class PatchSettings:
    """What belongs to one patch."""

    radius_px: int = 3  # Planes are fitted in windows of this radius. Unit: pixels. Range: 1 or more.
    # A surface is followed up to this change of depth from pixel to pixel. Unit: footprints. Range: above 0.
    steepest: float = 4.0
    # A surface ends where the planes of neighbouring pixels lie farther apart than this. Unit: footprints. Range:
    # above 0.
    gap: float = 1.5
    # The gap may be wider by this many standard deviations of the depth. Unit: standard deviations. Range: 0 or more.
    gap_noises: float = 0.0
    # An edge is free, or hidden, where the surface beside it lies this much farther or nearer. Unit: footprints.
    # Range: 0 or more.
    edge: float = 3.0
    # That difference is larger by this many standard deviations of the depth. Unit: standard deviations. Range: 0 or
    # more.
    edge_noises: float = 0.0
    min_px: int = 60  # Smaller patches are dropped. Unit: pixels. Range: 1 or more.
    # The area of a patch is computed with at least this cosine between normal and line of sight. Range: above 0, up
    # to 1.
    min_cosine: float = 0.1

    def __post_init__(self) -> None:
        if self.radius_px < 1 or self.min_px < 1:
            raise ValueError(f"radius_px and min_px must be at least 1, not {self}")
        if not (self.steepest > 0 and self.gap > 0 and self.edge >= 0):
            raise ValueError(f"steepest and gap must be above 0 and edge not below, not {self}")
        if self.gap_noises < 0 or self.edge_noises < 0 or not 0 < self.min_cosine <= 1:
            raise ValueError(f"noises must not be below 0 and min_cosine in (0, 1], not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalPlanes:
    """The plane around each pixel, and how well it goes on into the next one's."""

    slopes: NDArray[np.float32]  # (H, W, 3), inverse depth: change a pixel to the right and down, and value, in 1 / m
    support: NDArray[np.float32]  # (H, W), about how many neighbours lie on it
    gap_right: NDArray[np.float32]  # (H, W), to the plane of the next pixel, in footprints; 1e30 where there is none
    gap_down: NDArray[np.float32]  # (H, W)

    def normals(self, camera: Pinhole, *, threads: int = 0) -> NDArray[np.float32]:
        """(H, W, 3), unit, in the world, towards the camera; 0 where there is no depth."""
        seen = depth_view(camera, self.support)
        flat = _native.plane_normals(seen, self.slopes.reshape(-1, 3), threads=threads)
        return np.asarray(flat, np.float32).reshape(self.slopes.shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class Patches:
    """The K patches of one view."""

    labels: NDArray[np.int32]  # (H, W), 0 for none, k for the patch k - 1
    kind: NDArray[np.uint8]  # (H, W), INTERIOR, FREE_EDGE, HIDDEN_EDGE or UNKNOWN_EDGE
    pixels: NDArray[np.int64]  # (K,)
    area_m2: NDArray[np.float64]  # (K,), of the surface that is seen
    length_m: NDArray[np.float64]  # (K,), extent along the longest of its own axes
    width_m: NDArray[np.float64]  # (K,), extent along the second
    thickness_m: NDArray[np.float64]  # (K,), standard deviation along the third
    free_px: NDArray[np.int64]  # (K,), pixels of a free edge
    hidden_px: NDArray[np.int64]  # (K,)
    unknown_px: NDArray[np.int64]  # (K,)
    fill: NDArray[np.float64]  # (K,), area over that of the ellipse as long and wide
    normals: NDArray[np.float32] | None = None  # (H, W, 3), of the planes, if asked for

    def __len__(self) -> int:
        return len(self.pixels)

    def pixel_keys(self) -> list[tuple[int, int]]:
        """K of the number of pixels and the sum of their indices: equal for patches that are the same."""
        flat = self.labels.ravel()
        sums = np.bincount(flat, np.arange(len(flat), dtype=np.float64), minlength=len(self) + 1)[1:]
        return list(zip(self.pixels.tolist(), sums.astype(np.int64).tolist(), strict=True))


def fit_planes_of_view(
    view: View,
    depth_m: NDArray[np.floating],
    noise_m: float,
    settings: PatchSettings = PatchSettings(),
    *,
    threads: int = 0,
) -> LocalPlanes:
    """The planes around the pixels of a depth map (H, W) whose noise has this standard deviation.

    Raises:
        ValueError: The depth is not as large as the view.
    """
    seen = depth_view(view.camera, depth_m)
    planes = _native.fit_local_planes(
        seen, radius_px=settings.radius_px, steepest=settings.steepest, noise_m=noise_m, threads=threads
    )
    gaps = _native.measure_gaps(seen, planes.slopes, threads=threads)
    return LocalPlanes(
        slopes=planes.slopes.reshape(*depth_m.shape, 3),
        support=planes.support.reshape(depth_m.shape),
        gap_right=gaps.right,
        gap_down=gaps.down,
    )


def find_patches(
    view: View,
    depth_m: NDArray[np.floating],
    noise_m: float,
    settings: PatchSettings = PatchSettings(),
    *,
    valid: NDArray[np.bool_] | None = None,
    planes: LocalPlanes | None = None,
    with_normals: bool = False,
    threads: int = 0,
) -> Patches:
    """The patches of a depth map.

    Args:
        view: Whose camera saw the depth; its own depth is not used.
        depth_m: (H, W), 0 where there is none.
        noise_m: Standard deviation of the depth.
        settings: What belongs together.
        valid: (H, W), pixels that may belong to a patch; all by default. What the others show still bounds patches.
        planes: Of this depth, if they are there already.
        with_normals: Give the normals too.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: depth_m or valid is not as large as the view.
    """
    seen = depth_view(view.camera, depth_m)
    if valid is not None and valid.shape != depth_m.shape:
        raise ValueError(f"valid must be {depth_m.shape}, not {valid.shape}")
    if planes is None:
        planes = fit_planes_of_view(view, depth_m, noise_m, settings, threads=threads)
    allowed = np.ones(depth_m.shape, np.uint8) if valid is None else np.ascontiguousarray(valid, np.uint8)
    joined = _native.join_pixels(
        seen,
        right=planes.gap_right,
        down=planes.gap_down,
        valid=allowed,
        max_gap=settings.gap,
        noise_m=settings.gap_noises * noise_m,
        min_px=settings.min_px,
    )
    return measure_patches(
        view, depth_m, joined.labels, noise_m, settings,
        normals=planes.normals(view.camera, threads=threads) if with_normals else None, threads=threads,
    )  # fmt: skip


def measure_patches(
    view: View,
    depth_m: NDArray[np.floating],
    labels: NDArray[np.int32],
    noise_m: float,
    settings: PatchSettings = PatchSettings(),
    *,
    normals: NDArray[np.float32] | None = None,
    threads: int = 0,
) -> Patches:
    """The edges and sizes of patches that are known: labels (H, W), 0 for none, then numbers without gaps."""
    seen, count = depth_view(view.camera, depth_m), int(labels.max(initial=0))
    kind = _native.classify_edges(
        seen, labels, footprints=settings.edge, noise_m=settings.edge_noises * noise_m, threads=threads
    ).reshape(depth_m.shape)

    sums = _native.sum_points(seen, labels, count=count)
    axes, deviations = _principal_axes(sums)
    extents = _native.measure_extents(seen, labels, axes=axes, min_cosine=settings.min_cosine)
    length, width, area = extents.length_m, extents.width_m, extents.area_m2
    at_edges = np.bincount(labels.ravel() * np.int64(4) + kind.ravel(), minlength=4 * (count + 1)).reshape(-1, 4)[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        fill = np.where(length * width > 0, area / (np.pi / 4 * length * width), 0.0)
    return Patches(
        labels=labels,
        kind=kind,
        pixels=sums.pixels.astype(np.int64),
        area_m2=area,
        length_m=length,
        width_m=width,
        thickness_m=deviations[:, 2],
        free_px=at_edges[:, FREE_EDGE],
        hidden_px=at_edges[:, HIDDEN_EDGE],
        unknown_px=at_edges[:, UNKNOWN_EDGE],
        fill=fill,
        normals=normals,
    )


def _principal_axes(sums: _native.PointSums) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Axes (K, 3, 3) in rows, the longest first, and standard deviations (K, 3), from sums over points."""
    number = np.maximum(sums.pixels, 1)
    mean = sums.sums / number[:, None]
    square = sums.products[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3) / number[:, None, None]
    values, vectors = np.linalg.eigh(square - mean[:, :, None] * mean[:, None, :])
    return (
        np.ascontiguousarray(np.moveaxis(vectors, 1, 2)[:, ::-1]),
        np.sqrt(np.maximum(values[:, ::-1], 0)),
    )
