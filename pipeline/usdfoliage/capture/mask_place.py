"""Whether masks lie beside the plant that they are of, as where they were made of pictures of another crop. Our own."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.picture_agreement import find_vegetation
from usdfoliage.remarks import Remark, Setting, remark

_LONGEST_PX = 192  # of a picture in which masks are moved
_SOME_GREEN = 0.02  # share of a picture, from which what is green is judged
_FITS = 0.3  # overlap of green and mask, from which a moved mask is taken to show the plant; of good ones 0.38 to 0.48
_GAIN = 1.5  # times the overlap as it is, that moving must give
_FAR = 0.02  # of the longer side, below which a mask may lie as it was drawn
_APART = 0.35  # of the median move, up to which moves are the same one
_ENOUGH = 0.6  # share of the masks
_FEWEST = 3  # masks


@dataclass(frozen=True, kw_only=True, eq=False)
class MaskMove:
    """By how much a mask would have to be moved to cover what is green."""

    move: NDArray[np.float64]  # (2,), right and down, of the picture's longer side
    before: float  # overlap of green and mask, intersection over union, as it is
    after: float  # and after the move

    @property
    def helps(self) -> bool:
        """Whether the mask shows the plant after a move, and hardly does as it is."""
        far = float(np.linalg.norm(self.move)) >= _FAR
        return far and self.after >= _FITS and self.after >= _GAIN * self.before


def measure_move(srgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> MaskMove | None:
    """The move after which a mask overlaps most with what is green; None where little is green, or the mask is empty.

    Args:
        srgb: (H, W, 3), encoded for display.
        mask: (H, W).
    """
    green = find_vegetation(srgb)
    if green.mean() < _SOME_GREEN or not mask.any():
        return None
    scale = min(_LONGEST_PX / max(green.shape), 1.0)
    height, width = (max(round(scale * side), 1) for side in green.shape)
    small, own = (
        cv2.resize(each.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) for each in (green, mask)
    )
    shape = (2 * height, 2 * width)  # so that what is moved out on one side does not come in on the other
    spectrum = np.fft.rfft2(small, shape) * np.conj(np.fft.rfft2(own, shape))
    common = np.maximum(np.fft.irfft2(spectrum, shape), 0)
    overlap = common / (float(small.sum() + own.sum()) - common)
    down, right = np.unravel_index(int(np.argmax(overlap)), shape)
    move = np.array([right - (shape[1] if right >= width else 0), down - (shape[0] if down >= height else 0)])
    return MaskMove(move=move / max(height, width), before=float(overlap[0, 0]), after=float(overlap[down, right]))


def describe_moves(moves: Sequence[MaskMove | None]) -> tuple[Remark, ...]:
    """A warning where most masks (V) would have to be moved the same way; none of pictures that show little green."""
    known = [each for each in moves if each is not None]
    helped = np.array([each.move for each in known if each.helps]).reshape(-1, 2)
    if len(helped) < max(_ENOUGH * len(known), _FEWEST):
        return ()
    middle = np.median(helped, axis=0)
    length = float(np.linalg.norm(middle))
    same = np.linalg.norm(helped - middle, axis=1) <= _APART * length
    if np.count_nonzero(same) < max(_ENOUGH * len(known), _FEWEST):
        return ()
    text = (
        f"{int(same.sum())} of {len(moves)} masks lie beside the plant, by {length:.0%} of the photograph's longer "
        "side and all in the same direction: leaves are cut off, and what is beside the plant is taken for it"
    )
    remedy = ("make the masks of these photographs again, or set ", Setting(name="capture.mask", value='"none"'))
    return (remark("masks-beside-plant", text, remedy=remedy),)
