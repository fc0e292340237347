"""Extents in a look: edited leaves may reach further than the asset says, and what an extent lacks is culled."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom

from usdfoliage.asset.leaf_gprims import outward_corners
from usdfoliage.asset.leaves import ReadLeaves, with_margin
from usdfoliage.leaf.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.edits import LeafEdits, apply_edits
from usdfoliage.leaf.jitter import Jitter

_SHOWN = 2  # of extentsHint's pairs of corners, a pair a purpose: the first two, default and render, may hold leaves
_SLACK = 1e-5  # of the size: what edits and parameters lose as float32


def author_wider_extents(
    stage: Usd.Stage,
    path: Sdf.Path,
    plant: Usd.Prim,
    instancer: Usd.Prim,
    held: ReadLeaves,
    edits: LeafEdits,
    jitter_map: NDArray[np.float64] | None,
) -> None:
    """Author the extents that edited leaves outgrow: of the prototypes, of the instancer, of the plant.

    None becomes smaller than the asset has it, for a renderer without our shader draws leaves without the edits. Those
    of the prototypes get the margin that the asset gives them, for other looks may act besides this one.

    Args:
        stage: Of the look.
        path: What stands in the look for the plant.
        plant: Of the asset, composed.
        instancer: Its leaves.
        held: What the asset has of them.
        edits: What the look makes of its edits.
        jitter_map: (M,), None for procedural jitter.
    """
    if not len(held.leaves):
        return
    jitter = Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency, map=jitter_map)
    edited = apply_edits(held.leaves.parameters, edits)
    in_leaf_space = common_bounds(edited, jitter)
    for target in UsdGeom.PointInstancer(instancer).GetPrototypesRel().GetForwardedTargets():
        prototype = instancer.GetStage().GetPrimAtPath(target)
        for gprim in Usd.PrimRange(prototype) if prototype else ():
            if UsdGeom.Gprim(gprim):
                _widen(stage, path, plant, UsdGeom.Gprim(gprim), in_leaf_space, with_margin(in_leaf_space))

    bounds_m = leaf_bounds_m(replace(held.leaves, parameters=edited), jitter)
    _widen(stage, path, plant, UsdGeom.Boundable(instancer), bounds_m, bounds_m)
    matrix, _ = UsdGeom.XformCache().ComputeRelativeTransform(instancer, plant)
    placed = Gf.BBox3d(Gf.Range3d(Gf.Vec3d(*bounds_m[0]), Gf.Vec3d(*bounds_m[1])), matrix).ComputeAlignedRange()
    _widen_hint(stage, path, plant, np.array([placed.min, placed.max]))


def _widen(
    stage: Usd.Stage,
    path: Sdf.Path,
    plant: Usd.Prim,
    boundable: UsdGeom.Boundable,
    needed: NDArray[np.float64],
    wanted: NDArray[np.float64],
) -> None:
    """Where the extent does not hold what is needed, author one that holds what is wanted."""
    extent = np.asarray(boundable.GetExtentAttr().Get() or needed, np.float64)
    if _contains(extent, needed):
        return
    over = stage.OverridePrim(boundable.GetPath().ReplacePrefix(plant.GetPath(), path))
    UsdGeom.Boundable(over).CreateExtentAttr(outward_corners(_union(extent, wanted)))


def _widen_hint(stage: Usd.Stage, path: Sdf.Path, plant: Usd.Prim, needed: NDArray[np.float64]) -> None:
    attribute = UsdGeom.ModelAPI(plant).GetExtentsHintAttr()
    hint = np.asarray(attribute.Get() if attribute and attribute.HasAuthoredValue() else (), np.float64)
    pairs = hint.reshape(-1, 2, 3)
    wider = [
        outward_corners(_union(pair, needed)) if number < _SHOWN and (pair[0] <= pair[1]).all() else _exactly(pair)
        for number, pair in enumerate(pairs)
    ]
    if all((pair[0] > pair[1]).any() or _contains(pair, needed) for pair in pairs[:_SHOWN]):
        return
    over = stage.OverridePrim(path)
    attribute = over.CreateAttribute("extentsHint", Sdf.ValueTypeNames.Float3Array, custom=False)
    attribute.Set([corner for pair in wider for corner in pair])


def _contains(extent: NDArray[np.float64], needed: NDArray[np.float64]) -> bool:
    slack = _SLACK * float(np.ptp(needed, axis=0).max())
    return bool((extent[0] <= needed[0] + slack).all() and (extent[1] >= needed[1] - slack).all())


def _union(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.minimum(first[0], second[0]), np.maximum(first[1], second[1])])


def _exactly(extent: NDArray[np.float64]) -> list[Gf.Vec3f]:
    return [Gf.Vec3f(*map(float, corner)) for corner in extent]
