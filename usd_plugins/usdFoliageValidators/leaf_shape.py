"""Validator of FoliageLeafAPI: the leaves as they are drawn, with edits and jitter.

It computes with usdfoliage, which knows the surface; where that cannot be imported, it reports a warning.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usdFoliageValidators import values
from usdFoliageValidators.findings import Findings, count, error, warning, which
from usdFoliageValidators.guides import is_guide_copy
from usdFoliageValidators.leaf import PARAMETERS
from usdFoliageValidators.leaf_edits import JITTER_MAP, NUMBER_EDITS, VECTOR_EDITS

if TYPE_CHECKING:
    from usdfoliage.leaf.shape.edits import LeafEdits
    from usdfoliage.leaf.shape.jitter import Jitter

LEAF_API = "FoliageLeafAPI"
SLACK = 2e-3  # leaf lengths; bounds contain the surface and stand off a little from it
FOLDS = "has leaves that fold over themselves: {}; they are drawn as they are"
SILHOUETTE = slice(2, 5)  # rows of the parameters


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnLeaves:
    """The leaves of a prim with their edits."""

    prim: Usd.Prim
    plain: NDArray[np.float64]  # (N, 7, 3)
    edited: NDArray[np.float64]  # (N, 7, 3)
    edits: LeafEdits


def check_leaf_shape(stage: Usd.Stage, _time: object) -> Findings:
    """The edits leave the silhouettes in order, no leaf folds over itself, and the extents contain what is drawn.

    It looks at a whole stage, for leaves as patches are quick to look at together and slow one by one.
    """
    first = next(_with_leaves(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())), None)
    if first is None:
        return []
    try:
        from usdfoliage.asset.validation.instances import iterate_prims
        from usdfoliage.leaf.shape.fold import find_folds
    except ImportError as missing:
        text = f"was not looked at as it is drawn: {missing}; install usdfoliage for the Python of this USD"
        return [warning(first, "LeafShapeNotChecked", text)]
    # The other validators report what is wrong with the arrays or the edits.
    drawn = [
        leaves
        for leaves in map(_read_drawn_leaves, _with_leaves(iterate_prims(stage)))
        if leaves is not None and len(leaves.plain)
    ]
    findings: Findings = []
    patches = []
    for leaves in drawn:
        findings += _check_edited_silhouettes(leaves)
        if not UsdGeom.PointInstancer(leaves.prim):
            patches.append(leaves)
            continue
        findings += _check_extents(leaves)
        folds = find_folds(leaves.edited)
        if folds.any():
            findings.append(warning(leaves.prim, "LeafFolds", FOLDS.format(which(folds, "leaves"))))
    for _, group in itertools.groupby(patches, lambda leaves: leaves.prim.GetParent().GetPath()):
        together = list(group)
        folds = find_folds(np.concatenate([leaves.edited for leaves in together]))
        if folds.any():
            names = which(folds, "patches", [leaves.prim.GetName() for leaves in together])
            findings.append(warning(together[int(np.argmax(folds))].prim, "LeafFolds", FOLDS.format(names)))
    return findings


def _with_leaves(prims: Iterable[Usd.Prim]) -> Iterator[Usd.Prim]:
    with_api = (prim for prim in prims if LEAF_API in prim.GetPrimTypeInfo().GetAppliedAPISchemas())
    return (prim for prim in with_api if not is_guide_copy(prim))


def _read_drawn_leaves(prim: Usd.Prim) -> DrawnLeaves | None:
    """None where an array or an edit is not what it must be."""
    from usdfoliage.leaf.shape.edits import apply_edits

    arrays = [values.numbers(prim, f"primvars:leaf:{name}", 3) for name in PARAMETERS]
    given = [array for array in arrays if array is not None]
    if len(given) < len(PARAMETERS) or len({len(array) for array in given}) > 1:
        return None
    if not UsdGeom.PointInstancer(prim) and len(given[0]) != 1:
        return None
    plain = np.stack(given, axis=1)
    edits = _read_edits(prim)
    if edits is None or not np.isfinite(plain).all():
        return None
    return DrawnLeaves(prim=prim, plain=plain, edited=apply_edits(plain, edits), edits=edits)


def _read_edits(prim: Usd.Prim) -> LeafEdits | None:
    from usdfoliage.leaf.shape.edits import LeafEdits

    edits: dict[str, object] = {}
    for name in VECTOR_EDITS:
        if values.is_authored(prim, f"primvars:leaf:edit:{name}"):
            vector = values.tuple_of(prim, f"primvars:leaf:edit:{name}", 3)
            if vector is None:
                return None
            edits[name] = tuple(map(float, vector))
    for name, field in NUMBER_EDITS.items():
        if values.is_authored(prim, f"primvars:leaf:edit:{name}"):
            number = values.number(prim, f"primvars:leaf:edit:{name}")
            if number is None:
                return None
            edits[field] = number
    try:
        return LeafEdits(**edits)
    except ValueError:
        return None


def _check_edited_silhouettes(leaves: DrawnLeaves) -> Findings:
    """What an edit makes of silhouettes that were in order before it."""
    prim = leaves.prim
    findings: Findings = []
    plain, edited = leaves.plain[:, SILHOUETTE], leaves.edited[:, SILHOUETTE]
    before, after = _in_order(plain[..., 0]), _in_order(edited[..., 0])
    for point in range(3):
        name = f"silhouette{point + 1}"
        if getattr(leaves.edits, name)[0] == 0:
            continue
        # The gaps to the neighbours, or to base and apex, that this point borders on.
        wrong = (before[:, point] & ~after[:, point]) | (before[:, point + 1] & ~after[:, point + 1])
        if wrong.any():
            text = (
                f"moves v of {name} out of (0, 1) or past its neighbour in {count(wrong, 'leaves')}; such a leaf may "
                "fold: move it less"
            )
            findings.append(warning(prim, "EditedSilhouetteOrder", text, f"primvars:leaf:edit:{name}"))
    for point in range(3):
        name = f"silhouette{point + 1}"
        wrong = (plain[:, point, 1] > 0) & (edited[:, point, 1] <= 0)
        if wrong.any():
            edit = name if getattr(leaves.edits, name)[1] else "width"
            text = f"takes {name} onto or past the axis in {count(wrong, 'leaves')}; such a leaf is turned inside out"
            findings.append(warning(prim, "EditedSilhouetteWidth", text, f"primvars:leaf:edit:{edit}"))
    return findings


def _in_order(v: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether base, the three silhouette points (N, 3) and apex follow each other: (N, 4), a gap each."""
    whole = np.concatenate([np.zeros((len(v), 1)), v, np.ones((len(v), 1))], axis=1)
    return np.asarray(np.diff(whole, axis=1) > 0)


