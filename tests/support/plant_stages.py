"""Small stages that every validator finds good; tests break one thing in a copy."""

from pathlib import Path

import numpy as np
import OpenEXR
import usdfoliage  # noqa: F401  registers the schemas, before any stage
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, Vt
from usdfoliage.geometry.cubemap import face_directions, share_borders

LEAVES = 3


def build_leaves(stage: Usd.Stage, path: str = "/Leaves") -> Usd.Prim:
    """A PointInstancer of LEAVES leaves with one prototype."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    prim = instancer.GetPrim()
    prim.ApplyAPI("FoliageLeafAPI")
    instancer.CreatePositionsAttr([Gf.Vec3f(i, 1, 0) for i in range(LEAVES)])
    instancer.CreateScalesAttr([Gf.Vec3f(0.08)] * LEAVES)
    rotation = Gf.Rotation(Gf.Vec3d(1, 2, 3).GetNormalized(), 37).GetQuat()
    instancer.CreateOrientationsfAttr(Vt.QuatfArray([Gf.Quatf(rotation)] * LEAVES))
    instancer.CreateOrientationsAttr(Vt.QuathArray([Gf.Quath(rotation)] * LEAVES))
    instancer.CreateProtoIndicesAttr([0] * LEAVES)
    instancer.CreatePrototypesRel().SetTargets([f"{path}/Prototypes/Leaf"])
    UsdGeom.Scope.Define(stage, f"{path}/Prototypes")
    build_quad(stage, f"{path}/Prototypes/Leaf")
    author_leaf_arrays(prim, LEAVES, "varying")
    _primvar(prim, "packed", Sdf.ValueTypeNames.FloatArray, packed_leaves(LEAVES), "constant")
    return prim


def packed_leaves(count: int) -> list[float]:
    """The copy for Storm of the leaves of author_leaf_arrays: axis2, inner, outer, axis1, silhouette1 and 2 in 1/2048,
    the phase in 1/512."""
    numbers = (0.0, 1365.0, 0.0, *(0.0,) * 6, 3840.0, 0.0, 683.0, 0.0, 410.0, 410.0, 0.0, 1024.0, 717.0, 0.0)
    return [float(count), *(number for number in numbers for _ in range(count))]


def author_leaf_arrays(prim: Usd.Prim, leaves: int, interpolation: str) -> None:
    """The seven parameters, the phase and the three facts of a flat elliptic leaf, and neutral edits."""
    shape = {
        "axis1": (0, 1 / 3, 0),
        "axis2": (0, 2 / 3, 0),
        "silhouette1": (0.2, 0.2, 0),
        "silhouette2": (0.5, 0.35, 0),
        "silhouette3": (0.8, 0.2, 0),
        "inner": (0, 0, 0),
        "outer": (0, 0, 0),
    }
    for name, number in shape.items():
        _primvar(prim, name, Sdf.ValueTypeNames.Float3Array, [Gf.Vec3f(*number)] * leaves, interpolation)
    _primvar(prim, "phase", Sdf.ValueTypeNames.FloatArray, [7.5] * leaves, interpolation)
    _primvar(prim, "confidence", Sdf.ValueTypeNames.FloatArray, [0.5] * leaves, interpolation)
    _primvar(prim, "residual", Sdf.ValueTypeNames.FloatArray, [0.001] * leaves, interpolation)
    _primvar(prim, "view", Sdf.ValueTypeNames.IntArray, [-1] * leaves, interpolation)
    _primvar(prim, "origin", Sdf.ValueTypeNames.IntArray, [0] * leaves, interpolation)
    for name in ("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "curl"):
        _primvar(prim, f"edit:{name}", Sdf.ValueTypeNames.Float3, Gf.Vec3f(0), "constant")
    for name, number in (("width", 1.0), ("jitterAmplitude", 0.0), ("jitterFrequency", 8.0)):
        _primvar(prim, f"edit:{name}", Sdf.ValueTypeNames.Float, number, "constant")


def build_hero_leaf(stage: Usd.Stage, path: str = "/Hero") -> Usd.Prim:
    """One leaf as a NurbsPatch."""
    patch = UsdGeom.NurbsPatch.Define(stage, path)
    patch.CreateUVertexCountAttr(7)
    patch.CreateVVertexCountAttr(5)
    patch.CreateUOrderAttr(4)
    patch.CreateVOrderAttr(5)
    patch.CreateUKnotsAttr([-1.0] * 4 + [0.0] * 3 + [1.0] * 4)
    patch.CreateVKnotsAttr([0.0] * 5 + [1.0] * 5)
    points = [
        Gf.Vec3f(x * width, y, 0)
        for y, width in ((0, 0), (0.2, 0.2), (0.5, 0.35), (0.8, 0.2), (1, 0))
        for x in (-1, -2 / 3, -1 / 3, 0, 1 / 3, 2 / 3, 1)
    ]
    patch.CreatePointsAttr(points)
    patch.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim = patch.GetPrim()
    prim.ApplyAPI("FoliageLeafAPI")
    author_leaf_arrays(prim, 1, "constant")
    return prim


def build_quad(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    """A unit square with extent and st."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = [Gf.Vec3f(-0.5, 0, 0), Gf.Vec3f(0.5, 0, 0), Gf.Vec3f(0.5, 1, 0), Gf.Vec3f(-0.5, 1, 0)]
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateDoubleSidedAttr(True)
    normals = [Gf.Vec3f(0, 0, 1)] * 4
    mesh.CreateNormalsAttr(normals)
    mesh.SetNormalsInterpolation("vertex")
    return mesh


