"""Exact depth and what a depth camera or a stereo matcher would make of it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.pinhole import Pinhole

from tools.synthetic.raster import rasterise
from tools.synthetic.scene import Scene
from tools.synthetic.shading import backdrop_depth

SKY, WOOD, LEAF, BACKDROP = 0, 1, 2, 3  # labels of pixels


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """How depth is degraded; lengths in pixel footprints, what a pixel covers at the depth of its point."""

    sigma: float = 1.0
    outliers: float = 0.02  # share of pixels
    outlier_offset: float = 30.0  # towards or away from the camera
    outlier_sigma: float = 40.0
    edge_step: float = 6.0  # between neighbours, to be an edge
    edge_holes: float = 0.65  # share of the pixels beside edges, on either side
    holes: float = 0.02  # share of all pixels, in blobs

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            number = getattr(self, name)
            if not (np.isfinite(number) and number >= 0):
                raise ValueError(f"{name} must be 0 or more, not {number}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenDepth:
    """What is seen through the centre of every pixel of a view."""

    depth_m: NDArray[np.float32]  # (H, W), along the optical axis, 0 for none
    leaf_id: NDArray[np.uint16]  # (H, W), 0 for none, k for the leaf k - 1
    label: NDArray[np.uint8]  # (H, W), SKY, WOOD, LEAF or BACKDROP


def see_depth(scene: Scene, camera: Pinhole) -> SeenDepth:
    """Exact depth and what it belongs to."""
    places, depth = camera.project(scene.points_m)
    hits = rasterise(places, 1 / depth, scene.triangles, (camera.height_px, camera.width_px))
    behind = backdrop_depth(scene, camera)
    plant = hits.triangle >= 0
    leaf = np.where(plant, scene.leaf[hits.triangle], -1)
    label = np.where(behind > 0, BACKDROP, SKY)
    label[plant] = np.where(leaf[plant] >= 0, LEAF, WOOD)
    return SeenDepth(
        depth_m=np.where(plant, hits.depth, behind).astype(np.float32),
        leaf_id=(leaf + 1).astype(np.uint16),
        label=label.astype(np.uint8),
    )


def degrade_depth(
    depth_m: NDArray[np.float32], focal_px: float, rng: np.random.Generator, settings: NoiseSettings = NoiseSettings()
) -> NDArray[np.float32]:
    """Depth (H, W) with noise, outliers and holes, most of them beside the edges of things."""
    exact = depth_m.astype(np.float64)
    footprint = exact / focal_px
    noisy = exact + settings.sigma * footprint * rng.normal(size=exact.shape)
    outlier = rng.random(exact.shape) < settings.outliers
    side = rng.choice((-1.0, 1.0), exact.shape)
    far = settings.outlier_offset * side + settings.outlier_sigma * rng.normal(size=exact.shape)
    noisy[outlier] += (footprint * far)[outlier]
    kernel = np.ones((3, 3), np.uint8)
    step = cv2.dilate(exact, kernel) - cv2.erode(exact, kernel)
    beside = step > settings.edge_step * footprint
    holes = beside & (rng.random(exact.shape) < settings.edge_holes)
    blobs = cv2.GaussianBlur(rng.normal(size=exact.shape), (0, 0), 2.0)
    holes |= blobs > np.quantile(blobs, 1 - min(settings.holes, 1.0))
    noisy[holes | (exact == 0) | (noisy <= 0)] = 0
    return noisy.astype(np.float32)
