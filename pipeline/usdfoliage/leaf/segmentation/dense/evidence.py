"""What the views show of fitted leaves: seen in their place, looked through, and ending where they end. Our own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.capture.view import View
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.segmentation.dense.depth_view import depth_view, mean_focal_px
from usdfoliage.leaf.shape.surface import evaluate_grid

_ON, _THROUGH = 1, 2  # of _native.classify_points
_MAX_PLACES = 1000  # no photograph shows more of a leaf


@dataclass(frozen=True, kw_only=True)
class EvidenceSettings:
    """Where leaves are probed, and when a probe lies on what is seen."""

    columns: int = 8  # A leaf is probed at this many places across. Range: 1 to 1000.
    rows: int = 14  # A leaf is probed at this many places along. Range: 1 to 1000.
    ring: int = 16  # Either half of the silhouette is probed at this many places. Range: 1 to 1000.
    # A probe lies on the visible surface up to this distance. Unit: footprints. Range: 0 or more.
    footprints: float = 2.5
    # A probe around the silhouette lies on the visible surface up to this distance. Unit: footprints. Range: 0 or
    # more.
    ring_footprints: float = 3.0
    # These distances are larger by this many standard deviations of the depth. Unit: standard deviations. Range: 0 or
    # more.
    noises: float = 3.0
    # Probes around the silhouette lie inside and outside of it by at least this distance. Unit: leaf lengths. Range:
    # above 0.
    offset: float = 0.03
    # That distance has at least this many footprints. Unit: footprints. Range: 0 or more.
    offset_footprints: float = 2.5
    # That distance has, in addition, this many standard deviations of the depth. Unit: standard deviations. Range: 0
    # or more.
    offset_noises: float = 2.0

    def __post_init__(self) -> None:
        if not all(1 <= count <= _MAX_PLACES for count in (self.columns, self.rows, self.ring)):
            raise ValueError(f"columns, rows and ring must be 1 to {_MAX_PLACES}, not {self}")
        numbers = (self.footprints, self.ring_footprints, self.noises, self.offset_footprints, self.offset_noises)
        if min(numbers) < 0 or not self.offset > 0:
            raise ValueError(f"offset must be above 0, footprints and noises not below, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What is known of N leaves, each at K probes on its surface."""

    on: NDArray[np.float64]  # (N,), share of the area that at least as many views see in its place as look through it
    violated: NDArray[np.float64]  # (N,), share that more views look through
    unseen: NDArray[np.float64]  # (N,), the rest: hidden, or outside of all pictures
    free: NDArray[np.float64]  # (N,), share of the silhouette where what is seen ends with the leaf
    continued: NDArray[np.float64]  # (N,), share where it goes on
    area_m2: NDArray[np.float64]  # (N,)
    points_m: NDArray[np.float64]  # (N, K, 3), the probes
    normals: NDArray[np.float64]  # (N, K, 3), unit
    areas_m2: NDArray[np.float64]  # (N, K), that each probe stands for
    seen: NDArray[np.bool_]  # (N, K), probes that count as on


