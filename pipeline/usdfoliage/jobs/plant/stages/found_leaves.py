"""Which of the leaves that were found are of the plant: those on its stems, the others listed or left out."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.branch.model_file import TracedPlant
from usdfoliage.jobs.plant.stages.leaves_on_stems import find_dull_slivers, lie_along_stems
from usdfoliage.jobs.plant.stages.models import CapturedLeaves
from usdfoliage.jobs.plant.stages.plant_hue import find_plant_hue
from usdfoliage.leaf.change import move_leaves
from usdfoliage.leaf.fit.flip import flip_leaves
from usdfoliage.leaf.fit.silhouette_order import order_silhouettes
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places
from usdfoliage.remarks import Remark, remark

_ACROSS, _ALONG = 5, 9  # places of a leaf at which it is compared with others
_APART = 2.0  # median leaf lengths from stems and from leaves on them, beyond which a leaf is no part of the plant
_FAR = 0.1  # of the plant's height, from the points of its cloud, beyond which a leaf is of another plant
_DESCRIBED = 8  # leaves whose places a remark has


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundLeaves:
    """The leaves of a plant that were found, in its frame, and what the user should know of the others."""

    leaves: Leaves | None  # N, None where there is none
    remarks: tuple[Remark, ...] = ()
    led_to: int = 0  # of them, leaves that stems of photographs lead to
    kept: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))  # (N,), which of those found


def keep_found_leaves(
    captured: CapturedLeaves | None, traced: TracedPlant | None, plant_from_capture: NDArray[np.float64]
) -> FoundLeaves:
    """The leaves that are of the plant, in its frame, each with its base where a stem leads to it.

    Args:
        captured: That were found.
        traced: The stems, if any. Its leaves are numbered as the captured ones.
        plant_from_capture: (4, 4), column vectors.
    """
    if captured is None or not len(captured.fitted.leaves):
        return FoundLeaves(leaves=None)
    moved = plant_from_capture @ np.linalg.inv(captured.own_from_capture)
    placed = move_leaves(captured.fitted.leaves, moved)
    if traced is None:
        return FoundLeaves(leaves=placed, kept=np.arange(len(placed)))
    count = len(placed)
    if len(traced.turned):
        placed = order_silhouettes(flip_leaves(placed, np.isin(np.arange(count), traced.turned)))
    remarks: list[Remark] = []
    on_stems = lie_along_stems(placed, traced.skeleton)
    if on_stems.any():
        text = f"{int(on_stems.sum())} of {count} leaves that were found lie along a stem, and are of it"
        remarks.append(remark("leaves-on-stems-left-out", text))
    slivers = find_dull_slivers(placed) & ~on_stems
    if slivers.any():
        text = (
            f"{int(slivers.sum())} of {count} leaves that were found are narrow and duller than the plant's leaves, as "
            f"pieces of stems are, and are left out: at {_list_places(placed.take(slivers))}"
        )
        remarks.append(remark("slivers-left-out", text))
    left_out, unjoined = on_stems | slivers, np.zeros(count, bool)
    if traced.of_photographs:
        roots_m = traced.skeleton.points_m[traced.skeleton.first[traced.skeleton.parent_curve < 0]]
        below = lie_below_stems(placed, roots_m) & ~left_out
        if below.any():
            text = (
                f"{int(below.sum())} of {count} leaves that were found lie below the foot of the stems, beside it, in "
                f"another colour than the plant's leaves, and are left out: at {_list_places(placed.take(below))}"
            )
            remarks.append(remark("leaves-below-stems-left-out", text))
        left_out = left_out | below
        unjoined = np.isin(np.arange(count), traced.unjoined) & ~left_out
        apart = unjoined & lie_apart(placed, ~unjoined & ~left_out, traced.skeleton.points_m)
        if unjoined.any():
            remarks.append(_describe_unjoined(placed, unjoined, apart))
        left_out = left_out | apart
    else:
        plant_m = np.concatenate([traced.points_m, traced.skeleton.points_m])
        beside = lie_beside_plant(placed, plant_m) & ~left_out
        if beside.any():
            text = (
                f"{int(beside.sum())} of {count} leaves that were found lie beside the plant, as of another one, and "
                f"are left out: at {_list_places(placed.take(beside))}"
            )
            remarks.append(remark("leaves-beside-plant-left-out", text))
        left_out = left_out | beside
    return FoundLeaves(
        leaves=None if left_out.all() else placed.take(~left_out),
        kept=np.flatnonzero(~left_out),
        remarks=tuple(remarks),
        led_to=int(np.count_nonzero(~left_out & ~unjoined)) if traced.of_photographs else 0,
    )


def lie_below_stems(leaves: Leaves, roots_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) leaves that are rather of the soil, or of a stem that goes on into it. Our own.

    That a leaf lies lower than stems begin is not enough: leaves hang over the rim of a pot, whole plants hang, and
    where the soil is is known to a few centimetres. So three signs must agree. The middle of the leaf lies below the
    foot of every stem. It lies nearer to a foot than the leaf is long, in plan: what hangs over a rim is farther away.
    And its colour is not that of the plant: it differs from the median of the leaves above more than 95 of 100 of these
    do. Of leaves without colours, and where few leaves are above, nothing is left out.

    Args:
        leaves: N, Y up.
        roots_m: (R, 3), where stems leave the soil, in the same frame.
    """
    none = np.zeros(len(leaves), bool)
    if not len(leaves) or not len(roots_m):
        return none
    middle_m = _surfaces(leaves).mean(axis=1)
    below = middle_m[:, 1] < roots_m[:, 1].min()
    hue = find_plant_hue(leaves, ~below)
    if hue is None or not below.any():
        return none
    away_m = np.asarray(cKDTree(roots_m[:, [0, 2]]).query(middle_m[:, [0, 2]])[0])
    return np.asarray(below & (away_m < leaves.length_m) & (hue.off > hue.allowed))


