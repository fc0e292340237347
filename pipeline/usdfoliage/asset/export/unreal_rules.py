"""The published rules of Nanite assemblies in USD, checked. docs/export.md lists them with the address of each."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdShade, UsdSkel

from usdfoliage.asset.export.flat import listed_schemas
from usdfoliage.asset.export.nanite import (
    BIND_JOINTS,
    BIND_WEIGHTS,
    BINDING_API,
    EXTERNAL_API,
    MESH_TYPE,
    ROOT_API,
    SKELETAL,
    SKELETON,
    STATIC,
    WIND_API,
)
from usdfoliage.asset.export.plain_rules import check_plain, finding
from usdfoliage.asset.validation.findings import Finding


def check_unreal(stage: Usd.Stage) -> list[Finding]:
    """What a stage breaks of the rules; none for a good Nanite assembly."""
    root = stage.GetDefaultPrim()
    if not root or root.GetTypeName() != "Xform" or ROOT_API not in listed_schemas(root):
        return [finding("unreal", "Root", "/", f"the default prim is no Xform with {ROOT_API}")]
    findings = check_plain(stage, instances=True)
    mesh_type = root.GetAttribute(MESH_TYPE)
    kind = str(mesh_type.Get()) if mesh_type else ""
    if kind not in (STATIC, SKELETAL) or str(mesh_type.GetTypeName()) != "token":
        findings.append(finding("unreal", "MeshType", root.GetPath(), f"{MESH_TYPE} is {kind or 'missing'}"))
    joints: list[str] = []
    names: list[str] = []
    if kind == SKELETAL:
        targets = root.GetRelationship(SKELETON).GetTargets() if root.HasRelationship(SKELETON) else []
        skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath(targets[0])) if targets else None
        if not skeleton or not targets[0].HasPrefix(root.GetPath()):
            findings.append(finding("unreal", "Skeleton", root.GetPath(), f"{SKELETON} leads to no Skeleton below it"))
        else:
            findings += _check_skeleton(root, skeleton)
            joints, names = (
                list(map(str, each.Get() or ())) for each in (skeleton.GetJointsAttr(), skeleton.GetJointNamesAttr())
            )
    for prim in Usd.PrimRange(root):
        findings += _check_prim(prim, root, kind, [*names, *joints])
    parts = [prim for prim in Usd.PrimRange(root) if prim.IsA(UsdGeom.PointInstancer)]
    if not parts:
        findings.append(finding("unreal", "Parts", root.GetPath(), "holds no parts, so no assembly is made"))
    return findings


def _check_skeleton(root: Usd.Prim, skeleton: UsdSkel.Skeleton) -> Iterator[Finding]:
    path = skeleton.GetPath()
    base = UsdSkel.Root.Find(skeleton.GetPrim())
    if not base or not base.GetPath().HasPrefix(root.GetPath()) or base.GetPath() == root.GetPath():
        yield finding("unreal", "SkelRoot", path, "is in no SkelRoot below the root of the assembly")
        return
    joints = list(map(str, skeleton.GetJointsAttr().Get() or ()))
    names = list(map(str, skeleton.GetJointNamesAttr().Get() or ()))
    tops = [joint for joint in joints if "/" not in joint]
    if len(tops) != 1:
        yield finding("unreal", "OneRootJoint", path, f"has {len(tops)} joints without a parent, one is needed")
    valid, reason = UsdSkel.Topology(joints).Validate()
    if not valid:
        yield finding("unreal", "JointOrder", path, f"joints are out of order: {reason}")
    if len(names) != len(joints) or len(set(names)) != len(names):
        yield finding("unreal", "JointNames", path, "jointNames are not one for each joint, all different")
    for attribute in (skeleton.GetBindTransformsAttr(), skeleton.GetRestTransformsAttr()):
        if len(attribute.Get() or ()) != len(joints):
            yield finding("unreal", "Transforms", attribute.GetPath(), f"is not of {len(joints)} joints")
    meshes = [UsdGeom.Mesh(prim) for prim in Usd.PrimRange(base.GetPrim()) if prim.IsA(UsdGeom.Mesh)]
    if not any(len(mesh.GetPointsAttr().Get() or ()) for mesh in meshes):
        yield finding("unreal", "BaseMesh", base.GetPath(), "has no geometry, without which nothing is imported")
    for mesh in meshes:
        yield from _check_skin(mesh, len(joints))
    yield from _check_wind(skeleton.GetPrim(), names)


def _check_skin(mesh: UsdGeom.Mesh, count: int) -> Iterator[Finding]:
    """The joints of a mesh's points."""
    path = mesh.GetPath()
    binding = UsdSkel.BindingAPI(mesh.GetPrim())
    if not mesh.GetPrim().HasAPI(UsdSkel.BindingAPI) or not binding.GetSkeletonRel().GetTargets():
        yield finding("unreal", "Skin", path, "is bound to no skeleton")
        return
    points = len(mesh.GetPointsAttr().Get() or ())
    indices, weights = binding.GetJointIndicesPrimvar(), binding.GetJointWeightsPrimvar()
    numbers, shares = np.array(indices.Get() or []), np.array(weights.Get() or [])
    each = indices.GetElementSize()
    if len(numbers) != points * each or len(shares) != len(numbers):
        yield finding("unreal", "Skin", path, f"has {len(numbers)} joints for {points} points of {each} each")
    elif len(numbers) and (numbers.min() < 0 or numbers.max() >= count):
        yield finding("unreal", "Skin", path, f"follows joint {numbers.max()} of {count}")
    elif np.abs(shares.reshape(points, each).sum(axis=1) - 1).max(initial=0) > 1e-4:
        yield finding("unreal", "Skin", path, "has weights that are not 1 together")


