"""Thin lines in a photograph: bars with an edge on both sides, such as stems and petioles, and their middles.

Ridges of the picture at several widths propose middles (C. Steger, An unbiased detector of curvilinear structures,
1998, section 2). The border of a broad leaf is a ridge too; so both edges are looked for, of opposite signs, and the
weaker of the two counts (T. Koller et al., Multiscale detection of curvilinear structures in 2-D and 3-D image data,
1995). That edges and middles are sought in each channel of CIELAB, and how middles are linked: our own.
"""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_STEP_PX = 0.5  # between the samples of a profile
_ROUND = 0.5  # share of the smaller curvature that is taken from the larger: a spot is no line
_AT_ONCE = 20_000  # middles whose profiles are in memory at once


@dataclass(frozen=True, kw_only=True)
class LineSettings:
    """What is a line. Lightness and colours are CIELAB's, 0 to 100."""

    # Ridges are looked for at these widths of a Gaussian, the finest first. Unit: pixels. Range: above 0.
    scales_px: tuple[float, ...] = (0.8, 1.15, 1.6, 2.3, 3.2, 4.5)
    ridge: float = 3.0  # A ridge is at least this strong, in lightness or colour. Range: above 0.
    edge: float = 2.0  # Each edge of a line changes lightness or colour by at least this in a pixel. Range: above 0.
    widest_px: float = 14.0  # A line is at most this wide. Unit: pixels. Range: above 1.
    # The middle between the edges lies at most this share of the width beside the ridge. Range: 0 to 0.5.
    lopsided: float = 0.35
    link_px: float = 2.6  # Middles up to this far apart are linked. Unit: pixels. Range: 1 or more.
    turn_rad: float = 0.6  # A line turns by at most this from one middle to the next. Unit: radians. Range: above 0.
    fewest: int = 6  # A line has at least this many middles. Range: 1 or more.

    def __post_init__(self) -> None:
        if not self.scales_px or min(self.scales_px) <= 0:
            raise ValueError(f"scales_px must be above 0, not {self.scales_px}")
        if not (self.ridge > 0 and self.edge > 0 and self.widest_px > 1 and 0 <= self.lopsided <= 0.5):
            raise ValueError(f"ridge, edge and widest_px must be above 0, lopsided in [0, 0.5], not {self}")
        if not (self.link_px >= 1 and self.turn_rad > 0 and self.fewest >= 1):
            raise ValueError(f"link_px and fewest must be at least 1, turn_rad above 0, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines:
    """Middles of the lines in a photograph, line after line, each from one end to the other."""

    places_px: NDArray[np.float64]  # (N, 2), x and y; the middle of the first pixel is at 0.5
    normal_rad: NDArray[np.float64]  # (N,), direction across the line, from x towards y
    width_px: NDArray[np.float64]  # (N,), from edge to edge
    contrast: NDArray[np.float64]  # (N,), of the weaker edge
    color: NDArray[np.float32]  # (N, 3), CIELAB, of the middle
    line: NDArray[np.int64]  # (N,), number of the line, from 0 on and never falling

    def __len__(self) -> int:
        return len(self.line)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> "Lines":
        """These middles alone, in their order."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})


def find_lines(
    srgb: NDArray[np.uint8], within: NDArray[np.bool_] | None = None, settings: LineSettings = LineSettings()
) -> Lines:
    """The lines of a photograph.

    Args:
        srgb: (H, W, 3), red, green and blue, encoded for display.
        within: (H, W), where lines are looked for; None: everywhere.
        settings: What is a line.

    Raises:
        ValueError: The arrays do not fit together.
    """
    if srgb.ndim != 3 or srgb.shape[2] != 3 or (within is not None and within.shape != srgb.shape[:2]):
        raise ValueError(f"a photograph must be (H, W, 3), and within (H, W), not {srgb.shape}")
    lab = cv2.cvtColor(srgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    columns, rows, normal_rad, scale_px = _find_ridges(lab, within, settings)
    parts = [
        _measure_bars(lab, columns[some], rows[some], normal_rad[some], scale_px[some], settings)
        for some in np.array_split(np.arange(len(rows)), len(rows) // _AT_ONCE + 1)
    ]
    found = replace(
        parts[0], **{each.name: np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Lines)}
    )
    return _link(_without_doubles(found), settings)


def _find_ridges(
    lab: NDArray[np.float32], within: NDArray[np.bool_] | None, settings: LineSettings
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Columns, rows, directions across and widths of the pixels in the middle of a ridge."""
    height, width = lab.shape[:2]
    best = np.zeros((height, width), np.float32)
    normal, scale, offset = (np.zeros((height, width), np.float32) for _ in range(3))
    one, first = np.ones(1, np.float32), np.array([-0.5, 0, 0.5], np.float32)
    second = np.array([1, -2, 1], np.float32)
    for scale_px in settings.scales_px:
        smooth = cv2.GaussianBlur(lab, (0, 0), scale_px)
        xx, yy = cv2.sepFilter2D(smooth, -1, second, one), cv2.sepFilter2D(smooth, -1, one, second)
        xy = cv2.sepFilter2D(smooth, -1, first, first)
        mean, apart = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
        across = np.where(mean > 0, mean + apart, mean - apart)
        strength = scale_px**2 * (np.abs(across) - _ROUND * np.abs(2 * mean - across))
        channel = strength.argmax(axis=2)[..., None]
        strength, across, xx, yy, xy, dx, dy = (
            np.take_along_axis(each, channel, axis=2)[..., 0]
            for each in (
                strength,
                across,
                xx,
                yy,
                xy,
                cv2.sepFilter2D(smooth, -1, first, one),
                cv2.sepFilter2D(smooth, -1, one, first),
            )
        )
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the curvature that is most above 0
        angle = np.where(across > 0, angle, angle + np.pi / 2)
        aside = -(dx * np.cos(angle) + dy * np.sin(angle)) / np.where(np.abs(across) > 1e-6, across, 1e-6)
        better = strength > best
        for kept, new in ((best, strength), (normal, angle), (offset, aside)):
            kept[better] = new[better]
        scale[better] = scale_px
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    cos, sin = np.cos(normal), np.sin(normal)
    before, after = (
        cv2.remap(best, x + s * cos, y + s * sin, cv2.INTER_LINEAR) for s in (np.float32(-1), np.float32(1))
    )
    middle = (best >= before) & (best > after) & (best > settings.ridge) & (np.abs(offset) < np.maximum(1, scale))
    if within is not None:
        middle &= within
    rows, columns = np.nonzero(middle)
    return columns, rows, normal[middle].astype(np.float64), scale[middle].astype(np.float64)


def _measure_bars(
    lab: NDArray[np.float32],
    columns: NDArray[np.int64],
    rows: NDArray[np.int64],
    normal_rad: NDArray[np.float64],
    scale_px: NDArray[np.float64],
    settings: LineSettings,
) -> Lines:
    """Those of the ridges' pixels that have an edge on both sides, moved to the middle between these."""
    across = np.stack([np.cos(normal_rad), np.sin(normal_rad)], axis=1)
    along = np.stack([-across[:, 1], across[:, 0]], axis=1)
    reach = int(np.ceil(settings.widest_px / 2 / _STEP_PX)) + 2
    steps = np.arange(-reach, reach + 1)
    start = np.stack([columns, rows], axis=1).astype(np.float64)
    places = start[:, None] + _STEP_PX * steps[:, None] * across[:, None]
    # Noise goes out along the line.
    profile = np.zeros((*places.shape[:2], 3), np.float32)
    for shift in (-1, 0, 1):
        profile += _sample(lab, places + shift * along[:, None]) / 3
    slope = (profile[:, 2:] - profile[:, :-2]) / (2 * _STEP_PX)
    away_px = _STEP_PX * np.arange(1, reach, dtype=np.float64)  # of the slopes on either side
    inside = away_px <= np.minimum(2.2 * scale_px + 1, settings.widest_px / 2)[:, None]
    every = np.arange(len(rows))
    contrast, left_px, right_px = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows))
    for channel in range(3):
        for sign in (1, -1):
            right = np.where(inside, sign * slope[:, reach:, channel], 0)
            left = np.where(inside, -sign * slope[:, reach - 2 :: -1, channel], 0)
            at_right, at_left = right.argmax(axis=1), left.argmax(axis=1)
            weaker = np.minimum(right[every, at_right], left[every, at_left])
            better = weaker > contrast
            contrast[better] = weaker[better]
            right_px[better] = _peak(right, at_right, away_px)[better]
            left_px[better] = _peak(left, at_left, away_px)[better]
    width_px, aside_px = left_px + right_px, (right_px - left_px) / 2
    good = (contrast > settings.edge) & (np.abs(aside_px) <= np.maximum(0.75, settings.lopsided * width_px))
    return Lines(
        places_px=(start + aside_px[:, None] * across + 0.5)[good],
        normal_rad=normal_rad[good],
        width_px=width_px[good],
        contrast=contrast[good],
        color=profile[good, reach - 1 : reach + 2].mean(axis=1),
        line=np.zeros(int(good.sum()), np.int64),
    )


