"""A rig of branches in USD: UsdSkel joints, the branch surface bound to them, and an animation, in a layer of its own.

The layer goes over those of the branches in a variant: it makes the Scope geo/render a SkelRoot, which then holds the
surface and the joints. Not geo: USD takes the bounds of a SkelRoot for all that is below, and there the guides are. The
set that chooses among surfaces is there again, for each has points of its own to be bound.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from usdfoliage.asset.layer import FIRST_FRAME, author_frames, author_scopes, export_layer, new_layer
from usdfoliage.asset.look_layer import each_variant
from usdfoliage.asset.plant import BRANCHES
from usdfoliage.branch.motion.rig import Rig, Skin

SKEL_ROOT = "geo/render"
RIG = f"{SKEL_ROOT}/Rig"  # a Scope, no guide: Blender leaves guides out, and the surface without its joints
JOINTS = f"{RIG}/Joints"
ANIMATION = f"{RIG}/Animation"


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchRig:
    """Joints, and the surfaces that follow them."""

    rig: Rig
    skins: Mapping[str, Skin]  # by variant of the set branches, of the points of that surface
    extent_m: NDArray[np.float64]  # (2, 3), of what follows, in every frame
    sway_rad: NDArray[np.float64] | None = None  # (T, J, 3), rotation vectors in the joints' frames; None: at rest
    has_clips: bool = False  # the sway is written as value clips, no time samples

    @property
    def frames(self) -> int:
        return 0 if self.sway_rad is None else len(self.sway_rad)


def write_rig_layer(path: Path, name: str, rigged: BranchRig, extent_m: NDArray[np.float64]) -> None:
    """Write joints, their animation and how the surfaces follow them; extent_m (2, 3) of all below geo/render."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    if rigged.frames:
        author_frames(stage, rigged.frames)
    author_scopes(stage, root.AppendPath(SKEL_ROOT).GetParentPath())
    skel_root = UsdSkel.Root.Define(stage, root.AppendPath(SKEL_ROOT))
    skel_root.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent_m.astype(np.float32)))
    UsdGeom.Scope.Define(stage, root.AppendPath(RIG))
    joints = author_joints(stage, root.AppendPath(JOINTS), rigged.rig)
    author_animation(stage, root.AppendPath(ANIMATION), rigged.rig, None if rigged.has_clips else rigged.sway_rad)
    source = UsdSkel.BindingAPI.Apply(joints.GetPrim()).CreateAnimationSourceRel()
    source.SetTargets([root.AppendPath(ANIMATION)])
    for variant in each_variant(stage, root, "branches", list(rigged.skins)):
        surface = stage.OverridePrim(root.AppendPath(BRANCHES))
        author_skin(surface, root.AppendPath(JOINTS), rigged.skins[variant])
    export_layer(stage, path)


def joint_names(rig: Rig) -> list[str]:
    """Paths of the joints, each below its parent's: branch_0/branch_7, by the number of the curve."""
    names: list[str] = []
    for curve, parent in zip(rig.curve.tolist(), rig.parent.tolist(), strict=True):
        names.append(f"{names[parent]}/branch_{curve}" if parent >= 0 else f"branch_{curve}")
    return names


def author_joints(stage: Usd.Stage, path: Sdf.Path, rig: Rig) -> UsdSkel.Skeleton:
    """Define the joints at path."""
    return author_joints_at(stage, path, joint_names(rig), rig.bind, rig.rest)


def author_joints_at(
    stage: Usd.Stage, path: Sdf.Path, joints: Sequence[str], bind: NDArray[np.float64], rest: NDArray[np.float64]
) -> UsdSkel.Skeleton:
    """Define joints at path: their paths, and matrices (J, 4, 4) as Rig.bind and Rig.rest have them."""
    skeleton = UsdSkel.Skeleton.Define(stage, path)
    skeleton.CreateJointsAttr(list(joints))
    skeleton.CreateBindTransformsAttr(_matrices(bind))
    skeleton.CreateRestTransformsAttr(_matrices(rest))
    return skeleton


def author_animation(
    stage: Usd.Stage, path: Sdf.Path, rig: Rig, sway_rad: NDArray[np.float64] | None
) -> UsdSkel.Animation:
    """Define an animation of all joints at path: the pose of rest, and time samples of turning where there are any."""
    animation = UsdSkel.Animation.Define(stage, path)
    animation.CreateJointsAttr(joint_names(rig))
    rest = rig.rest
    animation.CreateTranslationsAttr(Vt.Vec3fArray.FromNumpy(rest[:, :3, 3].astype(np.float32)))
    animation.CreateScalesAttr(Vt.Vec3hArray(len(rig), Gf.Vec3h(1)))
    rotations = animation.CreateRotationsAttr(_quaternions(rest[:, :3, :3]))
    if sway_rad is not None:
        for frame, turn in enumerate(sway_rad, FIRST_FRAME):
            rotations.Set(joint_rotations(rig, turn), frame)
    return animation


def joint_rotations(rig: Rig, turn_rad: NDArray[np.float64]) -> Vt.QuatfArray:
    """The rotations of an animation, of joints that are turned by rotation vectors (J, 3) in their own frames."""
    return _quaternions(rig.rest[:, :3, :3] @ _rotations(turn_rad))


def author_skin(surface: Usd.Prim, joints: Sdf.Path, skin: Skin) -> None:
    """Bind the points of a surface to joints."""
    binding = UsdSkel.BindingAPI.Apply(surface)
    binding.CreateSkeletonRel().SetTargets([joints])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
    each = skin.joints.shape[1]
    indices = binding.CreateJointIndicesPrimvar(constant=False, elementSize=each)
    indices.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(skin.joints, np.int32).ravel()))
    weights = binding.CreateJointWeightsPrimvar(constant=False, elementSize=each)
    weights.Set(Vt.FloatArray.FromNumpy(skin.weights.astype(np.float32).ravel()))


def _matrices(columns: NDArray[np.float64]) -> Vt.Matrix4dArray:
    """Matrices (J, 4, 4) for column vectors, as USD has them."""
    return Vt.Matrix4dArray.FromNumpy(np.ascontiguousarray(columns.transpose(0, 2, 1)))


def _quaternions(turns: NDArray[np.float64]) -> Vt.QuatfArray:
    """Rotations (J, 3, 3) for column vectors."""
    xyzw = scipy.spatial.transform.Rotation.from_matrix(turns).as_quat(canonical=True)
    return Vt.QuatfArray([Gf.Quatf(float(w), float(x), float(y), float(z)) for x, y, z, w in xyzw])


def _rotations(turn_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(turn_rad).as_matrix())