def _check_extents(leaves: DrawnLeaves) -> Findings:
    """GPU culling drops what an extent does not contain."""
    from usdfoliage.errors import FoliageError
    from usdfoliage.leaf.shape.bounds import leaf_bounds

    prim = leaves.prim
    try:
        jitter = _read_jitter(leaves)
    except FoliageError as wrong:
        return [error(prim, "JitterMapUnusable", f"cannot be used: {wrong}", JITTER_MAP)]
    findings: Findings = []
    bounds = leaf_bounds(leaves.edited, jitter)
    used = values.indices(prim, "protoIndices")
    if used is None or len(used) != len(bounds):
        return findings
    for number, target in enumerate(UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets()):
        prototype, drawn = prim.GetStage().GetPrimAtPath(target), bounds[used == number]
        if not prototype or not len(drawn):
            continue
        for gprim in Usd.PrimRange(prototype):
            if UsdGeom.Gprim(gprim):
                findings += _check_extent(gprim, drawn, SLACK, "DisplacedExtent", "its leaves as displaced")
    if values.is_authored(prim, "extent"):
        placements = _placements(prim, len(bounds))
        if placements is not None:
            slack = SLACK * float(np.linalg.norm(placements[:, :, 0], axis=1).max())
            placed = leaf_bounds(leaves.edited, jitter, placements=placements)
            findings += _check_extent(prim, placed, slack, "LeavesExtent", "its leaves")
    return findings


def _read_jitter(leaves: DrawnLeaves) -> Jitter:
    """FoliageError where the map cannot be used; one that is missing LeafEdits reports."""
    from usdfoliage.leaf.shape.jitter import Jitter

    jitter_map = None
    asset = values.asset_path(leaves.prim, JITTER_MAP)
    if asset is not None and asset.resolvedPath:
        from usdfoliage.asset.materials.jitter_map import read_jitter_map

        jitter_map = read_jitter_map(Path(asset.resolvedPath))
    edits = leaves.edits
    return Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency, map=jitter_map)


def _check_extent(prim: Usd.Prim, bounds: NDArray[np.float64], slack: float, name: str, what: str) -> Findings:
    extent = values.numbers(prim, "extent", 3) if values.is_authored(prim, "extent") else None
    if extent is None or len(extent) != 2:
        return []  # LeafPrototype reports it
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    if (low >= extent[0] - slack).all() and (high <= extent[1] + slack).all():
        return []
    needed, authored = (" to ".join(_corner(corner) for corner in corners) for corners in ((low, high), extent))
    text = f"is {authored} and does not contain {what}, {needed}, so that they may be culled; author {needed}"
    return [error(prim, name, text, "extent")]


def _placements(prim: Usd.Prim, leaves: int) -> NDArray[np.float64] | None:
    """(N, 3, 4), where each leaf is; None where an array is not what it must be."""
    from usdfoliage.leaf.model import Leaves

    positions, scales = values.numbers(prim, "positions", 3), values.numbers(prim, "scales", 3)
    turns = values.numbers(prim, "orientationsf", 4)
    arrays = (positions, scales, turns)
    if any(array is None or len(array) != leaves or not np.isfinite(array).all() for array in arrays):
        return None
    placed = Leaves(
        parameters=np.zeros((leaves, 7, 3)),
        base_m=positions,
        orientation=turns,
        length_m=scales[:, 0],
        phase=np.zeros(leaves),
    )
    return placed.asset_from_leaf()


def _corner(corner: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in corner) + ")"
