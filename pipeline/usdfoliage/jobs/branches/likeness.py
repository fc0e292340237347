"""How variations differ from their plant and from each other, for report and terminal."""

from collections.abc import Sequence

import numpy as np

from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.similarity import compare_trees, measure_traits
from usdfoliage.jobs.report.table import Row

_TERMS = "1 for trees that agree in shape, in geometry and in the structure of their branches, 0 for no similarity"


def likeness_rows(plant: Skeleton, variations: Sequence[Skeleton], reached: Sequence[float]) -> list[Row]:
    """The similarity S_T, and the spread of heights, crown radii and fork angles; none without variations.

    Args:
        plant: That they are variations of.
        variations: Their branches.
        reached: Share of the points of its own envelope that each grew to.
    """
    if not variations:
        return []
    own, others = measure_traits(plant), [measure_traits(each) for each in variations]
    to_plant = [compare_trees(own, each).total for each in others]
    among = [compare_trees(one, other).total for index, one in enumerate(others) for other in others[:index]]
    value = f"{_range(to_plant, 2)} to the plant" + (f", {_range(among, 2)} to each other" if among else "")
    rows = [
        Row(name="similarity of variations, S_T", value=value, remark=_TERMS),
        _spread("height", " m", 2, own.height_m, [each.height_m for each in others]),
        _spread("crown radius", " m", 2, own.crown_m, [each.crown_m for each in others]),
    ]
    forked = [each.fork_deg for each in others if np.isfinite(each.fork_deg)]
    if forked and np.isfinite(own.fork_deg):
        rows.append(_spread("mean fork angle", "°", 0, own.fork_deg, forked))
    comes = Row(
        name="reach of variations",
        value=f"{_range([int(1000 * share) / 10 for share in reached], 1)} %",
        remark="of the points of their envelopes",
    )
    return [*rows, comes]


def _spread(what: str, unit: str, digits: int, of_plant: float, values: Sequence[float]) -> Row:
    mean = float(np.mean(values))
    varies = 100 * float(np.std(values)) / mean if mean > 0 else 0.0
    remark = f"{of_plant:.{digits}f}{unit} of the plant"
    value = f"{_range(values, digits)}{unit}, coefficient of variation {varies:.1f} %"
    return Row(name=f"{what} of variations", value=value, remark=remark)


def _range(values: Sequence[float], digits: int) -> str:
    low, high = (f"{limit:.{digits}f}" for limit in (np.min(values), np.max(values)))
    return low if low == high else f"{low} to {high}"
