"""Which pixels of all views show which leaf, and the points that follow from it. Our own."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.points import FREE_EDGE, HIDDEN_EDGE, INTERIOR, LeafPoints
from usdfoliage.leaf.segmentation.dense.depth_view import depth_view
from usdfoliage.leaf.segmentation.dense.patches import LocalPlanes, PatchSettings
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

_MIN_SUPPORT = 6.0  # neighbours on a plane whose normal is taken
_KINDS = np.array(
    [INTERIOR, FREE_EDGE, HIDDEN_EDGE, HIDDEN_EDGE], np.uint8
)  # an unknown edge may hide more of the leaf


MIN_CLAIMED = 0.5  # share of a patch that leaves claim, where they may claim more of it


_MAX_GRID = 1000  # places across or along a leaf: no photograph shows more


@dataclass(frozen=True, kw_only=True)
class ClaimSettings:
    """When a pixel shows a leaf."""

    # A pixel shows a leaf up to this distance between the leaf and the pixel's depth. Unit: footprints. Range: 0 or
    # more.
    footprints: float = 1.5
    # That distance is larger by this many standard deviations of the depth. Unit: standard deviations. Range: 0 or
    # more.
    noises: float = 3.0
    # A leaf's surface is followed beyond its silhouette by this much. Unit: units of u. Range: above 0.
    beyond_side: float = 0.12
    # A leaf's surface is followed beyond base and apex by this much. Unit: units of v. Range: above 0.
    beyond_end: float = 0.05
    # A place beyond the leaf counts as farther by this many tolerances. Unit: tolerances. Range: 0 or more.
    penalty: float = 0.6
    # The grid that stands for a leaf has this many columns, without those beyond it. Range: 3 to 1000.
    columns: int = 11
    rows: int = 13  # The grid that stands for a leaf has this many rows from base to apex. Range: 3 to 1000.
    # Distances along the ray are computed with at least this cosine between a leaf's normal and the ray. Range: above
    # 0, up to 1.
    min_cosine: float = 0.15

    def __post_init__(self) -> None:
        if self.footprints < 0 or self.noises < 0 or self.penalty < 0:
            raise ValueError(f"footprints, noises and penalty must not be below 0, not {self}")
        if not (self.beyond_side > 0 and self.beyond_end > 0 and 0 < self.min_cosine <= 1):
            raise ValueError(f"beyond_side and beyond_end must be above 0 and min_cosine in (0, 1], not {self}")
        if not (3 <= self.columns <= _MAX_GRID and 3 <= self.rows <= _MAX_GRID):
            raise ValueError(f"the grid must have 3 to {_MAX_GRID} rows and columns, not {self}")


@dataclass(frozen=True, kw_only=True)
class PointSettings:
    """Which points are kept of claimed pixels."""

    max_per_leaf: int = 4000  # At most this many points of a leaf are kept, chosen evenly. Range: 1 or more.
    # An edge is free, or hidden, where the surface beside it lies this much farther or nearer. Unit: footprints.
    # Range: 0 or more.
    edge: float = 3.0
    # That difference is larger by this many standard deviations of the depth. Unit: standard deviations. Range: 0 or
    # more.
    edge_noises: float = 0.0
    # A free edge is placed half way to the nearest background pixel within this distance. Unit: pixels. Range: 1 or
    # more.
    beside_px: int = 4

    def __post_init__(self) -> None:
        if self.max_per_leaf < 1 or self.edge < 0 or self.edge_noises < 0:
            raise ValueError(f"max_per_leaf must be at least 1, edge and edge_noises not below 0, not {self}")
        if self.beside_px < 1:
            raise ValueError(f"beside_px must be at least 1, not {self.beside_px}")


def claim_pixels(
    leaves: Leaves,
    views: Sequence[View],
    depths_m: Sequence[NDArray[np.floating]],
    noise_m: float | Sequence[float],
    settings: ClaimSettings = ClaimSettings(),
    *,
    threads: int = 0,
) -> tuple[NDArray[np.int32], ...]:
    """Labels (H, W) of each view: 0 for none, k for the leaf k - 1, whose surface is nearest to what the pixel shows.

    Args:
        leaves: In the frame of the cameras.
        views: V, of which the cameras are used.
        depths_m: V of (H, W), 0 where there is none.
        noise_m: Standard deviation of the depth, of all views or of each.
        settings: How near is near.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: There are not as many depth maps as views, or one is not as large as its view.
    """
    noises = np.broadcast_to(np.asarray(noise_m, np.float64), len(views))
    u = np.concatenate([[-1 - settings.beyond_side], np.linspace(-1, 1, settings.columns), [1 + settings.beyond_side]])
    v = np.concatenate([[-settings.beyond_end], np.linspace(0, 1, settings.rows), [1 + settings.beyond_end]])
    penalty = np.zeros((len(v), len(u)), np.float32)
    penalty[[0, -1]] = settings.penalty
    penalty[:, [0, -1]] = settings.penalty
    grids = evaluate_points(
        leaves.parameters, grid_places(u, v), placements=leaves.asset_from_leaf(), threads=threads
    ).reshape(len(leaves), len(v), len(u), 3)
    return tuple(
        _native.claim_pixels(
            depth_view(view.camera, depth_m),
            grids,
            penalty=penalty,
            footprints=settings.footprints,
            noise_m=settings.noises * float(noise),
            min_cosine=settings.min_cosine,
            threads=threads,
        )
        for view, depth_m, noise in zip(views, depths_m, noises, strict=True)
    )  # fmt: skip


def complete_claims(labels: NDArray[np.int32], patches: NDArray[np.int32], reach_px: float) -> NDArray[np.int32]:
    """Claims (H, W) that go on where the surface does: to unclaimed pixels of the same patch within reach_px.

    So a leaf gets the tips and margins that its model did not reach yet, and not the whole of a leaf that it touches.

    Args:
        labels: 0 for none, k for the leaf k - 1.
        patches: 0 for none, k for the patch k - 1.
        reach_px: From the nearest claimed pixel, whose leaf gets it.
    """
    claimed = labels > 0
    if not claimed.any():
        return labels
    distance_px, nearest = cv2.distanceTransformWithLabels(
        (~claimed).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    leaf_of, patch_of = (np.zeros(int(nearest.max()) + 1, np.int32) for _ in range(2))
    leaf_of[nearest[claimed]] = labels[claimed]
    patch_of[nearest[claimed]] = patches[claimed]
    count = int(patches.max()) + 1
    pixels = np.bincount(patches.ravel(), minlength=count)
    # A leaf may be one patch with the ground or wall it touches; that is not its margin.
    own = np.bincount(patches[claimed], minlength=count) >= MIN_CLAIMED * np.maximum(pixels, 1)
    own[0] = False
    goes_on = ~claimed & own[patches] & (distance_px <= reach_px) & (patch_of[nearest] == patches)
    return np.where(goes_on, leaf_of[nearest], labels).astype(np.int32)


def collect_points(
    views: Sequence[View],
    depths_m: Sequence[NDArray[np.floating]],
    labels: Sequence[NDArray[np.int32]],
    count: int,
    confidence: NDArray[np.float64] | None = None,
    view: NDArray[np.int32] | None = None,
    settings: PointSettings = PointSettings(),
    *,
    noise_m: float | Sequence[float] = 0.0,
    planes: Sequence[LocalPlanes] | None = None,
    threads: int = 0,
) -> LeafPoints:
    """The points of the pixels that show each of count leaves, picked evenly where there are many.

    Args:
        views: V, of which the cameras are used.
        depths_m: V of (H, W), 0 where there is none.
        labels: V of (H, W), 0 for none, k for the leaf k - 1; without effect where there is no depth.
        count: Of leaves; those without pixels get no points.
        confidence: (count,), 1 by default.
        view: (count,), numbers of the views that the leaves are named after; by default the one that shows the most
            pixels of each, 0 for a leaf without.
        settings: How many points, and what an edge is.
        noise_m: Standard deviation of the depth, of all views or of each.
        planes: V, around the pixels of these depths, if they are there already.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: The numbers or sizes of the arrays do not match, or a label is above count.
    """
    noises = np.broadcast_to(np.asarray(noise_m, np.float64), len(views))
    seen = [depth_view(one.camera, depth_m) for one, depth_m in zip(views, depths_m, strict=True)]
    pixels_seen = np.zeros((len(views), count), np.int64)
    for number, (one, claimed) in enumerate(zip(seen, labels, strict=True)):
        if claimed.shape != one.depth_m.shape:
            raise ValueError(f"the labels must be {one.depth_m.shape}, not {claimed.shape}")
        if (highest := int(claimed.max(initial=0))) > count:
            raise ValueError(f"labels must be at most {count}, not {highest}")
        pixels_seen[number] = _native.count_labels(one, claimed, count=count)

    total = pixels_seen.sum(axis=0)
    kept = np.minimum(total, settings.max_per_leaf)
    offsets = np.concatenate([[0], np.cumsum(kept)]).astype(np.int64)
    points, normals = np.empty((offsets[-1], 3)), np.empty((offsets[-1], 3))
    kind, point_view = np.empty(offsets[-1], np.uint8), np.empty(offsets[-1], np.int32)
    before = np.zeros(count, np.int64)
    for number, (one, claimed) in enumerate(zip(seen, labels, strict=True)):
        picked = _native.pick_pixels(one, claimed, total=total, kept=kept, offsets=offsets, seen=before)
        pixels, places = picked.pixels, picked.places
        noise, camera = float(noises[number]), views[number].camera
        edges = _native.classify_edges(
            one,
            claimed,
            pixels,
            footprints=settings.edge,
            noise_m=settings.edge_noises * noise,
            threads=threads,
        )
        if planes is None:
            local = _native.fit_local_planes(
                one,
                pixels,
                radius_px=PatchSettings.radius_px,
                steepest=PatchSettings.steepest,
                noise_m=noise,
                threads=threads,
            )
            slopes, support = local.slopes, local.support
        else:
            slopes = planes[number].slopes.reshape(-1, 3)[pixels]
            support = planes[number].support.ravel()[pixels]
        ends = _native.place_edges(
            one, claimed, slopes, pixels=pixels, kinds=edges, beside_px=settings.beside_px, threads=threads
        )
        located = camera.unproject(ends.places_px, ends.depth_m)
        facing = np.asarray(_native.plane_normals(one, slopes, pixels, threads=threads), np.float64)
        alone = support < _MIN_SUPPORT
        towards = camera.position_m - located[alone]
        facing[alone] = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        points[places], normals[places] = located, facing
        kind[places] = _KINDS[edges]
        point_view[places] = number
    best_view = pixels_seen.argmax(axis=0) if len(views) else np.zeros(count)
    return LeafPoints(
        points_m=points,
        normals=normals,
        kind=kind,
        point_view=point_view,
        offsets=offsets,
        confidence=np.ones(count) if confidence is None else np.asarray(confidence, np.float64),
        view=(best_view if view is None else view).astype(np.int32),
    )
