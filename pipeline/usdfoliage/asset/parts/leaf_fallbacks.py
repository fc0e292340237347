"""Leaves for applications without our shader: patches, one subdivision surface, or one mesh of all leaves."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import author_scopes, bind_material, export_layer, new_layer
from usdfoliage.asset.materials.layer import LEAF_MATERIAL
from usdfoliage.asset.parts.hero_leaf import author_hero_leaf, patch_matrices, patch_nets
from usdfoliage.asset.parts.leaf_gprims import (
    author_leaf_colors,
    author_leaf_gprim,
    author_leaf_mesh,
    author_st,
)
from usdfoliage.asset.parts.leaf_primvars import leaf_arrays, usd_array
from usdfoliage.asset.plant import LEAVES
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.cage import LeafCage
from usdfoliage.leaf.shape.jitter import Jitter
from usdfoliage.leaf.shape.mesh import LeafMesh

Color = tuple[float, float, float]
Extent = NDArray[np.float64]  # (2, 3), smallest and largest corner

_PATCHES = (
    "Every leaf as an exact NURBS patch, in the order of the instancer. A jitter of the silhouettes is carried only "
    "approximately: of its waves a patch has what its few control points can follow."
)
_CAGE = (
    "Every leaf as a Catmull-Clark surface, within 0.5 % of its length. A jitter of the silhouettes is carried only "
    "approximately: of its waves the surface has what the points of its cage can follow."
)
_MESH = "Every leaf as polygons; a jitter of the silhouettes is in the points."


def write_patches_layer(
    path: Path, name: str, leaves: Leaves, jitter: Jitter, color: Color, jitter_map: str = ""
) -> Extent:
    """Write the leaves as a Scope of patches at /name/geo/render/Leaves; returns the bounds that USD computes of it.

    Args:
        leaves: With the edits applied.
        jitter_map: As seen from path's folder.
    """
    stage = new_layer(path, name)
    scope = UsdGeom.Scope.Define(stage, _define_above(stage, name)).GetPrim()
    scope.SetDocumentation(_PATCHES)
    author_patches(stage, scope.GetPath(), leaves, jitter, color, jitter_map, Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    export_layer(stage, path)
    return _bounds(scope)


def author_patches(
    stage: Usd.Stage,
    path: Sdf.Path,
    leaves: Leaves,
    jitter: Jitter,
    color: Color,
    jitter_map: str,
    material: Sdf.Path,
) -> None:
    """Define one hero leaf a leaf below path, at patch_paths."""
    if not len(leaves):
        return
    paths = patch_paths(path, len(leaves))
    author_hero_leaf(stage, paths[0], leaves, 0, color=color, jitter=jitter, jitter_map=jitter_map)
    bind_material(stage, paths[0], material)

    # The others are copies of the first in which the numbers of the leaf are changed: the same, but ten times as fast.
    nets = patch_nets(leaves, jitter)
    extents = np.stack([nets.min(axis=1), nets.max(axis=1)], axis=1)
    places = patch_matrices(leaves)
    arrays = {f"primvars:{name}": array for name, array in leaf_arrays(leaves).items()}
    layer, first = stage.GetEditTarget().GetLayer(), paths[0]
    with Sdf.ChangeBlock():
        for number in range(1, len(leaves)):
            Sdf.CopySpec(layer, first, layer, paths[number])
            attributes = layer.GetPrimAtPath(paths[number]).attributes
            attributes["points"].default = Vt.Vec3fArray.FromNumpy(nets[number])
            attributes["extent"].default = Vt.Vec3fArray.FromNumpy(extents[number])
            attributes["xformOp:transform"].default = places[number]
            for name, array in arrays.items():
                attributes[name].default = usd_array(array[number : number + 1])


def patch_paths(path: Sdf.Path, count: int) -> list[Sdf.Path]:
    """Paths of so many patches below path: leaf_0, leaf_1, with as many digits as the last one needs."""
    digits = len(str(count - 1))
    return [path.AppendChild(f"leaf_{number:0{digits}}") for number in range(count)]


def write_cage_layer(path: Path, name: str, cage: LeafCage, of: Leaves, color: Color) -> Extent:
    """Write the cage of leaves as one subdivision surface at /name/geo/render/Leaves; returns its bounds."""
    stage = new_layer(path, name)
    leaves = _define_above(stage, name)
    if len(of):
        mesh = author_cage(stage, leaves, cage, len(of), color)
        if of.color is not None:
            author_leaf_colors(mesh, of.color, len(cage.face_counts))
        bind_material(stage, leaves, Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    return _finish_surface(stage, leaves, path, _CAGE)


def author_cage(stage: Usd.Stage, path: Sdf.Path, cage: LeafCage, count: int, color: Color) -> UsdGeom.Mesh:
    """Define the control mesh of a Catmull-Clark surface of count leaves at path."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(cage.points_m)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(cage.face_counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(cage.face_vertices))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    mesh.CreateInterpolateBoundaryAttr(UsdGeom.Tokens.edgeAndCorner)
    mesh.CreateCreaseIndicesAttr(Vt.IntArray.FromNumpy(cage.crease_indices))
    mesh.CreateCreaseLengthsAttr(Vt.IntArray.FromNumpy(cage.crease_lengths))
    mesh.CreateCreaseSharpnessesAttr(Vt.FloatArray.FromNumpy(cage.crease_sharpnesses))
    mesh.CreateCornerIndicesAttr(Vt.IntArray.FromNumpy(cage.corner_indices))
    mesh.CreateCornerSharpnessesAttr(Vt.FloatArray.FromNumpy(cage.corner_sharpnesses))
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    author_st(mesh, cage.st, count)
    author_leaf_gprim(mesh, color)
    return mesh


def write_mesh_layer(path: Path, name: str, surface: LeafMesh, of: Leaves, color: Color) -> Extent:
    """Write the surface of leaves as one mesh at /name/geo/render/Leaves; returns its bounds."""
    stage = new_layer(path, name)
    leaves = _define_above(stage, name)
    if len(of):
        mesh = author_leaf_mesh(stage, leaves, surface, color, count=len(of))
        if of.color is not None:
            author_leaf_colors(mesh, of.color, len(surface.face_counts))
        bind_material(stage, leaves, Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    return _finish_surface(stage, leaves, path, _MESH)


def _define_above(stage: Usd.Stage, name: str) -> Sdf.Path:
    """The path of the leaves, with the Scopes above it defined."""
    leaves = Sdf.Path(f"/{name}/{LEAVES}")
    author_scopes(stage, leaves.GetParentPath())
    return leaves


def _finish_surface(stage: Usd.Stage, leaves: Sdf.Path, path: Path, documentation: str) -> Extent:
    """Document and export; a Scope stands for the surface of no leaves, since a mesh without points is none."""
    prim = stage.GetPrimAtPath(leaves) or UsdGeom.Scope.Define(stage, leaves).GetPrim()
    prim.SetDocumentation(documentation)
    export_layer(stage, path)
    return _bounds(prim)


def _bounds(prim: Usd.Prim) -> Extent:
    """What USD takes for the bounds: those of turned boxes are wider than those of what is in them."""
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    bounds = cache.ComputeWorldBound(prim).ComputeAlignedRange()
    return np.zeros((2, 3)) if bounds.IsEmpty() else np.array([bounds.GetMin(), bounds.GetMax()])
