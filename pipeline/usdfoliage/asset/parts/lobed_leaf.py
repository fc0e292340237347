"""A leaf of several lobes as one Mesh, with the numbers that it is made of: FoliageLobedLeafAPI."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import author_scopes, bind_material, export_layer, new_layer
from usdfoliage.asset.materials.layer import LEAF_MATERIAL, copy_shaders
from usdfoliage.asset.materials.leaf import LEAF_COLOR, LEAF_SHADERS, LeafMaterial, author_leaf_material
from usdfoliage.asset.materials.texels import write_texels
from usdfoliage.asset.parts.leaf_gprims import author_leaf_gprim, author_st
from usdfoliage.asset.parts.part import MAPS, SHADERS, AssetPlace, Box, Part
from usdfoliage.asset.parts.terrain import vertex_normals
from usdfoliage.asset.plant import LEAVES, TO_LEAVES
from usdfoliage.asset.schema import LOBED_LEAF_API
from usdfoliage.leaf.lobed.deformation import FUNCTIONS, BranchFunctions
from usdfoliage.leaf.lobed.placed import LobedLeaf
from usdfoliage.leaf.lobed.turtle import ties_to_turtle

LOBED_LEAF_LAYER = "lobed_leaf.usdc"
MIDRIB_SHARPNESS = 2.0  # of the crease along the axis of a subdivision surface
SILHOUETTE_DEGREE = 3

_DOCUMENTATION = (
    "A leaf of several lobes. Its points are the nodes of the skeleton and then the ends of the railroad ties, as the "
    "functions turn, bend and twist deform them."
)


@dataclass(frozen=True, kw_only=True)
class LobedAssetSettings:
    """How the asset of a lobed leaf is written."""

    subdivision: bool = False  # a subdivision surface, with the midrib as a crease; else polygons
    version: str = "1"  # assetInfo


def author_lobed_leaf(stage: Usd.Stage, path: Sdf.Path, leaf: LobedLeaf, *, subdivision: bool = False) -> UsdGeom.Mesh:
    """Define a lobed leaf at path, in the current edit target.

    Args:
        stage: In metres.
        path: Of the mesh.
        leaf: What to define.
        subdivision: Whether the faces are the cage of a subdivision surface.
    """
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.GetPrim().SetDocumentation(_DOCUMENTATION)
    faces = leaf.shape.faces.astype(np.int32)
    points_m = leaf.points_m()
    points = Vt.Vec3fArray.FromNumpy(points_m.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.ravel()))
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    if subdivision:
        midrib = np.flatnonzero(leaf.shape.branches == 0).astype(np.int32)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
        mesh.CreateInterpolateBoundaryAttr(UsdGeom.Tokens.edgeAndCorner)
        mesh.CreateCreaseIndicesAttr(Vt.IntArray.FromNumpy(midrib))
        mesh.CreateCreaseLengthsAttr([len(midrib)])
        mesh.CreateCreaseSharpnessesAttr([MIDRIB_SHARPNESS])
    else:
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(vertex_normals(points_m, faces).astype(np.float32)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    author_leaf_gprim(mesh, LEAF_COLOR)
    author_st(mesh, leaf.st.astype(np.float32), 1)
    author_lobed_numbers(mesh.GetPrim(), leaf)
    return mesh


def author_lobed_numbers(prim: Usd.Prim, leaf: LobedLeaf) -> None:
    """Apply FoliageLobedLeafAPI to a prim, with all that it has of a leaf."""
    prim.AddAppliedSchema(LOBED_LEAF_API)
    shape, turtle = leaf.shape, ties_to_turtle(leaf.shape)
    types = Sdf.ValueTypeNames
    numbers = (
        ("silhouettePoints", types.Point3fArray, _in_space(leaf.silhouette_m)),
        ("silhouetteDegree", types.Int, SILHOUETTE_DEGREE),
        ("skeletonPoints", types.Point3fArray, _in_space(shape.nodes)),
        ("skeletonParents", types.IntArray, _integers(shape.parents)),
        ("skeletonBranches", types.IntArray, _integers(shape.branches)),
        ("tie:branch", types.IntArray, _integers(turtle.branches)),
        ("tie:kLength", types.FloatArray, _floats(turtle.k_length)),
        ("tie:kTurn", types.FloatArray, _floats(np.degrees(turtle.k_turn_rad))),
        ("tie:tLength", types.FloatArray, _floats(turtle.t_length)),
        ("tie:tTurn", types.FloatArray, _floats(np.degrees(turtle.t_turn_rad))),
    )
    for name, value_type, value in numbers:
        prim.CreateAttribute(f"foliage:lobed:{name}", value_type, custom=False).Set(value)
    author_functions(prim, leaf.functions)


def author_functions(prim: Usd.Prim, functions: BranchFunctions) -> None:
    """Author the keys of functions on a prim, which has FoliageLobedLeafAPI or is an over of one that has it."""
    for name in FUNCTIONS:
        lists = getattr(functions, name)
        keys = np.concatenate([np.zeros((0, 2)), *lists]) * [1.0, np.degrees(1.0)]
        counts = prim.CreateAttribute(f"foliage:lobed:{name}:keyCounts", Sdf.ValueTypeNames.IntArray, custom=False)
        counts.Set(_integers(np.array([len(own) for own in lists])))
        values = prim.CreateAttribute(f"foliage:lobed:{name}:keys", Sdf.ValueTypeNames.Float2Array, custom=False)
        values.Set(Vt.Vec2fArray.FromNumpy(keys.astype(np.float32)))


def write_lobed_part(
    place: AssetPlace, leaf: LobedLeaf, texture: NDArray[np.float32], settings: LobedAssetSettings
) -> Part:
    """Write a lobed leaf into the asset at place.

    Args:
        place: Where; the payload's folder exists.
        leaf: What to write.
        texture: (h, w, 4), linear colours and opacity over the leaf's st.
        settings: How.

    Raises:
        AssetError: The texture cannot be encoded, or a file cannot be written.
    """
    file = f"{place.name}_leaf.png"
    (place.folder / "maps").mkdir(exist_ok=True)
    write_texels(place.folder / "maps" / file, texture)
    copy_shaders(place.folder / "shaders", LEAF_SHADERS)
    _write_layer(place.payload / LOBED_LEAF_LAYER, place.name, leaf, settings)
    # The texture has the veins, and the shader's own would follow an axis that this leaf has not.
    material = LeafMaterial(
        shaders=SHADERS, texture=f"{MAPS}/{file}", color=LEAF_COLOR, veins=0.0, relief=0.0, mottling=0.0
    )
    return Part(
        relationships={TO_LEAVES: LEAVES},
        collections={"leaves": [LEAVES]},
        materials=[partial(_author_material, leaf=material)],
        near=[f"./{LOBED_LEAF_LAYER}"],
        near_m=[_box_of(leaf.points_m())],
        detail_m=float(np.ptp(leaf.shape.places, axis=0).max()),
    )


def _author_material(stage: Usd.Stage, root: Sdf.Path, leaf: LeafMaterial) -> None:
    author_leaf_material(stage, root.AppendPath(LEAF_MATERIAL), leaf)


def _write_layer(path: Path, name: str, leaf: LobedLeaf, settings: LobedAssetSettings) -> None:
    stage = new_layer(path, name)
    mesh = Sdf.Path(f"/{name}/{LEAVES}")
    author_scopes(stage, mesh.GetParentPath())
    author_lobed_leaf(stage, mesh, leaf, subdivision=settings.subdivision)
    bind_material(stage, mesh, Sdf.Path(f"/{name}/{LEAF_MATERIAL}"))
    export_layer(stage, path)


def _box_of(points_m: NDArray[np.float64]) -> Box:
    return np.stack([points_m.min(axis=0), points_m.max(axis=0)])


def _in_space(places: NDArray[np.float64]) -> Vt.Vec3fArray:
    return Vt.Vec3fArray.FromNumpy(np.column_stack([places, np.zeros(len(places))]).astype(np.float32))


def _integers(values: NDArray[np.integer]) -> Vt.IntArray:
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


def _floats(values: NDArray[np.floating]) -> Vt.FloatArray:
    return Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, np.float32))
