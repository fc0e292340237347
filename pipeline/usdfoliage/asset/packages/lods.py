"""What two of the lods of a whole plant have besides the parts that they show, both and auto; and auto of a forest.

Renderers that do not know UsdLod see of auto the leaves and branches, or the near form of a forest's plants: the other
item is authored invisible, as the manual of UsdLod asks for (section Legacy Renderer Compatibility). One that knows it
makes visible what it chooses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdLod, Vt

from usdfoliage.asset.layer import author_scopes, export_layer, new_layer
from usdfoliage.asset.parts.planted import PLANTS

BOTH_LAYER = "lod_both.usda"
AUTO_LAYER = "lod_auto.usda"
RENDER, PROXY, GUIDE = "geo/render", "geo/proxy", "geo/guide"  # below the root prim
HEURISTIC = "lod/ScreenSize"  # not below geo, whose children are what UsdLod chooses from
PLANTS_HEURISTIC = "lod/Distance"  # nor below plants

_BLEND = 0.8  # of the threshold: from here down a renderer that blends draws the crown alone


@dataclass(frozen=True, kw_only=True)
class AutoPlants:
    """When a renderer that knows UsdLod shows which form of all plants of a tile."""

    near: str  # level of the forest, as the instancer is named
    far: str
    lod_distance_m: tuple[float, float]  # of the camera from the plants' box: near up to the first, far from the second

    def __post_init__(self) -> None:
        if self.near == self.far:
            raise ValueError(f"plants near and far must differ in their level, not be both {self.near}")


@dataclass(frozen=True, kw_only=True, eq=False)
class AutoLod:
    """When a renderer that knows UsdLod shows the crown."""

    extent_m: NDArray[np.float64]  # (2, 3), of the whole plant
    threshold: float  # share of the picture's area that a sphere around that covers; from there down it is the crown

    def __post_init__(self) -> None:
        if not 0 < self.threshold < 1:
            raise ValueError(f"threshold must be between 0 and 1, not {self.threshold}")


def switch_threshold(
    extent_m: NDArray[np.float64], leaf_m: float, leaf_px: float, picture_px: tuple[int, int], max_share: float
) -> float:
    """The share of the picture's area that a plant covers where its leaves are so many pixels long.

    UsdLod's measure is the disc of the sphere around the extent over the area of the picture (ComputeScreenSize of
    LODScreenSizeHeuristic).

    Args:
        extent_m: (2, 3), of the plant.
        leaf_m: Median length of the leaves.
        leaf_px: What it shall be in the picture.
        picture_px: Width and height.
        max_share: The threshold is no more than that, however small the leaves are.
    """
    radius_px = leaf_px * float(np.linalg.norm(extent_m[1] - extent_m[0])) / 2 / leaf_m
    return min(max_share, float(np.pi * radius_px**2 / (picture_px[0] * picture_px[1])))


def write_both_layer(path: Path, name: str) -> None:
    """Write the purposes of an asset that shows leaves and branches in a picture, and the crown while one works."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    for part, purpose in ((RENDER, UsdGeom.Tokens.render), (PROXY, UsdGeom.Tokens.proxy)):
        author_scopes(stage, root.AppendPath(part))
        UsdGeom.Imageable(stage.GetPrimAtPath(root.AppendPath(part))).CreatePurposeAttr(purpose)
    render = UsdGeom.Imageable(stage.GetPrimAtPath(root.AppendPath(RENDER)))
    render.SetProxyPrim(stage.GetPrimAtPath(root.AppendPath(PROXY)))
    export_layer(stage, path)


def write_auto_layer(path: Path, name: str, auto: AutoLod) -> None:
    """Write the choice by UsdLod: the children of geo are the items, leaves and branches 0, the crown 1.

    Guides are inactive there, for a child more would be an item more.
    """
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    for part in (RENDER, PROXY, GUIDE):
        author_scopes(stage, root.AppendPath(part))
    UsdGeom.Imageable(stage.GetPrimAtPath(root.AppendPath(PROXY))).CreateVisibilityAttr(UsdGeom.Tokens.invisible)
    stage.GetPrimAtPath(root.AppendPath(GUIDE)).SetActive(False)
    geometry = stage.GetPrimAtPath(root.AppendPath(RENDER).GetParentPath())

    heuristic = root.AppendPath(HEURISTIC)
    author_scopes(stage, heuristic.GetParentPath())
    size = UsdLod.ScreenSizeHeuristic.Define(stage, heuristic)
    size.CreateLodDomainAttr(UsdLod.Tokens.imaging)
    size.CreateProjectionMethodAttr(UsdLod.Tokens.projectedSphere)
    size.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(auto.extent_m.astype(np.float32)))
    size.CreateThresholdsAttr(Vt.FloatArray([auto.threshold]))
    size.CreateBlendThresholdsAttr(Vt.FloatArray([_BLEND * auto.threshold]))
    _author_root(geometry, [Sdf.Path(part).name for part in (RENDER, PROXY)], heuristic)
    export_layer(stage, path)


def write_auto_plants_layer(path: Path, name: str, auto: AutoPlants) -> None:
    """Write the choice by UsdLod between two levels of the plants of a tile: the children of plants are the items.

    The distance is measured to the box around the plants, so that they are near where the camera is among them.

    Args:
        path: Of the layer; the plants are in those of the two levels.
        name: Of the root prim of the tile.
        auto: Which levels, and when.

    Raises:
        WriteError: The file cannot be written.
    """
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    plants = stage.OverridePrim(root.AppendChild(PLANTS))
    near, far = (plants.GetPath().AppendChild(level) for level in (auto.near, auto.far))
    stage.OverridePrim(near)
    UsdGeom.Imageable(stage.OverridePrim(far)).CreateVisibilityAttr(UsdGeom.Tokens.invisible)

    heuristic = root.AppendPath(PLANTS_HEURISTIC)
    author_scopes(stage, heuristic.GetParentPath())
    distance = UsdLod.DistanceHeuristic.Define(stage, heuristic)
    distance.CreateLodDomainAttr(UsdLod.Tokens.imaging)
    distance.CreateThresholdsAttr(Vt.FloatArray([auto.lod_distance_m[0]]))
    distance.CreateBlendThresholdsAttr(Vt.FloatArray([auto.lod_distance_m[1]]))
    distance.CreateBoundingVolumeRel().SetTargets([near])
    _author_root(plants, [auto.near, auto.far], heuristic)
    export_layer(stage, path)


def _author_root(prim: Usd.Prim, items: Sequence[str], heuristic: Sdf.Path) -> None:
    """Make a prim the root of its items, of which the first is drawn by default."""
    prim.SetChildrenReorder(list(items))
    api = UsdLod.RootAPI.Apply(prim)
    api.CreateLodDefaultIndexAttr(0)
    api.CreateLodHeuristicsRel().SetTargets([heuristic])
