"""A whole asset: every layer, map and shader of its folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf

from usdfoliage.asset.crown import crown_prim, write_crown_layer, write_crown_maps
from usdfoliage.asset.crown_material import CROWN_SHADER, CrownMaterial
from usdfoliage.asset.interface import write_interface_layer, write_payload_layer
from usdfoliage.asset.materials import copy_shaders, write_materials_layer
from usdfoliage.asset.plant import CROWN, Plant
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.variants import VariantSet
from usdfoliage.crown.model import CrownModel

SHADERS = "../shaders"  # from the payload's folder
MAPS = "../maps"


@dataclass(frozen=True, kw_only=True)
class AssetSettings:
    """How an asset of a crown is written."""

    crown_mesh_size: int = 129  # vertices along a cube edge: 98,304 quads; odd, so that the poles are vertices
    version: str = "1"  # assetInfo

    def __post_init__(self) -> None:
        if self.crown_mesh_size < 2:
            raise ValueError(f"crown_mesh_size must be at least 2, not {self.crown_mesh_size}")


def write_crown_asset(
    folder: Path,
    name: str,
    crown: CrownModel,
    provenance: Provenance,
    settings: AssetSettings = AssetSettings(),
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

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: name is no identifier, or the crown is not what CrownModel promises.
        AssetError: A file cannot be written.
    """
    payload = _begin(folder, name)
    # A mesh finer than its map would show the map's texels as facets.
    prim = crown_prim(name, crown, min(settings.crown_mesh_size, crown.radius_m.shape[1]))
    material = CrownMaterial(
        color_map=prim.color_map,
        radius_map=prim.radius_map,
        shader=f"{SHADERS}/{CROWN_SHADER}",
        face_size=crown.color.shape[1],
        center_m=(float(prim.center_m[0]), float(prim.center_m[1]), float(prim.center_m[2])),
        radius_range_m=prim.radius_range_m,
    )
    plant = Plant(
        provenance=provenance,
        asset_from_capture=crown.asset_from_photo,
        extent_m=np.stack([prim.mesh.points_m.min(axis=0), prim.mesh.points_m.max(axis=0)]),
        parts=(CROWN,),
        version=settings.version,
    )
    write_crown_maps(folder, name, crown)
    copy_shaders(folder / "shaders", (CROWN_SHADER,))
    write_materials_layer(payload / "materials.usda", name, crown=material)
    write_crown_layer(payload / "crown.usdc", name, prim)
    return _finish(folder, name, plant, [VariantSet(name="lod", variants={"crown": ["./crown.usdc"]})])


def _begin(folder: Path, name: str) -> Path:
    """The payload's folder, made; ValueError for a name that is no identifier."""
    if not Sdf.Path.IsValidIdentifier(name):
        raise ValueError(f"{name!r} is no identifier; asset_name makes one")
    payload = folder / "payload"
    payload.mkdir(parents=True, exist_ok=True)
    return payload


def _finish(folder: Path, name: str, plant: Plant, variants: Sequence[VariantSet]) -> Path:
    """The two layers that hold the others together."""
    write_payload_layer(folder / "payload" / "payload.usda", name, ["./materials.usda"], variants)
    interface = folder / f"{name}.usda"
    write_interface_layer(interface, name, plant, variants)
    return interface
