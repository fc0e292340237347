"""The materials layer of an asset, and the shaders that it names."""

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

from pxr import Sdf, Usd

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.resources import resource_folder

MATERIALS = "mtl"  # below the root prim
CROWN_MATERIAL = f"{MATERIALS}/Crown"
LEAF_MATERIAL = f"{MATERIALS}/Leaf"
BARK_MATERIAL = f"{MATERIALS}/Bark"


def write_materials_layer(path: Path, name: str, materials: Iterable[Callable[[Usd.Stage, Sdf.Path], None]]) -> None:
    """Write the materials of the asset alone, at /name/mtl: each is authored below the path of the root prim."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    author_scopes(stage, root.AppendPath(MATERIALS))
    for author in materials:
        author(stage, root)
    export_layer(stage, path)


def copy_shaders(folder: Path, files: Iterable[str]) -> None:
    """Copy glslfx sources into folder, so that the asset draws in Storm without any plugin."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copyfile(resource_folder("usd_plugins/usdFoliageShaders") / file, folder / file)
