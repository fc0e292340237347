"""How far away the lines of a photograph are, by the lines of the others.

A middle of a line may lie anywhere on its ray. Wherever the ray passes a line of another photograph, at a place and in
a direction that both agree on, as thick and as coloured as here, that photograph votes for this distance. Along a line
distances are chosen together, so that the line hangs together in space. Votes and choice are our own; that edges are
matched along epipolar lines and their distances chosen by dynamic programming is that of Y. Ohta and T. Kanade, Stereo
by intra- and inter-scanline search using dynamic programming, 1985.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from usdfoliage.branch.photographs.seen_lines import SeenLines, ranges_in_box

_BLUR = 0.8  # bins, of the votes
_UNSEEN = 1e3  # what a candidate that is none costs
_MAX_BINS, _MAX_DIRECTIONS = 10_000, 1000
_FEW_RAD = 0.05  # angle between two planes, below which they cut each other nowhere in particular


@dataclass(frozen=True, kw_only=True)
class DistanceSettings:
    """How lines of several photographs are brought together."""

    views: int = 10  # A line is looked for in this many other photographs. Range: 2 or more.
    # Photographs whose directions to the plant differ by angles between these are compared. Unit: radians.
    angles_rad: tuple[float, float] = (0.07, 1.9)
    within_px: float = 1.2  # A ray passes a line up to this far from it. Unit: pixels. Range: above 0.
    bins: int = 160  # Distances in the plant's box are distinguished in this many steps. Range: 8 to 10000.
    directions: int = 9  # Directions of a line within its plane are distinguished in this many steps. Range: 3 to 1000.
    width: float = 0.4  # Standard deviation of the logarithm of a line's width. Range: above 0.
    color: float = 12.0  # Standard deviation of a line's colour, in CIELAB, lightness counting 0.6. Range: above 0.
    steepest: float = 0.2  # A line is at least so far from an epipolar line, as a sine. Range: above 0, below 1.
    candidates: int = 6  # Distances that are weighed at each middle. Range: 1 or more.
    min_votes: float = 1.6  # A middle with fewer votes has no distance rather. Range: above 0.
    bend_px: float = (
        2.5  # A middle so far beside the course of its line costs half a vote. Unit: pixels. Range: above 0.
    )
    leap_px: float = 16.0  # Middles farther apart in space are of two lines. Unit: pixels. Range: above 0.

    def __post_init__(self) -> None:
        if not (8 <= self.bins <= _MAX_BINS and 3 <= self.directions <= _MAX_DIRECTIONS):
            raise ValueError(f"bins must be 8 to {_MAX_BINS} and directions 3 to {_MAX_DIRECTIONS}, not {self}")
        if self.views < 2 or self.candidates < 1:
            raise ValueError(f"views must be at least 2 and candidates 1, not {self}")
        if not 0 <= self.angles_rad[0] < self.angles_rad[1] <= np.pi:
            raise ValueError(f"angles_rad must be two rising angles up to pi, not {self.angles_rad}")
        positive = (self.within_px, self.width, self.color, self.min_votes, self.bend_px, self.leap_px)
        if min(positive) <= 0 or not 0 < self.steepest < 1:
            raise ValueError(f"tolerances must be above 0, steepest below 1, not {self}")


@dataclass(frozen=True, kw_only=True, eq=False)
class LinePoints:
    """Middles of lines in space."""

    points_m: NDArray[np.float64]  # (M, 3), in the world
    along: NDArray[np.float64]  # (M, 3), direction of the line, of length 1; its sign means nothing
    radius_m: NDArray[np.float64]  # (M,)
    votes: NDArray[np.float64]  # (M,), photographs that have a line there
    middle: NDArray[np.int64]  # (M,), number among the middles of the photograph

    def __len__(self) -> int:
        return len(self.middle)


def choose_views(
    seen: Sequence[SeenLines], number: int, middle_m: NDArray[np.float64], settings: DistanceSettings
) -> list[int]:
    """The photographs with which another one is compared: those whose directions to the plant are nearest."""
    away = np.array([each.position_m for each in seen]) - middle_m
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    angle_rad = np.arccos(np.clip(away @ away[number], -1, 1))
    good = np.flatnonzero((angle_rad >= settings.angles_rad[0]) & (angle_rad <= settings.angles_rad[1]))
    return [int(each) for each in good[np.argsort(angle_rad[good], kind="stable")][: settings.views] if each != number]


def find_distances(
    seen: SeenLines,
    others: Sequence[SeenLines],
    box_m: NDArray[np.float64],
    settings: DistanceSettings = DistanceSettings(),
) -> LinePoints:
    """The middles of a photograph's lines whose distance the others show.

    Args:
        seen: The lines of the photograph.
        others: Those of the photographs that it is compared with.
        box_m: (2, 3), lowest and highest corner of where the plant is.
        settings: How.
    """
    near_m, far_m = ranges_in_box(seen, box_m)
    hits = np.flatnonzero(far_m > 0)
    seen, near_m, far_m = seen.take(hits), near_m[hits], far_m[hits]
    if not len(seen):
        return _points_of(seen, hits, *(np.zeros((0, 1)),) * 3, np.zeros(0, np.int64))
    every, angles_rad = _count_votes(seen, others, near_m, far_m, settings)
    votes, distance_m, angle_rad = _find_peaks(every, angles_rad, near_m, far_m, settings.candidates)
    aside = np.cross(seen.plane, seen.ray)
    points_m = seen.position_m + seen.ray[:, None] * distance_m[..., None]
    along = np.cos(angle_rad)[..., None] * seen.ray[:, None] + np.sin(angle_rad)[..., None] * aside[:, None]
    chosen = _choose_along(seen, votes, distance_m, points_m, along, settings)
    return _points_of(seen, hits, votes, distance_m, angle_rad, chosen)


def _points_of(
    seen: SeenLines,
    number: NDArray[np.int64],
    votes: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    angle_rad: NDArray[np.float64],
    chosen: NDArray[np.int64],
) -> LinePoints:
    """The candidates that were chosen (N,), as many as there are candidates for none."""
    some = np.flatnonzero(chosen < votes.shape[1])
    at = chosen[some]
    away_m, angle = distance_m[some, at], angle_rad[some, at]
    aside = np.cross(seen.plane[some], seen.ray[some])
    return LinePoints(
        points_m=seen.position_m + seen.ray[some] * away_m[:, None],
        along=np.cos(angle)[:, None] * seen.ray[some] + np.sin(angle)[:, None] * aside,
        radius_m=0.5 * seen.width[some] * away_m,
        votes=votes[some, at],
        middle=number[some],
    )


def _count_votes(
    seen: SeenLines,
    others: Sequence[SeenLines],
    near_m: NDArray[np.float64],
    far_m: NDArray[np.float64],
    settings: DistanceSettings,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """(N, B) votes for each distance, evenly spaced by their inverse, and (N, B) the direction that most are for."""
    count, bins, directions = len(seen), settings.bins, settings.directions
    total = np.zeros(count * bins * directions, np.float32)
    aside = np.cross(seen.plane, seen.ray)
    step = (1 / near_m - 1 / far_m) / bins
    for other in others:
        middle, mate, distance_m, other_m, distinct = _pass_by(seen, other, settings)
        inside = (distance_m > near_m[middle]) & (distance_m < far_m[middle]) & (other_m > 0)
        middle, mate = middle[inside], mate[inside]
        distance_m, other_m, distinct = distance_m[inside], other_m[inside], distinct[inside]
        wider = np.log(seen.width[middle] * distance_m / (other.width[mate] * other_m)) / settings.width
        shade = (seen.color[middle] - other.color[mate]) * np.array([0.6, 1, 1]) / settings.color
        differs = np.square(wider) + np.square(shade).sum(axis=1)
        along = np.cross(seen.plane[middle], other.plane[mate])
        good = (differs < 4) & (np.linalg.norm(along, axis=1) > _FEW_RAD)
        middle, distance_m, along = middle[good], distance_m[good], along[good]
        differs, distinct = differs[good], distinct[good]
        angle_rad = np.arctan2(
            np.einsum("ij,ij->i", along, aside[middle]), np.einsum("ij,ij->i", along, seen.ray[middle])
        )
        place = np.clip(((1 / distance_m - 1 / far_m[middle]) / step[middle]).astype(np.int64), 0, bins - 1)
        turn = np.minimum((angle_rad % np.pi / np.pi * directions).astype(np.int64), directions - 1)
        key, of_key = np.unique((middle * bins + place) * directions + turn, return_inverse=True)
        weight = np.exp(-0.5 * differs) * np.minimum(1, distinct / (2 * settings.steepest))
        # A photograph has one vote for a place, however many of its middles are there.
        total[key] += np.minimum(np.bincount(of_key, weight, len(key)), 1).astype(np.float32)
    votes = total.reshape(count, bins, directions)
    votes = gaussian_filter1d(votes, _BLUR, axis=1, mode="constant", truncate=3)
    votes = gaussian_filter1d(votes, _BLUR, axis=2, mode="wrap", truncate=3)
    peak = gaussian_filter1d(np.eye(1, 21, 10)[0], _BLUR, truncate=3).max()
    best = votes.argmax(axis=2)
    # Votes half way between two bins are as good as those in the middle of one.
    return votes.max(axis=2) * np.float32(0.8 / peak**2), (best + 0.5) / directions * np.pi


def _pass_by(
    seen: SeenLines, other: SeenLines, settings: DistanceSettings
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Middles of two photographs whose rays pass each other, the distances on both rays, and how distinct these are.

    All rays of both cameras lie in planes through the line between the cameras; those that meet lie in one such plane.
    """
    nothing = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0)
    base_m = other.position_m - seen.position_m
    length_m = float(np.linalg.norm(base_m))
    if not len(seen) or not len(other) or not length_m > 0:
        return nothing
    axis = base_m / length_m
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    own_rad, mate_rad = (np.arctan2(each.ray @ second, each.ray @ first) for each in (seen, other))
    order = np.argsort(mate_rad, kind="stable")
    sorted_rad = mate_rad[order]
    # Near the line between the cameras planes are farther apart than pixels.
    apart = float(np.median(np.linalg.norm(np.cross(other.ray, axis), axis=1)))
    reach_rad = settings.within_px * other.pixel_rad / max(apart, 0.05)
    begin, end = (np.searchsorted(sorted_rad, own_rad + side * reach_rad) for side in (-1, 1))
    counts = end - begin
    middle = np.repeat(np.arange(len(seen)), counts)
    within = np.arange(len(middle)) - np.repeat(np.cumsum(counts) - counts, counts)
    mate = order[within + np.repeat(begin, counts)]
    across = np.cross(axis, seen.ray)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    distinct = np.sqrt(
        np.maximum(
            1
            - np.maximum(
                np.square(np.einsum("ij,ij->i", seen.plane, across))[middle],
                np.square(np.einsum("ij,ij->i", other.plane[mate], across[middle])),
            ),
            0,
        )
    )
    good = distinct > settings.steepest
    middle, mate, distinct = middle[good], mate[good], distinct[good]
    cosine = np.einsum("ij,ij->i", seen.ray[middle], other.ray[mate])
    square = 1 - np.square(cosine)
    on_own, on_other = (seen.ray @ base_m)[middle], (other.ray @ base_m)[mate]
    good = square > 1e-4
    middle, mate, distinct = middle[good], mate[good], distinct[good]
    cosine, square, on_own, on_other = cosine[good], square[good], on_own[good], on_other[good]
    return middle, mate, (on_own - cosine * on_other) / square, (cosine * on_own - on_other) / square, distinct


