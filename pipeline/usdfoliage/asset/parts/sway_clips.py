"""A sway as value clips: its samples in files of their own, which a shot loops, shifts and stretches.

A layer names the clip sets sway (joints) and leafSway (places of leaves) on the prim geo; for each, one file has the
samples of one loop, and another one the manifest. USD reads a sample once it is asked for. What the clips hold is below
/clip, whatever the plant is called, so that these files are copied as they are.

USD applies a clip only where the layer that names it has a spec of the prim: overs stand there for all that moves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from usdfoliage.asset.layer import FIRST_FRAME, export_layer, new_layer, save_layer
from usdfoliage.asset.look_layer import REPRESENTATION, each_variant
from usdfoliage.asset.parts.branch_rig import ANIMATION, BranchRig, joint_rotations
from usdfoliage.asset.parts.leaf_fallbacks import patch_paths
from usdfoliage.asset.parts.leaf_motion import (
    MAX_PATCHES,
    Box,
    DrawnLeaves,
    LeafMotion,
    author_moving_leaves,
    author_moving_patches,
)
from usdfoliage.asset.plant import LEAVES

RIG_CLIPS, LEAF_CLIPS = "rig_clips.usda", "rig_leaves_clips.usda"  # layers that name the clips
CLIP_ROOT = "clip"  # the root prim of the files with samples
LOOPS = 20  # of the sway, that the clips cover

_SETS = {RIG_CLIPS: "sway", LEAF_CLIPS: "leafSway"}
_FOLDER = "clips"  # of the payload's folder
_OF = "geo"  # below the root prim, which holds all that moves: in a native instance clips of its root do not count


def write_rig_clips(payload: Path, name: str, rigged: BranchRig) -> str:
    """Write the turning of a rig's joints as clips; returns the layer that names them, from the payload's folder."""
    assert rigged.sway_rad is not None

    def author(stage: Usd.Stage, root: Sdf.Path) -> None:
        assert rigged.sway_rad is not None
        rotations = stage.OverridePrim(root.AppendPath(ANIMATION)).CreateAttribute(
            "rotations", Sdf.ValueTypeNames.QuatfArray, custom=False
        )
        for frame, turn_rad in enumerate([*rigged.sway_rad, rigged.sway_rad[0]], FIRST_FRAME):
            rotations.Set(joint_rotations(rigged.rig, turn_rad), frame)

    return _write_clips(payload, name, RIG_CLIPS, rigged.frames, {"": [ANIMATION]}, author)


def write_leaf_clips(payload: Path, name: str, drawn: DrawnLeaves, motion: LeafMotion) -> tuple[str, list[Box]]:
    """Write where leaves are in a loop as clips; returns the layer that names them, and boxes around all frames.

    Only what has time samples of its own otherwise: bezier, and nurbs of few leaves. Meshes follow the joints.
    """
    closed = replace(motion, frames=motion.frames + 1, placed=lambda frame: motion.placed(frame % motion.frames))
    has_leaves = "bezier" in drawn.representations
    has_patches = "nurbs" in drawn.representations and len(drawn.leaves) <= MAX_PATCHES
    moved = {}
    if has_leaves:
        moved["bezier"] = [LEAVES]
    if has_patches:
        moved["nurbs"] = [str(path) for path in patch_paths(Sdf.Path(LEAVES), len(drawn.leaves))]
    boxes: list[Box] = []

    def author(stage: Usd.Stage, root: Sdf.Path) -> None:
        prim = root.AppendPath(LEAVES)
        if has_leaves:
            boxes.append(author_moving_leaves(UsdGeom.PointInstancer(stage.OverridePrim(prim)), drawn, closed))
        if has_patches:
            boxes.append(author_moving_patches(stage, prim, drawn, closed))

    return _write_clips(payload, name, LEAF_CLIPS, motion.frames, moved, author), boxes


def loop_times(frames: int, loops: int = LOOPS) -> Vt.Vec2dArray:
    """Times of the stage and of the clip: frames of the stage go through the clip again and again.

    The clip has one frame more than the loop, the first again, so that the last one is interpolated to it. Of two
    entries with the same time of the stage, USD takes the first one before that time, and the second from it on.
    """
    starts = FIRST_FRAME + frames * np.arange(loops, dtype=np.float64)
    first, after = np.full(loops, float(FIRST_FRAME)), np.full(loops, float(FIRST_FRAME + frames))
    times = np.stack([np.stack([starts, first], axis=1), np.stack([starts + frames, after], axis=1)], axis=1)
    return Vt.Vec2dArray.FromNumpy(np.ascontiguousarray(times.reshape(-1, 2)))


def clip_files(layer: str) -> tuple[str, str]:
    """The files with samples and manifest of a layer (RIG_CLIPS, LEAF_CLIPS), from the payload's folder."""
    stem = Path(layer).stem
    return f"{_FOLDER}/{stem}.usdc", f"{_FOLDER}/{stem}_manifest.usda"


