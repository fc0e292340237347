"""A whole plant in one asset: leaves and branches, the crown that stands for them from afar, or both.

The variant set lod chooses: leaves (leaves and branches), both (and the crown, by purpose), crown, and auto, in which a
renderer that knows UsdLod chooses by itself. What a lod does not show, none of its layers is opened for.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.locate import open_layer
from usdfoliage.asset.materials.layer import write_materials_layer
from usdfoliage.asset.packages.branch_package import BranchLeaves
from usdfoliage.asset.packages.interface import PAYLOAD
from usdfoliage.asset.packages.leaf_package import (
    CROWN_LAYER,
    MATERIAL_LAYER,
    begin_asset,
    finish_asset,
    leaf_jitter,
    write_crown_layers,
    write_leaf_layers,
)
from usdfoliage.asset.packages.lods import (
    AUTO_LAYER,
    BOTH_LAYER,
    AutoLod,
    switch_threshold,
    write_auto_layer,
    write_both_layer,
)
from usdfoliage.asset.packages.other_parts import OtherParts, copy_layers, fits_motion, keep_times, without_motion
from usdfoliage.asset.parts.bare_branches import BARE_LAYER, write_bare_branches_layer
from usdfoliage.asset.parts.crown import read_crown_radius
from usdfoliage.asset.parts.leaf_motion import DrawnLeaves
from usdfoliage.asset.plant import BARE_BRANCHES, BRANCHES, CROWN, LEAVES, Plant, PurposeBoxes, box_around
from usdfoliage.asset.provenance import Provenance, needs_file, write_provenance_file
from usdfoliage.asset.variants import VariantSet
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError

THUMBNAILS = "thumbnails"  # folder of the asset
MOVING = ("rig", "growth")  # variant sets whose layers go over those of the others
MOST_SIZE = 0.25  # of the picture's area: a plant that covers more is shown with its leaves, however small they are

Box = NDArray[np.float64]  # (2, 3)


@dataclass(frozen=True, kw_only=True)
class PlantAssetSettings:
    """How an asset of a whole plant is written; how its leaves are is said with them."""

    crown_mesh_size: int = 129  # vertices along a cube edge, as AssetSettings
    switch_leaf_px: float = 2.0  # in the lod auto the crown takes over where the usual leaf is no longer than that
    picture_px: tuple[int, int] = (1920, 1080)  # in a picture so wide and high
    switch_size: float = 0.05  # the same for a plant without leaves: the share of the picture's area that it covers
    version: str = "1"  # assetInfo
    lod: str | None = None  # that is selected; None, or one the plant has not: the leaves, or what its parts had

    def __post_init__(self) -> None:
        if self.crown_mesh_size < 2:
            raise ValueError(f"crown_mesh_size must be at least 2, not {self.crown_mesh_size}")
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
    branches: OtherParts | None = None,
    foliage: BranchLeaves | None = None,
    crown: CrownModel | None = None,
    settings: PlantAssetSettings = PlantAssetSettings(),
    thumbnail: Path | None = None,
) -> Path:
    """Write an asset of a whole plant, inside publish_folder as leaf_package.write_crown_asset.

    Args:
        folder: An existing folder; the asset's files are written into it.
        name: Name of the root prim and of the interface layer, an identifier (usdfoliage.asset.plant.asset_name).
        provenance: The runs that made it.
        asset_from_capture: (4, 4) for column vectors.
        branches: Of an asset of branches or of a whole plant (other_parts.read_other_parts), whose
            layers are copied, those of a crown too. Its leaves are not among them: those that shall be in the plant
            are foliage.
        foliage: Leaves in the plant's frame.
        crown: In the plant's frame; takes the place of the one that branches may have.
        settings: How it is written.
        thumbnail: PNG picture of the plant, which is copied.

    Returns:
        The interface layer, folder/<name>.usda.

    Raises:
        ValueError: There is no part at all, name is no identifier, or a part is not what its model promises.
        CaptureError: The jitter map of the leaves cannot be used.
        AssetError: A layer or a picture cannot be read, or a file cannot be written.
    """
    has_branches = branches is not None and branches.has_branches
    has_crown = crown is not None or (branches is not None and branches.crown_m is not None)
    if not has_branches and foliage is None and not has_crown:
        raise ValueError("a plant has leaves, branches or a crown, and none of them was given")
    if foliage is not None and not len(foliage.leaves) and (has_branches or has_crown):
        foliage = None  # empty prims would have an extent all the same, which validators mistrust
    payload = begin_asset(folder, name)
    lods = _lods(near=has_branches or foliage is not None, crown=has_crown)
    leafy = [lod for lod in lods if lod != "crown"]
    crown_m, material = branches.crown_m if branches is not None else None, None
    if crown is not None:
        layers = write_crown_layers(folder, name, crown, settings.crown_mesh_size)
        crown_m, material = layers.extent_m, layers.material
        branches = replace(branches, crown_m=None, bare_m=None) if branches is not None else None
    leaf_layers = None
    if foliage is None:
        write_materials_layer(payload / MATERIAL_LAYER, name, crown=material)
    else:
        leaf_layers = write_leaf_layers(
            folder, name, foliage.leaves, foliage.settings, foliage.edits, foliage.look, crown=material, lods=leafy
        )
    moving_m: Sequence[Box] = ()
    if branches is not None:
        branches, moving_m = _copy_branches(branches, payload, name, foliage)
        surface = _coarse_surface(branches)
        hull = _hull_to_pierce(branches, crown) if surface is not None else None
        if surface is not None and hull is not None:
            source = branches.interface.parent / "payload" / surface
            bare_m = write_bare_branches_layer(payload / BARE_LAYER, name, source, branches.name, *hull)
            branches = replace(branches, bare_m=bare_m)
    bare_m = branches.bare_m if branches is not None else None
    crown_m = box_around([crown_m, bare_m]) if crown_m is not None and bare_m is not None else crown_m
    far = [*([f"./{BARE_LAYER}"] if bare_m is not None else []), f"./{CROWN_LAYER}"]
    near_m: list[Box] = [*(branches.extents_m if branches is not None else ()), *moving_m]
    if leaf_layers is not None:
        near_m.append(leaf_layers.extent_m)
    guides_m = [
        *([leaf_layers.guide_extent_m] if leaf_layers is not None and leaf_layers.guide_extent_m is not None else []),
        *(branches.guide_extents_m if branches is not None else ()),
    ]
    boxes = _lod_boxes(lods, near_m, guides_m, crown_m)
    if "both" in lods:
        write_both_layer(payload / BOTH_LAYER, name)
        write_auto_layer(payload / AUTO_LAYER, name, _auto(boxes["auto"], foliage, settings))

    guides = list(branches.shared) if branches is not None else []
    shown = {
        "leaves": guides,
        "both": [f"./{BOTH_LAYER}", *far, *guides],
        "crown": far,
        "auto": [f"./{AUTO_LAYER}", *far],
    }
    # Of the sets inside a lod the first is strongest: what moves goes over what stands still.
    moving = [held for held in branches.sets if held.name in MOVING] if branches is not None else []
    still = [held for held in branches.sets if held.name not in (*MOVING, "lod")] if branches is not None else []
    sets = [
        VariantSet(name="lod", variants={lod: shown[lod] for lod in _selected_first(lods, branches, settings.lod)}),
        *(replace(held, inside=leafy) for held in moving),
        *([leaf_layers.variants] if leaf_layers is not None else []),
        *(replace(held, inside=leafy) for held in still),
    ]
    collections = {
        **({"leaves": [LEAVES]} if foliage is not None else {}),
        **({"branches": [BRANCHES, *([BARE_BRANCHES] if bare_m is not None else [])]} if has_branches else {}),
        **({"crown": [CROWN]} if has_crown else {}),
    }
    plant = Plant(
        provenance=provenance,
        asset_from_capture=asset_from_capture,
        extent_m=box_around([*near_m, *([crown_m] if crown_m is not None else [])]),
        parts=[
            *(leaf_layers.parts if leaf_layers is not None else ()),
            *(branches.parts if branches is not None else ()),
            *((CROWN,) if has_crown else ()),
        ],
        version=settings.version,
        lods=boxes,
        collections=collections,
        thumbnail=_copy_thumbnail(folder, name, thumbnail),
    )
    interface = finish_asset(folder, name, plant, sets)
    if needs_file(provenance):
        write_provenance_file(folder, provenance)
    if branches is not None:
        for path in (interface, folder / PAYLOAD):
            keep_times(open_layer(branches.interface), path)
    return interface


def _lods(near: bool, crown: bool) -> list[str]:
    """Those that have something to show, the default first."""
    if near and crown:
        return ["leaves", "both", "crown", "auto"]
    return ["leaves"] if near else ["crown"]


def _selected_first(lods: Sequence[str], branches: OtherParts | None, wanted: str | None) -> list[str]:
    """The same lods, the one before the others that is wanted, or that the plant had of which the parts are."""
    first = wanted if wanted in lods or branches is None else branches.lod
    return sorted(lods, key=lambda lod: lod != first)


def _copy_branches(
    branches: OtherParts, payload: Path, name: str, foliage: BranchLeaves | None
) -> tuple[OtherParts, list[Box]]:
    """Copy what the branches are; returns them as they are in the new asset, and boxes around leaves that move."""
    if foliage is None:
        still = without_motion(branches)
        return still, copy_layers(still, payload, name, None)
    if not fits_motion(branches, payload, name, foliage.settings.representations):
        branches = without_motion(branches)
    drawn = DrawnLeaves(
        payload=payload,
        leaves=foliage.leaves,
        representations=foliage.settings.representations,
        edits=foliage.edits,
        jitter=leaf_jitter(foliage.edits, foliage.look),
    )
    return branches, copy_layers(branches, payload, name, drawn)


def _hull_to_pierce(
    branches: OtherParts, crown: CrownModel | None
) -> tuple[NDArray[np.floating], NDArray[np.float64]] | None:
    """Radius and centre of the crown out of which branches are still to be found; None where there is none.

    Earlier versions left out what stands out of a crown: it is made when such an asset is written anew.
    """
    if crown is not None:
        return crown.radius_m, crown.center_m
    if branches.crown_m is None or branches.bare_m is not None:
        return None
    return read_crown_radius(branches.interface.parent / "payload" / CROWN_LAYER, branches.name)


def _coarse_surface(branches: OtherParts) -> str | None:
    """The surface of the branches of order 1, or without such the first that there is, from the payload's folder."""
    for held in branches.sets:
        if held.name == "branches":
            layers = held.variants.get("order1") or next(iter(held.variants.values()))
            return layers[0] if layers else None
    return None


