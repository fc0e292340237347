"""A small whole plant: a fork with branches of two orders, leaves on it, and a crown around them."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from pxr import Usd
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.packages.cards import AssetPictures
from usdfoliage.asset.packages.other_parts import find_other_parts
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.parts.branch_part import BranchAssetSettings
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.copied_parts import OtherParts
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAssetSettings
from usdfoliage.asset.provenance import Provenance
from usdfoliage.branch.cage.build import build_branch_cage
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.crown.model import CrownModel

from tests.support.branch_shapes import fork
from tests.support.crown_shapes import ellipsoid_radius
from tests.support.leaves.assets import random_leaves

RUN = Provenance(capture="fork.ply", generator="test", seed=0, input_sha256="")
CROWN_CENTER = (0.0, 2.0, 0.0)
CROWN_AXES = (6.0, 7.0, 6.0)  # half, around the leaves


def some_leaves(count: int = 6, *representations: str) -> BranchLeaves:
    """Leaves within some metres of the origin."""
    settings = LeafAssetSettings(representations=representations or ("bezier", "nurbs", "subdiv", "mesh"))
    return BranchLeaves(leaves=random_leaves(count), settings=settings)


@lru_cache
def round_crown(
    size: int = 8,
    axes_m: tuple[float, float, float] = CROWN_AXES,
    center_m: tuple[float, float, float] = CROWN_CENTER,
) -> CrownModel:
    """An ellipsoid, green."""
    return CrownModel(
        radius_m=ellipsoid_radius(axes_m, size).astype(np.float32),
        color=np.broadcast_to(np.array([0.1, 0.3, 0.05], np.float32), (6, size, size, 3)).copy(),
        center_m=np.array(center_m),
        relief_weight=0.0,
        asset_from_photo=np.eye(4),
    )


def fork_branches(folder: Path, name: str = "fork", at_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OtherParts:
    """The branches of an asset of a fork, which is written to folder: with a picture of bark, and two orders."""
    folder.mkdir(parents=True)
    bark = folder.parent / "bark.png"
    cv2.imwrite(str(bark), np.full((4, 4, 3), 90, np.uint8))
    skeleton = fork()
    skeleton = replace(skeleton, points_m=skeleton.points_m + at_m)
    interface = write_branch_asset(
        folder,
        name,
        SkeletonPrim(skeleton=skeleton),
        BranchSurfaces(whole=build_branch_cage(skeleton), by_order=((1, build_branch_cage(skeleton.up_to_order(1))),)),
        RUN,
        np.eye(4),
        BranchAssetSettings(texture=bark),
    )
    stage = Usd.Stage.Open(str(interface))
    parts = find_other_parts(stage.GetDefaultPrim(), interface)
    assert parts is not None
    return parts


def high_crown() -> CrownModel:
    """A ball of 0.6 m around the upper end of the fork's trunk: 1.4 m of it, and its branch, stand out."""
    return round_crown(8, (0.6, 0.6, 0.6), (0.0, 2.0, 0.0))


def write_whole_plant(
    folder: Path,
    name: str = "oak",
    *,
    leaves: bool = True,
    branches: bool = True,
    crown: bool | CrownModel = True,
    count: int = 6,
) -> Path:
    """The asset of the plant in folder, with a thumbnail; returns its interface layer."""
    folder.mkdir(parents=True)
    picture = folder.parent / f"{folder.name}_picture.png"
    cv2.imwrite(str(picture), np.full((8, 8, 3), 120, np.uint8))
    return write_plant_asset(
        folder,
        name,
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=fork_branches(folder.parent / f"{folder.name}_branches") if branches else None,
        foliage=some_leaves(count) if leaves else None,
        crown=(round_crown() if crown is True else crown) or None,
        pictures=AssetPictures(thumbnail=picture),
    )
