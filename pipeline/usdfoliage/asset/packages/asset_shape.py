"""How large an asset is, where it stands and what can be chosen in it, as its writer knows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.plant import Plant, box_around
from usdfoliage.asset.variants import VariantSet, order_variants


@dataclass(frozen=True, kw_only=True, eq=False)
class AssetShape:
    """The same values as a reader finds in the composed asset."""

    extent_m: NDArray[np.float64] | None  # (2, 3), of all purposes in the selected lod; None where it is not known
    asset_from_capture: NDArray[np.float64]  # (4, 4), column vectors
    variants: Mapping[str, Sequence[str]]  # names by variant set
    selections: Mapping[str, str]
    drawn_m: NDArray[np.float64] | None = None  # (2, 3), as extent_m without guides


def shape_of(plant: Plant, sets: Sequence[VariantSet]) -> AssetShape:
    """The shape of a plant with lods that is written with these variant sets."""
    names: dict[str, list[str]] = {}
    selections: dict[str, str] = {}
    for entry in sets:
        names.setdefault(entry.name, []).extend(entry.variants)
        selections[entry.name] = next(iter(entry.variants))
    boxes = plant.lods[selections["lod"]]
    drawn = [box for box in (boxes.default, boxes.render, boxes.proxy) if box is not None]
    known = [*drawn, *([boxes.guide] if boxes.guide is not None else [])]
    return AssetShape(
        extent_m=_around(known),
        drawn_m=_around(drawn),
        asset_from_capture=plant.asset_from_capture,
        variants={name: tuple(order_variants(dict.fromkeys(members))) for name, members in names.items()},
        selections=selections,
    )


def _around(boxes: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """The box around boxes, as USD stores it; None for none."""
    return box_around(boxes).astype(np.float32).astype(np.float64) if boxes else None
