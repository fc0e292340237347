"""The leaves of a crown in USD: a PointInstancer of clusters."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import bind_material
from usdfoliage.asset.materials.layer import CROWN_LEAVES_MATERIAL
from usdfoliage.asset.parts.instancers import author_turns
from usdfoliage.asset.plant import CROWN_HOLDER
from usdfoliage.asset.stored_numbers import stored_numbers
from usdfoliage.crown.leafy_crown import LeafCluster, LeafyCrown

CROWN_LEAVES = "CrownLeaves"  # beside the crown
CLUSTERS = "Prototypes"  # below them, the forms of clusters
LARGER = 3.0  # times as large as they are, that leaves are drawn at most


def author_crown_leaves(stage: Usd.Stage, holder: Sdf.Path, name: str, leafy: LeafyCrown) -> None:
    """Define the clusters of a crown below the scope that the crown is in.

    Args:
        stage: Of the crown's layer.
        holder: The scope.
        name: Of the root prim.
        leafy: The clusters.
    """
    instancer = UsdGeom.PointInstancer.Define(stage, holder.AppendChild(CROWN_LEAVES))
    path = instancer.GetPath()
    forms = path.AppendChild(CLUSTERS)
    UsdGeom.Scope.Define(stage, forms)
    targets = []
    for number, cluster in enumerate(leafy.forms):
        targets.append(forms.AppendChild(_cluster_name(number)))
        _author_cluster(stage, targets[-1], cluster)
        bind_material(stage, targets[-1], Sdf.Path(f"/{name}/{CROWN_LEAVES_MATERIAL}"))
    instancer.CreatePrototypesRel().SetTargets(targets)
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(leafy.form.astype(np.int32)))
    instancer.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(leafy.place_m.astype(np.float32)))
    scale = np.repeat(leafy.radius_m[:, None], 3, axis=1)
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(scale.astype(np.float32)))
    author_turns(instancer, np.roll(leafy.orientation, -1, axis=1))
    instancer.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(leafy.extent_m.astype(np.float32)))
    primvars = UsdGeom.PrimvarsAPI(instancer)
    color = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.varying)
    color.Set(Vt.Vec3fArray.FromNumpy(leafy.color.astype(np.float32)))
    rank = primvars.CreatePrimvar("leafRank", Sdf.ValueTypeNames.Float2Array, UsdGeom.Tokens.varying)
    ranks = np.column_stack([leafy.rank, leafy.radius_m / leafy.radius_m.max()])
    rank.Set(Vt.Vec2fArray.FromNumpy(ranks.astype(np.float32)))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedClusters:
    """What another layer must know of a crown's clusters to give them other leaves; lengths in the asset's unit."""

    forms: int
    reach: float  # of leaves from the middle of a cluster, in its radii
    radius: float  # of the largest cluster
    extent: NDArray[np.float64]  # (2, 3) around all


def read_placed_clusters(holder: Usd.Prim) -> PlacedClusters | None:
    """The clusters below the scope that a crown is in; None where its selected form has none, or none as we write them.

    Args:
        holder: The scope.
    """
    instancer = UsdGeom.PointInstancer(holder.GetChild(CROWN_LEAVES)) if holder.GetChild(CROWN_LEAVES) else None
    if not instancer:
        return None
    named = [target.name for target in instancer.GetPrototypesRel().GetTargets()]
    if not named or named != [_cluster_name(number) for number in range(len(named))]:
        return None
    meshes = [UsdGeom.Mesh(instancer.GetPrim().GetPrimAtPath(f"{CLUSTERS}/{name}")) for name in named]
    points = [stored_numbers(mesh.GetPointsAttr().Get(), (None, 3)) if mesh else None for mesh in meshes]
    scales = stored_numbers(instancer.GetScalesAttr().Get(), (None, 3))
    extent = stored_numbers(instancer.GetExtentAttr().Get(), (2, 3))
    if scales is None or extent is None or not len(scales):
        return None
    reaches = [0.0 if each is None or not len(each) else float(np.linalg.norm(each, axis=1).max()) for each in points]
    return PlacedClusters(forms=len(named), reach=max(reaches), radius=float(np.abs(scales).max()), extent=extent)


@dataclass(frozen=True, kw_only=True, eq=False)
class OtherLeaves:
    """Leaves that the crown of an asset has in another layer."""

    leaf_map: str  # picture of a leaf, as seen from that layer's folder
    brightness: float  # factor on its colours
    clusters: tuple[LeafCluster, ...]  # as many forms as the asset has
    extent: NDArray[np.float64]  # (2, 3) around all clusters, in the asset's unit


def author_other_leaves(stage: Usd.Stage, plant: Sdf.Path, other: OtherLeaves) -> None:
    """Give the crown of an asset at plant other leaves, by opinions over its own."""
    instancer = plant.AppendPath(CROWN_HOLDER).AppendChild(CROWN_LEAVES)
    over = UsdGeom.PointInstancer(stage.OverridePrim(instancer))
    over.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(other.extent.astype(np.float32)))
    for number, cluster in enumerate(other.clusters):
        _author_cluster(stage, instancer.AppendPath(f"{CLUSTERS}/{_cluster_name(number)}"), cluster)
    texture = stage.OverridePrim(plant.AppendPath(f"{CROWN_LEAVES_MATERIAL}/LeafMap"))
    types = Sdf.ValueTypeNames
    for name, kind, value in (
        ("file", types.Asset, Sdf.AssetPath(other.leaf_map)),
        ("scale", types.Float4, Gf.Vec4f(*[other.brightness] * 3, 1)),
        ("sourceColorSpace", types.Token, "sRGB"),
    ):
        texture.CreateAttribute(f"inputs:{name}", kind, custom=False).Set(value)


def _cluster_name(number: int) -> str:
    return f"Cluster_{number + 1}"


def _author_cluster(stage: Usd.Stage, path: Sdf.Path, cluster: LeafCluster) -> None:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(cluster.points.astype(np.float32)))
    count = len(cluster.points) // 4
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(count, 4))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.arange(4 * count, dtype=np.int32)))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(cluster.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    # As they are displaced: larger where few are drawn, and turned to the camera.
    away = np.linalg.norm(cluster.middle, axis=1).max() + np.linalg.norm(cluster.corner, axis=1).max()
    reach = LARGER * float(away)
    mesh.CreateExtentAttr(Vt.Vec3fArray([(-reach, -reach, -reach), (reach, reach, reach)]))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    leaf = np.repeat(np.arange(count), 4)
    types = Sdf.ValueTypeNames
    for name, kind, array, values, indices in (
        ("st", types.TexCoord2fArray, Vt.Vec2fArray, cluster.st[:4], np.arange(4 * count) % 4),
        ("leafMiddle", types.Float3Array, Vt.Vec3fArray, cluster.middle[::4], leaf),
        ("leafNumber", types.FloatArray, Vt.FloatArray, (np.arange(count) + 0.5) / count, leaf),
        ("leafCorner", types.Float2Array, Vt.Vec2fArray, cluster.corner, None),
    ):
        primvar = primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.vertex)
        primvar.Set(array.FromNumpy(np.ascontiguousarray(values, np.float32)))
        if indices is not None:
            primvar.SetIndices(Vt.IntArray.FromNumpy(indices.astype(np.int32)))
