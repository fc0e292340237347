"""Which division the leaf has that an instancer repeats: as few triangles as keep the leaves' form. Our own."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.leaf.shape.deviation import measure_deviation
from usdfoliage.leaf.shape.mesh import PrototypeSettings
from usdfoliage.leaf.shape.topology import VertexPlaces

# For leaves that may be edited one by one: silhouettes fine enough for jitter. 404 to 644 triangles.
_OF_FEW = tuple(PrototypeSettings(across=across) for across in (6, 8, 10, 12, 14))
# (across, along, silhouette), with 28 to 332 triangles.
_EVEN = (
    (4, 4, 6), (4, 4, 8), (4, 5, 8), (4, 5, 10), (4, 6, 10), (6, 4, 10), (4, 7, 14), (6, 6, 10), (6, 6, 12), (6, 7, 14),
    (8, 6, 12), (8, 7, 14), (8, 8, 16), (10, 8, 16), (10, 10, 20), (12, 10, 20), (12, 12, 24), (14, 12, 24),
)  # fmt: skip
_OF_MANY = tuple(
    PrototypeSettings(across=across, along=along, silhouette=silhouette, even=True)
    for across, along, silhouette in _EVEN
)
_FIRST_STEP, _LAST_STEP = 0.02, 0.002  # by which vertices are moved, in u and v
_MIN_GAP = 0.02  # between vertices
_POWER = 4  # of the mean of deviations that moving lessens: the large ones count


@dataclass(frozen=True, kw_only=True)
class PrototypeChoice:
    """What is asked of a prototype, and what it may cost."""

    few: int = 3000  # up to so many leaves each has a silhouette fine enough for jitter
    total: int = 2_000_000  # triangles of all leaves, beyond which none are added
    fewest: int = 48  # triangles that a leaf may always have
    within: float = 0.005  # leaf lengths, from the surface
    share: float = 0.9  # of the leaves, that are within
    sample: int = 64  # leaves that are measured
    nearly: float = 1.2  # times as far away: then the vertices of few triangles are moved to where they serve best
    moved: int = 48  # triangles of a form whose vertices are moved; with more, more triangles cost less than the search


def choose_prototype(
    parameters: NDArray[np.floating], choice: PrototypeChoice = PrototypeChoice()
) -> PrototypeSettings:
    """The division with the fewest triangles that is near enough to most leaves, or the nearest that may be.

    Leaves with curved halves need many columns: where so many triangles would be too many, they get what comes nearest.

    Args:
        parameters: (N, 7, 3), all leaves of an instancer.
        choice: What near enough is.
    """
    forms = _OF_FEW if len(parameters) <= choice.few else _OF_MANY
    if not len(parameters):
        return forms[0]
    sample = np.linspace(0, len(parameters) - 1, min(len(parameters), choice.sample)).astype(np.intp)
    leaves = np.asarray(parameters, np.float64)[sample]
    allowed = max(choice.total // len(parameters), choice.fewest)
    nearest, away = forms[0], np.inf
    for form in forms:
        if form.triangles > max(allowed, forms[0].triangles):
            continue
        found = _distance(leaves, form, choice)
        if choice.within < found <= choice.nearly * choice.within and form.triangles <= choice.moved:
            form = place_vertices(leaves, form)
            found = _distance(leaves, form, choice)
        if found <= choice.within:
            return form
        if found < away:
            nearest, away = form, found
    return place_vertices(leaves, nearest) if nearest.triangles <= choice.moved and not nearest.places else nearest


def place_vertices(parameters: NDArray[np.floating], form: PrototypeSettings) -> PrototypeSettings:
    """The division with its rows, columns and segments where its triangles come nearest to leaves (N, 7, 3)."""
    topology = form.topology()
    u, v = topology.uv.T
    counts = form.across // 2 - 1, form.along - 1, form.silhouette - 1
    is_inner = (np.abs(u) < 1) & (v > 0) & (v < 1)
    columns, rows, ends = np.unique(u[is_inner & (u > 0)]), np.unique(v[is_inner]), np.unique(v[u == 1])
    places = np.concatenate([columns, rows, ends])
    groups = np.split(np.arange(len(places)), np.cumsum(counts)[:-1])

    def placed(numbers: NDArray[np.float64]) -> PrototypeSettings | None:
        parts = [np.round(numbers[group], 4) for group in groups]
        if any((np.diff([0.0, *part, 1.0]) < _MIN_GAP).any() for part in parts):
            return None
        columns, rows, silhouette = (tuple(map(float, part)) for part in parts)
        return replace(form, places=VertexPlaces(columns=columns, rows=rows, silhouette=silhouette))

    def cost(candidate: PrototypeSettings) -> float:
        return float(np.mean(measure_deviation(parameters, candidate.topology()) ** _POWER))

    best = form
    lowest, step = cost(form), _FIRST_STEP
    while step > _LAST_STEP:
        was = lowest
        for index in range(len(places)):
            for sign in (1, -1):
                moved = places.copy()
                moved[index] += sign * step
                candidate = placed(moved)
                if candidate is None:
                    continue
                found = cost(candidate)
                if found < lowest:
                    places, lowest, best = moved, found, candidate
                    break
        if lowest > 0.999 * was:
            step /= 2
    return best


def _distance(leaves: NDArray[np.float64], form: PrototypeSettings, choice: PrototypeChoice) -> float:
    return float(np.quantile(measure_deviation(leaves, form.topology()), choice.share))
