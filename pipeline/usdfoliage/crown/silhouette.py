"""The crown's silhouette as a star-shaped curve: its centre and its radius by angle (thesis section 4.2.1).

Image frame: x to the right, y down, in pixels, the centre of pixel (column, row) at (column + 0.5, row + 0.5).
Angles run from +x towards −y, anticlockwise as one sees the picture.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import FitError


@dataclass(frozen=True, kw_only=True)
class SilhouetteSettings:
    """How finely the silhouette is described and its centre searched."""

    angles: int = 1024
    search_px: int = 128  # the centre is searched on a mask reduced to this many pixels
    search_angles: int = 256
    equal_share: float = 0.002  # centres whose losses differ by less of the mask's area count as equally good

    def __post_init__(self) -> None:
        for name in ("angles", "search_px", "search_angles"):
            if getattr(self, name) < 16:
                raise ValueError(f"{name} must be at least 16, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StarSilhouette:
    """The star-shaped curve about a centre that differs least from a mask."""

    center_px: NDArray[np.float64]  # (2,), x and y
    radius_px: NDArray[np.float64]  # (A,), at angle 2π a / A
    lost_share: float  # area of curve and mask that only one of them covers, over the mask's area
    iou: float  # intersection over union of curve and mask

    def curve_px(self) -> NDArray[np.float64]:
        """The curve's points (A, 2), x and y in the image frame."""
        angle = 2 * np.pi * np.arange(len(self.radius_px)) / len(self.radius_px)
        return self.center_px + self.radius_px[:, None] * np.column_stack([np.cos(angle), -np.sin(angle)])


def fit_star_silhouette(mask: NDArray[np.bool_], settings: SilhouetteSettings = SilhouetteSettings()) -> StarSilhouette:
    """Find the interior point whose star-shaped silhouette loses least area, and that silhouette.

    The thesis keeps the last crossing of each ray; here the radius of each ray is the one that leaves least area on
    the wrong side, which no other star-shaped curve about the same centre betters. The centre is searched on a grid of
    the whole interior, made finer twice about the best candidates, since the loss has many local minima (fig. 4.5).

    Args:
        mask: (H, W), True inside the crown.
        settings: Resolution of curve and search.

    Raises:
        ValueError: mask is not two-dimensional.
        FitError: The mask is empty, or has no interior.

    Source:
        Argudo, section 4.2.1; the radius rule is ours.
    """
    if mask.ndim != 2:
        raise ValueError(f"mask must be (H, W), not {mask.shape}")
    rows, columns = np.nonzero(mask)
    if len(rows) == 0:
        raise FitError("the mask is empty; a crown needs at least 3 x 3 pixels")
    corner = np.array([columns.min(), rows.min()])
    extent = np.array([columns.max(), rows.max()]) + 1 - corner
    if extent.min() < 3:
        raise FitError(f"the mask is {extent[0]} x {extent[1]} pixels; a crown needs at least 3 x 3")
    box = mask[corner[1] : corner[1] + extent[1], corner[0] : corner[0] + extent[0]]
    center = _search_center(box, settings)
    radius, lost, kept = _best_radii(box, center[None], settings.angles, samples_per_px=2.0)
    area = float(np.count_nonzero(box))
    # The curve's area is what it keeps of the mask and what it adds; lost = added + missed, kept = area − missed.
    missed = max(area - float(kept[0]), 0.0)
    added = max(float(lost[0]) - missed, 0.0)
    return StarSilhouette(
        center_px=center + corner,
        radius_px=radius[0],
        lost_share=(missed + added) / area,
        iou=(area - missed) / (area + added),
    )


def _search_center(box: NDArray[np.bool_], settings: SilhouetteSettings) -> NDArray[np.float64]:
    """The best centre (x, y) in the frame of the cropped mask."""
    stride = max(1, int(np.ceil(max(box.shape) / settings.search_px)))
    small = _reduce(box, stride)
    rows, columns = np.nonzero(small)
    centroid = np.array([columns.mean(), rows.mean()]) + 0.5
    pixels = np.column_stack([columns, rows]) + 0.5
    spacing = max(2.0, np.sqrt(len(pixels) / 150))
    lattice = np.all(np.mod(np.floor(pixels), np.floor(spacing)) == 0, axis=1)
    candidates = np.vstack([centroid, pixels[lattice]])
    lowest = np.inf
    while True:
        inside = _is_inside(small, candidates)
        candidates = (
            candidates[inside] if inside.any() else pixels[np.argmin(np.sum((pixels - centroid) ** 2, axis=1))][None]
        )
        _, lost, _ = _best_radii(small, candidates, settings.search_angles, samples_per_px=1.0)
        best, lowest = candidates[np.argmin(lost)], min(lowest, float(lost.min()))
        if spacing <= 0.5:
            break
        spacing /= 3
        offsets = np.arange(-2, 3) * spacing
        candidates = (best + np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)).reshape(-1, 2)
    # The loss of a compact crown is flat, down to the accuracy of its mask: on the way from the centroid to the
    # optimum take the first centre that is as good, so that a round crown is seen from its middle.
    path = centroid + np.linspace(0, 1, 25)[:, None] * (best - centroid)
    path = np.vstack([path[_is_inside(small, path)], best])
    _, lost, _ = _best_radii(small, path, settings.search_angles, samples_per_px=1.0)
    first = int(np.argmax(lost <= max(lowest, float(lost[-1])) + settings.equal_share * len(pixels)))
    return np.asarray(path[first] * stride)


def _reduce(box: NDArray[np.bool_], stride: int) -> NDArray[np.bool_]:
    """Majority of each stride × stride block."""
    height, width = (-(-n // stride) * stride for n in box.shape)
    padded = np.zeros((height, width), np.float32)
    padded[: box.shape[0], : box.shape[1]] = box
    share = padded.reshape(height // stride, stride, width // stride, stride).mean(axis=(1, 3))
    small = share >= 0.5
    return small if small.any() else share >= share.max()


def _is_inside(mask: NDArray[np.bool_], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    column, row = np.floor(points).astype(np.intp).T
    inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
    inside[inside] = mask[row[inside], column[inside]]
    return inside


def _best_radii(
    mask: NDArray[np.bool_], centers: NDArray[np.float64], angles: int, samples_per_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """For each centre (K, 2): radii (K, A), area lost (K,), mask area kept (K,), all in pixels of mask."""
    step = 1.0 / samples_per_px
    reach = np.hypot(*mask.shape) + 1
    radius = (np.arange(int(reach / step)) + 0.5) * step
    angle = 2 * np.pi * np.arange(angles) / angles
    ring = radius * step * (2 * np.pi / angles)  # area of one sample
    padded = np.pad(mask, 1)
    radii, lost, kept = (np.empty((len(centers), angles)), np.empty(len(centers)), np.empty(len(centers)))
    for k, (x, y) in enumerate(centers):
        column = np.clip(np.floor(x + np.cos(angle)[:, None] * radius), -1, mask.shape[1]).astype(np.intp) + 1
        row = np.clip(np.floor(y - np.sin(angle)[:, None] * radius), -1, mask.shape[0]).astype(np.intp) + 1
        inside = padded[row, column]
        covered = np.cumsum(inside * ring, axis=1)
        gain = np.cumsum(np.where(inside, ring, -ring), axis=1)
        last = np.argmax(gain, axis=1)
        every = np.arange(angles)
        radii[k] = radius[last] + step / 2
        best = np.maximum(gain[every, last], 0)
        kept[k] = covered[every, last].sum()
        lost[k] = covered[:, -1].sum() - best.sum()
    return radii, lost, kept
