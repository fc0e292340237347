"""The materials layer of an asset, and the shaders that it names."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from pxr import Sdf

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.materials.bark import BarkMaterial, author_bark_material
from usdfoliage.asset.materials.crown import CrownMaterial, author_crown_material
from usdfoliage.asset.materials.leaf import LeafMaterial, author_leaf_material
from usdfoliage.asset.resources import resource_folder

MATERIALS = "mtl"  # below the root prim
CROWN_MATERIAL = f"{MATERIALS}/Crown"
LEAF_MATERIAL = f"{MATERIALS}/Leaf"
BARK_MATERIAL = f"{MATERIALS}/Bark"


def write_materials_layer(
    path: Path,
    name: str,
    *,
    crown: CrownMaterial | None = None,
    leaf: LeafMaterial | None = None,
    bark: BarkMaterial | None = None,
) -> None:
    """Write the materials of the asset alone, at /name/mtl: those of the parts that it has."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    author_scopes(stage, root.AppendPath(MATERIALS))
    if crown is not None:
        author_crown_material(stage, root.AppendPath(CROWN_MATERIAL), crown)
    if leaf is not None:
        author_leaf_material(stage, root.AppendPath(LEAF_MATERIAL), leaf)
    if bark is not None:
        author_bark_material(stage, root.AppendPath(BARK_MATERIAL), bark)
    export_layer(stage, path)


def copy_shaders(folder: Path, files: Iterable[str]) -> None:
    """Copy glslfx sources into folder, so that the asset draws in Storm without any plugin."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copyfile(resource_folder("usd_plugins/usdFoliageShaders") / file, folder / file)