def build_skeleton(stage: Usd.Stage, path: str = "/Skeleton") -> Usd.Prim:
    """A trunk of three vertices, a branch from its second, and a twig from the branch's tip."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    prim = curves.GetPrim()
    prim.ApplyAPI("FoliageSkeletonAPI")
    curves.CreateTypeAttr("linear")
    curves.CreateCurveVertexCountsAttr([3, 2, 2])
    trunk = [(0, 0, 0), (0, 1, 0), (0, 2, 0)]
    branch = [(0, 1, 0), (1, 1.5, 0)]
    twig = [(1, 1.5, 0), (1.5, 2, 0)]
    points = [Gf.Vec3f(*point) for point in (*trunk, *branch, *twig)]
    curves.CreatePointsAttr(points)
    widths = [0.2, 0.15, 0.1, 0.08, 0.04, 0.02, 0.01]
    curves.CreateWidthsAttr(widths)
    curves.SetWidthsInterpolation("vertex")
    curves.CreateExtentAttr(UsdGeom.Curves.ComputeExtent(points, widths))
    prim.GetAttribute("foliage:parentCurve").Set([-1, 0, 1])
    prim.GetAttribute("foliage:parentVertex").Set([-1, 1, 4])
    prim.GetAttribute("foliage:order").Set([0, 1, 2])
    prim.GetAttribute("foliage:growth:branchingAngle").Set(38.0)
    prim.GetAttribute("foliage:growth:tropismDirection").Set(Gf.Vec3f(0, -1, 0))
    return prim


def radius_map(size: int = 8) -> np.ndarray:
    """Radii (6, size, size) from 1 to 2 m, the same where faces meet."""
    return share_borders(1.5 + 0.5 * face_directions(size)[..., 1]).astype(np.float32)


def write_cubemap(path: Path, channels: dict[str, np.ndarray], *, header: dict[str, object] | None = None) -> None:
    """Channels (6, N, N) in one file, as a cubemap unless the header states another kind."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "envmap": OpenEXR.ENVMAP_CUBE}
    pixels = {name: np.ascontiguousarray(channel.reshape(-1, channel.shape[-1])) for name, channel in channels.items()}
    OpenEXR.File({**whole, **(header or {})}, pixels).write(str(path))


def build_crown(stage: Usd.Stage, maps: Path, path: str = "/Crown", relative: str = "./maps") -> Usd.Prim:
    """A crown whose cubemaps stand in maps, which the layer calls relative."""
    radius = radius_map()
    write_cubemap(maps / "radius.exr", {"R": radius})
    color = np.full(radius.shape, 0.2, np.float16)
    write_cubemap(maps / "color.exr", {"R": color, "G": color, "B": color})
    prim = build_quad(stage, path).GetPrim()
    prim.ApplyAPI("FoliageCrownAPI")
    prim.GetAttribute("foliage:crown:radiusMap").Set(Sdf.AssetPath(f"{relative}/radius.exr"))
    prim.GetAttribute("foliage:crown:colorMap").Set(Sdf.AssetPath(f"{relative}/color.exr"))
    prim.GetAttribute("foliage:crown:center").Set(Gf.Vec3f(0, 1, 0))
    prim.GetAttribute("foliage:crown:radiusRange").Set(Gf.Vec2f(float(radius.min()), float(radius.max())))
    prim.GetAttribute("foliage:crown:reliefWeight").Set(0.25)
    return prim


