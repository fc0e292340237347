"""Candidate leaves of one view, and how sure it is that each is one leaf.

Source: G. Chaurasia, P. Beardsley, Editable Parametric Dense Foliage from 3D Capture, 2017, section 4.1, leaf
confidence.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.enclosing_ellipse import enclosing_ellipses
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.segmentation.model import Candidates
from usdfoliage.leaf.segmentation.paper.affinity import AffinitySettings, join_superpixels, measure_affinity
from usdfoliage.leaf.segmentation.paper.planes import PlaneSettings, SuperpixelPlanes, fit_planes
from usdfoliage.leaf.segmentation.paper.superpixels import SuperpixelSettings, segment_superpixels

_GRAZING = 0.1  # cosine below which a surface is seen too flat for its area to be measured


@dataclass(frozen=True, kw_only=True)
class CandidateSettings:
    """Which components are candidates."""

    min_superpixels: int = 2  # A component with fewer superpixels is no candidate. Range: 1 or more.
    # A component larger than this share of the picture is a wall or the ground, and no candidate. Range: above 0, up
    # to 1.
    max_share: float = 0.25

    def __post_init__(self) -> None:
        if self.min_superpixels < 1 or not 0 < self.max_share <= 1:
            raise ValueError(f"min_superpixels must be at least 1 and max_share in (0, 1], not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateShapes:
    """The enclosing ellipses of C candidates, each in the plane through its points, in the world."""

    centers_m: NDArray[np.float64]  # (C, 3)
    axes: NDArray[np.float64]  # (C, 3, 3), rows: along the ellipse, across it, normal towards the camera
    half_axes_m: NDArray[np.float64]  # (C, 2), the longer one first
    areas_m2: NDArray[np.float64]  # (C,), of the leaf, projected on its plane
    confidence: NDArray[np.float64]  # (C,), share of the ellipse that the leaf occupies


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewCandidates:
    """What is found in one view."""

    candidates: Candidates
    shapes: CandidateShapes
    planes: SuperpixelPlanes
    dropped: Mapping[str, int]  # superpixels and components, by reason


def segment_view(
    view: View,
    plane_threshold_m: float,
    superpixels: SuperpixelSettings = SuperpixelSettings(),
    planes: PlaneSettings = PlaneSettings(),
    affinity: AffinitySettings = AffinitySettings(),
    settings: CandidateSettings = CandidateSettings(),
    *,
    rng: np.random.Generator,
) -> ViewCandidates:
    """Candidate leaves of one view with depth: superpixels, their planes, their graph, its components."""
    points_m = view.points()
    wanted = np.ones(view.depth_m.shape, np.bool_) if view.mask is None else view.mask
    labels = segment_superpixels(view.srgb, wanted, superpixels)
    fitted = fit_planes(points_m, labels, view.camera.position_m, plane_threshold_m, planes, rng=rng)
    graph = measure_affinity(points_m, labels, fitted, plane_threshold_m, affinity)
    component = join_superpixels(graph, fitted.valid, affinity)

    found = component >= 0
    count = int(component.max(initial=-1)) + 1
    grains = np.bincount(component[found], minlength=count)
    pixels = np.bincount(
        component[found],
        np.bincount(labels[fitted.inliers], minlength=len(component))[found],
        minlength=count,
    )
    small = grains < settings.min_superpixels
    huge = pixels > settings.max_share * labels.size
    kept = ~small & ~huge
    number = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    component[found] = number[component[found]]

    shapes = measure_shapes(points_m, labels, component, fitted, view.camera)
    # Pixels without depth inside a superpixel of a leaf are that leaf's: its colour shows it.
    of_leaf = fitted.inliers | ((labels >= 0) & ~(view.depth_m > 0))
    pixel_component = np.append(component, np.int32(-1))[labels]
    return ViewCandidates(
        candidates=Candidates(
            labels=np.where(of_leaf, pixel_component + 1, 0).astype(np.int32),
            confidence=shapes.confidence,
            superpixels=labels,
        ),
        shapes=shapes,
        planes=fitted,
        dropped={
            **fitted.dropped,
            "components of too few superpixels": int(np.count_nonzero(small)),
            "components too large for a leaf": int(np.count_nonzero(huge)),
        },
    )


def measure_shapes(
    points_m: NDArray[np.float64],
    labels: NDArray[np.int32],
    component: NDArray[np.int32],
    planes: SuperpixelPlanes,
    camera: Pinhole,
) -> CandidateShapes:
    """Enclosing ellipse, area and confidence of every candidate.

    Args:
        points_m: (H, W, 3), in the world, NaN where there is none.
        labels: (H, W), superpixels from 0, -1 for none.
        component: (S,), the candidate of each superpixel, from 0; -1 for none.
        planes: Of the superpixels.
        camera: That saw the points.
    """
    count = int(component.max(initial=-1)) + 1
    owner_map = np.where(planes.inliers, np.append(component, np.int32(-1))[labels], -1).ravel()
    order = np.flatnonzero(owner_map >= 0)
    order = order[np.argsort(owner_map[order], kind="stable")]
    owner = owner_map[order].astype(np.intp)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))]).astype(np.int64)
    centers, axes = plane_frames(points_m.reshape(-1, 3)[order], offsets, camera.position_m)
    local = np.einsum("pij,pj->pi", axes[owner, :2], points_m.reshape(-1, 3)[order] - centers[owner])
    ellipses = enclosing_ellipses(local, offsets)
    centers = centers + np.einsum("ci,cij->cj", ellipses.centers, axes[:, :2])
    cosine, sine = np.cos(ellipses.angles), np.sin(ellipses.angles)
    along = cosine[:, None] * axes[:, 0] + sine[:, None] * axes[:, 1]
    axes = np.stack([along, np.cross(axes[:, 2], along), axes[:, 2]], axis=1)

    # The area of a superpixel's pixels on its own plane, then projected on the candidate's.
    in_cam = planes.centroids @ camera.cam_from_world[:, :3].T + camera.cam_from_world[:, 3]
    turned = planes.normals @ camera.cam_from_world[:, :3].T
    ray = in_cam / in_cam[:, 2:]
    facing = np.maximum(np.abs(np.einsum("si,si->s", turned, ray)) / np.linalg.norm(ray, axis=1), _GRAZING)
    pixel_m2 = in_cam[:, 2] ** 2 / (camera.focal_px[0] * camera.focal_px[1]) / (facing * np.linalg.norm(ray, axis=1))
    covered = planes.inliers | ~np.isfinite(points_m[..., 0])
    pixels = np.bincount(labels[covered & (labels >= 0)], minlength=len(component))
    member = component >= 0
    toward = np.abs(np.einsum("si,si->s", planes.normals[member], axes[component[member], 2]))
    areas_m2 = np.bincount(component[member], (pixels * pixel_m2)[member] * toward, minlength=count).astype(np.float64)
    seen = np.bincount(component[member], pixels[member], minlength=count)
    # Points are the middles of pixels, areas are whole pixels: the ellipse reaches half a pixel farther.
    margin_m = 0.5 * np.sqrt(areas_m2 / np.maximum(seen, 1))
    ellipse_m2 = np.pi * np.prod(ellipses.half_axes + margin_m[:, None], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        confidence = np.where(ellipse_m2 > 0, np.minimum(areas_m2 / ellipse_m2, 1.0), 0.0)
    return CandidateShapes(
        centers_m=centers, axes=axes, half_axes_m=ellipses.half_axes, areas_m2=areas_m2, confidence=confidence
    )


def plane_frames(
    points_m: NDArray[np.float64], offsets: NDArray[np.int64], camera_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means (C, 3) and axes (C, 3, 3) of sets of points: rows from the longest extent to the normal, right-handed."""
    sizes = np.diff(offsets)
    owner = np.repeat(np.arange(len(sizes)), sizes)
    total = np.maximum(sizes, 1)[:, None]
    means = np.stack([np.bincount(owner, points_m[:, k], minlength=len(sizes)) for k in range(3)], axis=1) / total
    centered = points_m - means[owner]
    covariance = np.empty((len(sizes), 3, 3))
    for row in range(3):
        for column in range(row, 3):
            sums = np.bincount(owner, centered[:, row] * centered[:, column], minlength=len(sizes))
            covariance[:, row, column] = covariance[:, column, row] = sums
    _, vectors = np.linalg.eigh(covariance)
    along, normal = vectors[:, :, 2], vectors[:, :, 0]
    normal = np.where(np.einsum("ci,ci->c", normal, camera_m - means)[:, None] < 0, -normal, normal)
    return means, np.stack([along, np.cross(normal, along), normal], axis=1)
