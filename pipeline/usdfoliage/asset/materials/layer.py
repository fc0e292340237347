"""The materials layer of an asset, and the shaders that it names."""

import re
from collections.abc import Callable, Iterable
from pathlib import Path

from pxr import Sdf, Usd

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.resources import resource_folder

MATERIALS = "mtl"  # below the root prim
CROWN_MATERIAL = f"{MATERIALS}/Crown"
CROWN_RELIEF_MATERIAL = f"{MATERIALS}/CrownRelief"
CROWN_LEAVES_MATERIAL = f"{MATERIALS}/CrownLeaves"
LEAF_MATERIAL = f"{MATERIALS}/Leaf"
BARK_MATERIAL = f"{MATERIALS}/Bark"
GROUND_MATERIAL = f"{MATERIALS}/Ground"
GRASS_MATERIAL = f"{MATERIALS}/Grass"


def write_materials_layer(path: Path, name: str, materials: Iterable[Callable[[Usd.Stage, Sdf.Path], None]]) -> None:
    """Write the materials of the asset alone, at /name/mtl: each is authored below the path of the root prim."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    author_scopes(stage, root.AppendPath(MATERIALS))
    for author in materials:
        author(stage, root)
    export_layer(stage, path)


def copy_shaders(folder: Path, files: Iterable[str]) -> None:
    """Copy glslfx sources into folder, so that the asset draws in Storm without any plugin; each is whole by itself."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = resource_folder("usd_plugins/usdFoliageShaders")
    for file in files:
        text = (sources / file).read_text("utf-8")
        (folder / file).write_text(inline_sections(text, sources), "utf-8")


def inline_sections(source: str, folder: Path) -> str:
    """A glslfx source with the sections of code that it uses of others in place of their imports.

    In a package an import is not found.
    """
    imported = re.findall(r"^#import \./(\S+)\n", source, re.MULTILINE)
    if not imported:
        return source
    used = re.findall(r'"([^"]+)"', " ".join(re.findall(r'"source": \[([^\]]*)\]', source)))
    sections = []
    for file in imported:
        parts = re.split(r"^(?=-- glsl )", (folder / file).read_text("utf-8"), flags=re.MULTILINE)
        sections += [part for part in parts[1:] if part.split()[2] in used]
    body = re.sub(r"^#import \./\S+\n+", "", source, flags=re.MULTILINE)
    head, separator, own = body.partition("-- glsl ")
    return head + "".join(sections) + separator + own
