"""Leaves that follow their branches in USD: time samples or joints over the layers of leaves, in layers of their own.

They go over those of the leaves in a variant of the sets growth and rig, and have the set representation again, since
each shows leaves by other prims. Like the branches', they hold no values but those of their frames.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import FIRST_FRAME, author_frames, export_layer, new_layer
from usdfoliage.asset.look_layer import each_variant
from usdfoliage.asset.parts.branch_rig import JOINTS, author_skin
from usdfoliage.asset.parts.hero_leaf import patch_matrices, patch_nets
from usdfoliage.asset.parts.leaf_fallbacks import patch_paths
from usdfoliage.asset.parts.leaf_gprims import outward_corners
from usdfoliage.asset.parts.leaves import PLACE, edited_leaves, set_places
from usdfoliage.asset.plant import LEAVES, box_around
from usdfoliage.branch.motion.rig import Skin
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.bounds import leaf_bounds_m
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter

GROWTH_LEAVES, RIG_LEAVES = "growth_leaves.usdc", "rig_leaves.usdc"
MAX_PATCHES = 2000  # that get time samples: each is a prim
_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)

Box = NDArray[np.float64]  # (2, 3), smallest and largest corner


@dataclass(frozen=True, kw_only=True, eq=False)
class LeafMotion:
    """Leaves in each of T frames."""

    frames: int  # T
    placed: Callable[[int], Leaves]  # called with a frame, from 0 on; an array that never changes is the same object


@dataclass(frozen=True, kw_only=True, eq=False)
class RiggedLeaves:
    """Leaves that follow joints."""

    skin: Skin  # of their places
    motion: LeafMotion | None = None  # in the animation of the rig


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnLeaves:
    """The leaves that an asset's layers show."""

    leaves: Leaves
    surface_points: Callable[[str], NDArray[np.float32]]  # (P, 3) of the representation mesh or subdiv, leaf by leaf
    representations: Sequence[str]
    edits: LeafEdits = NEUTRAL
    jitter: Jitter = NO_JITTER


def write_leaf_growth_layer(path: Path, name: str, drawn: DrawnLeaves, motion: LeafMotion) -> Box:
    """Write leaves that grow; returns a box around them in all frames.

    bezier and nurbs have every leaf's place and length in every frame; what is one prim for all leaves, or too many, is
    shown in the last frame alone.
    """
    stage = new_layer(path, name)
    author_frames(stage, motion.frames)
    prim = Sdf.Path(f"/{name}/{LEAVES}")
    boxes = []
    for representation in each_variant(stage, prim.GetPrefixes()[0], "representation", list(drawn.representations)):
        if representation == "bezier":
            boxes.append(author_moving_leaves(UsdGeom.PointInstancer(stage.OverridePrim(prim)), drawn, motion))
        elif representation == "nurbs" and len(drawn.leaves) <= MAX_PATCHES:
            boxes.append(author_moving_patches(stage, prim, drawn, motion))
        else:
            visibility = UsdGeom.Imageable(stage.OverridePrim(prim)).CreateVisibilityAttr()
            visibility.Set(UsdGeom.Tokens.invisible, FIRST_FRAME)
            visibility.Set(UsdGeom.Tokens.inherited, FIRST_FRAME + motion.frames - 1)
    export_layer(stage, path)
    return box_around(boxes) if boxes else leaf_bounds_m(_edited(drawn, drawn.leaves), drawn.jitter)


def write_leaf_rig_layer(
    path: Path, name: str, drawn: DrawnLeaves, rigged: RiggedLeaves, *, has_samples: bool = True
) -> Box:
    """Write leaves that follow joints; returns a box around them in all frames of the animation.

    mesh and subdiv are bound to the joints, all points of a leaf with the same weights. No renderer skins an instancer,
    or patches: they have time samples of the animation, where there is one; too many patches stay.

    Args:
        path: Of the layer.
        name: Of the root prim.
        drawn: The leaves.
        rigged: How they follow.
        has_samples: False leaves out the time samples, where value clips hold them.
    """
    stage = new_layer(path, name)
    motion = rigged.motion
    if motion is not None:
        author_frames(stage, motion.frames)
    root = Sdf.Path(f"/{name}")
    prim = root.AppendPath(LEAVES)
    boxes = [leaf_bounds_m(_edited(drawn, drawn.leaves), drawn.jitter)]
    for representation in each_variant(stage, root, "representation", list(drawn.representations)):
        if representation in ("mesh", "subdiv"):
            points_m = drawn.surface_points(representation).astype(np.float64).reshape(len(drawn.leaves), -1, 3)
            skin = Skin(
                joints=np.repeat(rigged.skin.joints, points_m.shape[1], axis=0),
                weights=np.repeat(rigged.skin.weights, points_m.shape[1], axis=0),
            )
            author_skin(stage.OverridePrim(prim), root.AppendPath(JOINTS), skin)
            if motion is not None:
                boxes.append(_within_reach(points_m, drawn.leaves, motion))
        elif motion is None or not has_samples:
            continue
        elif representation == "bezier":
            boxes.append(author_moving_leaves(UsdGeom.PointInstancer(stage.OverridePrim(prim)), drawn, motion))
        elif len(drawn.leaves) <= MAX_PATCHES:
            boxes.append(author_moving_patches(stage, prim, drawn, motion))
    export_layer(stage, path)
    return box_around(boxes)