def _check_prim(prim: Usd.Prim, root: Usd.Prim, kind: str, joints: list[str]) -> Iterator[Finding]:
    path, schemas = prim.GetPath(), listed_schemas(prim)
    if ROOT_API in schemas and prim != root:
        yield finding("unreal", "Nested", path, "is an assembly in an assembly")
    imageable = UsdGeom.Imageable(prim)
    if imageable and imageable.GetVisibilityAttr().Get() == UsdGeom.Tokens.invisible:
        yield finding("unreal", "Visible", path, "is invisible, and so no part of the assembly")
    if EXTERNAL_API in schemas and not (
        prim.GetTypeName() == "Xform" and prim.GetAttribute("unreal:naniteAssembly:meshAssetPath").Get()
    ):
        yield finding("unreal", "ExternalRef", path, "is no Xform that names a mesh of Unreal")
    if not prim.IsA(UsdGeom.Gprim) and prim.GetTypeName() != "GeomSubset":
        binding = UsdShade.MaterialBindingAPI(prim)
        if binding.GetDirectBindingRel().GetTargets():
            yield finding("unreal", "Bindings", path, "is bound to a material, which is for meshes")
    instancer = UsdGeom.PointInstancer(prim)
    if instancer:
        yield from _check_parts(instancer, kind, set(joints))


def _check_parts(instancer: UsdGeom.PointInstancer, kind: str, joints: set[str]) -> Iterator[Finding]:
    prim, stage, path = instancer.GetPrim(), instancer.GetPrim().GetStage(), instancer.GetPath()
    targets = instancer.GetPrototypesRel().GetTargets()
    indices = np.array(instancer.GetProtoIndicesAttr().Get() or [])
    if not targets or not len(indices):
        yield finding("unreal", "Parts", path, "has no prototypes or no instances")
    elif indices.min() < 0 or indices.max() >= len(targets):
        yield finding("unreal", "Parts", path, f"names prototype {indices.max()} of {len(targets)}")
    for target in targets:
        below = list(Usd.PrimRange(stage.GetPrimAtPath(target))) if stage.GetPrimAtPath(target) else []
        if any(each.IsA(UsdGeom.PointInstancer) for each in below):
            yield finding("unreal", "Nested", target, "is a prototype with an instancer in it")
        meshes = [each for each in below if each.IsA(UsdGeom.Mesh)]
        skeletons = [each for each in below if each.IsA(UsdSkel.Skeleton) and UsdSkel.Root.Find(each)]
        if not meshes:
            yield finding("unreal", "PartMesh", target, "is a prototype without a mesh")
        elif kind == SKELETAL and len(skeletons) != 1:
            yield finding("unreal", "PartSkeleton", target, "is a prototype without a skeleton of its own")
        elif kind == SKELETAL:
            count = len(UsdSkel.Skeleton(skeletons[0]).GetJointsAttr().Get() or ())
            for mesh in meshes:
                yield from _check_skin(UsdGeom.Mesh(mesh), count)
    if kind != SKELETAL:
        return
    if BINDING_API not in listed_schemas(prim):
        yield finding("unreal", "PartBinding", path, f"has no {BINDING_API}")
        return
    primvars = UsdGeom.PrimvarsAPI(prim)
    bound, weights = primvars.GetPrimvar(BIND_JOINTS), primvars.GetPrimvar(BIND_WEIGHTS)
    tokens: list[Any] = list(bound.Get() or ()) if bound else []
    each = bound.GetElementSize() if bound else 1
    if not tokens or len(tokens) != each * len(indices):
        yield finding(
            "unreal", "PartBinding", path, f"has {len(tokens)} joints for {len(indices)} parts of {each} each"
        )
    unknown = sorted({str(token) for token in tokens} - joints)
    if unknown:
        yield finding("unreal", "PartBinding", path, f"follows {unknown[0]}, which is no joint of the assembly")
    shares = np.array(weights.Get() or []) if weights else np.array([])
    if len(shares) and (len(shares) != len(tokens) or weights.GetElementSize() != each):
        yield finding("unreal", "PartWeights", path, f"has {len(shares)} weights for {len(tokens)} joints")


def _check_wind(prim: Usd.Prim, names: list[str]) -> Iterator[Finding]:
    if WIND_API not in listed_schemas(prim):
        return
    path = prim.GetPath()

    def values(name: str) -> list[Any]:
        attribute = prim.GetAttribute(f"unreal:dynamicWind:{name}")
        return list(attribute.Get() or ()) if attribute else []

    joints, groups, influences = (
        values("jointNames"),
        values("jointSimulationGroups"),
        values("simulationGroupInfluences"),
    )
    if len(joints) != len(groups):
        yield finding("unreal", "WindJoints", path, f"has {len(groups)} groups of wind for {len(joints)} joints")
    if set(map(str, joints)) - set(names):
        yield finding("unreal", "WindJoints", path, "has wind for joints that it has not")
    if groups and not 0 <= min(groups) <= max(groups) < len(influences):
        yield finding("unreal", "WindGroups", path, f"names group {max(groups)} of {len(influences)}")
    if any(not 0 <= each <= 1 for each in [*influences, *values("simulationGroupShiftTops")]):
        yield finding("unreal", "WindInfluences", path, "has an influence that is not 0 to 1")
    if any(not 0 <= each < len(influences) for each in values("trunkSimulationGroups")):
        yield finding("unreal", "WindGroups", path, "names a group of the trunk that is not there")