def build_lobed_leaf(stage: Usd.Stage, path: str = "/Lobed") -> Usd.Prim:
    """A leaf with an axis and one lobe."""
    prim = build_quad(stage, path).GetPrim()
    prim.ApplyAPI("FoliageLobedLeafAPI")
    square = [Gf.Vec3f(0, 0, 0), Gf.Vec3f(0.5, 0.5, 0), Gf.Vec3f(0, 1, 0), Gf.Vec3f(-0.5, 0.5, 0)]
    values = {
        "silhouettePoints": square,
        "skeletonPoints": [Gf.Vec3f(0, 0, 0), Gf.Vec3f(0, 0.5, 0), Gf.Vec3f(0, 0.9, 0), Gf.Vec3f(0.3, 0.6, 0)],
        "skeletonParents": [-1, 0, 1, 1],
        "skeletonBranches": [0, 0, 0, 1],
        "tie:branch": [0, 0, 1],
        "tie:kLength": [0.2, 0.4, 0.1],
        "tie:kTurn": [0.0, 5.0, -60.0],
        "tie:tLength": [0.1, 0.2, 0.1],
        "tie:tTurn": [90.0, 80.0, -90.0],
        "bend:keyCounts": [2, 0],
        "bend:keys": [Gf.Vec2f(0, 0), Gf.Vec2f(1, 30)],
    }
    for name, value in values.items():
        prim.GetAttribute(f"foliage:lobed:{name}").Set(value)
    return prim


def build_forest(stage: Usd.Stage, path: str = "/Forest") -> Usd.Prim:
    """Four plants of two prototypes."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    prim = instancer.GetPrim()
    prim.ApplyAPI("FoliageForestAPI")
    instancer.CreatePositionsAttr([Gf.Vec3f(5 * i, 0, 0) for i in range(4)])
    instancer.CreateProtoIndicesAttr([0, 1, 0, 1])
    for name in ("Oak", "Heather"):
        build_quad(stage, f"{path}/Prototypes/{name}")
    instancer.CreatePrototypesRel().SetTargets([f"{path}/Prototypes/Oak", f"{path}/Prototypes/Heather"])
    values = {
        "species": ["Quercus robur", "Calluna vulgaris"],
        "speciesKind": ["tree", "shrub"],
        "speciesShare": [1.0, 1.0],
        "speciesScale": [Gf.Vec2f(0.8, 1.2), Gf.Vec2f(0.5, 1)],
        "seed": 0,
        "lodJitter": [0.0, 0.3, 0.7, 1.0],
        "lodDistance": Gf.Vec2f(120, 200),
    }
    for name, value in values.items():
        prim.GetAttribute(f"foliage:forest:{name}").Set(value)
    return prim


def write_asset(folder: Path, name: str = "oak") -> Path:
    """An asset with leaves, skeleton and crown in the layout of the design; returns its interface layer."""
    root = f"/{name}"
    (folder / "payload").mkdir(parents=True)
    content = _new_stage(folder / "payload" / "payload.usda", root)
    for scope, purpose in (("render", "render"), ("proxy", "proxy"), ("guide", "guide")):
        UsdGeom.Scope.Define(content, f"{root}/geo/{scope}").CreatePurposeAttr(purpose)
    build_leaves(content, f"{root}/geo/render/Leaves")
    build_crown(content, folder / "maps", f"{root}/geo/proxy/Crown", "../maps")
    build_skeleton(content, f"{root}/geo/guide/Skeleton")
    content.GetRootLayer().Save()

    interface = _new_stage(folder / f"{name}.usda", root)
    plant = interface.GetPrimAtPath(root)
    plant.ApplyAPI("FoliagePlantAPI")
    author_plant(plant)
    Usd.ModelAPI(plant).SetKind(Kind.Tokens.component)
    for relationship, part in (("leaves", "render/Leaves"), ("skeleton", "guide/Skeleton"), ("crown", "proxy/Crown")):
        plant.CreateRelationship(f"foliage:{relationship}", custom=False).SetTargets([f"{root}/geo/{part}"])
    plant.GetPayloads().AddPayload("./payload/payload.usda")
    cache = UsdGeom.BBoxCache(0, UsdGeom.Imageable.GetOrderedPurposeTokens())
    model = UsdGeom.ModelAPI.Apply(plant)
    model.SetExtentsHint(model.ComputeExtentsHint(cache))
    interface.GetRootLayer().Save()
    return folder / f"{name}.usda"


def author_plant(plant: Usd.Prim) -> None:
    """The facts of a plant made from nothing in particular."""
    plant.GetAttribute("foliage:generator").Set("a test")
    plant.GetAttribute("foliage:captureToAsset").Set(Gf.Matrix4d(0.01))
    matrix = Gf.Matrix4d(1).SetScale(0.01)
    plant.GetAttribute("foliage:captureToAsset").Set(matrix)


def _new_stage(path: Path, root: str) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, root).GetPrim())
    UsdGeom.Scope.Define(stage, f"{root}/geo")
    return stage


def _primvar(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: object, interpolation: str) -> None:
    UsdGeom.PrimvarsAPI(prim).CreatePrimvar(f"leaf:{name}", kind, interpolation).Set(value)
