"""A plant as a Nanite assembly of Unreal: a base mesh of wood on joints, and leaves as parts that follow them.

The schemas are Unreal's. Their names are authored as text, so that nothing of Unreal is needed to write them, and USD
that does not know them keeps them. docs/export.md has the rules with the address of each; `unreal_rules` checks them.

Source:
    Nanite Assemblies, https://dev.epicgames.com/documentation/en-us/unreal-engine/nanite-assemblies, which names
    NaniteAssemblyRootAPI, NaniteAssemblyExternalRefAPI and NaniteAssemblySkelBindingAPI; their properties as
    https://github.com/EpicGames/UnrealEngine (5.7) reads them in
    Engine/Plugins/Importers/USDImporter/Source/USDSchemas/Private/USDNaniteAssemblyTranslator.cpp; those of
    DynamicWindSkeletonAPI as Engine/Plugins/Experimental/DynamicWind/Resources/PythonExamples/
    export_dynamic_wind_json.py does there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Kind, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, Vt

from usdfoliage.asset.export.flat import drop_empty_scopes, drop_lost_targets, listed_schemas, set_applied
from usdfoliage.asset.export.repeated_leaves import RepeatedLeaves, author_repeated_leaves
from usdfoliage.asset.materials.layer import LEAF_MATERIAL
from usdfoliage.asset.parts.branch_rig import author_joints_at, author_skin, joint_names
from usdfoliage.asset.parts.leaf_gprims import author_leaf_mesh
from usdfoliage.asset.plant import BRANCHES
from usdfoliage.branch.motion.rig import Rig, Skin
from usdfoliage.leaf.shape.mesh import LeafMesh

ROOT_API, BINDING_API = "NaniteAssemblyRootAPI", "NaniteAssemblySkelBindingAPI"
EXTERNAL_API = "NaniteAssemblyExternalRefAPI"  # for parts that are in Unreal already; an export has none
WIND_API = "DynamicWindSkeletonAPI"
MESH_TYPE, SKELETON = "unreal:naniteAssembly:meshType", "unreal:naniteAssembly:skeleton"
BIND_JOINTS, BIND_WEIGHTS = "unreal:naniteAssembly:bindJoints", "unreal:naniteAssembly:bindJointWeights"  # primvars
SKELETAL, STATIC = "skeletalMesh", "staticMesh"
ROOT_JOINT, PART_JOINT = "root", "leaf"
KIND = Kind.Tokens.group  # importers may be set to make one mesh of a component, and leave a group as it is

BASE, LEAVES = "Base", "Leaves"  # below the root prim


@dataclass(frozen=True, kw_only=True, eq=False)
class AssemblyRig:
    """Joints of the wood, and how it and the leaves follow them."""

    rig: Rig
    order: NDArray[np.int32]  # (J,), of each joint's branch, the trunk's 0
    wood: Skin  # of the points of the base mesh
    leaves: Skin  # of the leaves' places


def author_assembly(
    stage: Usd.Stage, root: Sdf.Path, rigged: AssemblyRig | None, leaves: RepeatedLeaves | None
) -> None:
    """Make a Nanite assembly of a flat plant.

    Args:
        stage: Flat, its wood of polygons; it is changed.
        root: The plant's prim.
        rigged: The joints; without them the assembly is one of static meshes.
        leaves: None where the plant has none.
    """
    layer = stage.GetRootLayer()
    wood, base = root.AppendPath(BRANCHES), root.AppendChild(BASE)
    if stage.GetPrimAtPath(wood):
        UsdSkel.Root.Define(stage, base) if rigged is not None else UsdGeom.Xform.Define(stage, base)
        Sdf.CopySpec(layer, wood, layer, base.AppendChild("Branches"))
    stage.RemovePrim(root.AppendChild("geo"))
    prim = stage.GetPrimAtPath(root)
    mesh_type = prim.CreateAttribute(MESH_TYPE, Sdf.ValueTypeNames.Token, False, Sdf.VariabilityUniform)
    mesh_type.Set(STATIC if rigged is None else SKELETAL)
    if rigged is not None:
        skeleton = base.AppendChild("Skeleton")
        _author_skeleton(stage, skeleton, rigged)
        surface = stage.GetPrimAtPath(base.AppendChild("Branches"))
        author_skin(surface, skeleton, _below_root(rigged.wood))
        _set_extent(UsdSkel.Root(stage.GetPrimAtPath(base)))
        prim.CreateRelationship(SKELETON, custom=False).SetTargets([skeleton])
    if leaves is not None:
        material = root.AppendPath(LEAF_MATERIAL)
        part = _author_skeletal_part if rigged is not None else None
        instancer = author_repeated_leaves(stage, root.AppendChild(LEAVES), leaves, material, part)
        if rigged is not None:
            _bind_leaves(instancer, rigged)
    for each in stage.Traverse():  # bindings to materials stay on meshes alone
        if not each.IsA(UsdGeom.Gprim) and UsdShade.MaterialBindingAPI(each).GetDirectBindingRel():
            UsdShade.MaterialBindingAPI(each).UnbindAllBindings()
    set_applied(layer.GetPrimAtPath(root), [ROOT_API, *listed_schemas(prim)])
    drop_empty_scopes(stage)
    drop_lost_targets(stage)


def wind_data(rig: Rig, order: NDArray[np.int32]) -> Mapping[str, Any]:
    """What Unreal imports of a skeletal mesh's wind, as JSON: a simulation group for each order of branches.

    Influences are Unreal's own defaults, to be set there.

    Source:
        https://dev.epicgames.com/documentation/en-us/unreal-engine/API/Plugins/DynamicWindEditor/FDynamicWindSkeletalImportData
    """
    joints = [{"JointName": ROOT_JOINT, "SimulationGroupIndex": 0}]
    joints += [
        {"JointName": name.rsplit("/", 1)[-1], "SimulationGroupIndex": int(group)}
        for name, group in zip(joint_names(rig), order, strict=True)
    ]
    groups = [
        {
            "bUseDualInfluence": False,
            "Influence": 1.0,
            "MinInfluence": 0.0,
            "MaxInfluence": 0.0,
            "ShiftTop": 0.0,
            "bIsTrunkGroup": group == 0,
        }
        for group in range(int(order.max(initial=0)) + 1)
    ]
    return {"Joints": joints, "SimulationGroups": groups, "bIsGroundCover": False, "GustAttenuation": 0.0}


def _paths(rig: Rig) -> list[str]:
    """Of all joints: one root, below it those of the rig, since Unreal's skeletons have one root."""
    return [ROOT_JOINT, *(f"{ROOT_JOINT}/{name}" for name in joint_names(rig))]


