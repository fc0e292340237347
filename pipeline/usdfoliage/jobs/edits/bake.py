"""From an asset with edits to one whose leaves are as the edits make them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin, is_asset_folder, read_origin
from usdfoliage.asset.leaf_representations import check_memory, read_representations, read_settings
from usdfoliage.asset.locate import find_leaves, require_leaves, select_leafy_lod, select_representation
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.own_files import own_folders
from usdfoliage.asset.packages.cards import AssetPictures
from usdfoliage.asset.packages.contents import (
    PlantFacts,
    count_changed_patches,
    files_left_out,
    find_crown,
    interface_of,
    matrix_in_plant,
    read_leaf_appearance,
    read_plant_facts,
    representations,
    require_plant,
)
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.packages.other_parts import find_other_parts, write_leaves_beside
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.parts.bare_branches import BARE_LAYER
from usdfoliage.asset.parts.copied_parts import OtherParts, lost_leaf_motion
from usdfoliage.asset.parts.hero_leaf import read_hero_leaf
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAppearance, LeafAssetSettings
from usdfoliage.asset.parts.leaf_primvars import animated_edits, read_leaf_primvars
from usdfoliage.asset.parts.leaves import ReadLeaves, read_leaves
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.provenance import package_versions
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.asset.variants import REPRESENTATIONS
from usdfoliage.errors import AssetError, FitError
from usdfoliage.jobs.edits.edit import Value, changed_edits, show_value
from usdfoliage.leaf.change import bake_leaves, join_leaves, move_leaves, remaining_edits
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Argument, Remark, RenderSetting, as_plan_setting, label_remarks, remark

_JITTER = ("jitter_amplitude", "jitter_frequency")  # edits that stay
_STIFF = remark(
    "leaf-motion-lost",
    "the leaves no longer follow branches that grow or sway, since they stand elsewhere or are divided otherwise",
    remedy="`usdfoliage branches` makes leaves that do",
)
_BARED = remark(
    "trunk-shown-with-crown",
    "what stands out of the crown, the trunk below it above all, is now shown with it; the asset had it in no lod",
)


@dataclass(frozen=True, kw_only=True)
class BakeRequest:
    """What the user asked for, checked."""

    asset: Path
    output: Path
    name: str | None
    representations: tuple[str, ...] | None  # None: those that the asset has
    resolution: tuple[int, int] | None
    source: str  # the representation that is read, bezier or nurbs
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset


@dataclass(frozen=True, kw_only=True, eq=False)
class BakeInput:
    """What is baked."""

    plant: PlantFacts
    interface: Path
    leaves: Leaves  # as ASSET stores them
    edits: LeafEdits
    appearance: LeafAppearance
    others: OtherParts | None  # what the plant has besides
    settings: LeafAssetSettings
    name: str
    remarks: tuple[Remark, ...]


@dataclass(frozen=True, kw_only=True)
class BakedAsset:
    """What was written, and what the user should know of it."""

    asset: Path
    lines: tuple[str, ...]
    remarks: tuple[Remark, ...]


def bake_asset(request: BakeRequest, progress: StepProgress | None = None) -> BakedAsset:
    """Write the asset of the edited leaves; what was there stays until the new one is whole.

    Raises:
        FoliageError: The asset cannot be read or has no leaves, or the output cannot be written; nothing was changed.
    """
    with publish_folder(
        request.output, force=request.force, origin=find_bake_origin(request), keep_old=request.keep_old
    ) as folder:
        given = read_bake_input(request, progress)
        if progress:
            progress("write", 0.5)
        leaves = bake_leaves(given.leaves, given.edits)
        provenance = replace(
            given.plant.provenance,
            generator=f"usdfoliage {__version__}",
            settings={**given.plant.provenance.settings, **describe_settings(request, given)},
            versions=package_versions(tuple(given.plant.provenance.versions)),
        )
        rest = (given.settings, remaining_edits(given.edits), given.appearance, given.plant.asset_from_capture)
        if given.others is not None and given.others.is_whole:
            foliage = BranchLeaves(leaves=leaves, settings=given.settings, edits=rest[1], appearance=given.appearance)
            interface = write_plant_asset(
                folder,
                given.name,
                provenance=provenance,
                asset_from_capture=given.plant.asset_from_capture,
                branches=given.others,
                foliage=foliage,
                settings=PlantAssetSettings(version=given.settings.version),
                pictures=AssetPictures(
                    thumbnail=given.others.thumbnail,
                    cards=given.others.cards if given.edits == NEUTRAL else {},  # those show the plant as it was
                ),
            )
        elif given.others is None:
            interface = write_leaf_asset(folder, given.name, leaves, provenance, *rest)
        else:
            interface = write_leaves_beside(folder, given.name, leaves, given.others, provenance, *rest)
        stiff = given.others is not None and lost_leaf_motion(given.others, folder)
        bared = given.others is not None and given.others.bare_m is None and (folder / "payload" / BARE_LAYER).exists()
    remarks = (*given.remarks, *([_STIFF] if stiff else []), *([_BARED] if bared else []))
    return BakedAsset(asset=request.output / interface.name, lines=tuple(_lines(request, given)), remarks=remarks)


def find_bake_origin(request: BakeRequest) -> AssetOrigin:
    """Of the new asset; an asset that is baked in its own folder stays one of its origin.

    Raises:
        AssetError: The asset that is read is none, or cannot be read.
    """
    interface, _ = interface_of(request.asset)
    folder = interface.resolve().parent
    in_place = request.output.resolve() == folder
    name = asset_name(request.name or (interface.stem if in_place else request.output.resolve().name))
    old = read_origin(folder) if in_place else None
    return replace(old, name=name) if old is not None else AssetOrigin(name=name, command="bake", source=interface.stem)


def plan_bake(request: BakeRequest, render: RenderSetting = as_plan_setting) -> str:
    """What bake_asset would do, in lines, after reading the asset; writes nothing. render: of settings in remarks."""
    given = read_bake_input(request)
    lines = [
        *_lines(request, given),
        *label_remarks(given.remarks, render),
        plan_folder(
            request.output,
            f"{given.name}.usda",
            request.force,
            origin=find_bake_origin(request),
            keep_old=request.keep_old,
        ),
    ]
    return "\n".join(lines)


def read_bake_input(request: BakeRequest, progress: StepProgress | None = None) -> BakeInput:
    """Read what is to be baked.

    Raises:
        AssetError: The asset cannot be read, has no leaves, several plants or a crown besides, or lacks the
            representation that is to be read; its leaves have been bent out of shape by a matrix.
    """
    interface, look = interface_of(request.asset)
    _check_place(request.output, interface)
    stage = open_asset(request.asset)
    plant = require_plant(stage, request.asset)
    facts = read_plant_facts(plant, interface)
    others = find_other_parts(plant, interface)
    if find_crown(plant) is not None and not (others is not None and others.is_whole):
        raise AssetError(
            f"{request.asset} has a crown besides its leaves, which bake would lose", "bake the leaves' asset"
        )
    present = representations(plant)
    remarks = _check_patches(plant, request.source)
    select_leafy_lod(stage)
    if present:
        select_representation(stage, "bezier")
    prim = require_leaves(stage, request.asset)[0]
    read = read_leaves(prim)
    folders = own_folders(interface, None if look is None else look.path, prim)
    appearance = read_leaf_appearance(prim, read.jitter_map, folders)
    left_out = [] if others is None else files_left_out(interface)
    if left_out:
        more = f" and {len(left_out) - 3} more" if len(left_out) > 3 else ""
        text = f"not copied into the new asset, since outside its folder or no picture: {', '.join(left_out[:3])}{more}"
        remarks.append(remark("files-left-out", text))
    hidden = len(prim.GetAttribute("positions").Get() or ()) - len(read.leaves)
    if hidden:
        text = f"{hidden:,} {'leaf is' if hidden == 1 else 'leaves are'} hidden and left out"
        remarks.append(remark("hidden-leaves-left-out", text))
    animated = animated_edits(prim)
    if animated:
        text = f"animated: {', '.join(animated)}; baked as at the earliest time"
        remarks.append(remark("animated-edits", text))
    leaves, edits = move_leaves(read.leaves, matrix_in_plant(prim, plant)), read.edits
    if request.source == "nurbs":
        select_representation(stage, "nurbs")
        patches = read_patches(find_leaves(stage), plant, progress)
        leaves, edits = patches.leaves, patches.edits
        remarks += patches.remarks
        if look is not None:
            text = f"the edits of {look.path} act on bezier alone and were left out"
            remarks.append(remark("look-left-out", text))
    known = read_representations([name for name in present if name in REPRESENTATIONS])
    lost = [name for name in present if name not in known]
    if lost:
        text = f"representation {', '.join(lost)} is not ours and was left out"
        remarks.append(remark("representation-left-out", text))
    settings = read_settings(request.representations or known, request.resolution)
    check_memory(len(leaves), settings)
    in_place = request.output.resolve() == interface.resolve().parent
    if in_place and look is not None and request.source == "bezier":
        text = f"{look.path} still holds these edits"
        remarks.append(remark("look-acts-twice", text, remedy="take it out of your scenes, or they act twice"))
    remarks += _remark_jitter(edits, settings.representations)
    default_name = interface.stem if in_place else request.output.resolve().name
    return BakeInput(
        plant=facts,
        interface=interface,
        leaves=leaves,
        edits=edits,
        appearance=appearance,
        others=others,
        settings=replace(settings, version=facts.version or settings.version),
        name=asset_name(request.name or default_name),
        remarks=tuple(remarks),
    )


def _check_patches(plant: Any, source: str) -> list[Remark]:
    """A remark where patches that somebody changed are shown but not read."""
    changed = count_changed_patches(plant) if source != "nurbs" else 0
    if not changed:
        return []
    what = "patch of the representation nurbs has" if changed == 1 else "patches of the representation nurbs have"
    remedy = (Argument(name="source", value="nurbs"), " reads them")
    return [remark("changed-patches-not-read", f"{changed:,} {what} changes that were not read", remedy=remedy)]


def _check_place(output: Path, interface: Path) -> None:
    """Raises AssetError for an output that would change or lose the asset that is read."""
    target, folder = output.resolve(), interface.resolve().parent
    if not is_asset_folder(folder):
        return  # a scene that has a plant
    if target != folder and target.is_relative_to(folder):
        raise AssetError(
            f"{output} lies in the asset's folder {folder}", "name a folder beside it, or that folder itself"
        )
    if target != folder and folder.is_relative_to(target):
        raise AssetError(f"{output} holds the asset that is read, {folder}, and would lose it", "name another folder")


def describe_settings(request: BakeRequest, given: BakeInput) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    return {
        "bake-from": request.source,
        "bake-edits": "; ".join(_list_edits(changed_edits(given.edits))) or "none",
        "representation": " ".join(given.settings.representations),
        "resolution": f"{given.settings.mesh.across} {given.settings.mesh.along}",
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class PatchLeaves:
    """The leaves of patches, in their order."""

    leaves: Leaves
    edits: LeafEdits
    remarks: tuple[Remark, ...]


def read_patches(prims: Sequence[Any], plant: Any, progress: StepProgress | None = None) -> PatchLeaves:
    """Read the leaves of the representation nurbs; a patch that is near to no leaf is left out.

    Raises:
        AssetError: There is no patch, none is a leaf, or one has lost what makes it one.
    """
    read: list[Leaves] = []
    failed: list[str] = []
    residuals_m: list[float] = []
    edits = NEUTRAL
    for number, prim in enumerate(prims):
        if progress and number % 64 == 0:
            progress("patches", 0.5 * number / len(prims))
        try:
            one: ReadLeaves = read_hero_leaf(prim)
        except FitError as error:
            failed.append(f"{prim.GetPath()}: {error}")
            continue
        edits = remaining_edits(one.edits)
        leaf = move_leaves(bake_leaves(one.leaves, one.edits), matrix_in_plant(prim.GetParent(), plant))
        written = read_leaf_primvars(prim, 1)
        if not np.array_equal(one.leaves.parameters, written["parameters"]):
            residuals_m += [] if leaf.residual_m is None else [float(leaf.residual_m[0])]
        # In an asset the residual is the distance to what was captured, not to what was modelled.
        read.append(replace(leaf, residual_m=written.get("residual_m")))
    if not read:
        if failed:
            raise AssetError(f"none of {len(failed)} patches is near to a leaf, the first is {failed[0]}")
        raise AssetError(f"<{plant.GetPath()}> has no patches in its representation nurbs", "bake from bezier")
    text = f"{len(residuals_m):,} of {len(prims):,} patches were changed and fitted"
    if residuals_m:
        text += (
            f", root mean square distance {1000 * float(np.median(residuals_m)):.3g} mm (median), "
            f"{1000 * max(residuals_m):.3g} mm (largest)"
        )
    remarks = [remark("patches-fitted", text)]
    if failed:
        text = f"{len(failed):,} of {len(prims):,} patches are no leaves and were left out, the first is {failed[0]}"
        remarks.append(remark("patches-left-out", text))
    return PatchLeaves(leaves=join_leaves(read), edits=edits, remarks=tuple(remarks))


def _lines(request: BakeRequest, given: BakeInput) -> list[str]:
    baked = _list_edits({name: value for name, value in changed_edits(given.edits).items() if name not in _JITTER})
    return [
        f"leaves: {len(given.leaves):,}, from {request.source}",
        f"baked edits: {'; '.join(baked) or 'none'}",
        f"representations: {', '.join(given.settings.representations)}",
    ]


def _list_edits(edits: Mapping[str, Value]) -> list[str]:
    return [f"{name} {show_value(value)}" for name, value in edits.items()]


def _remark_jitter(edits: LeafEdits, chosen: Sequence[str]) -> list[Remark]:
    if not edits.jitter_amplitude:
        return []
    carried = {"nurbs": "the slow part of it", "subdiv": "it approximately", "mesh": "it exactly"}
    named_ones = [f"{name} has {how}" for name, how in carried.items() if name in chosen]
    return [remark("jitter-stays-edit", f"the jitter stays an edit{': ' if named_ones else ''}{', '.join(named_ones)}")]
