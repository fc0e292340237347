"""What moves in an asset of branches, where it is asked for: a rig, its sway, and growth."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.parts.branch_growth import BranchGrowth
from usdfoliage.asset.parts.branch_part import ALL_ORDERS
from usdfoliage.asset.parts.branch_rig import BranchRig
from usdfoliage.asset.parts.leaf_motion import LeafMotion, RiggedLeaves
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.axis_places import Places, nearest_places, places_at
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.motion.growth_stages import (
    GrowthStages,
    carry_points,
    carry_surface,
    grow_skeleton,
    grow_surface,
    plan_stages,
)
from usdfoliage.branch.motion.growth_times import GrowthStageSettings
from usdfoliage.branch.motion.leaf_motion import carry_leaves, sway_leaves
from usdfoliage.branch.motion.rig import RigSettings, build_rig, skin_places
from usdfoliage.branch.motion.skinning import pose_joints, skin_points
from usdfoliage.branch.motion.surface_places import cage_exits, cage_places
from usdfoliage.branch.motion.sway import SwaySettings, sway_joints
from usdfoliage.branch.tracing.reconstruct import TracedBranches
from usdfoliage.jobs.branches.foliage import GrownLeaves
from usdfoliage.leaf.model import Leaves

_SAMPLES_A_LEAF = 4  # of axes, in the length of a leaf, where the branch next to its base is looked for


@dataclass(frozen=True, kw_only=True)
class BranchMotion:
    """What was asked for."""

    rig: RigSettings | None = None
    sway: SwaySettings | None = None  # of the rig
    sway_clips: bool = False  # the sway is written as value clips, no time samples
    growth_frames: int = 0

    def describe(self) -> dict[str, str]:
        """Settings by the names of their options; nothing of what was not asked for."""
        described = {}
        if self.rig is not None:
            described["rig-order"] = str(self.rig.order)
        if self.sway is not None:
            described["sway"] = str(self.sway.frames)
            if self.sway_clips:
                described["sway-clips"] = "on"
        if self.growth_frames:
            described["growth"] = str(self.growth_frames)
        return described


def rig_branches(skeleton: Skeleton, surfaces: BranchSurfaces, motion: BranchMotion, seed: int) -> BranchRig | None:
    """The rig of all surfaces, None where it was not asked for."""
    if motion.rig is None:
        return None
    drawn = np.isin(np.arange(len(skeleton)), surfaces.whole.curve)
    rig = build_rig(skeleton, motion.rig, cage_exits(surfaces.whole, skeleton), drawn)
    skins = {}
    for variant, cage in _each_surface(skeleton, surfaces):
        places = cage_places(cage, skeleton)
        skins[variant] = skin_places(rig, places.curve, places.arc_m)
    low_m, high_m = surfaces.whole.points_m.min(axis=0), surfaces.whole.points_m.max(axis=0)
    sway_rad = None
    if motion.sway is not None:
        sway_rad = sway_joints(rig, skeleton, np.random.default_rng(seed), motion.sway)
        for turn_rad in sway_rad:
            points_m = skin_points(rig, skins[ALL_ORDERS], surfaces.whole.points_m, pose_joints(rig, turn_rad))
            low_m, high_m = np.minimum(low_m, points_m.min(axis=0)), np.maximum(high_m, points_m.max(axis=0))
    return BranchRig(
        rig=rig,
        skins=skins,
        extent_m=np.stack([low_m, high_m]),
        sway_rad=sway_rad,
        has_clips=sway_rad is not None and motion.sway_clips,
    )


def rig_grown_leaves(rigged: BranchRig | None, grown: GrownLeaves | None) -> RiggedLeaves | None:
    """rig_leaves for leaves on twigs; None without a rig or leaves."""
    if rigged is None or grown is None:
        return None
    return rig_leaves(rigged, grown.foliage.leaves, grown.places.branch, grown.places.arc_m)


def rig_leaves(
    rigged: BranchRig, leaves: Leaves, branch: NDArray[np.integer], arc_m: NDArray[np.float64]
) -> RiggedLeaves:
    """How leaves follow the rig of their branches, and where they are in its sway.

    Args:
        rigged: The branches.
        leaves: (N,), at rest.
        branch: (N,), which branch each follows.
        arc_m: (N,), at which length along it, in metres.
    """
    rig, sway_rad = rigged.rig, rigged.sway_rad
    skin = skin_places(rig, branch, arc_m)
    if sway_rad is None:
        return RiggedLeaves(skin=skin)

    def placed(frame: int) -> Leaves:
        posed = pose_joints(rig, sway_rad[frame])
        base_m, orientation = sway_leaves(rig, skin, leaves.base_m, leaves.orientation, posed)
        return replace(leaves, base_m=base_m, orientation=orientation)

    return RiggedLeaves(skin=skin, motion=LeafMotion(frames=len(sway_rad), placed=placed))


def rig_near_leaves(rigged: BranchRig, skeleton: Skeleton, leaves: Leaves, drawn: NDArray[np.integer]) -> RiggedLeaves:
    """rig_leaves for leaves that were found: each follows the branch whose bark is nearest to its base.

    Args:
        rigged: The branches.
        skeleton: Theirs.
        leaves: (N,), at least one, at rest.
        drawn: Branches that the surface shows.
    """
    places = _near_places(skeleton, leaves, drawn)
    return rig_leaves(rigged, leaves, places.curve, places.arc_m)


def _near_places(skeleton: Skeleton, leaves: Leaves, drawn: NDArray[np.integer]) -> Places:
    apart_m = float(np.median(leaves.length_m)) / _SAMPLES_A_LEAF
    return nearest_places(skeleton, leaves.base_m, drawn, apart_m)


def grow_branches(
    traced: TracedBranches, surfaces: BranchSurfaces, motion: BranchMotion, grown: GrownLeaves | None = None
) -> BranchGrowth | None:
    """The frames of the growth, made as they are gone through; None where it was not asked for."""
    if not motion.growth_frames:
        return None
    leaves = None if grown is None else grown.foliage.leaves
    places = None if grown is None else places_at(traced.skeleton, grown.places.branch, grown.places.arc_m)
    exponent = traced.radii.exponent
    return _grow(traced.skeleton, surfaces, motion, traced.internode_m, exponent, leaves, places)


def grow_near_leaves(
    skeleton: Skeleton,
    surfaces: BranchSurfaces,
    motion: BranchMotion,
    internode_m: float,
    exponent: float,
    leaves: Leaves | None,
) -> BranchGrowth:
    """The frames of the growth, with leaves that were found: each goes with the branch whose bark is nearest to it.

    Args:
        skeleton: The branches.
        surfaces: Theirs.
        motion: What was asked for, with frames of growth.
        internode_m: Length of an internode.
        exponent: Of the allometry.
        leaves: (N,), at least one, full-grown; None for none.
    """
    places = None
    if leaves is not None:
        places = _near_places(skeleton, leaves, np.unique(surfaces.whole.curve))
    return _grow(skeleton, surfaces, motion, internode_m, exponent, leaves, places)


def _grow(
    skeleton: Skeleton,
    surfaces: BranchSurfaces,
    motion: BranchMotion,
    internode_m: float,
    exponent: float,
    leaves: Leaves | None,
    places: Places | None,
) -> BranchGrowth:
    settings = GrowthStageSettings()
    if 0 < exponent <= 2:
        settings = replace(settings, allometry=AllometrySettings(exponent=exponent))
    stages = plan_stages(skeleton, internode_m, motion.growth_frames, settings)
    moves = None
    if leaves is not None and places is not None:
        moves = _grow_leaves(stages, surfaces.whole, leaves, places)
    return BranchGrowth(
        frames=len(stages),
        skeleton=(grow_skeleton(stages, stage) for stage in range(len(stages))),
        surfaces={variant: _grow_surface(stages, cage) for variant, cage in _each_surface(skeleton, surfaces)},
        leaves=moves,
    )


def _grow_leaves(stages: GrowthStages, cage: BranchCage, leaves: Leaves, places: Places) -> LeafMotion:
    carried = carry_points(cage, stages.skeleton, leaves.base_m, places)

    def placed(frame: int) -> Leaves:
        base_m, share = carry_leaves(stages, frame, carried)
        return replace(leaves, base_m=base_m, length_m=share * leaves.length_m)

    return LeafMotion(frames=len(stages), placed=placed)


def _grow_surface(stages: GrowthStages, cage: BranchCage) -> Iterator[NDArray[np.float64]]:
    surface = carry_surface(cage, stages.skeleton)
    return (grow_surface(stages, stage, surface) for stage in range(len(stages)))


def _each_surface(skeleton: Skeleton, surfaces: BranchSurfaces) -> Iterator[tuple[str, BranchCage]]:
    """Every variant of the set branches and its cage, whose branches are numbered as in the whole skeleton."""
    yield ALL_ORDERS, surfaces.whole
    for order, cage in surfaces.by_order:
        numbers = np.flatnonzero(skeleton.order <= order).astype(np.int32)
        yield f"order{order}", replace(cage, curve=numbers[cage.curve])
