"""Depth of posed photographs by PatchMatch: a slanted plane through every pixel, matched with other photographs.

Guo et al., Realistic Procedural Plant Modeling from Multiple View Images, 2020, section 4: the matching of equation 1
and the coherence of equation 3; after M. Bleyer et al., PatchMatch Stereo, 2011, with the checkerboard of S. Galliani
et al., Massively Parallel Multiview Stereopsis, 2015. Planes are linear in inverse depth, which homographies keep so.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import _native
from usdfoliage.geometry.pinhole import Pinhole

UNMATCHED = 4.0  # cost of a pixel that nothing can be compared with, as in patch_match.h


@dataclass(frozen=True, kw_only=True)
class PatchMatchSettings:
    """How patches are compared, and how many planes are tried."""

    radius_px: int = 5  # of the window
    step_px: int = 2  # between its samples
    color_sigma: float = 0.1  # of brightness, 0 to 1: what is beside an edge counts little
    best: int = 2  # sources that count at each pixel, those that match best: from the others it may be hidden
    steepest: float = 6.0  # tangent of the angle between a surface and the picture plane
    iterations: tuple[int, ...] = (4, 2, 2)  # at the coarsest scale, at twice that, ..., at full size
    coherent_iterations: int = 1  # more at full size, with what the sources' own depth says
    coherence_weight: float = 0.1  # of a pixel of reprojection error, in cost
    coherence_most_px: float = 3.0  # of reprojection error, that counts at most

    def __post_init__(self) -> None:
        if self.radius_px < 1 or self.step_px < 1 or self.best < 1 or self.coherent_iterations < 0:
            raise ValueError(f"radius_px, step_px and best must be at least 1, coherent_iterations 0, not {self}")
        if not self.iterations or min(self.iterations) < 0:
            raise ValueError(f"iterations must be numbers from 0 on, one a scale, not {self.iterations}")
        for name in ("color_sigma", "steepest", "coherence_weight", "coherence_most_px"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPicture:
    """A photograph as it is matched."""

    camera: Pinhole
    grey: NDArray[np.float32]  # (H, W), 0 to 1
    valid: NDArray[np.bool_] | None = None  # (H, W), where depth is wanted

    def __post_init__(self) -> None:
        size = self.camera.height_px, self.camera.width_px
        if self.grey.shape != size or (self.valid is not None and self.valid.shape != size):
            raise ValueError(f"grey and valid must be {size}, not {self.grey.shape}")


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedPlanes:
    """The plane through every pixel."""

    slopes: NDArray[np.float32]  # (H, W, 3), inverse depth: change a pixel to the right and down, and value, in 1 / m
    cost: NDArray[np.float32]  # (H, W), 0 a perfect match, UNMATCHED where there is none

    def depth_m(self, most_cost: float) -> NDArray[np.float32]:
        """(H, W), along the optical axis; 0 where the cost is higher."""
        value = self.slopes[..., 2]
        good = (self.cost <= most_cost) & (value > 0)
        return np.where(good, 1 / np.where(good, value, 1), 0).astype(np.float32)


def match_picture(
    reference: MatchedPicture,
    sources: Sequence[MatchedPicture],
    nearest_m: float,
    farthest_m: float,
    settings: PatchMatchSettings = PatchMatchSettings(),
    *,
    seed: int = 0,
    threads: int = 0,
) -> MatchedPlanes:
    """The planes of a photograph, from coarse pictures to full ones, by how its patches look in the sources.

    Args:
        reference: Whose planes.
        sources: Which see the same from elsewhere; 16 at most.
        nearest_m: Depth, along the optical axis.
        farthest_m: Depth.
        settings: How.
        seed: Of the planes that are guessed.
        threads: At most so many, 0 for one per core; the result is the same.

    Raises:
        ValueError: The depths are not above 0 and in order, or there is no source, or there are more than 16.
    """
    if not 0 < nearest_m < farthest_m:
        raise ValueError(f"depths must rise from above 0, not {nearest_m} to {farthest_m}")
    if not 1 <= len(sources) <= 16:
        raise ValueError(f"a photograph is matched with 1 to 16 others, not {len(sources)}")
    planes: MatchedPlanes | None = None
    for number, iterations in enumerate(settings.iterations):
        scale = 0.5 ** (len(settings.iterations) - 1 - number)
        pictures = [_shrink(picture, scale) for picture in (reference, *sources)]
        start = None if planes is None else _grow(planes.slopes, pictures[0].grey.shape)
        planes = _match(
            pictures[0], pictures[1:], [None] * len(sources), start, nearest_m, farthest_m, iterations, settings,
            seed + number, threads,
        )  # fmt: skip
    assert planes is not None
    return planes


def match_coherently(
    reference: MatchedPicture,
    sources: Sequence[MatchedPicture],
    start: MatchedPlanes,
    of_sources: Sequence[MatchedPlanes],
    nearest_m: float,
    farthest_m: float,
    settings: PatchMatchSettings = PatchMatchSettings(),
    *,
    seed: int = 0,
    threads: int = 0,
) -> MatchedPlanes:
    """Planes improved where the depth of the sources contradicts them, equation 3.

    Args:
        reference: Whose planes.
        sources: As for match_picture.
        start: The planes so far.
        of_sources: Those of each source.
        nearest_m: Depth.
        farthest_m: Depth.
        settings: How.
        seed: Of the planes that are guessed.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    return _match(
        reference, sources, [planes.slopes for planes in of_sources], start.slopes, nearest_m, farthest_m,
        settings.coherent_iterations, settings, seed, threads,
    )  # fmt: skip