def lie_apart(leaves: Leaves, joined: NDArray[np.bool_], stems_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) leaves of which no place is near a stem, or near a leaf on one: nearer than two median leaf lengths.

    Args:
        leaves: N, in any frame.
        joined: (N,), those on stems.
        stems_m: (S, 3), places on stems, in the same frame.
    """
    if not len(leaves):
        return np.zeros(0, bool)
    plant_m = np.concatenate([stems_m, _surfaces(leaves)[joined].reshape(-1, 3)])
    return _away_m(leaves, plant_m) > _APART * float(np.median(leaves.length_m))


def lie_beside_plant(leaves: Leaves, plant_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) leaves of which no place is near a point of the plant's cloud.

    Near is nearer than two median leaf lengths or a tenth of the plant's height, whichever is more: clouds are sparse.

    Args:
        leaves: N, Y up.
        plant_m: (P, 3), the cloud without ground and other plants, in the same frame.
    """
    if not len(leaves) or not len(plant_m):
        return np.zeros(len(leaves), bool)
    far_m = max(_APART * float(np.median(leaves.length_m)), _FAR * float(np.ptp(plant_m[:, 1])))
    return _away_m(leaves, plant_m) > far_m


def _away_m(leaves: Leaves, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,), from the nearest place of each leaf to the nearest of points; 0 without any."""
    if not len(points_m):
        return np.zeros(len(leaves))
    away_m = np.asarray(cKDTree(points_m).query(_surfaces(leaves).reshape(-1, 3))[0])
    return np.asarray(away_m.reshape(len(leaves), -1).min(axis=1))


def _describe_unjoined(leaves: Leaves, unjoined: NDArray[np.bool_], apart: NDArray[np.bool_]) -> Remark:
    """Which leaves no stem leads to: those that are near the plant, and those that are left out."""
    near = unjoined & ~apart
    what = [
        f"{int(group.sum())} {kept}: at {_list_places(leaves.take(group))}"
        for group, kept in ((near, "near the plant are kept"), (apart, "apart from it are left out"))
        if group.any()
    ]
    text = f"no stem leads to {int(unjoined.sum())} of {len(leaves)} leaves that were found; {'; '.join(what)}"
    return remark("leaves-not-joined", text)


def _list_places(leaves: Leaves) -> str:
    """The middles of leaves, in metres, in their frame: the first of many."""
    places = [f"({', '.join(f'{c:.3f}' for c in middle)})" for middle in _surfaces(leaves).mean(axis=1)]
    more = f" and {len(places) - _DESCRIBED} more" if len(places) > _DESCRIBED else ""
    return ", ".join(places[:_DESCRIBED]) + more


def _surfaces(leaves: Leaves) -> NDArray[np.float64]:
    """(N, 45, 3) places on each leaf, in metres."""
    places = grid_places(np.linspace(-1, 1, _ACROSS), np.linspace(0, 1, _ALONG))
    points_m = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    return np.asarray(points_m).reshape(len(leaves), -1, 3)
