"""The leaves of a crown in USD: a PointInstancer of clusters."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import bind_material
from usdfoliage.asset.materials.layer import CROWN_LEAVES_MATERIAL
from usdfoliage.asset.parts.instancers import author_turns
from usdfoliage.crown.leafy_crown import LeafCluster, LeafyCrown

CROWN_LEAVES = "CrownLeaves"  # beside the crown
LARGER = 3.0  # times as large as they are, that clusters are drawn at most


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
    forms = path.AppendChild("Prototypes")
    UsdGeom.Scope.Define(stage, forms)
    targets = []
    for number, cluster in enumerate(leafy.forms):
        targets.append(forms.AppendChild(f"Cluster_{number + 1}"))
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
    reach = float(np.linalg.norm(cluster.middle, axis=1).max() + LARGER * np.linalg.norm(cluster.corner, axis=1).max())
    mesh.CreateExtentAttr(Vt.Vec3fArray([(-reach, -reach, -reach), (reach, reach, reach)]))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    leaf = np.repeat(np.arange(count), 4)
    types = Sdf.ValueTypeNames
    for name, kind, array, values, indices in (
        ("st", types.TexCoord2fArray, Vt.Vec2fArray, cluster.st[:4], np.arange(4 * count) % 4),
        ("leafMiddle", types.Float3Array, Vt.Vec3fArray, cluster.middle[::4], leaf),
        ("leafShade", types.FloatArray, Vt.FloatArray, cluster.shade[::4], leaf),
        ("leafCorner", types.Float2Array, Vt.Vec2fArray, cluster.corner, None),
    ):
        primvar = primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.vertex)
        primvar.Set(array.FromNumpy(np.ascontiguousarray(values, np.float32)))
        if indices is not None:
            primvar.SetIndices(Vt.IntArray.FromNumpy(indices.astype(np.int32)))
