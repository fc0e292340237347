"""An asset of one part: a crown, or leaves."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.assembly import Origin, begin_asset, write_asset
from usdfoliage.asset.parts.crown_part import write_crown_part
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAppearance, LeafAssetSettings, write_leaf_part
from usdfoliage.asset.provenance import Provenance
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.crown_cage import MIN_SIZE
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits


@dataclass(frozen=True, kw_only=True)
class AssetSettings:
    """How an asset of a crown is written."""

    crown_mesh_size: int | None = None  # vertices along a cube edge; None: as few as keep the silhouettes
    version: str = "1"  # assetInfo

    def __post_init__(self) -> None:
        if self.crown_mesh_size is not None and self.crown_mesh_size < MIN_SIZE:
            raise ValueError(f"crown_mesh_size must be at least {MIN_SIZE}, not {self.crown_mesh_size}")


def write_crown_asset(
    folder: Path,
    name: str,
    crown: CrownModel,
    provenance: Provenance,
    settings: AssetSettings = AssetSettings(),
    leaf: LeafPicture | None = None,
) -> Path:
    """Write an asset that has a crown and nothing else.

    Call it inside usdfoliage.asset.publish.publish_folder, whose folder takes the asset's place when all is written::

        with publish_folder(out, force=force) as folder:
            write_crown_asset(folder, asset_name(name or out.name), crown, provenance)
            write_report(folder / "report", ...)
        asset = out / f"{asset_name(name or out.name)}.usda"

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        crown: What to write.
        provenance: The run that made it.
        settings: How fine a mesh, and the asset's version.
        leaf: Picture of a leaf, for its leaves; None for a plain one.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, or the crown is not what CrownModel promises.
        WriteError: A file cannot be written.
    """
    place = begin_asset(folder, name)
    origin = Origin(provenance=provenance, asset_from_capture=crown.asset_from_photo, version=settings.version)
    return write_asset(place, [write_crown_part(place, crown, settings.crown_mesh_size, leaf)], origin)


def write_leaf_asset(
    folder: Path,
    name: str,
    leaves: Leaves,
    provenance: Provenance,
    settings: LeafAssetSettings = LeafAssetSettings(),
    edits: LeafEdits = NEUTRAL,
    appearance: LeafAppearance = LeafAppearance(),
    asset_from_capture: NDArray[np.float64] | None = None,
) -> Path:
    """Write an asset that has leaves and nothing else, inside publish_folder as write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        leaves: What to write; none is a valid asset.
        provenance: The run that made it.
        settings: Which representations, and how fine.
        edits: Those of all leaves: opinions in bezier, applied in the others.
        appearance: Colour and pictures, which are copied.
        asset_from_capture: (4, 4) for column vectors; the identity by default.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, or the leaves have numbers that are no leaves.
        CaptureError: The jitter map cannot be used.
        AssetError: A picture cannot be copied, or a file cannot be written.
    """
    place = begin_asset(folder, name)
    foliage = BranchLeaves(leaves=leaves, settings=settings, edits=edits, appearance=appearance)
    origin = Origin(provenance=provenance, asset_from_capture=asset_from_capture, version=settings.version)
    return write_asset(place, [write_leaf_part(place, foliage)], origin)
