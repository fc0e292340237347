"""The crown in USD: a closed mesh with FoliageCrownAPI, and the two cubemaps it is made from."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import author_scopes, bind_material, export_layer, new_layer
from usdfoliage.asset.locate import open_layer
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.asset.materials.layer import CROWN_MATERIAL, CROWN_RELIEF_MATERIAL
from usdfoliage.asset.parts.crown_leaves import author_crown_leaves
from usdfoliage.asset.parts.crown_maps import color_map_path, leaf_color_map_path, leaf_map_path, radius_map_path
from usdfoliage.asset.plant import CROWN
from usdfoliage.asset.schema import CROWN_API
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.leafy_crown import LeafyCrown, LeafyCrownSettings, build_leafy_crown
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError
from usdfoliage.geometry.crown_cage import build_crown_cage
from usdfoliage.geometry.crown_hull import CrownHull, fit_crown_hull
from usdfoliage.geometry.crown_mesh import CrownMesh
from usdfoliage.geometry.crown_mesh_size import choose_mesh_size

FORM = "crown"  # variant set of the scope that the crown is in: how it is drawn
MESH, RELIEF, LEAVES = "mesh", "relief", "leaves"
FORMS = (MESH, RELIEF, LEAVES)  # the first is the default, which every renderer draws


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownPrim:
    """All that is authored of a crown: its cage, its hull, and where its maps are, as seen from the layer's folder."""

    cage: CrownMesh
    hull: CrownHull
    leafy: LeafyCrown
    radius_map: str
    color_map: str
    leaf_map: str
    leaf_color_map: str
    center_m: NDArray[np.float64]  # (3,)
    radius_range_m: tuple[float, float]  # smallest and largest of the map
    relief_weight: float
    mean_color: NDArray[np.float64]  # (3,), linear Rec.709; for applications that show no texture


def crown_prim(name: str, crown: CrownModel, mesh_size: int | None, leaf: LeafPicture) -> CrownPrim:
    """What the layer payload/crown.usdc of the asset called name holds; a mesh_size of None is chosen.

    The leaves of its clusters have the form of the picture of a leaf.
    """
    size = choose_mesh_size(crown.radius_m) if mesh_size is None else mesh_size
    return CrownPrim(
        cage=build_crown_cage(crown.radius_m, crown.center_m, size),
        hull=fit_crown_hull(crown.radius_m, crown.center_m),
        leafy=build_leafy_crown(crown, LeafyCrownSettings(leaf_width=leaf.width, leaf_cover=leaf.cover)),
        radius_map=f"../{radius_map_path(name).as_posix()}",
        color_map=f"../{color_map_path(name).as_posix()}",
        leaf_map=f"../{leaf_map_path(name).as_posix()}",
        leaf_color_map=f"../{leaf_color_map_path(name).as_posix()}",
        center_m=np.asarray(crown.center_m, np.float64),
        radius_range_m=(float(crown.radius_m.min()), float(crown.radius_m.max())),
        relief_weight=crown.relief_weight,
        mean_color=crown.color.reshape(-1, 3).mean(axis=0, dtype=np.float64),
    )


def write_crown_layer(path: Path, name: str, crown: CrownPrim) -> None:
    """Write the crown alone: a layer with the crown at /name/geo/proxy/Crown, in the forms of the set FORM there."""
    stage = new_layer(path, name)
    crown_path = Sdf.Path(f"/{name}/{CROWN}")
    author_scopes(stage, crown_path.GetParentPath())
    _author_facts(stage, crown_path, crown)
    forms = stage.GetPrimAtPath(crown_path.GetParentPath()).GetVariantSets().AddVariantSet(FORM)
    for form in FORMS:
        forms.AddVariant(form)
    forms.SetVariantSelection(MESH)
    with forms.GetVariantEditContext():
        author_crown_cage(stage, crown_path, crown.cage)
        bind_material(stage, crown_path, Sdf.Path(f"/{name}/{CROWN_MATERIAL}"))
    forms.SetVariantSelection(RELIEF)
    with forms.GetVariantEditContext():
        _author_hull(stage, crown_path, crown.hull, crown.center_m)
        bind_material(stage, crown_path, Sdf.Path(f"/{name}/{CROWN_RELIEF_MATERIAL}"))
    forms.SetVariantSelection(LEAVES)
    with forms.GetVariantEditContext():
        _author_hull(stage, crown_path, crown.hull, crown.center_m)
        UsdGeom.Imageable(stage.GetPrimAtPath(crown_path)).MakeInvisible()
        author_crown_leaves(stage, crown_path.GetParentPath(), name, crown.leafy)
    forms.SetVariantSelection(MESH)
    export_layer(stage, path)