def _match(
    reference: MatchedPicture,
    sources: Sequence[MatchedPicture],
    of_sources: Sequence[NDArray[np.float32] | None],
    start: NDArray[np.float32] | None,
    nearest_m: float,
    farthest_m: float,
    iterations: int,
    settings: PatchMatchSettings,
    seed: int,
    threads: int,
) -> MatchedPlanes:
    slopes = np.zeros((*reference.grey.shape, 3), np.float32) if start is None else start.copy()
    cost = np.full(reference.grey.shape, UNMATCHED, np.float32)
    seen = [
        (
            source.grey,
            _map_to(reference.camera, source.camera),
            _map_to(source.camera, reference.camera),
            its_planes,
        )
        for source, its_planes in zip(sources, of_sources, strict=True)
    ]
    _native.match_patches(
        reference.grey, None if reference.valid is None else reference.valid.astype(np.uint8), seen, slopes, cost,
        settings.radius_px, settings.step_px, settings.color_sigma, 1 / nearest_m, 1 / farthest_m, settings.steepest,
        settings.best, iterations, settings.coherence_weight, settings.coherence_most_px,
        float(np.sqrt(np.prod(reference.camera.focal_px))), seed, threads,
    )  # fmt: skip
    return MatchedPlanes(slopes=slopes, cost=cost)


def _map_to(reference: Pinhole, source: Pinhole) -> NDArray[np.float64]:
    """(3, 4): where (x, y, 1, inverse depth) of the reference is seen in the source, homogeneous."""
    turn = source.cam_from_world[:, :3] @ reference.cam_from_world[:, :3].T
    shift = source.cam_from_world[:, 3] - turn @ reference.cam_from_world[:, 3]
    linear = _intrinsics(source) @ turn @ np.linalg.inv(_intrinsics(reference))
    return np.column_stack([linear, _intrinsics(source) @ shift])


def _intrinsics(camera: Pinhole) -> NDArray[np.float64]:
    (fx, fy), (cx, cy) = camera.focal_px, camera.center_px
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _shrink(picture: MatchedPicture, scale: float) -> MatchedPicture:
    if scale == 1:
        return picture
    camera = picture.camera
    width, height = (max(1, round(side * scale)) for side in (camera.width_px, camera.height_px))
    across, down = width / camera.width_px, height / camera.height_px
    valid = None
    if picture.valid is not None:
        valid = cv2.resize(picture.valid.astype(np.uint8), (width, height), interpolation=cv2.INTER_AREA) > 0
    return MatchedPicture(
        camera=Pinhole(
            width_px=width,
            height_px=height,
            focal_px=(camera.focal_px[0] * across, camera.focal_px[1] * down),
            center_px=(camera.center_px[0] * across, camera.center_px[1] * down),
            cam_from_world=camera.cam_from_world,
        ),
        grey=np.ascontiguousarray(cv2.resize(picture.grey, (width, height), interpolation=cv2.INTER_AREA), np.float32),
        valid=valid,
    )


def _grow(slopes: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Planes (h, w, 3) of a coarse picture at the pixels of a finer one (H, W)."""
    height, width = shape
    down, across = slopes.shape[0] / height, slopes.shape[1] / width
    row, column = (np.arange(height) + 0.5) * down, (np.arange(width) + 0.5) * across
    i, j = row.astype(int), column.astype(int)
    near = slopes[i][:, j]
    beside, below = (column - j - 0.5).astype(np.float32), (row - i - 0.5).astype(np.float32)
    value = near[..., 2] + near[..., 0] * beside + near[..., 1] * below[:, None]
    return np.ascontiguousarray(
        np.stack([near[..., 0] * np.float32(across), near[..., 1] * np.float32(down), value], axis=-1)
    )
