"""Which patches of different views are of the same surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.files.threads import map_threaded

SAMPLES = 150  # pixels of a patch that are looked for in other views
SAME = 0.85  # share of either of two patches that lies on the other, if they show the same


@dataclass(frozen=True, kw_only=True, eq=False)
class Overlaps:
    """How the patches of all views overlap; patch k of view v has the number first[v] + k - 1."""

    first: NDArray[np.int64]  # (V + 1,)
    view: NDArray[np.int64]  # (P,), of each patch
    share: sp.csr_matrix  # (P, P), share of the first one's pixels seen in the other's view that lie on the other
    seen: NDArray[np.float64]  # (P, V), share of each patch that a view sees
    stability: NDArray[np.float64]  # (P,), how far other views show the same patch, 0 to 1
    views_seen: NDArray[np.int64]  # (P,), how many other views see a good part of it


def measure_overlaps(
    views: Sequence[View],
    depths_m: Sequence[NDArray[np.floating]],
    labels: Sequence[NDArray[np.int32]],
    counts: Sequence[int],
    neighbors: Sequence[Sequence[int]],
    tolerance: float,
    noise_m: float,
    *,
    threads: int = 0,
) -> Overlaps:
    """Project patches into other views and see what lies there.

    Args:
        views: V.
        depths_m: V of (H, W).
        labels: V of (H, W), 0 for none, k for patch k - 1.
        counts: Patches of each view.
        neighbors: The views to look into, for each view.
        tolerance: Footprints between a pixel and what the other view sees, besides three times noise_m.
        noise_m: Standard deviation of the depth.
        threads: At most so many, 0 for one per core; the result is the same.
    """
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    total = int(first[-1])
    view_of = np.repeat(np.arange(len(views)), counts)
    samples, seen_px = np.zeros(total), np.zeros((total, len(views)))

    def match_view(index: int) -> tuple[NDArray[np.intp], list[tuple[int, NDArray[np.intp], NDArray[np.int64]]]]:
        """Pixels looked for (P,); by view that was looked into: pixels seen (P,), and keys of the pairs that meet."""
        view, depth_m, label = views[index], depths_m[index], labels[index]
        picked, patch = _pick(label, counts[index])
        patch = patch + first[index]
        row, column = np.divmod(picked, label.shape[1])
        points_m = view.camera.unproject(np.column_stack([column + 0.5, row + 0.5]), depth_m[row, column])
        found = []
        for other in neighbors[index]:
            camera = views[other].camera
            places, distance_m = camera.project(points_m)
            with np.errstate(invalid="ignore"):  # behind the camera
                x, y = places.T
                which = np.flatnonzero((x >= 0) & (y >= 0) & (x < camera.width_px) & (y < camera.height_px))
            x, y = places[which].astype(np.int64).T
            there_m = depths_m[other][y, x]
            near_m = tolerance * distance_m[which] / camera.focal_px[0] + 3 * noise_m
            same = (there_m > 0) & (np.abs(there_m - distance_m[which]) < near_m)
            label_there = labels[other][y[same], x[same]].astype(np.int64)
            on_patch = label_there > 0
            key = patch[which[same]][on_patch] * total + first[other] + label_there[on_patch] - 1
            found.append((other, np.bincount(patch[which[same]], minlength=total), key))
        return np.bincount(patch, minlength=total), found

    rows: list[NDArray[np.int64]] = []
    columns: list[NDArray[np.int64]] = []
    hits: list[NDArray[np.int64]] = []
    for looked_for, found in map_threaded(match_view, range(len(views)), threads=threads):
        samples += looked_for
        for other, seen_there, key in found:
            seen_px[:, other] += seen_there
            pair, number = np.unique(key, return_counts=True)
            rows.append(pair // total)
            columns.append(pair % total)
            hits.append(number)
    row_of, column_of = (np.concatenate([*parts, np.zeros(0, np.int64)]) for parts in (rows, columns))
    number_of = np.concatenate([*hits, np.zeros(0, np.int64)])
    values = number_of / np.maximum(seen_px[row_of, view_of[column_of]], 1)
    share = sp.csr_matrix((values, (row_of, column_of)), shape=(total, total))
    seen = seen_px / np.maximum(samples, 1)[:, None]
    back = np.asarray(share[column_of, row_of]).ravel() if len(row_of) else np.zeros(0)
    best = np.zeros((total, len(views)))
    np.maximum.at(best, (row_of, view_of[column_of]), np.minimum(values, back))
    weight = np.where(seen > 0.4, seen, 0)
    stability = (best * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
    return Overlaps(
        first=first,
        view=view_of,
        share=share,
        seen=seen,
        stability=stability,
        views_seen=np.count_nonzero(weight, axis=1),
    )


def group_patches(overlaps: Overlaps, worth: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Patches that show the same surface whole, the most worthy first, each in one group; those worth 0 in none.

    A patch takes those of other views that overlap with itself both ways; what these overlap with does not count, since
    leaves that touch in one view would chain all foliage together.
    """
    share, seen, view = overlaps.share, overlaps.seen, overlaps.view
    used = np.zeros(len(worth), bool)
    groups = []
    for patch in np.argsort(-worth, kind="stable"):
        if used[patch] or worth[patch] <= 0:
            continue
        begin, end = share.indptr[patch], share.indptr[patch + 1]
        others = share.indices[begin:end].astype(np.int64)
        back = np.asarray(share[others, np.full(len(others), patch)]).ravel()
        same = np.minimum(share.data[begin:end], back) > SAME
        same &= ~used[others] & (worth[others] > 0)
        same &= (seen[patch, view[others]] > 0.4) & (seen[others, view[patch]] > 0.4)
        group = np.concatenate([[patch], others[same]])
        used[group] = True
        groups.append(group)
    return groups


def _pick(label: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """At most SAMPLES pixels of each patch, evenly in the order of rows, and the patch (from 0) of each."""
    flat = label.ravel()
    pixels = np.flatnonzero(flat)
    pixels = pixels[np.argsort(flat[pixels], kind="stable")]
    numbers = np.bincount(flat[pixels], minlength=count + 1)[1:]
    rank = np.arange(len(pixels)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
    size = np.repeat(numbers, numbers)
    samples = np.minimum(size, SAMPLES)
    chosen = (rank * samples) // np.maximum(size, 1) != ((rank - 1) * samples) // np.maximum(size, 1)
    return pixels[chosen], (flat[pixels[chosen]] - 1).astype(np.int64)