def _find_peaks(
    votes: NDArray[np.float32],
    angle_rad: NDArray[np.float64],
    near_m: NDArray[np.float64],
    far_m: NDArray[np.float64],
    candidates: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(N, K) votes, distances and directions of the peaks with most votes; 0 votes where there are fewer peaks."""
    around = np.pad(votes.astype(np.float64), ((0, 0), (1, 1)))
    below, top, above = around[:, :-2], around[:, 1:-1], around[:, 2:]
    peaks = np.where((top >= below) & (top > above), top, 0)
    at = np.argsort(-peaks, axis=1, kind="stable")[:, :candidates]
    low, high, middle = (np.take_along_axis(each, at, axis=1) for each in (below, above, top))
    bend = low - 2 * middle + high
    shift = np.where(bend < -1e-6, 0.5 * (low - high) / np.minimum(bend, -1e-6), 0)
    step = (1 / near_m - 1 / far_m) / votes.shape[1]
    inverse = 1 / far_m[:, None] + (at + 0.5 + np.clip(shift, -0.5, 0.5)) * step[:, None]
    return np.take_along_axis(peaks, at, axis=1), 1 / inverse, np.take_along_axis(angle_rad, at, axis=1)


def _choose_along(
    seen: SeenLines,
    votes: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    points_m: NDArray[np.float64],
    along: NDArray[np.float64],
    settings: DistanceSettings,
) -> NDArray[np.int64]:
    """(N,) candidate of each middle, or their number K for none: the best for each line as a whole.

    Source:
        A. Viterbi, Error bounds for convolutional codes, 1967; all lines at once, one middle of each after the other.
    """
    count, candidates = votes.shape
    footprint_m = seen.pixel_rad * distance_m
    gain = np.zeros((count, candidates + 1))
    gain[:, :candidates] = np.where(votes > 0, votes - settings.min_votes, -_UNSEEN)
    start = np.flatnonzero(np.diff(seen.line, prepend=-1))
    length = np.diff(np.append(start, count))
    total = gain.copy()
    before = np.full((count, candidates + 1), -1, np.int64)
    for step in range(1, int(length.max())):
        own = start[length > step] + step
        last = own - 1
        offset_m = points_m[own][:, None] - points_m[last][:, :, None]  # (M, last, own, 3)
        apart_m = np.linalg.norm(offset_m, axis=-1)
        aside_m = np.minimum(
            np.linalg.norm(np.cross(offset_m, along[last][:, :, None]), axis=-1),
            np.linalg.norm(np.cross(offset_m, along[own][:, None]), axis=-1),
        )
        unit_m = footprint_m[own][:, None]
        cost = np.full((len(own), candidates + 1, candidates + 1), 1.0)
        cost[:, -1, -1] = 0
        cost[:, :-1, :-1] = 0.5 * np.minimum(aside_m / (settings.bend_px * unit_m), 6)
        cost[:, :-1, :-1] += np.where(apart_m > settings.leap_px * unit_m, 3.0, 0.0)
        reached = total[last][:, :, None] - cost
        before[own] = reached.argmax(axis=1)
        total[own] = reached.max(axis=1) + gain[own]
    chosen = np.full(count, candidates)
    ends = start + length - 1
    chosen[ends] = total[ends].argmax(axis=1)
    for step in range(int(length.max()) - 1, 0, -1):
        own = start[length > step] + step
        chosen[own - 1] = before[own, chosen[own]]
    return chosen
