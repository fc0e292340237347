"""Assets of branches that move."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.provenance import Provenance
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.foliage.species import load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.jobs.branches.foliage import FoliageRequest, GrownLeaves, grow_leaves
from usdfoliage.jobs.branches.motion import BranchMotion, grow_branches, rig_branches, rig_grown_leaves

INTERNODE_M = 0.05


def surfaces_of(plant: Skeleton) -> BranchSurfaces:
    """All orders, and the first one."""
    return BranchSurfaces(whole=build_branch_cage(plant), by_order=((1, build_branch_cage(plant.up_to_order(1))),))


def leaves_on(plant: Skeleton, *representations: str, seed: int = 0) -> GrownLeaves:
    """Leaves on the twigs of a plant, in bezier alone if no representation is given."""
    species = replace(load_species("maple"), twig_radius_m=0.03, internode_m=0.1)
    request = FoliageRequest(kind="template", species=species, representations=representations or ("bezier",))
    grown = grow_leaves(plant, request, None, seed)
    assert grown is not None
    return grown


def write_moving(
    folder: Path, name: str, plant: Skeleton, motion: BranchMotion, grown: GrownLeaves | None = None
) -> Path:
    """An asset of a plant, and leaves, with what moves of it."""
    folder.mkdir(parents=True, exist_ok=True)
    surfaces = surfaces_of(plant)
    traced = SimpleNamespace(skeleton=plant, internode_m=INTERNODE_M, radii=SimpleNamespace(exponent=0.45))
    rig = rig_branches(plant, surfaces, motion, seed=0)
    return write_branch_asset(
        folder,
        name,
        SkeletonPrim(skeleton=plant),
        surfaces,
        Provenance(capture="plant.ply", generator="test", seed=0, input_sha256=""),
        np.eye(4),
        foliage=grown.foliage if grown else None,
        rig=rig,
        growth=grow_branches(traced, surfaces, motion, grown),
        rigged_leaves=rig_grown_leaves(rig, grown),
    )
