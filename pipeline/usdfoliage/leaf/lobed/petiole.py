"""The petiole of a leaf in a scan set apart from its blade, whether it lies beside it or over it.

A petiole over the blade is a long thin region of another colour; beside the blade it is a thin limb as well. What a
petiole hides of the blade is filled in: both sides of it are blade.

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
class PetioleSettings:
    """How a petiole looks. Lengths are parts of the root of the leaf's area."""

    width: float = 0.045  # of the widest one
    thinnest: float = 0.009  # of the thinnest one over the blade: veins are thinner
    length: float = 0.1  # of the shortest one
    slender: float = 4.0  # its length, in its widths
    darker: float = 10.0  # Lab units, than paper: through a slit in a leaf paper is seen
    colored: float = 5.0  # median deviations, that its colour differs from the blade's

    def __post_init__(self) -> None:
        if not (0 < self.thinnest < self.width and self.length > 0 and self.slender >= 1):
            raise ValueError("thinnest must be above 0 and below width, length above 0, slender at least 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class SplitLeaf:
    """A leaf's pixels by what they are."""

    blade: Mask  # (H, W), what the petiole hides of it included
    petiole: Mask  # (H, W), where it is seen: over the blade as well
    ends: Floats  # (2, 2) x and y of the petiole's ends, pixels, y down; (0, 2) where none was found


def split_petiole(srgb: NDArray[np.uint8], mask: Mask, settings: PetioleSettings = PetioleSettings()) -> SplitLeaf:
    """The blade and the petiole of a leaf.

    Args:
        srgb: (H, W, 3), of the picture.
        mask: (H, W), of the leaf; a petiole as light as the paper's ruling may be missing in it as a slit.
        settings: How a petiole looks.
    """
    if srgb.shape[:2] != mask.shape:
        raise ValueError(f"the mask must be {srgb.shape[:2]}, not {mask.shape}")
    size = float(np.sqrt(mask.sum()))
    lab = cv2.cvtColor(cv2.GaussianBlur(srgb, (0, 0), max(0.8, 0.0025 * size)), cv2.COLOR_RGB2LAB).astype(np.float64)
    lab[..., 0] *= 100 / 255
    found = _slits(lab[..., 0], mask, size, settings)
    full = mask | found
    found |= _colored(lab, full, size, settings)
    found = _close(found, 0.01 * size) & full
    rest = _largest(cv2.morphologyEx((full & ~found).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)
    blade = _largest((_close(rest, 0.6 * settings.width * size) & full) | rest)
    # A fringe of the petiole is left where it ends at the blade; tips of teeth are blade.
    off = full & ~blade
    _count, labels = cv2.connectedComponents(off.astype(np.uint8), connectivity=8)
    touched = np.isin(labels, np.unique(labels[found & off])) & (labels > 0)
    blade |= off & ~touched
    petiole = _largest(found | touched)
    if not petiole.any():
        return SplitLeaf(blade=mask.copy(), petiole=petiole, ends=np.empty((0, 2)))
    return SplitLeaf(blade=_fill(blade, found), petiole=petiole, ends=_ends(petiole))


def _slits(light: Floats, mask: Mask, size: float, settings: PetioleSettings) -> Mask:
    """Narrow gaps of a mask through which no paper is seen."""
    gaps = _close(mask, settings.width * size / 2) & ~mask
    around = ~cv2.dilate(mask.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool)
    if not around.any():
        return np.zeros_like(mask)
    paper = float(np.median(light[around]))
    gaps &= light < paper - settings.darker
    # Along the silhouette pixels are a mixture of leaf and paper: gaps as thin as that are none.
    core = cv2.morphologyEx(gaps.astype(np.uint8), cv2.MORPH_OPEN, _disc(settings.thinnest * size / 4)) > 0
    return _long(core, size, settings, touching=gaps)


def _colored(lab: Floats, mask: Mask, size: float, settings: PetioleSettings) -> Mask:
    """Long thin parts of a mask in another colour than most of it."""
    inside = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    if inside.sum() < 16:
        return np.zeros_like(mask)
    median = np.median(lab[inside], axis=0)
    deviation = 1.5 + np.median(np.abs(lab[inside] - median), axis=0)
    differs = np.sqrt((((lab - median) / deviation)[..., 1:] ** 2).sum(axis=-1)) > settings.colored
    differs &= inside
    core = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, _disc(settings.thinnest * size / 2)) > 0
    return _long(core, size, settings, touching=differs)


def _long(core: Mask, size: float, settings: PetioleSettings, *, touching: Mask) -> Mask:
    """The long thin ones of the regions of a mask, with what lies close to them."""
    found = np.zeros_like(core)
    count, labels, measures, _ = cv2.connectedComponentsWithStats(core.astype(np.uint8), connectivity=8)
    for each in range(1, count):
        left, top, across, down, pixels = (int(value) for value in measures[each])
        if np.hypot(across, down) < settings.length * size:
            continue
        region = labels[top : top + down, left : left + across] == each
        length = _length(region)
        width = pixels / max(length, 1)
        if length >= settings.length * size and length >= settings.slender * width and width <= settings.width * size:
            found[top : top + down, left : left + across] |= region
    near = cv2.dilate(found.astype(np.uint8), _disc(settings.thinnest * size / 2)) > 0
    return found | (near & touching)


def _length(region: Mask) -> float:
    """The extent of a region along its longest diameter, pixels."""
    rows, columns = np.nonzero(region)
    points = np.stack([columns, rows], axis=-1).astype(np.float32)
    (_, (one, other), _) = cv2.minAreaRect(points)
    return float(max(one, other)) + 1


def _ends(region: Mask) -> Floats:
    """(2, 2) the two ends of a long region: the places farthest from each other."""
    rows, columns = np.nonzero(region)
    points = np.stack([columns, rows], axis=-1).astype(np.float64)
    first = points[np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))]
    other = points[np.argmax(((points - first) ** 2).sum(axis=1))]
    # The middle of what is close to an end, so that it lies on the petiole's own axis.
    reach = 0.05 * np.linalg.norm(other - first) + 1
    return np.stack(
        [points[np.linalg.norm(points - end, axis=1) <= reach].mean(axis=0) + 0.5 for end in (first, other)]
    )


def _fill(blade: Mask, hidden: Mask) -> Mask:
    """A blade without the holes that a petiole makes in it."""
    count, labels = cv2.connectedComponents((~blade).astype(np.uint8), connectivity=4)
    pixels = np.bincount(labels.ravel(), minlength=count)
    under = np.bincount(labels[hidden], minlength=count)
    holes = under > pixels / 2
    holes[np.unique(labels[blade])] = False
    holes[np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))] = False
    return np.asarray(blade | holes[labels])


def _largest(mask: Mask) -> Mask:
    count, labels, measures, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return np.asarray(labels == 1 + int(np.argmax(measures[1:, cv2.CC_STAT_AREA]))) if count > 1 else mask.copy()


def _close(mask: Mask, reach_px: float) -> Mask:
    pad = int(np.ceil(reach_px)) + 2
    wide = np.pad(mask, pad).astype(np.uint8)
    return np.asarray(cv2.morphologyEx(wide, cv2.MORPH_CLOSE, _disc(reach_px))[pad:-pad, pad:-pad] > 0)


def _disc(reach_px: float) -> NDArray[np.uint8]:
    side = 2 * max(1, round(reach_px)) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
