"""Leaves that repeat a few shapes: a PointInstancer whose prototypes are meshes of leaves."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from usdfoliage.asset.parts.leaf_gprims import author_leaf_mesh
from usdfoliage.asset.parts.leaves import set_places
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.groups import LeafGroups
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.mesh import LeafMesh, LeafMeshSettings, build_leaf_mesh

PROTOTYPES = "Prototypes"  # the Scope below the instancer

AuthorPrototype = Callable[[Usd.Stage, Sdf.Path, LeafMesh, tuple[float, float, float]], UsdGeom.Mesh]


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatedLeaves:
    """Leaves, each with the shape of one of a few."""

    leaves: Leaves  # in the plant's frame
    groups: LeafGroups
    color: tuple[float, float, float]  # of leaves without a colour of their own
    jitter: Jitter = NO_JITTER
    mesh: LeafMeshSettings = field(default_factory=LeafMeshSettings)


def author_repeated_leaves(
    stage: Usd.Stage,
    path: Sdf.Path,
    repeated: RepeatedLeaves,
    material: Sdf.Path,
    author_prototype: AuthorPrototype | None = None,
) -> UsdGeom.PointInstancer:
    """Define the leaves at path, with a prototype for each shape below it, in leaf space: the scale is the length.

    Args:
        author_prototype: Defines a prototype at a path, and returns the mesh in it; the mesh itself by default.
        material: Bound to every mesh; nothing is where the stage has none there.
    """
    leaves, groups = repeated.leaves, repeated.groups
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    set_places(instancer, leaves)
    instancer.CreateProtoIndicesAttr(Vt.IntArray.FromNumpy(groups.group))
    scope = path.AppendChild(PROTOTYPES)
    UsdGeom.Scope.Define(stage, scope)
    digits = len(str(max(len(groups) - 1, 0)))
    author = author_prototype or _author_mesh
    targets = []
    for number in range(len(groups)):
        prototype = scope.AppendChild(f"leaf_{number:0{digits}}")
        members = groups.group == number
        color = repeated.color
        if leaves.color is not None:
            red, green, blue = leaves.color[members].mean(axis=0).tolist()
            color = (red, green, blue)
        mesh = author(stage, prototype, _shape(repeated, int(groups.chosen[number])), color)
        if stage.GetPrimAtPath(material):
            binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
            binding.Bind(UsdShade.Material(stage.GetPrimAtPath(material)))
        targets.append(prototype)
    instancer.CreatePrototypesRel().SetTargets(targets)
    extent = instancer.ComputeExtentAtTime(Usd.TimeCode.Default(), Usd.TimeCode.Default()) if len(leaves) else None
    instancer.CreateExtentAttr(extent if extent is not None else [Gf.Vec3f(0), Gf.Vec3f(0)])
    return instancer


def _shape(repeated: RepeatedLeaves, number: int) -> LeafMesh:
    """The mesh of one leaf, in leaf space."""
    one = repeated.leaves.take([number])
    still: NDArray[np.float64] = np.array([[0.0, 0.0, 0.0, 1.0]])
    in_leaf_space = Leaves(
        parameters=one.parameters,
        base_m=np.zeros((1, 3)),
        orientation=still,
        length_m=np.ones(1),
        phase=one.phase,
    )
    return build_leaf_mesh(in_leaf_space, repeated.mesh, repeated.jitter)


def _author_mesh(stage: Usd.Stage, path: Sdf.Path, shape: LeafMesh, color: tuple[float, float, float]) -> UsdGeom.Mesh:
    return author_leaf_mesh(stage, path, shape, color)
