"""What a part brings into an asset: a part writes its own layers, maps and shaders, and the rest is in a Part.

An asset is the sum of its parts (usdfoliage.asset.packages.assembly). A new part is a module beside this one with a
function that writes its files and returns a Part, and one line where the asset of a plant is written
(usdfoliage.jobs.plant.stages.assemble): the function, in `more` of write_plant_asset. Whoever writes the asset again
with other leaves copies it with what it finds in the layers (usdfoliage.asset.packages.other_parts).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from usdfoliage.asset.materials.picture import copy_picture
from usdfoliage.asset.variants import VariantSet

SHADERS = "../shaders"  # from the payload's folder
MAPS = "../maps"

Box = NDArray[np.float64]  # (2, 3), smallest and largest corner in metres
# Authors a material on a stage, below the path of the root prim.
MaterialAuthor = Callable[[Usd.Stage, Sdf.Path], None]


@dataclass(frozen=True, kw_only=True)
class AssetPlace:
    """Where an asset is written."""

    folder: Path  # an existing one
    name: str  # of the root prim and of the interface layer, an identifier

    @property
    def payload(self) -> Path:
        """The folder of the payload's layers."""
        return self.folder / "payload"


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """What one part brings into an asset whose files it has written.

    Layers are named by their paths from the payload's folder. Near is what shows the plant itself, far what stands for
    it from a distance.
    """

    relationships: Mapping[str, str] = field(default_factory=dict)  # of the root prim, each to a prim below it
    collections: Mapping[str, Sequence[str]] = field(default_factory=dict)  # prims by collection of a whole plant
    materials: Sequence[MaterialAuthor] = ()
    near: Sequence[str] = ()  # layers in every lod that shows the plant itself
    guides: Sequence[str] = ()  # layers of guides, in the same lods but auto
    far: Sequence[str] = ()  # layers in every lod that shows what stands for the plant
    near_m: Sequence[Box] = ()  # of what is shown near, in any variant and frame
    far_m: Sequence[Box] = ()
    guides_m: Sequence[Box] = ()  # of guides
    moving: Sequence[VariantSet] = ()  # whose layers go over those of all that stands still
    inside: Sequence[VariantSet] = ()  # always inside the lods that show the plant itself, of a whole plant in all
    still: Sequence[VariantSet] = ()  # inside those lods only where there are several, below the others
    lods: VariantSet | None = None  # the set lod of the asset that the part comes from
    detail_m: float | None = None  # length of what a picture must show for the plant itself to be worth it: a leaf's
    frames: int = 0  # of what moves
    times: Mapping[str, float] = field(default_factory=dict)  # range of time of what moves, as metadata of a layer
    lod: str = ""  # the one that was selected where the part comes from
    # Writes layers that need the box around all that is near, in every part.
    finish: Callable[[Box], None] | None = None


PartWriter = Callable[[AssetPlace], Part]  # writes the files of a part


def map_file(name: str, source: str) -> str:
    """Where copy_map puts a picture, from the asset's folder.

    Args:
        name: Of the map, without its suffix.
        source: File name of the picture.
    """
    return f"maps/{name}{Path(source).suffix.lower()}"


def copy_map(place: AssetPlace, name: str, source: Path | None) -> str:
    """Copy a picture into the asset's maps; returns its path from the payload's folder, empty without a picture.

    Raises:
        AssetError: It cannot be copied, or is no picture.
    """
    if source is None:
        return ""
    target = place.folder / map_file(name, source.name)
    copy_picture(source, target)
    return f"{MAPS}/{target.name}"
