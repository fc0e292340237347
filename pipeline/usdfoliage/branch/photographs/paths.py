"""Links between places on stems, what it costs to follow them, and the cheapest paths from the soil. Our own."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from usdfoliage.branch.photographs.join_settings import JoinSettings
from usdfoliage.branch.photographs.stem_points import StemPoints

_NEAR = 0.05  # of the longest gap: of nearer places directions are not certain
_BASE_SINE = 0.3  # square of the sine of the angle between a link and a leaf's base, whose direction is not known


@dataclass(frozen=True, kw_only=True, eq=False)
class Links:
    """P pairs of near places on stems and at ends of leaves, which are numbered after the stems."""

    one: NDArray[np.int64]  # (P,)
    other: NDArray[np.int64]  # (P,)
    length_m: NDArray[np.float64]  # (P,)
    rise: NDArray[np.float64]  # (P,), sine of the angle at which the second lies above the first
    smaller: NDArray[np.float64]  # (P,), square of the sine of the angle between the link and one place's course
    larger: NDArray[np.float64]  # (P,), and of the other, where it is larger

    def take(self, chosen: NDArray[np.bool_]) -> "Links":
        """These pairs alone."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})

    def among(self, places: NDArray[np.int64], count: int) -> "Links":
        """The pairs of these places, of so many, by their numbers in this order."""
        number = np.full(count, -1, np.int64)
        number[places] = np.arange(len(places))
        left = self.take((number[self.one] >= 0) & (number[self.other] >= 0))
        return replace(left, one=number[left.one], other=number[left.other])


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkCosts:
    """What paths along P links cost, in metres: from the first place to the second, and back."""

    one: NDArray[np.int64]  # (P,)
    other: NDArray[np.int64]  # (P,)
    outwards: NDArray[np.float64]  # (P,)
    back: NDArray[np.float64]  # (P,)

    def take(self, chosen: NDArray[np.bool_]) -> "LinkCosts":
        """Those of these links alone."""
        return replace(self, **{each.name: getattr(self, each.name)[chosen] for each in fields(self)})


def link_places(stems: StemPoints, ends_m: NDArray[np.float64], longest_m: float) -> Links:
    """The links up to this length between places on stems and ends (E, 3) of leaves, whose course is not known."""
    places_m = np.concatenate([stems.points_m, ends_m])
    along = np.concatenate([stems.along, np.zeros((len(ends_m), 3))])
    one, other = cKDTree(places_m).query_pairs(longest_m, output_type="ndarray").T
    offset_m = places_m[other] - places_m[one]
    length_m = np.maximum(np.linalg.norm(offset_m, axis=1), 1e-9)
    sines = []
    for each in (one, other):
        cosine = np.einsum("ij,ij->i", offset_m, along[each]) / length_m
        sines.append(np.where(each < len(stems), 1 - np.square(cosine), _BASE_SINE))
    return Links(
        one=one,
        other=other,
        length_m=length_m,
        rise=offset_m[:, 1] / length_m,
        smaller=np.minimum(*sines),
        larger=np.maximum(*sines),
    )


def weigh_links(links: Links, odds: NDArray[np.float64], height_m: float, settings: JoinSettings) -> LinkCosts:
    """What links cost between places of these odds (N,), of a plant of this height: those that are not too long."""
    longest_m, gap_m = settings.longest_gap * height_m, settings.gap * height_m
    if links.length_m.max(initial=0) > longest_m:
        links = links.take(links.length_m <= longest_m)
    length_m = links.length_m
    turned = np.minimum(length_m / (_NEAR * longest_m), 1) * (
        settings.bend * links.smaller + settings.fork * links.larger
    )
    dear = np.exp(-settings.sure * odds)
    cost = length_m * (1 + turned) * (1 + length_m / gap_m) * 0.5 * (dear[links.one] + dear[links.other])
    # Stems rise from the soil: who comes to one by its tip, and leads down along it, has come by a leaf.
    outwards, back = (cost * (1 + settings.fall * np.square(np.maximum(-sign * links.rise, 0))) for sign in (1, -1))
    return LinkCosts(one=links.one, other=links.other, outwards=outwards, back=back)


def find_cheapest_paths(
    costs: LinkCosts,
    stems: StemPoints,
    odds: NDArray[np.float64],
    soil_m: float,
    height_m: float,
    may_root: NDArray[np.bool_],
    settings: JoinSettings,
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """(N,) place before each one on the cheapest path from the soil, -1 where the soil is; (N,) what the paths cost.

    What no path leads to costs infinitely much, and has nothing before it.
    """
    whole, count, gap_m = len(odds), len(stems), settings.gap * height_m
    above_m = stems.points_m[:, 1] - soil_m
    low = np.flatnonzero((above_m < settings.highest_root * height_m) & may_root[:count])
    down_m = np.maximum(above_m[low], 1e-3 * height_m)
    lying = 1 - np.square(stems.along[low, 1])
    dear = np.exp(-settings.sure * odds[low])
    to_soil = down_m * (1 + settings.bend * lying) * (1 + settings.hidden * down_m / gap_m) * dear
    if not len(low):
        low, to_soil = np.array([np.argmin(above_m)]), np.array([1.0])
    soil = np.full(len(low), whole)
    graph = coo_array(
        (
            np.concatenate([costs.outwards, costs.back, to_soil]),
            (np.concatenate([costs.one, costs.other, soil]), np.concatenate([costs.other, costs.one, low])),
        ),
        shape=(whole + 1, whole + 1),
    ).tocsr()
    total, before, _ = dijkstra(
        csr_array(graph), directed=True, indices=np.array([whole]), min_only=True, return_predecessors=True
    )
    before = before[:whole]
    return np.where((before < 0) | (before == whole), -1, before).astype(np.int32), total[:whole]