def _lod_boxes(
    lods: Sequence[str], near_m: Sequence[Box], guides_m: Sequence[Box], crown_m: Box | None
) -> dict[str, PurposeBoxes]:
    """What each lod holds, by purpose."""
    near = box_around(near_m) if near_m else None
    guide = box_around(guides_m) if guides_m else None
    everything = box_around([box for box in (near, crown_m) if box is not None])
    held = {
        "leaves": PurposeBoxes(default=near, guide=guide),
        "both": PurposeBoxes(render=near, proxy=crown_m, guide=guide),
        "crown": PurposeBoxes(default=crown_m),
        "auto": PurposeBoxes(default=everything),
    }
    return {lod: held[lod] for lod in lods}


def _auto(boxes: PurposeBoxes, foliage: BranchLeaves | None, settings: PlantAssetSettings) -> AutoLod:
    assert boxes.default is not None
    threshold = settings.switch_size
    if foliage is not None and len(foliage.leaves):
        leaf_m = float(np.median(foliage.leaves.length_m))
        threshold = switch_threshold(boxes.default, leaf_m, settings.switch_leaf_px, settings.picture_px, MOST_SIZE)
    return AutoLod(extent_m=boxes.default, threshold=threshold)


def _copy_thumbnail(folder: Path, name: str, source: Path | None) -> str:
    """Copy the picture; returns its path from the interface layer, empty without one."""
    if source is None:
        return ""
    target = folder / THUMBNAILS / f"{name}.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        shutil.copyfile(source, target)
    except OSError as error:
        raise AssetError(f"{source} cannot be copied into the asset: {error.strerror}") from error
    return f"./{THUMBNAILS}/{target.name}"
