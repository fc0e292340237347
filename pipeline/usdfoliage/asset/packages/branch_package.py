"""A whole asset of branches: their skeleton, their surface by order, and leaves on their twigs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.parts.branch_growth import BranchGrowth
from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches, write_branch_part
from usdfoliage.asset.parts.branch_rig import BranchRig
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_motion import RiggedLeaves
from usdfoliage.asset.parts.leaf_part import BranchLeaves, drawn_leaves, write_leaf_part
from usdfoliage.asset.parts.part import Part
from usdfoliage.asset.provenance import Provenance
from usdfoliage.branch.cage.surfaces import BranchSurfaces


def write_branch_asset(
    folder: Path,
    name: str,
    skeleton: SkeletonPrim,
    surfaces: BranchSurfaces,
    provenance: Provenance,
    asset_from_capture: NDArray[np.float64],
    settings: BranchAssetSettings = BranchAssetSettings(),
    foliage: BranchLeaves | None = None,
    rig: BranchRig | None = None,
    growth: BranchGrowth | None = None,
    rigged_leaves: RiggedLeaves | None = None,
) -> Path:
    """Write an asset of branches, inside publish_folder as usdfoliage.asset.packages.leaf_package.write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        skeleton: Of all branches.
        surfaces: The variants of the set branches.
        provenance: The run that made it.
        asset_from_capture: (4, 4) for column vectors.
        settings: Bark, and the asset's version.
        foliage: Leaves on them, None for none.
        rig: Joints, for a variant set rig.
        growth: Frames of the growth, for a variant set growth.
        rigged_leaves: How the leaves follow the joints, for the same set as the rig.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, the settings are not those of any bark, or the leaves have numbers that are
            no leaves.
        CaptureError: The jitter map of the leaves cannot be used.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    place = begin_asset(folder, name)
    leaves: list[Part] = []
    drawn = None
    if foliage is not None:
        leaves.append(write_leaf_part(place, foliage))
        if len(foliage.leaves):
            drawn = drawn_leaves(foliage)
        else:  # their prims are at the origin, wherever the branches are
            leaves = [replace(part, near_m=(), guides_m=()) for part in leaves]
    branches = PlantBranches(
        skeleton=skeleton,
        surfaces=surfaces,
        settings=settings,
        rig=rig,
        growth=growth,
        rigged_leaves=rigged_leaves,
    )
    origin = Origin(provenance=provenance, asset_from_capture=asset_from_capture, version=settings.version)
    return write_asset(place, [*leaves, write_branch_part(place, branches, drawn)], origin)
