"""Places on stems, brought together from the lines of all photographs: one for each bit of a stem. Our own."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from usdfoliage.branch.photographs.evidence import StemEvidence

_TURNS = 3  # of drawing places together
_PARALLEL = 0.8  # cosine of the angle between lines that are one


@dataclass(frozen=True, kw_only=True)
class MergeSettings:
    """Which lines of several photographs are one, and what speaks for a stem. Lengths in footprints of a pixel."""

    reach: float = 3.0  # Lines so near and parallel are one. Range: above 0.
    apart: float = 2.0  # Places that are left lie at least so far apart. Range: above 0.
    min_lines: int = 3  # Photographs that have a line at a place, or all that see it. Range: 2 or more.
    min_share: float = 0.3  # Share of the photographs that see it, likewise. Range: 0 to 1.
    max_beside: float = 0.6  # Sides on which the surface goes on, at most. Range: 0 to 2.

    def __post_init__(self) -> None:
        if not (self.reach > 0 and self.apart > 0 and self.min_lines >= 2 and 0 <= self.min_share <= 1):
            raise ValueError(f"reach and apart must be above 0, min_lines at least 2, min_share in [0, 1], not {self}")
        if not 0 <= self.max_beside <= 2:
            raise ValueError(f"max_beside must be from 0 to 2, not {self.max_beside:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StemPoints:
    """Places on the axes of what may be stems."""

    points_m: NDArray[np.float64]  # (S, 3), metres
    along: NDArray[np.float64]  # (S, 3), direction of the axis, of length 1; its sign means nothing
    radius_m: NDArray[np.float64]  # (S,)
    odds: NDArray[np.float64]  # (S,), logarithm of the odds that it is a stem
    footprint_m: float  # of a pixel at the plant

    def __len__(self) -> int:
        return len(self.odds)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> "StemPoints":
        """These places alone."""
        every = (each.name for each in fields(self) if each.name != "footprint_m")
        return replace(self, **{name: getattr(self, name)[chosen] for name in every})

    def with_odds(self, odds: NDArray[np.float64]) -> "StemPoints":
        """The same places with other odds (S,)."""
        return replace(self, odds=odds)


def merge_lines(
    points_m: NDArray[np.float64],
    along: NDArray[np.float64],
    radius_m: NDArray[np.float64],
    view: NDArray[np.integer],
    evidence: StemEvidence,
    footprint_m: float,
    settings: MergeSettings = MergeSettings(),
) -> StemPoints:
    """One place for each bit of a line that photographs show.

    Args:
        points_m: (M, 3), of the lines of all photographs.
        along: (M, 3), their directions, of length 1.
        radius_m: (M,).
        view: (M,), the photograph whose line it is.
        evidence: Of all photographs.
        footprint_m: Of a pixel at the plant.
        settings: Which are one.
    """
    enough = (evidence.lines >= settings.min_lines) | ((evidence.lines >= 2) & (evidence.lines == evidence.seen))
    good = np.flatnonzero(enough & (evidence.share > settings.min_share) & (evidence.beside < settings.max_beside))
    points_m, along, radius_m, view = points_m[good], along[good], radius_m[good], view[good]
    share, beside, lines = evidence.share[good], evidence.beside[good], evidence.lines[good]
    weight = share * np.sqrt(lines)
    reach_m = settings.reach * footprint_m
    for _ in range(_TURNS):
        one, other, cosine = _parallel_pairs(points_m, along, reach_m)
        near = weight[other] * np.exp(-2 * np.square((points_m[other] - points_m[one]) / reach_m).sum(axis=1))
        links = coo_array((near, (one, other)), shape=(len(points_m),) * 2).tocsr()
        signed = coo_array((near * np.sign(cosine), (one, other)), shape=(len(points_m),) * 2).tocsr()
        along = signed @ along
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        moved_m = (links @ points_m) / links.sum(axis=1)[:, None] - points_m
        points_m = points_m + moved_m - (moved_m * along).sum(axis=1, keepdims=True) * along  # across alone
    one, other, _ = _parallel_pairs(points_m, along, reach_m)
    links = coo_array((weight[other], (one, other)), shape=(len(points_m),) * 2).tocsr()
    whole: NDArray[np.float64] = np.asarray(links.sum(axis=1))
    mean = [np.asarray(links @ each) / whole for each in (np.log(radius_m), share, beside)]
    of_view = np.unique(one * (int(view.max(initial=0)) + 1) + view[other])
    views = np.bincount(of_view // (int(view.max(initial=0)) + 1), minlength=len(points_m))
    odds = 4 * (mean[1] - 0.45) - 3 * np.maximum(mean[2] - 0.1, 0) + 0.4 * (np.minimum(views, 5) - 2)
    kept = _one_in_reach(points_m, weight * views, settings.apart * footprint_m)
    return StemPoints(
        points_m=points_m[kept],
        along=along[kept],
        radius_m=np.exp(mean[0])[kept],
        odds=odds[kept],
        footprint_m=footprint_m,
    )


def _parallel_pairs(
    points_m: NDArray[np.float64], along: NDArray[np.float64], reach_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Places within reach of each other whose lines are parallel, both ways and each with itself; their cosines."""
    pairs = cKDTree(points_m).query_pairs(reach_m, output_type="ndarray") if len(points_m) else np.zeros((0, 2), int)
    every = np.arange(len(points_m))
    one = np.concatenate([pairs[:, 0], pairs[:, 1], every])
    other = np.concatenate([pairs[:, 1], pairs[:, 0], every])
    cosine = np.einsum("ij,ij->i", along[one], along[other])
    parallel = np.abs(cosine) > _PARALLEL
    return one[parallel], other[parallel], cosine[parallel]


def _one_in_reach(points_m: NDArray[np.float64], weight: NDArray[np.float64], reach_m: float) -> NDArray[np.int64]:
    """Places of which none is within reach of another one, those of most weight first."""
    if not len(points_m):
        return np.zeros(0, np.int64)
    order = np.argsort(-weight, kind="stable")
    around = list(cKDTree(points_m).query_ball_point(points_m[order], reach_m))
    gone = np.zeros(len(points_m), bool)
    kept = []
    for place, near in zip(order.tolist(), around, strict=True):
        if not gone[place]:
            kept.append(place)
            gone[near] = True
    return np.sort(np.array(kept, np.int64))
