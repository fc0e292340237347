"""Whether the wood of a plant is in one piece: what of its surface is afloat, and what of its axes is bare."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from usdfoliage.branch.distances import place_on_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.mesh_pieces import find_pieces

AFLOAT_M = 0.002  # from all other pieces: what is nearer lets no light pass
BARE = 2.0  # radii from an axis, within which there must be surface
BARE_EDGES = 1.5  # or so many edges of the surface
PLACES = 4  # on each segment, on average
DENSEST = 16  # places that are added on an edge at most


@dataclass(frozen=True, kw_only=True)
class WoodWholeness:
    """Figures of the wood of a plant."""

    pieces: int  # of the surface, that share no corner
    afloat: int  # pieces without a root that stand off all others
    widest_gap_m: float  # of those
    bare: float  # share of the length of all axes that has no surface


def measure_wholeness(skeleton: Skeleton, points_m: NDArray[np.float64], faces: NDArray[np.integer]) -> WoodWholeness:
    """Measure the surface of branches, and how it covers their axes.

    Args:
        skeleton: All branches; metres.
        points_m: (P, 3), of the surface as it is drawn.
        faces: (F, 3) or (F, 4).
    """
    roots_m = skeleton.points_m[skeleton.first[skeleton.parent_curve < 0]]
    pieces = find_pieces(points_m, faces, roots_m, AFLOAT_M / 2)
    used = np.zeros(len(points_m), bool)
    used[faces] = True
    afloat = pieces.afloat(AFLOAT_M)
    gaps_m = pieces.gap_m[afloat]
    bare_m = bare_lengths(skeleton, points_m, faces)
    return WoodWholeness(
        pieces=len(np.unique(pieces.of_point[used])),
        afloat=len(afloat),
        widest_gap_m=float(gaps_m[np.isfinite(gaps_m)].max(initial=0)),
        bare=float(bare_m.sum() / max(float(skeleton.lengths_m.sum()), 1e-300)),
    )


def bare_lengths(
    skeleton: Skeleton, points_m: NDArray[np.float64], faces: NDArray[np.integer], edges: float = BARE_EDGES
) -> NDArray[np.float64]:
    """(B,) how much of each axis is farther from the surface than it may be, and in no other branch that is thicker.

    Metres.

    Args:
        skeleton: All branches; metres.
        points_m: (P, 3), of the surface as it is drawn.
        faces: (F, 3) or (F, 4).
        edges: So many edges of the surface an axis may be away from it, if that is more than BARE radii.
    """
    if not len(faces):
        return skeleton.lengths_m
    step_m = max(float(skeleton.lengths_m.sum()) / (PLACES * len(skeleton.points_m)), 1e-9)
    places = place_on_axes(skeleton, step_m)
    surface_m, edge_m = _places_on_surface(points_m, faces)
    away_m, nearest = (np.asarray(each) for each in scipy.spatial.cKDTree(surface_m).query(places.points_m, workers=-1))
    off = away_m > np.maximum(BARE * places.radius_m, edges * edge_m[nearest])
    own = np.flatnonzero(off)
    curve = skeleton.curve[places.vertex]
    if len(own):  # within thicker wood nothing is to be seen
        size = np.floor(np.log2(places.radius_m))
        for each in np.unique(size):
            some = np.flatnonzero(size == each)
            apart_m, found = (
                np.asarray(one)
                for one in scipy.spatial.cKDTree(places.points_m[some]).query(places.points_m[own], workers=-1)
            )
            thicker_m = places.radius_m[some[found]]
            thicker = (thicker_m > places.radius_m[own]) & (curve[some[found]] != curve[own])
            off[own[(apart_m < 1.1 * thicker_m) & thicker]] = False
    # Every place stands for as much of its segment as the others of it.
    ends_m = np.linalg.norm(skeleton.points_m[places.vertex + 1] - skeleton.points_m[places.vertex], axis=1)
    shares_m = ends_m / np.bincount(places.vertex)[places.vertex]
    return np.bincount(curve[off], shares_m[off], len(skeleton)).astype(np.float64)


def _places_on_surface(
    points_m: NDArray[np.float64], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of faces, with places between them on edges that are long for the width of their face.

    Of a thin branch whose faces are long, the axis is far from all corners.

    Returns:
        Places (N, 3), and the mean length of the edges there (N,).
    """
    following = np.roll(faces, -1, axis=1)
    edges_m = points_m[following] - points_m[faces]
    length_m = np.linalg.norm(edges_m, axis=2)
    around = np.bincount(faces.ravel(), minlength=len(points_m))
    mean_m = np.bincount(faces.ravel(), length_m.ravel(), len(points_m)) / np.maximum(around, 1)
    width_m = length_m.min(axis=1)
    added = np.minimum(length_m / np.maximum(2 * width_m, 1e-12)[:, None], DENSEST).astype(np.int64)
    added[faces > following] = 0  # the other face of the edge has it too
    face, corner = np.nonzero(added)
    count = added[face, corner]
    of = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + 1) / (count[of] + 1)
    begin, end = faces[face, corner], following[face, corner]
    between_m = points_m[begin][of] + share[:, None] * edges_m[face, corner][of]
    back = np.flatnonzero(around)
    return np.concatenate([points_m[back], between_m]), np.concatenate(
        [mean_m[back], (mean_m[begin] + mean_m[end])[of] / 2]
    )
