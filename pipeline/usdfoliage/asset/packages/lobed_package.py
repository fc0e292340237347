"""An asset of one leaf of several lobes."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.parts.lobed_leaf import LobedAssetSettings, write_lobed_part
from usdfoliage.asset.provenance import Provenance
from usdfoliage.leaf.lobed.placed import LobedLeaf


def write_lobed_asset(
    folder: Path,
    name: str,
    leaf: LobedLeaf,
    texture: NDArray[np.float32],
    provenance: Provenance,
    settings: LobedAssetSettings = LobedAssetSettings(),
) -> Path:
    """Write an asset that has a lobed leaf and nothing else, inside publish_folder.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        leaf: What to write.
        texture: (h, w, 4), linear colours and opacity over the leaf's st.
        provenance: The run that made it.
        settings: Polygons or a subdivision surface, and the asset's version.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier.
        AssetError: A file cannot be written.
    """
    place = begin_asset(folder, name)
    origin = Origin(provenance=provenance, asset_from_capture=leaf.asset_from_picture, version=settings.version)
    return write_asset(place, [write_lobed_part(place, leaf, texture, settings)], origin)