def keep_own_clips(layer: Sdf.Layer, name: str, file: str, representations: Sequence[str]) -> None:
    """Make a copied layer (RIG_CLIPS, LEAF_CLIPS) name its own two files, whatever it named, and keep of the
    representations those that there are."""
    root = layer.GetPrimAtPath(f"/{name}")
    geometry = layer.GetPrimAtPath(f"/{name}/{_OF}")
    samples, manifest = clip_files(file)
    clips = {} if geometry is None else dict(geometry.GetInfo("clips"))
    entry = dict(clips.get(_SETS[file], {}))
    entry["assetPaths"] = Sdf.AssetPathArray([Sdf.AssetPath(f"./{samples}")])
    entry["manifestAssetPath"] = Sdf.AssetPath(f"./{manifest}")
    if geometry is not None:
        geometry.SetInfo("clips", {_SETS[file]: entry})
    if root is not None and REPRESENTATION in root.variantSets:
        variants = root.variantSets[REPRESENTATION]
        for gone in [variant for each, variant in variants.variants.items() if each not in representations]:
            variants.RemoveVariant(gone)


def _write_clips(
    payload: Path,
    name: str,
    layer: str,
    frames: int,
    moved: Mapping[str, Sequence[str]],
    author: Callable[[Usd.Stage, Sdf.Path], None],
) -> str:
    """Write the samples that author makes, their manifest, and the layer that names both.

    moved are the prims by representation, "" for those of all: an over where there is no such prim is a fault.
    """
    (payload / _FOLDER).mkdir(exist_ok=True)
    samples, manifest = clip_files(layer)
    stage = new_layer(payload / samples, CLIP_ROOT)
    author(stage, Sdf.Path(f"/{CLIP_ROOT}"))
    export_layer(stage, payload / samples)
    declared = Usd.ClipsAPI.GenerateClipManifestFromLayers([stage.GetRootLayer()], Sdf.Path(f"/{CLIP_ROOT}"))
    save_layer(declared, payload / manifest)

    named = new_layer(payload / layer, name)
    root = named.GetDefaultPrim()
    for prim in moved.get("", ()):
        named.OverridePrim(root.GetPath().AppendPath(prim))
    representations = [each for each in moved if each]
    if representations:
        for representation in each_variant(named, root.GetPath(), REPRESENTATION, representations):
            for prim in moved[representation]:
                named.OverridePrim(root.GetPath().AppendPath(prim))
    clips, which = Usd.ClipsAPI(named.OverridePrim(root.GetPath().AppendPath(_OF))), _SETS[layer]
    clips.SetClipAssetPaths([Sdf.AssetPath(f"./{samples}")], which)
    clips.SetClipManifestAssetPath(Sdf.AssetPath(f"./{manifest}"), which)
    clips.SetClipPrimPath(f"/{CLIP_ROOT}/{_OF}", which)
    clips.SetClipActive(Vt.Vec2dArray([(FIRST_FRAME, 0)]), which)
    clips.SetClipTimes(loop_times(frames), which)
    export_layer(named, payload / layer)
    return f"./{layer}"
