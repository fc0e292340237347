"""Assets of branches that move."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
from usdfoliage.asset.branch_package import BranchSurfaces, write_branch_asset
from usdfoliage.asset.branches import SkeletonPrim
from usdfoliage.asset.provenance import Provenance
from usdfoliage.branch.cage import build_branch_cage
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.branch_motion import BranchMotion, grow_branches, rig_branches

INTERNODE_M = 0.05


def surfaces_of(plant: Skeleton) -> BranchSurfaces:
    """All orders, and the first one."""
    return BranchSurfaces(whole=build_branch_cage(plant), by_order=((1, build_branch_cage(plant.up_to_order(1))),))


def write_moving(folder: Path, name: str, plant: Skeleton, motion: BranchMotion) -> Path:
    """An asset of a plant with what moves of it."""
    folder.mkdir(parents=True, exist_ok=True)
    surfaces = surfaces_of(plant)
    traced = SimpleNamespace(skeleton=plant, internode_m=INTERNODE_M, radii=SimpleNamespace(exponent=0.45))
    return write_branch_asset(
        folder,
        name,
        SkeletonPrim(skeleton=plant),
        surfaces,
        Provenance(capture="plant.ply", generator="test", seed=0, input_sha256=""),
        np.eye(4),
        rig=rig_branches(plant, surfaces, motion, seed=0),
        growth=grow_branches(traced, surfaces, motion),
    )
