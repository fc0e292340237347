"""Which features of two photographs may show the same point: nearest descriptors, both ways."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

_DESCRIPTOR_NORM = 512.0  # of SIFT descriptors as bytes
_BLOCK = 4096  # rows compared at once
_ALLOWED_BLOCK = 1024  # the same where not all may match


@dataclass(frozen=True, kw_only=True)
class MatchSettings:
    """When two descriptors are similar."""

    max_ratio: float = 0.8  # of the angle to the nearest and to the second nearest
    max_angle_rad: float = 0.7

    def __post_init__(self) -> None:
        if not 0 < self.max_ratio <= 1 or not 0 < self.max_angle_rad <= np.pi:
            raise ValueError(f"max_ratio must be in 0 to 1 and max_angle_rad in 0 to π, not {self}")


def match_descriptors(
    first: NDArray[np.uint8], second: NDArray[np.uint8], settings: MatchSettings = MatchSettings()
) -> NDArray[np.uint32]:
    """Pairs of features that are each other's nearest, and much nearer than the next.

    Exact, and the same however many threads multiply: products of bytes are whole numbers below 2²⁴.

    Args:
        first: (N, 128), SIFT descriptors of unit length times 512.
        second: (M, 128).
        settings: When they are similar.

    Returns:
        (K, 2), numbers of the first and of the second, in the order of the first.

    Source:
        D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, 2004, section 7.1.
    """
    if len(first) < 1 or len(second) < 2:
        return np.zeros((0, 2), np.uint32)
    return match_nearest(first, second, settings.max_ratio, settings.max_angle_rad)


def match_nearest(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    max_ratio: float,
    max_angle_rad: float,
    allowed: Callable[[slice], NDArray[np.bool_]] | None = None,
) -> NDArray[np.uint32]:
    """Pairs (K, 2) of features that are each other's nearest among those allowed, and much nearer than the next.

    Args:
        first: (N, 128), SIFT descriptors of unit length times 512.
        second: (M, 128), one at least.
        max_ratio: Of the angle to the nearest and to the second nearest.
        max_angle_rad: Of a match.
        allowed: For rows of the first (R,), which of the second (R, M) may match them; None: all.
    """
    columns = np.ascontiguousarray(second.astype(np.float32).T)
    nearest = np.zeros(len(first), np.int64)
    dots = np.full((2, len(first)), -1, np.float32)
    back = np.zeros(len(second), np.int64)
    back_dot = np.full(len(second), -1, np.float32)
    block = _BLOCK if allowed is None else _ALLOWED_BLOCK
    for start in range(0, len(first), block):
        rows = slice(start, min(start + block, len(first)))
        table = first[rows].astype(np.float32) @ columns
        if allowed is not None:
            table[~allowed(rows)] = -1
        best = table.argmax(axis=0)
        best_dot = table[best, np.arange(len(second))]
        better = best_dot > back_dot
        back[better], back_dot[better] = best[better] + start, best_dot[better]
        own = table.argmax(axis=1)
        along = np.arange(len(own))
        nearest[rows], dots[0, rows] = own, table[along, own]
        table[along, own] = -1
        dots[1, rows] = table.max(axis=1)
    angles = np.arccos(np.clip(dots / np.float32(_DESCRIPTOR_NORM**2), -1, 1))
    good = (
        (dots[0] >= 0)
        & (back[nearest] == np.arange(len(first)))
        & (angles[0] <= max_angle_rad)
        & (angles[0] < max_ratio * angles[1])
    )
    chosen = np.flatnonzero(good)
    return np.column_stack([chosen, nearest[chosen]]).astype(np.uint32)


def neighbors_in_order(count: int, overlap: int) -> Iterator[tuple[int, int]]:
    """Pairs of a sequence of pictures at most so many apart, and twice, four times, … as far beyond."""
    steps = sorted({*range(1, overlap + 1), *(overlap * 2**power for power in range(1, 4))})
    for first in range(count):
        for step in steps:
            if first + step < count:
                yield first, first + step


def all_pairs(count: int) -> Iterator[tuple[int, int]]:
    yield from combinations(range(count), 2)


def retrieve_pairs(
    descriptors: list[NDArray[np.uint8]], neighbors: int, rng: np.random.Generator, words: int = 64
) -> set[tuple[int, int]]:
    """For each photograph those that look most like it, by descriptors gathered over words of their own vocabulary.

    Args:
        descriptors: (N, 128) of each photograph.
        neighbours: How many for each.
        rng: Draws the descriptors that the words come from.
        words: Size of the vocabulary.

    Returns:
        Pairs, the smaller number first.

    Source:
        H. Jégou et al., Aggregating local descriptors into a compact image representation, 2010, section 3.
    """
    per_photo = max(1, 60_000 // max(len(descriptors), 1))
    drawn = [item[np.sort(rng.choice(len(item), min(per_photo, len(item)), replace=False))] for item in descriptors]
    sample = _unit(np.concatenate(drawn))
    if len(sample) < 2 * words:
        return set(all_pairs(len(descriptors)))
    centers = sample[np.sort(rng.choice(len(sample), words, replace=False))]
    for _ in range(10):  # Lloyd's iterations; the words need not be good, only the same for all
        nearest = (sample @ centers.T).argmax(axis=1)
        sums = np.zeros_like(centers)
        np.add.at(sums, nearest, sample)
        filled = np.linalg.norm(sums, axis=1) > 0
        centers[filled] = _unit_rows(sums[filled])
    signatures = np.zeros((len(descriptors), words * sample.shape[1]), np.float32)
    for index, item in enumerate(descriptors):
        own = _unit(item)
        nearest = (own @ centers.T).argmax(axis=1)
        residuals = np.zeros_like(centers)
        np.add.at(residuals, nearest, own - centers[nearest])
        signatures[index] = _unit_rows(residuals).ravel()
    similarity = signatures @ signatures.T
    np.fill_diagonal(similarity, -np.inf)
    order = np.argsort(-similarity, axis=1, kind="stable")[:, : min(neighbors, len(descriptors) - 1)]
    return {(min(i, int(j)), max(i, int(j))) for i, row in enumerate(order) for j in row}


def _unit(descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
    return _unit_rows(descriptors.astype(np.float32))


def _unit_rows(values: NDArray[np.float32]) -> NDArray[np.float32]:
    length = np.linalg.norm(values, axis=1, keepdims=True)
    return np.asarray(np.divide(values, length, out=np.zeros_like(values), where=length > 0), np.float32)