def author_moving_leaves(instancer: UsdGeom.PointInstancer, drawn: DrawnLeaves, motion: LeafMotion) -> Box:
    """What moves of an instancer's leaves, and its extent, in every frame; returns a box around all."""
    boxes = []
    for frame in range(motion.frames):
        placed = motion.placed(frame)
        moved = [name for name in PLACE if _moves(placed, drawn.leaves, name)]
        set_places(instancer, placed, moved, FIRST_FRAME + frame)
        boxes.append(leaf_bounds_m(_edited(drawn, placed), drawn.jitter))
        instancer.CreateExtentAttr().Set(outward_corners(boxes[-1]), FIRST_FRAME + frame)
    return box_around(boxes)


def author_moving_patches(stage: Usd.Stage, path: Sdf.Path, drawn: DrawnLeaves, motion: LeafMotion) -> Box:
    """The matrices of the patches of leaves below path in every frame; returns a box around them, as USD has it."""
    target = stage.GetEditTarget()
    layer, edited = target.GetLayer(), _edited(drawn, drawn.leaves)
    nets = patch_nets(edited, drawn.jitter)
    low, high = nets.min(axis=1), nets.max(axis=1)
    corners = low[:, None] + _CORNERS * (high - low)[:, None]
    boxes = []
    with Sdf.ChangeBlock():
        samples = []
        for patch in patch_paths(path, len(drawn.leaves)):
            spec = Sdf.CreatePrimInLayer(layer, target.MapToSpecPath(patch))
            samples.append(Sdf.AttributeSpec(spec, "xformOp:transform", Sdf.ValueTypeNames.Matrix4d).path)
        for frame in range(motion.frames):
            matrices = patch_matrices(motion.placed(frame))
            for attribute, matrix in zip(samples, matrices, strict=True):
                layer.SetTimeSample(attribute, FIRST_FRAME + frame, matrix)
            rows = np.array(matrices)
            moved_m = np.einsum("nkr,nrc->nkc", corners, rows[:, :3, :3]) + rows[:, None, 3, :3]
            boxes.append(np.stack([moved_m.min(axis=(0, 1)), moved_m.max(axis=(0, 1))]))
    return box_around(boxes)


def adapt_leaf_motion(layer: Sdf.Layer, name: str, drawn: DrawnLeaves) -> list[Box]:
    """Make a layer of leaves that move, that were as these are but for their shape, one of these.

    It keeps the representations that there are, and the extents of an instancer become those of these leaves.

    Returns:
        These extents (2, 3), a frame each.
    """
    variants = layer.GetPrimAtPath(f"/{name}").variantSets["representation"]
    for gone in [variant for each, variant in variants.variants.items() if each not in drawn.representations]:
        variants.RemoveVariant(gone)
    prim = Sdf.Path(f"/{name}").AppendVariantSelection("representation", "bezier").AppendPath(LEAVES)
    return adapt_moving_leaves(layer, prim, drawn)


def adapt_moving_leaves(layer: Sdf.Layer, prim: Sdf.Path, drawn: DrawnLeaves) -> list[Box]:
    """Make the extents of the instancer at prim, in every frame, those of these leaves; returns them (2, 3)."""
    boxes = []
    extent = prim.AppendProperty("extent")

    def at(field: str, time: float, still: NDArray[np.float64]) -> NDArray[np.float64]:
        sample = layer.QueryTimeSample(prim.AppendProperty(field), time)
        return still if sample is None else np.array(sample, np.float64)

    for time in layer.ListTimeSamplesForPath(extent):
        leaves = drawn.leaves
        placed = replace(
            leaves,
            base_m=at("positions", time, leaves.base_m),
            length_m=at("scales", time, leaves.length_m[:, None])[:, 0],
            orientation=at("orientationsf", time, leaves.orientation),
        )
        boxes.append(leaf_bounds_m(_edited(drawn, placed), drawn.jitter))
        layer.SetTimeSample(extent, time, Vt.Vec3fArray(outward_corners(boxes[-1])))
    return boxes


def _moves(placed: Leaves, still: Leaves, name: str) -> bool:
    return getattr(placed, name) is not getattr(still, name)


def _edited(drawn: DrawnLeaves, placed: Leaves) -> Leaves:
    """Leaves in a frame as they are shown."""
    return edited_leaves(placed, drawn.edits)


def _within_reach(points_m: NDArray[np.float64], leaves: Leaves, motion: LeafMotion) -> Box:
    """A box around leaves of points (N, P, 3): a mean of turns takes none farther from its base than it is."""
    away_m = np.linalg.norm(points_m - leaves.base_m[:, None], axis=2).max(axis=1, keepdims=True) * (1 + 1e-6)
    boxes = []
    for frame in range(motion.frames):
        base_m = motion.placed(frame).base_m
        boxes.append(np.stack([(base_m - away_m).min(axis=0), (base_m + away_m).max(axis=0)]))
    return box_around(boxes)
