"""Strokes for a photograph that nobody drew over: around a crown's mask, and down the stem below it. Our own."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.sketch.before_sky import complete_before_sky
from usdfoliage.sketch.drawing import dilate
from usdfoliage.sketch.strokes import TreeStrokes

Floats = NDArray[np.float64]

_MARGIN = 0.02  # of the crown's width, between its leaves and the stroke around it
_SIMPLE = 0.004  # of the crown's width, by which the outline may leave the mask
_WORK_PX = 500  # longer side of the picture in which the stem is looked for
_BESIDE = 0.3  # of the crown's width, to either side of its middle, where a stem may come out
_WIDTHS = (0.02, 0.035, 0.06)  # of the crown's width, that a stem may have
_LEAN = 1  # pixels to either side, by which a stem may go on from one row to the next
_SIDEWAYS = 6.0  # what a step to the side costs, as such a difference
_ASIDE = 60.0  # what a stem costs that comes out at the end of _BESIDE, as a sum of such differences
_OTHER = 16.0  # difference in CIELAB to the stem just below the crown, of what is no longer the stem,
_LONG = 0.04  # if it goes on so far, of the crown's height
_CLEAR = 6.0  # difference in CIELAB between a stem and what is beside it, which counts as one
_TOP = 0.25  # of a clear proposal's height, that is completed
_INTO = 0.55  # of the crown's height from below, to which the stem goes on


def propose_strokes(mask: NDArray[np.bool_], srgb: NDArray[np.uint8]) -> TreeStrokes:
    """Strokes for one tree.

    Args:
        mask: (H, W), its crown; not empty.
        srgb: (H, W, 3), the photograph.
    """
    drawn = _with_margin(mask)
    contours, _ = cv2.findContours(drawn.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    width = float(np.ptp(largest[:, 0, 0]) + 1)
    outline = cv2.approxPolyDP(largest, _SIMPLE * width, True)[:, 0].astype(np.float64) + 0.5
    if len(outline) < 3:
        x, y, w, h = cv2.boundingRect(largest)
        outline = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]], np.float64)
    return TreeStrokes(crown_px=outline, branches_px=(find_stem(mask, srgb),))


def complete_proposal(
    mask: NDArray[np.bool_], srgb: NDArray[np.uint8], sky: NDArray[np.bool_], *, only_top: bool = False
) -> NDArray[np.bool_]:
    """(H, W) a proposed crown with what stands before the sky above it.

    Args:
        mask: (H, W), the proposal; not empty.
        srgb: (H, W, 3), the photograph.
        sky: (h, w), of the same photograph, as find_sky gives it.
        only_top: The proposal is clear, and nothing but its top is completed, whose fine shoots have the sky's colours.
    """
    small = cv2.resize(mask.astype(np.uint8), sky.shape[::-1], interpolation=cv2.INTER_AREA) > 0
    if not small.any():
        return mask
    colors = cv2.resize(srgb, sky.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float64)
    complete = complete_before_sky(small, sky, colors)
    if complete is small:
        return mask
    enlarged = cv2.resize(complete.astype(np.float32), mask.shape[::-1], interpolation=cv2.INTER_LINEAR)
    if not only_top:
        return np.asarray(enlarged > 0.5)
    rows = np.flatnonzero(mask.any(axis=1))
    top = np.arange(len(mask))[:, None] < rows[0] + _TOP * np.ptp(rows)
    return np.asarray(mask | ((enlarged > 0.5) & top))


def _with_margin(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A mask as somebody would draw around it: a little outside of its leaves."""
    return dilate(mask, _MARGIN * float(np.ptp(np.flatnonzero(mask.any(axis=0))) + 1))


