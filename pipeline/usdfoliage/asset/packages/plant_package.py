"""A whole plant in one asset: leaves and branches, the crown that stands for them from afar, or both.

The variant set lod chooses: leaves (leaves and branches), both (and the crown, by purpose), crown, and auto, in which a
renderer that knows UsdLod chooses by itself. What a lod does not show, none of its layers is opened for.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.picture import copy_picture
from usdfoliage.asset.packages.assembly import (
    Origin,
    begin_asset,
    close_asset,
    merge_collections,
    merge_relationships,
    write_interface,
)
from usdfoliage.asset.packages.asset_shape import shape_of
from usdfoliage.asset.packages.cards import AssetPictures, DrawPictures, copy_cards
from usdfoliage.asset.packages.lods import (
    AUTO_LAYER,
    BOTH_LAYER,
    AutoLod,
    switch_threshold,
    write_auto_layer,
    write_both_layer,
)
from usdfoliage.asset.parts.bare_branches import CrownHull, copy_bare_part, write_bare_part
from usdfoliage.asset.parts.branch_part import PlantBranches, write_branch_part
from usdfoliage.asset.parts.copied_parts import OtherParts, copy_far_part, copy_near_part
from usdfoliage.asset.parts.crown import read_crown_radius
from usdfoliage.asset.parts.crown_part import CROWN_LAYER, write_crown_part
from usdfoliage.asset.parts.leaf_part import MATERIAL_LAYER, BranchLeaves, drawn_leaves, write_leaf_part
from usdfoliage.asset.parts.part import AssetPlace, Box, Part, PartWriter
from usdfoliage.asset.plant import COLLECTIONS, Plant, PurposeBoxes, box_around
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.variants import VariantSet
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.crown_cage import MIN_SIZE

THUMBNAILS = "thumbnails"  # folder of the asset
MAX_SIZE = 0.25  # of the picture's area: a plant that covers more is shown with its leaves, however small they are


@dataclass(frozen=True, kw_only=True)
class PlantAssetSettings:
    """How an asset of a whole plant is written; the leaves have settings of their own."""

    crown_mesh_size: int | None = None  # vertices along a cube edge, as AssetSettings
    switch_leaf_px: float = 2.0  # in the lod auto the crown takes over where the median leaf is no longer than that
    picture_px: tuple[int, int] = (1920, 1080)  # in a picture so wide and high
    switch_size: float = 0.05  # the same for a plant without leaves: the share of the picture's area that it covers
    version: str = "1"  # assetInfo
    lod: str | None = None  # that is selected; None, or one the plant has not: the leaves, or what its parts had

    def __post_init__(self) -> None:
        if self.crown_mesh_size is not None and self.crown_mesh_size < MIN_SIZE:
            raise ValueError(f"crown_mesh_size must be at least {MIN_SIZE}, not {self.crown_mesh_size}")
        if not self.switch_leaf_px > 0 or min(self.picture_px) < 1:
            raise ValueError(f"leaves of {self.switch_leaf_px} pixels in {self.picture_px} cannot be; all are above 0")
        if not 0 < self.switch_size < 1:
            raise ValueError(f"switch_size must be between 0 and 1, not {self.switch_size}")


def write_plant_asset(
    folder: Path,
    name: str,
    *,
    provenance: Provenance,
    asset_from_capture: NDArray[np.float64],
    branches: PlantBranches | OtherParts | None = None,
    foliage: BranchLeaves | None = None,
    crown: CrownModel | None = None,
    crown_leaf: LeafPicture | None = None,
    more: Sequence[PartWriter] = (),
    settings: PlantAssetSettings = PlantAssetSettings(),
    pictures: AssetPictures | DrawPictures | None = None,
) -> Path:
    """Write an asset of a whole plant, inside publish_folder as leaf_package.write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        provenance: The runs that made it.
        asset_from_capture: (4, 4) for column vectors.
        branches: Models, or the parts of an asset of branches or of a whole plant (other_parts.read_other_parts), whose
            layers are copied, those of a crown too. Leaves are not among them: those that shall be in the plant are
            foliage.
        foliage: Leaves in the plant's frame.
        crown: In the plant's frame; takes the place of the one that branches may have.
        crown_leaf: Picture of a leaf, for the leaves of that crown; None for a plain one.
        more: Parts of other kinds, each shown near, far or as a guide, as its Part states.
        settings: How it is written.
        pictures: Pictures of the plant, which are copied; or a function that draws them of the asset, or gives None
            where it cannot. The function is called once, with the asset's shape beside its interface layer.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: There is no part at all, name is no identifier, or a part is not what its model promises.
        CaptureError: The jitter map of the leaves cannot be used.
        AssetError: A layer or a picture cannot be read, or a file cannot be written.
    """
    copied = branches if isinstance(branches, OtherParts) else None
    has_branches = copied.has_branches if copied is not None else branches is not None
    has_crown = crown is not None or (copied is not None and copied.crown_m is not None)
    if not has_branches and foliage is None and not has_crown and not more:
        raise ValueError("a plant has leaves, branches, a crown or another part, and none of them was given")
    if foliage is not None and not len(foliage.leaves) and (has_branches or has_crown or more):
        foliage = None  # empty prims would have an extent all the same, which validators mistrust
    place = begin_asset(folder, name)
    parts: list[Part] = []
    if foliage is not None:
        parts.append(write_leaf_part(place, foliage))
    drawn = drawn_leaves(foliage) if foliage is not None else None
    if isinstance(branches, PlantBranches):
        parts.append(write_branch_part(place, branches, drawn))
        if crown is not None:
            parts.append(write_bare_part(place, _hull_of(crown), branches.surfaces.coarsest, branches.settings.color))
    if copied is not None:
        if crown is not None:
            copied = replace(copied, crown_m=None, bare_m=None)
        parts += [copy_near_part(copied, place, drawn), _bare_part(place, copied, crown), copy_far_part(copied, place)]
    if crown is not None:
        parts.append(write_crown_part(place, crown, settings.crown_mesh_size, crown_leaf))
    parts += [write(place) for write in more]
    origin = Origin(provenance=provenance, asset_from_capture=asset_from_capture, version=settings.version)
    return _write_whole(place, parts, origin, settings, pictures)


def _write_whole(
    place: AssetPlace,
    parts: Sequence[Part],
    origin: Origin,
    settings: PlantAssetSettings,
    pictures: AssetPictures | DrawPictures | None,
) -> Path:
    """Put the parts of a plant together, each in the lods that show it; returns the interface layer."""
    lods = _lods(parts)
    near_m = [box for part in parts for box in part.near_m]
    far_m = [box for part in parts for box in part.far_m]
    boxes = _lod_boxes(lods, near_m, [box for part in parts for box in part.guides_m], far_m)
    if "both" in lods:
        write_both_layer(place.payload / BOTH_LAYER, place.name)
        write_auto_layer(place.payload / AUTO_LAYER, place.name, _auto(boxes["auto"], parts, settings))
    near, guides, far = (
        [layer for part in parts for layer in getattr(part, which)] for which in ("near", "guides", "far")
    )
    visible = {
        "leaves": [*near, *guides],
        "both": [f"./{BOTH_LAYER}", *far, *near, *guides],
        "crown": far,
        "auto": [f"./{AUTO_LAYER}", *far, *near],
    }
    first = settings.lod if settings.lod in lods else next((part.lod for part in parts if part.lod), "")
    leafy = [lod for lod in lods if lod != "crown"]
    # Of the sets inside a lod the first is strongest: what moves goes over what stands still.
    sets = [
        VariantSet(name="lod", variants={lod: visible[lod] for lod in sorted(lods, key=lambda lod: lod != first)}),
        *(replace(variant_set, inside=leafy) for part in parts for variant_set in part.moving),
        *(replace(variant_set, inside=leafy) for part in parts for variant_set in part.inside),
        *(replace(variant_set, inside=leafy) for part in parts for variant_set in part.still),
    ]
    plant = Plant(
        provenance=origin.provenance,
        asset_from_capture=origin.matrix,
        extent_m=box_around([*near_m, *far_m]),
        relationships=merge_relationships(parts),
        version=origin.version,
        lods=boxes,
        collections=merge_collections(parts, COLLECTIONS),
    )
    if isinstance(pictures, AssetPictures):
        plant = _with_pictures(place, plant, pictures)
    interface = close_asset(place, parts, plant, sets, [f"./{MATERIAL_LAYER}"])
    if callable(pictures):  # the interface alone is written again, once there is something to draw
        drawn = pictures(interface, shape_of(plant, sets))
        if drawn is not None:
            interface = write_interface(place, parts, _with_pictures(place, plant, drawn), sets)
    return interface


def _with_pictures(place: AssetPlace, plant: Plant, pictures: AssetPictures) -> Plant:
    """Copy pictures into the asset; returns the plant that names them."""
    thumbnail, cards = _copy_thumbnail(place, pictures.thumbnail), copy_cards(place, pictures.cards)
    return replace(plant, thumbnail=thumbnail, cards=cards)


def _lods(parts: Sequence[Part]) -> list[str]:
    """Those that have something to show, the default first."""
    is_near = any(part.near or part.guides or part.moving or part.inside or part.still for part in parts)
    is_far = any(part.far for part in parts)
    if is_near and is_far:
        return ["leaves", "both", "crown", "auto"]
    return ["crown"] if is_far else ["leaves"]


def _hull_of(crown: CrownModel) -> CrownHull:
    return CrownHull(radius_m=crown.radius_m, center_m=crown.center_m)


def _bare_part(place: AssetPlace, copied: OtherParts, crown: CrownModel | None) -> Part:
    """What of copied branches stands out of a crown, where that is still to be found.

    Earlier versions left out what stands out of a crown: it is made when such an asset is written anew.
    """
    surface = _coarse_surface(copied)
    payload = copied.interface.parent / "payload"
    if surface is None or (crown is None and (copied.crown_m is None or copied.bare_m is not None)):
        return Part()
    if crown is not None:
        hull = _hull_of(crown)
    else:
        radius_m, center_m = read_crown_radius(payload / CROWN_LAYER, copied.name)
        hull = CrownHull(radius_m=radius_m, center_m=center_m)
    return copy_bare_part(place, hull, payload / surface, copied.name)


def _coarse_surface(copied: OtherParts) -> str | None:
    """The surface of the branches of order 1, or without such the first that there is, from the payload's folder."""
    for variant_set in copied.sets:
        if variant_set.name == "branches":
            layers = variant_set.variants.get("order1") or next(iter(variant_set.variants.values()))
            return layers[0] if layers else None
    return None


