"""The crown as a part of an asset: its layer, its two maps, its shader and its material."""

from functools import partial

import numpy as np
from pxr import Sdf, Usd

from usdfoliage.asset.materials.crown import (
    CROWN_SHADER,
    LEAVES_SHADER,
    RELIEF_SHADER,
    CrownLeavesMaterial,
    CrownMaterial,
    author_crown_leaves_material,
    author_crown_material,
    author_relief_material,
)
from usdfoliage.asset.materials.layer import (
    CROWN_LEAVES_MATERIAL,
    CROWN_MATERIAL,
    CROWN_RELIEF_MATERIAL,
    copy_shaders,
)
from usdfoliage.asset.parts.crown import crown_prim, write_crown_layer
from usdfoliage.asset.parts.crown_leaf_picture import brightness_of
from usdfoliage.asset.parts.crown_maps import write_crown_maps
from usdfoliage.asset.parts.part import SHADERS, AssetPlace, Part
from usdfoliage.asset.plant import CROWN, TO_CROWN
from usdfoliage.crown.leaf_picture import LeafPicture, plain_leaf
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.crown_cage import MIN_SIZE

CROWN_LAYER = "crown.usdc"


def write_crown_part(
    place: AssetPlace, crown: CrownModel, mesh_size: int | None, leaf: LeafPicture | None = None
) -> Part:
    """Write a crown into the asset at place.

    Args:
        place: Where; the payload's folder exists.
        crown: In the plant's frame.
        mesh_size: Vertices of the cage along a cube edge, at most as many as the map has texels; None: as few as keep
            the silhouettes.
        leaf: Picture of a leaf, which its leaves have where they are drawn; None for a plain one.

    Raises:
        ValueError: The crown is not what CrownModel promises.
        WriteError: A file cannot be written.
    """
    # A cage finer than its map would show the map's texels.
    size = None if mesh_size is None else max(min(mesh_size, crown.radius_m.shape[1]), MIN_SIZE)
    leaf = plain_leaf() if leaf is None else leaf
    prim = crown_prim(place.name, crown, size, leaf)
    write_crown_maps(place.folder, place.name, crown, leaf, prim.leafy.leaf_color)
    copy_shaders(place.folder / "shaders", (CROWN_SHADER, RELIEF_SHADER, LEAVES_SHADER))
    write_crown_layer(place.payload / CROWN_LAYER, place.name, prim)
    material = CrownMaterial(
        color_map=prim.color_map,
        radius_map=prim.radius_map,
        shader=f"{SHADERS}/{CROWN_SHADER}",
        relief_shader=f"{SHADERS}/{RELIEF_SHADER}",
        face_size=crown.color.shape[1],
        center_m=(float(prim.center_m[0]), float(prim.center_m[1]), float(prim.center_m[2])),
        radius_range_m=prim.radius_range_m,
        mean_color=(float(prim.mean_color[0]), float(prim.mean_color[1]), float(prim.mean_color[2])),
    )
    leaves = CrownLeavesMaterial(
        leaf_map=prim.leaf_map,
        leaf_brightness=brightness_of(leaf),
        shader=f"{SHADERS}/{LEAVES_SHADER}",
        color_map=prim.leaf_color_map,
        clusters=len(prim.leafy.place_m),
        leaves=prim.leafy.leaf_color.shape[1],
        radius_in_clusters=prim.radius_range_m[1] / float(prim.leafy.radius_m.max()),
    )
    drawn_m = np.concatenate([prim.cage.points_m, prim.hull.points_m, prim.leafy.extent_m])  # in any form
    extent_m = np.stack([drawn_m.min(axis=0), drawn_m.max(axis=0)]).astype(np.float64)
    return Part(
        relationships={TO_CROWN: CROWN},
        collections={"crown": [CROWN]},
        materials=[partial(_author_material, crown=material, leaves=leaves)],
        far=[f"./{CROWN_LAYER}"],
        far_m=[extent_m],
    )


def _author_material(stage: Usd.Stage, root: Sdf.Path, crown: CrownMaterial, leaves: CrownLeavesMaterial) -> None:
    author_crown_material(stage, root.AppendPath(CROWN_MATERIAL), crown)
    author_relief_material(stage, root.AppendPath(CROWN_RELIEF_MATERIAL), crown)
    author_crown_leaves_material(stage, root.AppendPath(CROWN_LEAVES_MATERIAL), crown, leaves)