def find_stem(mask: NDArray[np.bool_], srgb: NDArray[np.uint8]) -> Floats:
    """(K, 2) a line up the stem of a crown, from its foot into the crown, in pixels.

    Below the crown the way down is taken along which a bar differs most from what is beside it. Where there is none
    the stem begins at the crown's lowest place.

    Args:
        mask: (H, W), the crown; not empty.
        srgb: (H, W, 3), the photograph.
    """
    rows, columns = np.nonzero(mask)
    top, bottom, middle = int(rows.min()), int(rows.max()), float(np.median(columns))
    crown_height, crown_width = bottom - top + 1, float(np.ptp(columns) + 1)
    scale = min(1.0, _WORK_PX / max(srgb.shape[:2]))
    small = cv2.resize(srgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(small.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    contrast = np.max([_bars(lab, max(2, round(share * crown_width * scale))) for share in _WIDTHS], axis=0)
    reach = _BESIDE * crown_width
    first, last = (int(np.clip((middle + side * reach) * scale, 0, small.shape[1] - 1)) for side in (-1, 1))
    lowest = int(min((bottom - 0.12 * crown_height) * scale, small.shape[0] - 2))
    part = np.minimum(contrast[lowest:, first : last + 1], 3 * _CLEAR) - _CLEAR
    head = np.array([[middle, top + (1 - _INTO) * crown_height]])
    none = np.array([[float(np.median(columns[rows > bottom - 0.05 * crown_height])) + 0.5, bottom + 1.0]])
    if part.size == 0 or part.shape[1] < 3:
        return np.concatenate([none, head])
    aside = (np.arange(part.shape[1]) + first - middle * scale) / (reach * scale)
    part[0] -= _ASIDE * aside**2
    score, back = _walk_down(part)
    best_row = score.max(axis=1)
    foot_row = int(np.argmax(best_row))
    below = max(0, round(bottom * scale) - lowest)
    if best_row[foot_row] <= 0 or foot_row < max(3, below):  # within the crown its border is no stem
        return np.concatenate([none, head])
    column = int(np.argmax(score[foot_row]))
    line = []
    for row in range(foot_row, -1, -1):
        line.append([(column + first + 0.5) / scale, (row + lowest + 0.5) / scale])
        column = int(back[row, column])
    line = line[::-1]
    line = line[: _end_of_bark(small, np.array(line) * scale, below, crown_height * scale, crown_width * scale)]
    stem = np.array(line[::-1])[:: max(1, len(line) // 8)]
    return np.concatenate([stem, head[head[:, 1] < stem[-1, 1]]]) if len(stem) > 1 else np.concatenate([none, head])


def _end_of_bark(srgb: NDArray[np.uint8], line: Floats, below: int, crown_height: float, crown_width: float) -> int:
    """How many of the places (K, 2) down a stem, in pixels, have the colours that it has just below the crown.

    Args:
        srgb: (H, W, 3), the photograph.
        line: Down the stem, a place in each row.
        below: Which of these is the first one below the crown.
        crown_height: In pixels.
        crown_width: In pixels.
    """
    width = max(2, round(_WIDTHS[0] * crown_width))
    run = max(2, round(_LONG * crown_height))
    if len(line) <= below + run:
        return len(line)
    lab = cv2.blur(cv2.cvtColor(srgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), (width, max(3, width)))
    x, y = np.floor(line[below:]).astype(int).T
    colors = lab[np.clip(y, 0, len(lab) - 1), np.clip(x, 0, lab.shape[1] - 1)]
    other = np.linalg.norm(colors - np.median(colors[:run], axis=0), axis=1) > _OTHER
    ends = np.flatnonzero(np.convolve(other, np.ones(run), "valid") == run)
    return below + int(ends[0]) if len(ends) else len(line)


def _bars(lab: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """(H, W) how much a bar of a width differs from both of what is beside it: the lesser difference."""
    bar = cv2.blur(lab, (width, max(3, width)))
    left, right = np.roll(bar, round(1.4 * width), axis=1), np.roll(bar, -round(1.4 * width), axis=1)
    return np.minimum(np.linalg.norm(bar - left, axis=2), np.linalg.norm(bar - right, axis=2))


def _walk_down(gain: NDArray[np.float32]) -> tuple[Floats, NDArray[np.int64]]:
    """(R, C) the greatest sum of gains on a way down to each pixel, from the first row, and the column before.

    Steps to the side cost _SIDEWAYS: stems are steep, and edges of roads and fields are not.
    """
    score = np.zeros(gain.shape)
    back = np.tile(np.arange(gain.shape[1]), (len(gain), 1))
    score[0] = gain[0]
    for row in range(1, len(gain)):
        before = np.pad(score[row - 1], _LEAN, constant_values=-np.inf)
        options = np.stack([before[k : k + gain.shape[1]] for k in range(2 * _LEAN + 1)])
        options -= _SIDEWAYS * np.abs(np.arange(2 * _LEAN + 1) - _LEAN)[:, None]
        chosen = options.argmax(axis=0)
        score[row] = gain[row] + options.max(axis=0)
        back[row] = np.arange(gain.shape[1]) + chosen - _LEAN
    return score, back
