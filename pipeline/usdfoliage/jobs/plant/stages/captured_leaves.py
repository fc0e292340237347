"""The leaves that were found in photographs, as the asset of their stage holds them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.packages.contents import interface_of, read_plant_facts, require_plant
from usdfoliage.errors import AssetError
from usdfoliage.jobs.branches.foliage import FITTED, FittedLeaves, FoliageRequest, read_fitted_leaves


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedLeaves:
    """Leaves that were found in photographs, in the frame of their own asset."""

    fitted: FittedLeaves
    own_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the capture's coordinates


def read_captured_leaves(asset: Path) -> CapturedLeaves | None:
    """The leaves of an asset of leaves; None where it has none, or there is no asset.

    Raises:
        AssetError: It cannot be read.
    """
    if not asset.is_dir():
        return None
    frame = read_leaf_frame(asset)
    try:
        fitted = read_fitted_leaves(FoliageRequest(kind=FITTED, source=asset), asset / "nowhere")
    except AssetError as error:
        if "none is shown" not in str(error):
            raise
        return None
    return None if fitted is None or frame is None else CapturedLeaves(fitted=fitted, own_from_capture=frame)


def read_leaf_frame(asset: Path) -> NDArray[np.float64] | None:
    """(4, 4) for column vectors, from the capture's coordinates to those of an asset; None where there is no asset.

    Raises:
        AssetError: It cannot be read.
    """
    if not asset.is_dir():
        return None
    interface, _ = interface_of(asset)
    stage = open_asset(asset)  # which prims do not keep
    return read_plant_facts(require_plant(stage, asset), interface).asset_from_capture