def read_crown_radius(path: Path, name: str) -> tuple[NDArray[np.floating], NDArray[np.float64]]:
    """The radius cubemap (6, N, N) of a crown, in metres, and its centre (3,), as write_crown_layer wrote them.

    Raises:
        AssetError: The layer or the cubemap cannot be read, or the crown names no cubemap or centre.
    """
    stage = Usd.Stage.Open(open_layer(path), Usd.Stage.LoadNone)
    crown = stage.GetPrimAtPath(f"/{name}/{CROWN}")
    radius_map, center = (
        crown.GetAttribute(f"foliage:crown:{fact}").Get(Usd.TimeCode.EarliestTime()) if crown else None
        for fact in ("radiusMap", "center")
    )
    center_m = stored_numbers(center, (3,))
    if not isinstance(radius_map, Sdf.AssetPath) or not radius_map.path or center_m is None:
        raise AssetError(f"{path} lacks the radius map or the centre of the crown </{name}/{CROWN}>", "build it again")
    file = Path(radius_map.resolvedPath or path.parent / radius_map.path)
    pixels = read_cubemap(file).pixels
    if pixels.ndim != 3 or not (np.isfinite(pixels).all() and pixels.min() > 0):
        raise AssetError(f"{file} holds no radii, which are one number above 0 a texel", "build the crown again")
    return pixels, center_m


def _author_facts(stage: Usd.Stage, path: Sdf.Path, crown: CrownPrim) -> None:
    """Define the crown at path as a mesh without faces, with FoliageCrownAPI and the maps it comes from."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    color = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.constant
    )
    color.Set([Gf.Vec3f(*map(float, crown.mean_color))])

    prim = mesh.GetPrim()
    prim.AddAppliedSchema(CROWN_API)
    facts = (
        ("radiusMap", Sdf.ValueTypeNames.Asset, Sdf.AssetPath(crown.radius_map)),
        ("colorMap", Sdf.ValueTypeNames.Asset, Sdf.AssetPath(crown.color_map)),
        ("center", Sdf.ValueTypeNames.Point3f, Gf.Vec3f(*map(float, crown.center_m))),
        ("radiusRange", Sdf.ValueTypeNames.Float2, Gf.Vec2f(*crown.radius_range_m)),
        ("reliefWeight", Sdf.ValueTypeNames.Float, float(crown.relief_weight)),
        ("leafTexture", Sdf.ValueTypeNames.Asset, Sdf.AssetPath(crown.leaf_map)),
    )
    for fact, value_type, value in facts:
        prim.CreateAttribute(f"foliage:crown:{fact}", value_type, custom=False).Set(value)


def _author_hull(stage: Usd.Stage, path: Sdf.Path, hull: CrownHull, center_m: NDArray[np.float64]) -> None:
    """The hull as the mesh at path, from which the relief is drawn."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(hull.points_m.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(hull.faces), 3))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(hull.faces.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(False)  # closed, and only its front is drawn
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(hull.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    rest = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("rest", Sdf.ValueTypeNames.Float3Array, UsdGeom.Tokens.vertex)
    rest.Set(Vt.Vec3fArray.FromNumpy((hull.points_m - center_m).astype(np.float32)))  # what a fragment has of them


def author_crown_cage(stage: Usd.Stage, path: Sdf.Path, crown: CrownMesh) -> UsdGeom.Mesh:
    """Define the cage at path, to be subdivided, with its place on the cubemap's image as st."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(crown.points_m)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(crown.face_vertices), 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(crown.face_vertices.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    # The limit of a vertex lies where its st looks, and so does what is between two of them, evenly.
    mesh.CreateFaceVaryingLinearInterpolationAttr(UsdGeom.Tokens.all)
    mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
    mesh.CreateDoubleSidedAttr(False)  # closed
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))  # holds the limit, which lies within the cage
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set(Vt.Vec2fArray.FromNumpy(crown.st))
    st.SetIndices(Vt.IntArray.FromNumpy(crown.face_st.ravel()))
    return mesh