def _peak(slopes: NDArray[np.floating], at: NDArray[np.integer], away_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) where slopes (N, K) are largest, between the samples."""
    every = np.arange(len(slopes))
    inner = np.clip(at, 1, slopes.shape[1] - 2)
    low, top, high = (slopes[every, inner + step] for step in (-1, 0, 1))
    bend = low - 2 * top + high
    shift = np.where((bend < -1e-6) & (at == inner), 0.5 * (low - high) / np.minimum(bend, -1e-6), 0)
    return np.asarray(away_px[at] + _STEP_PX * np.clip(shift, -1, 1))


def _sample(picture: NDArray[np.float32], places: NDArray[np.float64]) -> NDArray[np.float32]:
    """(..., C) the picture (H, W, C) at places (..., 2), column and row, linear between pixels."""
    height, width = picture.shape[:2]
    x, y = np.clip(places[..., 0], 0, width - 1.001), np.clip(places[..., 1], 0, height - 1.001)
    column, row = x.astype(np.int64), y.astype(np.int64)
    right, down = (x - column)[..., None].astype(np.float32), (y - row)[..., None].astype(np.float32)
    flat, at = picture.reshape(-1, picture.shape[2]), row * width + column
    upper = flat[at] * (1 - right) + flat[at + 1] * right
    lower = flat[at + width] * (1 - right) + flat[at + width + 1] * right
    return np.asarray(upper * (1 - down) + lower * down)


def _without_doubles(found: Lines) -> Lines:
    """Without the weaker of middles side by side, whose edges are the same."""
    if len(found) < 2:
        return found
    pairs = cKDTree(found.places_px).query_pairs(1.3, output_type="ndarray")
    one, other = pairs.T
    apart = found.places_px[other] - found.places_px[one]
    across = np.stack([np.cos(found.normal_rad), np.sin(found.normal_rad)], axis=1)
    parallel = np.abs((across[one] * across[other]).sum(axis=1)) > 0.85
    beside = np.abs((apart * across[one]).sum(axis=1)) >= 0.75 * np.linalg.norm(apart, axis=1)
    one, other = one[parallel & beside], other[parallel & beside]
    kept = np.ones(len(found), bool)
    kept[np.where(found.contrast[one] < found.contrast[other], one, other)] = False
    return found.take(kept)


def _link(found: Lines, settings: LineSettings) -> Lines:
    """Lines of middles that are each other's best continuation; those of few middles are left out."""
    count = len(found)
    if count < 2:
        return found.take(np.zeros(count, bool))
    along = np.stack([-np.sin(found.normal_rad), np.cos(found.normal_rad)], axis=1)
    pairs = cKDTree(found.places_px).query_pairs(settings.link_px, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    apart = found.places_px[other] - found.places_px[one]
    length_px = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
    ahead, behind = ((apart * along[each]).sum(axis=1) / length_px for each in (one, other))
    turn_rad = np.abs((found.normal_rad[one] - found.normal_rad[other] + np.pi / 2) % np.pi - np.pi / 2)
    wider = np.abs(np.log(found.width_px[one] / found.width_px[other]))
    good = (np.abs(ahead) > 0.7) & (np.abs(behind) > 0.7) & (turn_rad < settings.turn_rad) & (wider < np.log(2))
    cost = length_px + 2 * turn_rad + wider + 1.5 * (1 - np.abs(ahead))
    # A middle has two ends, each with one best mate.
    end, mate = 2 * one + (ahead > 0), 2 * other + (behind < 0)
    end, mate, cost = end[good], mate[good], cost[good]
    order = np.lexsort((mate, cost, end))
    first = np.ones(len(order), bool)
    first[1:] = end[order][1:] != end[order][:-1]
    best = np.full(2 * count, -1, np.int64)
    best[end[order[first]]] = mate[order[first]]
    mutual = (best >= 0) & (best[best] == np.arange(2 * count))
    chains = _walk(np.where(mutual, best, -1))
    chains = [chain for chain in chains if len(chain) >= settings.fewest]
    if not chains:
        return found.take(np.zeros(count, bool))
    linked = found.take(np.concatenate([np.array(chain, np.int64) for chain in chains]))
    return replace(linked, line=np.repeat(np.arange(len(chains)), [len(chain) for chain in chains]))


def _walk(mates: NDArray[np.int64]) -> list[list[int]]:
    """The middles of each chain in order, by the mate (2 N,) of each middle's two ends, -1 where there is none."""
    mate = mates.tolist()
    count = len(mate) // 2
    seen = [False] * count
    open_ended = [each for each in range(count) if mate[2 * each] < 0 or mate[2 * each + 1] < 0]
    chains = []
    for start in (*open_ended, *range(count)):  # rings come last
        if seen[start]:
            continue
        seen[start] = True
        chain = [start]
        end = 2 * start + 1 if mate[2 * start] < 0 else 2 * start
        while mate[end] >= 0 and not seen[mate[end] // 2]:
            end = mate[end] ^ 1
            seen[end // 2] = True
            chain.append(end // 2)
        chains.append(chain)
    return chains
