"""The maps of a crown as files of an asset: two cubemaps, the picture of a leaf, and the colours of its leaves."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.cubemap_exr import write_color_cubemap, write_radius_cubemap
from usdfoliage.asset.parts.crown_leaf_picture import write_leaf_colors, write_leaf_picture
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.model import CrownModel


def radius_map_path(name: str) -> Path:
    """Where the radius cubemap is, from the asset's folder."""
    return Path("maps") / f"{name}_crown_radius.exr"


def color_map_path(name: str) -> Path:
    """Where the colour cubemap is, from the asset's folder."""
    return Path("maps") / f"{name}_crown_color.exr"


def leaf_map_path(name: str) -> Path:
    """Where the picture of a leaf of the crown is, from the asset's folder."""
    return Path("maps") / f"{name}_crown_leaf.png"


def leaf_color_map_path(name: str) -> Path:
    """Where the colours of the crown's leaves are, from the asset's folder."""
    return Path("maps") / f"{name}_crown_leaf_colors.png"


def write_crown_maps(
    folder: Path, name: str, crown: CrownModel, leaf: LeafPicture, leaf_color: NDArray[np.floating]
) -> None:
    """Write the maps of the asset in folder; leaf_color is (N, L, 3), linear, of the leaves of each cluster.

    Raises:
        ValueError: The two maps are not of one size, or one of them is no cubemap.
        WriteError: A file cannot be written.
    """
    if crown.color.shape[:3] != crown.radius_m.shape:
        raise ValueError(f"radius and colour must be of one size, not {crown.radius_m.shape} and {crown.color.shape}")
    facts = {
        "foliage:crown:center": " ".join(repr(float(c)) for c in crown.center_m),
        "foliage:crown:reliefWeight": repr(float(crown.relief_weight)),
    }
    for path in (radius_map_path(name), color_map_path(name)):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
    write_radius_cubemap(folder / radius_map_path(name), crown.radius_m, facts)
    write_color_cubemap(folder / color_map_path(name), crown.color, facts)
    write_leaf_picture(folder / leaf_map_path(name), leaf)
    write_leaf_colors(folder / leaf_color_map_path(name), leaf_color)
