"""UsdValidation validators of the usdFoliage schemas and of the layout of an asset.

USD imports this package when it first needs one of the validators that plugInfo.json announces.
"""

from pxr import UsdValidation

from usdFoliageValidators.asset import (
    check_asset_bounds,
    check_asset_interface,
    check_asset_paths,
    check_asset_purposes,
)
from usdFoliageValidators.crown import check_crown, check_crown_files
from usdFoliageValidators.forest import check_forest
from usdFoliageValidators.guides import but_guide_copies
from usdFoliageValidators.leaf import check_leaf_arrays, check_leaf_orientations
from usdFoliageValidators.leaf_edits import check_leaf_edits
from usdFoliageValidators.leaf_patch import check_leaf_patch
from usdFoliageValidators.leaf_prototype import check_leaf_prototype
from usdFoliageValidators.leaf_shape import check_leaf_shape
from usdFoliageValidators.lobed import check_lobed_leaf
from usdFoliageValidators.lods import check_asset_collections, check_asset_lods
from usdFoliageValidators.plant import check_plant
from usdFoliageValidators.skeleton import check_skeleton

PRIM_VALIDATORS = {
    "Plant": check_plant,
    "LeafArrays": but_guide_copies(check_leaf_arrays),
    "LeafOrientations": but_guide_copies(check_leaf_orientations),
    "LeafPrototype": but_guide_copies(check_leaf_prototype),
    "LeafPatch": but_guide_copies(check_leaf_patch),
    "LeafEdits": but_guide_copies(check_leaf_edits),
    "LobedLeaf": check_lobed_leaf,
    "Skeleton": check_skeleton,
    "Crown": check_crown,
    "CrownFiles": check_crown_files,
    "Forest": check_forest,
}
STAGE_VALIDATORS = {
    "LeafShape": check_leaf_shape,
    "AssetInterface": check_asset_interface,
    "AssetPaths": check_asset_paths,
    "AssetBounds": check_asset_bounds,
    "AssetPurposes": check_asset_purposes,
    "AssetLods": check_asset_lods,
    "AssetCollections": check_asset_collections,
}

_registry = UsdValidation.ValidationRegistry()
for _name, _check in PRIM_VALIDATORS.items():
    _registry.RegisterPluginPrimValidator(f"usdFoliageValidators:{_name}", _check)
for _name, _check in STAGE_VALIDATORS.items():
    _registry.RegisterPluginStageValidator(f"usdFoliageValidators:{_name}", _check)