def _lod_boxes(
    lods: Sequence[str], near_m: Sequence[Box], guides_m: Sequence[Box], far_m: Sequence[Box]
) -> dict[str, PurposeBoxes]:
    """What each lod holds, by purpose."""
    near = box_around(near_m) if near_m else None
    far = box_around(far_m) if far_m else None
    guide = box_around(guides_m) if guides_m else None
    boxes_by_lod = {
        "leaves": PurposeBoxes(default=near, guide=guide),
        "both": PurposeBoxes(render=near, proxy=far, guide=guide),
        "crown": PurposeBoxes(default=far),
        "auto": PurposeBoxes(default=box_around([*near_m, *far_m])),
    }
    return {lod: boxes_by_lod[lod] for lod in lods}


def _auto(boxes: PurposeBoxes, parts: Sequence[Part], settings: PlantAssetSettings) -> AutoLod:
    assert boxes.default is not None
    threshold = settings.switch_size
    detail_m = next((part.detail_m for part in parts if part.detail_m is not None), None)
    if detail_m is not None:
        threshold = switch_threshold(boxes.default, detail_m, settings.switch_leaf_px, settings.picture_px, MAX_SIZE)
    return AutoLod(extent_m=boxes.default, threshold=threshold)


def _copy_thumbnail(place: AssetPlace, source: Path | None) -> str:
    """Copy the picture; returns its path from the interface layer, empty without one.

    Raises:
        AssetError: It cannot be copied, or is no picture.
    """
    if source is None:
        return ""
    target = place.folder / THUMBNAILS / f"{place.name}.png"
    copy_picture(source, target)
    return f"./{THUMBNAILS}/{target.name}"
