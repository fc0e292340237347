"""One leaf as a NurbsPatch that a modeller can pull at, and back."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.materials.jitter_map import read_jitter_map
from usdfoliage.asset.materials.leaf import LEAF_COLOR
from usdfoliage.asset.parts.leaf_gprims import author_leaf_gprim, author_st
from usdfoliage.asset.parts.leaf_primvars import (
    author_edits,
    author_jitter_map,
    author_leaf_primvars,
    place,
    read_array,
    read_edits,
    read_jitter_map_path,
    read_leaf_primvars,
)
from usdfoliage.asset.parts.leaves import ReadLeaves, check_leaves
from usdfoliage.asset.schema import LEAF_API
from usdfoliage.errors import AssetError
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.jittered_net import jittered_nets
from usdfoliage.leaf.shape.nurbs import SHAPE, U_KNOTS, U_ORDER, V_KNOTS, V_ORDER, fit_leaf
from usdfoliage.leaf.shape.surface import grid_places, leaf_nets

V_COUNT, U_COUNT = SHAPE[:2]  # control points along and across
# Where the control points lie in (s, t): u and v, which run straight through them.
_NET_ST = grid_places(np.linspace(0, 1, U_COUNT), np.linspace(0, 1, V_COUNT)).astype(np.float32)
_UNCHANGED = 1e-6  # leaf lengths; float32 keeps 1e-7
_RIGID = 1e-6  # how far a matrix may be from a turn with one scale for all axes, of its scale


def author_hero_leaf(
    stage: Usd.Stage,
    path: Sdf.Path,
    leaves: Leaves,
    index: int,
    *,
    color: tuple[float, float, float] = LEAF_COLOR,
    jitter: Jitter = NO_JITTER,
    jitter_map: str = "",
) -> UsdGeom.NurbsPatch:
    """Define one of leaves at path: control points in leaf space, FoliageLeafAPI, and where it is as its own matrix.

    Args:
        leaves: With the edits applied.
        index: Which of them.
        jitter: A patch of so few control points has only the slow part of it, see patch_nets.
        jitter_map: The jitter's map as seen from the layer's folder.
    """
    leaf = leaves.take([index])
    check_leaves(leaf)
    patch = UsdGeom.NurbsPatch.Define(stage, path)
    net = patch_nets(leaf, jitter)[0]
    patch.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(net))
    patch.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([net.min(axis=0), net.max(axis=0)])))
    patch.CreateUVertexCountAttr(U_COUNT)
    patch.CreateVVertexCountAttr(V_COUNT)
    patch.CreateUOrderAttr(U_ORDER)
    patch.CreateVOrderAttr(V_ORDER)
    patch.CreateUKnotsAttr(Vt.DoubleArray.FromNumpy(np.array(U_KNOTS, np.float64)))
    patch.CreateVKnotsAttr(Vt.DoubleArray.FromNumpy(np.array(V_KNOTS, np.float64)))
    patch.CreateURangeAttr(Gf.Vec2d(-1, 1))
    patch.CreateVRangeAttr(Gf.Vec2d(0, 1))
    patch.CreateUFormAttr(UsdGeom.Tokens.open)
    patch.CreateVFormAttr(UsdGeom.Tokens.open)
    author_st(patch, _NET_ST, 1)
    author_leaf_gprim(patch, color)
    patch.MakeMatrixXform().Set(patch_matrices(leaf)[0])

    prim = patch.GetPrim()
    prim.AddAppliedSchema(LEAF_API)
    author_leaf_primvars(prim, leaf, UsdGeom.Tokens.constant)
    if jitter.amplitude:
        author_edits(prim, replace(NEUTRAL, jitter_amplitude=jitter.amplitude, jitter_frequency=jitter.frequency))
        if jitter_map:
            author_jitter_map(prim, jitter_map)
    return patch


def patch_nets(leaves: Leaves, jitter: Jitter = NO_JITTER) -> NDArray[np.float32]:
    """Control points (N, 35, 3) of the leaves in leaf space, row after row from base to apex.

    Exact but for the jitter, see jittered_nets.
    """
    # From what the primvars hold.
    nets = jittered_nets(np.asarray(leaves.parameters, np.float32), jitter, np.asarray(leaves.phase, np.float32))
    return nets.reshape(len(leaves), -1, 3).astype(np.float32)


def patch_matrices(leaves: Leaves) -> Vt.Matrix4dArray:
    """Where each leaf is, from the float32 numbers that an instancer holds of it."""
    stored = replace(
        leaves,
        base_m=np.asarray(leaves.base_m, np.float32),
        length_m=np.asarray(leaves.length_m, np.float32),
        orientation=np.asarray(leaves.orientation, np.float32),
    )
    matrices = np.zeros((len(leaves), 4, 4))
    matrices[:, :, :3] = np.moveaxis(stored.asset_from_leaf(), 1, 2)  # USD multiplies row vectors from the left
    matrices[:, 3, 3] = 1
    return Vt.Matrix4dArray.FromNumpy(matrices)


def read_hero_leaf(prim: Usd.Prim) -> ReadLeaves:
    """The leaf of a patch, its place counted from the patch's parent.

    While the control points are those that were written, the parameters are too; once a modeller has moved some, they
    are those of the leaf that is nearest to the patch, and residual_m is its distance.

    Raises:
        AssetError: The prim is no patch of a leaf or has lost its parameters, its control points are of another
            number, or a number is not finite.
        FitError: The patch is so far from any leaf that none can be fitted.
    """
    patch = UsdGeom.NurbsPatch(prim)
    if not patch or LEAF_API not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        what = f"a {prim.GetTypeName() or 'prim without type'} ({place(prim)})" if prim else "no prim"
        raise AssetError(f"no hero leaf: {what} where a NurbsPatch with {LEAF_API} is needed")
    vertex_counts = (patch.GetUVertexCountAttr().Get(), patch.GetVVertexCountAttr().Get())
    if vertex_counts != (U_COUNT, V_COUNT):
        raise AssetError(
            f"the patch has {vertex_counts[0]} × {vertex_counts[1]} control points where a leaf has "
            f"{U_COUNT} × {V_COUNT} ({place(prim)})",
            "rebuild it with these, of degree 3 across and 4 along",
        )
    points = read_array(prim, "points", (U_COUNT * V_COUNT, 3))
    matrix = np.array(UsdGeom.Xformable(prim).GetLocalTransformation())
    edits, jitter_map = read_edits(prim), read_jitter_map_path(prim)
    jitter = Jitter(
        amplitude=edits.jitter_amplitude,
        frequency=edits.jitter_frequency,
        map=None if jitter_map is None else read_jitter_map(jitter_map),
    )
    written = Leaves(
        base_m=matrix[None, 3, :3],
        orientation=np.array([[0.0, 0.0, 0.0, 1.0]]),
        length_m=np.ones(1),
        **read_leaf_primvars(prim, 1),
    )
    length = np.cbrt(np.linalg.det(matrix[:3, :3]))
    rigid = length > 0 and np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, length**2 * np.eye(3), 0, _RIGID * length**2)
    if rigid and np.allclose(points, patch_nets(written, jitter)[0], 0, _UNCHANGED):
        turn = Gf.Matrix3d((matrix[:3, :3] / length).tolist()).ExtractRotation().GetQuat()
        orientation = np.array([[*turn.GetImaginary(), turn.GetReal()]])
        leaf = replace(written, orientation=orientation, length_m=np.array([length]))
    else:
        waves = jittered_nets(written.parameters, jitter, written.phase) - leaf_nets(written.parameters)
        smooth = points.reshape(V_COUNT, U_COUNT, 3) - waves[0]
        fitted = fit_leaf(smooth @ matrix[:3, :3] + matrix[3, :3])
        leaf = replace(
            written,
            parameters=fitted.parameters[None],
            base_m=fitted.base_m[None],
            orientation=fitted.orientation[None],
            length_m=np.array([fitted.length_m]),
            residual_m=np.array([fitted.residual_m]),
        )
    return ReadLeaves(leaves=leaf, edits=edits, jitter_map=jitter_map)
