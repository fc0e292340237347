"""Sinuses that overlapping lobes close, opened again, so that the silhouette goes into them.

Where the margins of two lobes lie over each other, the sinus between them is a long hole that points to the silhouette.
A torn hole is round, or far from the silhouette, and stays.

Source:
    Our own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class SinusSettings:
    """Which holes are sinuses."""

    long: float = 1.5  # A sinus is so many times as long as it is wide at least. Range: 1 or more.
    overlap: float = 0.2  # Lobes overlap by this part of the root of the leaf's area at most. Range: above 0.
    beside: float = 1.2  # and by so many lengths of the hole. Range: above 0.
    width: float = 0.006  # of the cut, as a part of the root of the leaf's area, 3 pixels at least. Range: above 0.

    def __post_init__(self) -> None:
        if not (self.long >= 1 and min(self.overlap, self.beside, self.width) > 0):
            raise ValueError("long must be at least 1, and overlap, beside and width above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedSinuses:
    """A mask whose sinuses are open."""

    mask: Mask  # (H, W)
    opened: int  # how many were closed
    holes: int  # that stay


def open_sinuses(mask: Mask, settings: SinusSettings = SinusSettings()) -> OpenedSinuses:
    """Cut a mask (H, W) from each hole that is a sinus to the outside of the leaf, as the hole points."""
    if mask.all() or not mask.any():
        return OpenedSinuses(mask=mask.copy(), opened=0, holes=0)
    count, labels, measures, _ = cv2.connectedComponentsWithStats((~np.pad(mask, 1)).astype(np.uint8), connectivity=4)
    labels = labels[1:-1, 1:-1]
    outside = labels == _outside_label(mask, labels)
    size = float(np.sqrt(mask.sum()))
    lines, _ = cv2.findContours((~outside).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rim = np.concatenate([line[:, 0, :] for line in lines]).astype(np.float64)
    cut = mask.copy()
    opened = kept = 0
    for hole in range(1, count):
        region = labels == hole
        if not region.any() or (region & outside).any() or mask[region].any():
            continue
        bridge = _bridge(region, rim, size, settings)
        if bridge is None:
            kept += 1
            continue
        line = np.zeros(mask.shape, np.uint8)
        ends = [(int(x), int(y)) for x, y in np.round(bridge)]
        cv2.line(line, ends[0], ends[1], 1, max(3, round(settings.width * size)))
        cut &= line == 0
        opened += 1
    # A cut may set a corner of a lobe free.
    pieces, labels, measures, _ = cv2.connectedComponentsWithStats(cut.astype(np.uint8), connectivity=4)
    if pieces > 2:
        cut = labels == 1 + int(np.argmax(measures[1:, cv2.CC_STAT_AREA]))
    return OpenedSinuses(mask=cut, opened=opened, holes=kept)


def _outside_label(mask: Mask, labels: NDArray[np.int32]) -> int:
    """The number of what is around a mask, to which the padding of one pixel belongs."""
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    free = rim[~np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])]
    return int(free[0]) if len(free) else -1


def _bridge(region: Mask, rim: Floats, size: float, settings: SinusSettings) -> Floats | None:
    """(2, 2) from the end of a hole to the rim of the leaf, as the hole points; None where it is no sinus."""
    rows, columns = np.nonzero(region)
    points = np.stack([columns, rows], axis=-1).astype(np.float64)
    if len(points) < 8:
        return None
    _, (one, other), _ = cv2.minAreaRect(points.astype(np.float32))
    length, width = max(one, other) + 1, min(one, other) + 1
    if length < settings.long * width:
        return None
    middle = points.mean(axis=0)
    axis = np.linalg.eigh(np.cov((points - middle).T))[1][:, -1]
    best: tuple[float, Floats] | None = None
    for direction in (axis, -axis):
        end = points[np.argmax((points - middle) @ direction)]
        route = rim - end
        away = np.linalg.norm(route, axis=1)
        turn = 1 - (route @ direction) / np.maximum(away, 1e-9)
        near = np.flatnonzero((away <= settings.overlap * size) & (away <= settings.beside * length) & (turn < 0.7))
        if len(near):
            dear = away[near] * (1 + 2 * turn[near])
            place = int(near[np.argmin(dear)])
            if best is None or dear.min() < best[0]:
                ahead = route[place] / max(float(away[place]), 1e-9)
                best = float(dear.min()), np.stack([end - 2 * ahead, rim[place] + 2 * ahead])
    return None if best is None else best[1]
