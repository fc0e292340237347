"""Extents in a look: edited leaves may reach beyond the asset's extents, and renderers cull what lies outside."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd

from usdfoliage.asset.look_layer import widen_extents
from usdfoliage.asset.parts.leaves import ReadLeaves
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter


def author_wider_extents(
    stage: Usd.Stage,
    path: Sdf.Path,
    plant: Usd.Prim,
    instancer: Usd.Prim,
    read: ReadLeaves,
    edits: LeafEdits,
    jitter_map: NDArray[np.float64] | None,
) -> None:
    """Author the extents that edited leaves outgrow (usdfoliage.asset.look_layer.widen_extents), as wide as they are.

    Args:
        stage: Of the look.
        path: What stands in the look for the plant.
        plant: Of the asset, composed.
        instancer: Its leaves.
        read: What the asset has of them.
        edits: What the look makes of its edits.
        jitter_map: (M,), None for procedural jitter.
    """
    if not len(read.leaves):
        return
    jitter = Jitter(amplitude=edits.jitter_amplitude, frequency=edits.jitter_frequency, map=jitter_map)
    edited = apply_edits(read.leaves.parameters, edits)
    in_leaf_space = common_bounds(edited, jitter)
    among_leaves = leaf_bounds_m(replace(read.leaves, parameters=edited), jitter)
    widen_extents(stage, path, plant, instancer, _range(in_leaf_space), _range(among_leaves))


def extents_hold(
    plant: Usd.Prim, instancer: Usd.Prim, read: ReadLeaves, jitter_map: NDArray[np.float64] | None
) -> bool:
    """Whether the extents that a composed plant has hold its leaves as its edits make them.

    Args:
        plant: Composed, with whatever edits it.
        instancer: Its leaves.
        read: What there is of them, with their edits.
        jitter_map: (M,), None for procedural jitter.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    author_wider_extents(Usd.Stage.Open(layer), plant.GetPath(), plant, instancer, read, read.edits, jitter_map)
    return not layer.rootPrims


def _range(bounds: NDArray[np.float64]) -> Gf.Range3d:
    return Gf.Range3d(Gf.Vec3d(*bounds[0].tolist()), Gf.Vec3d(*bounds[1].tolist()))
