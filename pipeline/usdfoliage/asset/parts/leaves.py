"""Leaves in USD: one PointInstancer with FoliageLeafAPI, and back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import author_scopes, bind_material, export_layer, new_layer
from usdfoliage.asset.look_layer import PROTOTYPE_MARGIN
from usdfoliage.asset.materials.layer import LEAF_MATERIAL
from usdfoliage.asset.materials.leaf import author_packed_leaves
from usdfoliage.asset.parts.instancers import author_turns
from usdfoliage.asset.parts.leaf_gprims import author_leaf_mesh, outward_corners
from usdfoliage.asset.parts.leaf_primvars import (
    author_edits,
    author_jitter_map,
    author_leaf_primvars,
    place,
    read_array,
    read_edits,
    read_jitter_map_path,
    read_leaf_primvars,
    time_of,
)
from usdfoliage.asset.plant import LEAVES, LEAVES_GUIDE
from usdfoliage.asset.schema import LEAF_API
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves, mean_leaf, unit_quaternions
from usdfoliage.leaf.shape.bounds import common_bounds, leaf_bounds_m
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import LeafMesh, PrototypeSettings, build_prototype
from usdfoliage.leaf.shape.variation import default_leaf

PROTOTYPE = "Prototypes/Leaf"  # below the instancer
PLACE = ("base_m", "length_m", "orientation")  # fields of Leaves: where a leaf is


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesPrim:
    """All that is authored of leaves in the representation bezier."""

    leaves: Leaves
    prototype: LeafMesh  # what a renderer without our shader shows in place of every leaf, in leaf space
    prototype_extent: NDArray[np.float64]  # (2, 3), of all leaves as they are drawn, with a margin, in leaf space
    extent_m: NDArray[np.float64]  # (2, 3), of the same, in the asset's frame
    color: tuple[float, float, float]  # linear Rec.709
    edits: LeafEdits = NEUTRAL
    jitter_map: str = ""  # as seen from the layer's folder


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadLeaves:
    """Leaves as an asset has them; the edits are not applied."""

    leaves: Leaves
    edits: LeafEdits
    jitter_map: Path | None


def leaves_prim(
    leaves: Leaves,
    edits: LeafEdits,
    jitter: Jitter,
    color: tuple[float, float, float],
    jitter_map: str,
    settings: PrototypeSettings,
) -> LeavesPrim:
    """What the layer payload/leaves.usdc holds: the leaves as they are, with bounds of them as they are drawn.

    Args:
        leaves: Before the edits.
        jitter: Of the edits, with the map in jitter_map.
    """
    check_leaves(leaves)
    prototype = build_prototype(mean_leaf(leaves.parameters) if len(leaves) else default_leaf(), settings)
    drawn = edited_leaves(leaves, edits)
    low, high = common_bounds(drawn.parameters, jitter)
    points = prototype.points_m
    extent = np.stack([np.minimum(points.min(axis=0), low), np.maximum(points.max(axis=0), high)])
    return LeavesPrim(
        leaves=leaves,
        prototype=prototype,
        prototype_extent=with_margin(extent),
        extent_m=leaf_bounds_m(drawn, jitter),
        color=color,
        edits=edits,
        jitter_map=jitter_map,
    )


def with_margin(extent: NDArray[np.floating]) -> NDArray[np.float64]:
    """What a prototype's extent must hold, (2, 3), so that leaves within extent (2, 3) are drawn under more edits."""
    return np.stack([extent[0] - PROTOTYPE_MARGIN, extent[1] + PROTOTYPE_MARGIN]).astype(np.float64)


def edited_leaves(leaves: Leaves, edits: LeafEdits) -> Leaves:
    """The leaves that a renderer shows of those that author_leaves writes: their float32 parameters, edited."""
    return replace(leaves, parameters=apply_edits(np.asarray(leaves.parameters, np.float32), edits))


def author_leaves(stage: Usd.Stage, path: Sdf.Path, prim: LeavesPrim) -> UsdGeom.PointInstancer:
    """Define the leaves at path, and the prototype below it.

    Raises:
        ValueError: A number is not finite, a length not above 0, or a quaternion has length 0.
    """
    leaves = prim.leaves
    check_leaves(leaves)
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    set_places(instancer, leaves)
    instancer.CreateProtoIndicesAttr(Vt.IntArray(len(leaves), 0))
    instancer.CreateExtentAttr(outward_corners(prim.extent_m))

    prototype = path.AppendPath(PROTOTYPE)
    UsdGeom.Scope.Define(stage, prototype.GetParentPath())
    author_leaf_mesh(stage, prototype, prim.prototype, prim.color, extent=prim.prototype_extent)
    instancer.CreatePrototypesRel().SetTargets([prototype])

    instancer.GetPrim().AddAppliedSchema(LEAF_API)
    author_leaf_primvars(instancer.GetPrim(), leaves, UsdGeom.Tokens.varying)
    author_packed_leaves(instancer, leaves)
    author_edits(instancer.GetPrim(), prim.edits)
    if prim.jitter_map:
        author_jitter_map(instancer.GetPrim(), prim.jitter_map)
    return instancer