def _author_skeleton(stage: Usd.Stage, path: Sdf.Path, rigged: AssemblyRig) -> None:
    rig, paths = rigged.rig, _paths(rigged.rig)
    names = [each.rsplit("/", 1)[-1] for each in paths]
    still = np.eye(4)[None]
    skeleton = author_joints_at(
        stage, path, paths, np.concatenate([still, rig.bind]), np.concatenate([still, rig.rest])
    )
    skeleton.CreateJointNamesAttr(names)
    prim = skeleton.GetPrim()
    layer = stage.GetRootLayer()
    set_applied(layer.GetPrimAtPath(path), [*listed_schemas(prim), WIND_API])
    wind = wind_data(rig, rigged.order)
    groups = wind["SimulationGroups"]
    facts: Sequence[tuple[str, Sdf.ValueTypeName, Any]] = (
        ("jointNames", Sdf.ValueTypeNames.TokenArray, names),
        (
            "jointSimulationGroups",
            Sdf.ValueTypeNames.IntArray,
            [each["SimulationGroupIndex"] for each in wind["Joints"]],
        ),
        ("simulationGroupInfluences", Sdf.ValueTypeNames.FloatArray, [each["Influence"] for each in groups]),
        ("simulationGroupShiftTops", Sdf.ValueTypeNames.FloatArray, [each["ShiftTop"] for each in groups]),
        ("trunkSimulationGroups", Sdf.ValueTypeNames.IntArray, [0]),
        ("isGroundCover", Sdf.ValueTypeNames.Bool, wind["bIsGroundCover"]),
        ("gustAttenuation", Sdf.ValueTypeNames.Float, wind["GustAttenuation"]),
    )
    for name, value_type, value in facts:
        attribute = prim.CreateAttribute(f"unreal:dynamicWind:{name}", value_type, False, Sdf.VariabilityUniform)
        attribute.Set(value)


def _bind_leaves(instancer: UsdGeom.PointInstancer, rigged: AssemblyRig) -> None:
    """Bind every leaf to joints, as many for each: the primvars' elementSize."""
    paths, skin = np.array(_paths(rigged.rig)), _below_root(rigged.leaves)
    each = skin.joints.shape[1]
    prim = instancer.GetPrim()
    layer = prim.GetStage().GetRootLayer()
    set_applied(layer.GetPrimAtPath(prim.GetPath()), [*listed_schemas(prim), BINDING_API])
    # Their interpolation stays the default of the schema: renderers would take others for values of instances.
    tokens = Vt.TokenArray(paths[skin.joints.ravel()].tolist())
    shares = Vt.FloatArray.FromNumpy(np.ascontiguousarray(skin.weights, np.float32).ravel())
    for name, value_type, values in (
        (BIND_JOINTS, Sdf.ValueTypeNames.TokenArray, tokens),
        (BIND_WEIGHTS, Sdf.ValueTypeNames.FloatArray, shares),
    ):
        attribute = prim.CreateAttribute(f"primvars:{name}", value_type, False, Sdf.VariabilityUniform)
        attribute.Set(values)
        UsdGeom.Primvar(attribute).SetElementSize(each)


def _below_root(skin: Skin) -> Skin:
    """The same by the numbers that joints have below the one root."""
    return Skin(joints=skin.joints + np.int32(1), weights=skin.weights)


def _author_skeletal_part(
    stage: Usd.Stage, path: Sdf.Path, shape: LeafMesh, color: tuple[float, float, float]
) -> UsdGeom.Mesh:
    """A leaf on one joint: the parts of an assembly on joints are skeletal meshes too."""
    UsdGeom.Xform.Define(stage, path)
    part = path.AppendChild("Part")
    skel_root = UsdSkel.Root.Define(stage, part)
    mesh = author_leaf_mesh(stage, part.AppendChild("Leaf"), shape, color)
    joint = part.AppendChild("Skeleton")
    skeleton = author_joints_at(stage, joint, [PART_JOINT], np.eye(4)[None], np.eye(4)[None])
    skeleton.CreateJointNamesAttr([PART_JOINT])
    count = len(shape.points_m)
    author_skin(mesh.GetPrim(), joint, Skin(joints=np.zeros((count, 1), np.int32), weights=np.ones((count, 1))))
    _set_extent(skel_root)
    return mesh


def _set_extent(root: UsdSkel.Root) -> None:
    """The box that UsdSkel itself derives, with room for joints that turn: validators ask for no other."""
    root.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(root, Usd.TimeCode.Default()))