def weigh_evidence(
    leaves: Leaves,
    views: Sequence[View],
    depths_m: Sequence[NDArray[np.floating]],
    noise_m: float | Sequence[float],
    settings: EvidenceSettings = EvidenceSettings(),
    *,
    threads: int = 0,
) -> Evidence:
    """Probe leaves against the depth of all views.

    A place on the silhouette is free in a view that sees the leaf right inside of it and something farther right
    outside, and goes on where the view sees the leaf's surface there too; the more frequent of both counts.

    Args:
        leaves: In the frame of the cameras.
        views: V, of which the cameras are used.
        depths_m: V of (H, W), 0 where there is none.
        noise_m: Standard deviation of the depth, of all views or of each.
        settings: Where to probe.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: There are not as many depth maps as views, or one is not as large as its view.
    """
    noises = np.broadcast_to(np.asarray(noise_m, np.float64), len(views))
    points, normals, areas = _probes(leaves, settings, threads)
    ring, outward = _ring(leaves, settings, threads)
    probes = np.ascontiguousarray(points.reshape(-1, 3))
    on, through = np.zeros(len(probes), np.int32), np.zeros(len(probes), np.int32)
    free, continued = np.zeros(ring.shape[:2], np.int32), np.zeros(ring.shape[:2], np.int32)
    for view, depth_m, noise in zip(views, depths_m, noises.tolist(), strict=True):
        seen = depth_view(view.camera, depth_m)
        state = _native.classify_points(
            probes, seen, footprints=settings.footprints, noise_m=settings.noises * noise, threads=threads
        )
        on += state == _ON
        through += state == _THROUGH

        # right beside the silhouette as this view resolves it
        rotation, translation = view.camera.cam_from_world[2, :3], view.camera.cam_from_world[2, 3]
        footprint_m = np.maximum(ring @ rotation + translation, 0) / mean_focal_px(view.camera)
        aside_m = settings.offset_footprints * footprint_m + settings.offset_noises * noise
        aside_m = np.maximum(settings.offset * leaves.length_m[:, None], aside_m)[..., None]
        inside, outside = (
            _native.classify_points(
                (ring + side * aside_m * outward).reshape(-1, 3),
                seen,
                footprints=settings.ring_footprints,
                noise_m=settings.noises * noise,
                threads=threads,
            ).reshape(ring.shape[:2])
            for side in (-1, 1)
        )
        free += (inside == _ON) & (outside == _THROUGH)
        continued += (inside == _ON) & (outside == _ON)

    is_on = ((on > 0) & (on >= through)).reshape(areas.shape)
    is_violated = (through > on).reshape(areas.shape)
    area = areas.sum(axis=1)
    whole = np.where(area > 0, area, 1.0)
    on_share, violated_share = (areas * is_on).sum(axis=1) / whole, (areas * is_violated).sum(axis=1) / whole
    return Evidence(
        on=on_share,
        violated=violated_share,
        unseen=np.where(area > 0, (areas * ~(is_on | is_violated)).sum(axis=1) / whole, 1.0),
        free=((free > continued) & (free > 0)).mean(axis=1),
        continued=((continued >= free) & (continued > 0)).mean(axis=1),
        area_m2=area,
        points_m=points,
        normals=normals,
        areas_m2=areas,
        seen=is_on,
    )


def _probes(
    leaves: Leaves, settings: EvidenceSettings, threads: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The middles of a grid's cells, (N, K, 3), the normals there and the cells' areas (N, K)."""
    u, v = (
        (np.arange(settings.columns) + 0.5) * 2 / settings.columns - 1,
        (np.arange(settings.rows) + 0.5) / settings.rows,
    )
    grid = evaluate_grid(leaves.parameters, u, v, placements=leaves.asset_from_leaf(), threads=threads)
    elements = np.linalg.norm(np.cross(grid.tangents_u, grid.tangents_v), axis=-1)
    count = settings.columns * settings.rows
    return (
        grid.points.reshape(-1, count, 3),
        grid.normals.reshape(-1, count, 3),
        elements.reshape(-1, count) * (2 / count),
    )


def _ring(leaves: Leaves, settings: EvidenceSettings, threads: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points on the silhouette (N, R, 3), and where the surface would go on from there: unit, across the silhouette."""
    v = (np.arange(settings.ring) + 0.5) / settings.ring
    grid = evaluate_grid(leaves.parameters, [-1.0, 1.0], v, placements=leaves.asset_from_leaf(), threads=threads)
    along = _unit(grid.tangents_v)
    outward = grid.tangents_u * np.array([-1.0, 1.0])[:, None]
    outward = _unit(outward - np.sum(outward * along, axis=-1, keepdims=True) * along)
    return grid.points.reshape(-1, 2 * settings.ring, 3), outward.reshape(-1, 2 * settings.ring, 3)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, norm, out=np.zeros_like(vectors), where=norm > 0)