def set_places(
    instancer: UsdGeom.PointInstancer,
    leaves: Leaves,
    fields: Sequence[str] = PLACE,
    time: Usd.TimeCode | float = Usd.TimeCode.Default(),
) -> None:
    """Author where leaves are, at a time; fields are those of PLACE that are authored."""
    if "base_m" in fields:
        positions = np.ascontiguousarray(leaves.base_m, np.float32)
        instancer.CreatePositionsAttr().Set(Vt.Vec3fArray.FromNumpy(positions), time)
    if "length_m" in fields:
        scales = np.repeat(np.asarray(leaves.length_m, np.float32)[:, None], 3, axis=1)
        instancer.CreateScalesAttr().Set(Vt.Vec3fArray.FromNumpy(scales), time)
    if "orientation" in fields:
        author_turns(instancer, unit_quaternions(leaves.orientation), time)


def write_leaves_layer(path: Path, name: str, prim: LeavesPrim) -> NDArray[np.float64]:
    """Write the leaves alone: a layer with the instancer at /name/geo/render/Leaves; returns its bounds (2, 3)."""
    stage = new_layer(path, name)
    leaves = Sdf.Path(f"/{name}/{LEAVES}")
    author_scopes(stage, leaves.GetParentPath())
    author_leaves(stage, leaves, prim)
    bind_material(stage, leaves.AppendPath(PROTOTYPE), Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    export_layer(stage, path)
    return prim.extent_m


def write_leaves_guide_layer(path: Path, name: str, leaves: str) -> None:
    """Write a layer that keeps the leaves of the layer at leaves as a guide, where another representation is shown.

    Their parameters then stay in the asset whatever is selected: a shot that is flattened with meshes can be edited
    again, and the guide shows what the fallback stands for. It brings the whole layer, since the binding of a part
    of it leads out of that part. It is made anew, to the plant's own material: a guide has no materials of its own.
    """
    stage = new_layer(path, name)
    guide = Sdf.Path(f"/{name}/{LEAVES_GUIDE}")
    author_scopes(stage, guide.GetParentPath())
    UsdGeom.Imageable(stage.GetPrimAtPath(guide.GetParentPath())).CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim = UsdGeom.Xform.Define(stage, guide).GetPrim()
    prim.SetDocumentation("The leaves with their parameters, as the representation bezier has them before any look.")
    prim.GetReferences().AddReference(leaves)
    bind_material(stage, guide.AppendPath(f"{LEAVES}/{PROTOTYPE}"), Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    export_layer(stage, path)


def read_leaves(prim: Usd.Prim) -> ReadLeaves:
    """The leaves of an instancer that author_leaves wrote, with the opinions of stronger layers.

    Leaves that are hidden by their number (inactiveIds, invisibleIds) are left out.

    Raises:
        AssetError: The prim is no instancer of leaves, an array is missing, of another length than the others or not
            finite, a scale is not above 0 or not the same for all axes, or the map of the jitter is missing.
    """
    instancer = UsdGeom.PointInstancer(prim)
    if not instancer or LEAF_API not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        what = f"a {prim.GetTypeName() or 'prim without type'}" if prim else "no prim"
        raise AssetError(
            f"no leaves: {what} where a PointInstancer with {LEAF_API} is needed{f' ({place(prim)})' if prim else ''}",
            "choose the representation bezier",
        )
    time = time_of(instancer.GetPositionsAttr())
    positions = instancer.GetPositionsAttr().Get(time)
    count = 0 if positions is None else len(positions)
    base_m = read_array(prim, "positions", (count, 3))
    scales = read_array(prim, "scales", (count, 3))
    uneven = (np.ptp(scales, axis=1) > 1e-5 * np.abs(scales).max(axis=1)) | (scales <= 0).any(axis=1)
    if uneven.any():
        raise AssetError(
            f"scales is not above 0 and the same for all axes in {np.count_nonzero(uneven)} of {count} leaves, the "
            f"first is leaf {np.flatnonzero(uneven)[0]} ({place(prim)}); a scale is the leaf's length in metres"
        )
    # An application that knows only the older attribute may have written that alone.
    exact = prim.GetAttribute("orientationsf").HasAuthoredValue()
    leaves = Leaves(
        base_m=base_m,
        length_m=scales[:, 0],
        orientation=read_array(prim, "orientationsf" if exact else "orientations", (count, 4)),
        **read_leaf_primvars(prim, count),
    )
    visible = instancer.ComputeMaskAtTime(time)
    return ReadLeaves(
        leaves=leaves.take(np.array(visible, bool)) if len(visible) else leaves,
        edits=read_edits(prim),
        jitter_map=read_jitter_map_path(prim),
    )


def check_leaves(leaves: Leaves) -> None:
    """ValueError unless every number is finite, every length above 0 and every orientation a rotation."""
    for name, array in (
        ("parameters", leaves.parameters),
        ("base_m", leaves.base_m),
        ("orientation", leaves.orientation),
        ("length_m", leaves.length_m),
        ("phase", leaves.phase),
        ("color", leaves.color),
        ("confidence", leaves.confidence),
        ("residual_m", leaves.residual_m),
    ):
        if array is not None and not np.isfinite(array).all():
            wrong = np.count_nonzero(~np.isfinite(array).reshape(len(leaves), -1).all(axis=1))
            raise ValueError(f"{name} is not finite in {wrong} of {len(leaves)} leaves")
    if (leaves.length_m <= 0).any():
        raise ValueError(f"length_m must be above 0, not {leaves.length_m.min():g}")
    nothing = ~np.any(leaves.orientation, axis=1)
    if nothing.any():
        raise ValueError(f"{np.count_nonzero(nothing)} of {len(leaves)} orientations are (0, 0, 0, 0)")
