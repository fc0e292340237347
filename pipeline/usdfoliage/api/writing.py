"""From models to assets, looks and baked assets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.access import bake_access, look_access
from usdfoliage.asset.asset_record import AssetOrigin, is_asset_folder
from usdfoliage.asset.leaf_representations import read_representations, read_settings
from usdfoliage.asset.looks.look import write_look_layer
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.parts.branch_part import BranchAssetSettings, PlantBranches
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_part import BranchLeaves, LeafAppearance
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import publish_folder
from usdfoliage.branch.model import Skeleton
from usdfoliage.crown.model import CrownModel
from usdfoliage.files.write_gate import Access, check_access
from usdfoliage.jobs.branches.surfaces import build_surfaces
from usdfoliage.jobs.edits.bake import BakeRequest, bake_asset
from usdfoliage.jobs.edits.given_pictures import check_pictures
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Remark


@dataclass(frozen=True, kw_only=True)
class WrittenAsset:
    """An asset that was written.

    Attributes:
        asset: The interface layer: the file to open or to reference.
        remarks: What the user should know of it.
    """

    asset: Path
    remarks: tuple[Remark, ...] = ()


def write_asset(
    output: str | Path,
    *,
    leaves: Leaves | None = None,
    skeleton: Skeleton | None = None,
    crown: CrownModel | None = None,
    edits: LeafEdits = NEUTRAL,
    appearance: LeafAppearance = LeafAppearance(),
    representations: Sequence[str] = ("bezier", "nurbs", "subdiv", "mesh"),
    asset_from_capture: NDArray[np.float64] | None = None,
    provenance: Provenance | None = None,
    name: str | None = None,
    version: str = "1",
    force: bool = False,
    keep_old: bool = False,
) -> WrittenAsset:
    """Write an asset of one part or of several. It appears whole or not at all; an asset that was there is replaced.

    All parts are in the asset's frame: metres, right-handed, Y up. The same arguments write the same bytes.

    Args:
        output: The asset's folder.
        leaves: The leaves, before the edits.
        skeleton: The axes of the branches; their surface is made of it.
        crown: The crown.
        edits: Collective edits of the leaves. They stay opinions that an artist can change; representations other than
            `bezier` are written as the edits make them.
        appearance: The colour and the pictures that all leaves share; pictures are copied into the asset.
        representations: Those of the leaves, of `bezier`, `nurbs`, `subdiv` and `mesh`; the first one is selected.
            `bezier` is always written, since without it nothing could be edited.
        asset_from_capture: (4, 4) for column vectors, from the coordinates of the input files to the asset. Without it
            that of the crown if there is one, else the identity.
        provenance: What made the models, such as AssetModels.provenance; without it an empty record of this version.
        name: The name of the root prim; by default that of the folder, made an identifier.
        version: The asset's version, for its assetInfo.
        force: Replace an asset of another name or origin too, or one whose record is lost. Files that are not the
            asset's always stay.
        keep_old: Keep the asset that is replaced, in a folder beside the new one that the log names.

    Returns:
        The asset, and remarks on branches that its surface could not take in.

    Raises:
        ValueError: No part is given, a number of a part is not finite or out of its range, or the crown's cubemaps do
            not fit each other.
        CaptureError: A picture of the appearance cannot be used.
        FoliageError: There is no such representation.
        AssetError: The output is a file or somebody else's folder, holds a picture that is read, or cannot be written.
            What was there is unchanged.
    """
    if leaves is None and skeleton is None and crown is None:
        raise ValueError("an asset has leaves, branches or a crown, and none of them was given")
    check_pictures(appearance.texture, appearance.jitter_map)
    folder = Path(output)
    check_access(_access_of_pictures(appearance, folder))
    root = asset_name(name or folder.resolve().name)
    record = provenance or Provenance(capture="", generator=f"usdfoliage {__version__}", seed=0, input_sha256="")
    matrix = asset_from_capture
    if matrix is None:
        matrix = np.eye(4) if crown is None else crown.asset_from_photo
    settings = replace(read_settings(read_representations(representations), None), version=version)
    foliage = None
    if leaves is not None:
        foliage = BranchLeaves(leaves=leaves, settings=settings, edits=edits, appearance=appearance)
    remarks: list[Remark] = []
    origin = AssetOrigin(name=root, command="write_asset")
    with publish_folder(folder, force=force, origin=origin, keep_old=keep_old) as new:
        if crown is not None:
            branches = None
            if skeleton is not None:
                made = build_surfaces(skeleton)
                remarks = list(made.remarks)
                prim = SkeletonPrim(skeleton=made.skeleton)
                branches = PlantBranches(
                    skeleton=prim, surfaces=made.surfaces, settings=BranchAssetSettings(version=version)
                )
            interface = write_plant_asset(
                new,
                root,
                provenance=record,
                asset_from_capture=matrix,
                branches=branches,
                foliage=foliage,
                crown=crown,
                settings=PlantAssetSettings(version=version),
            )
        elif skeleton is not None:
            made = build_surfaces(skeleton)
            remarks = list(made.remarks)
            prim = SkeletonPrim(skeleton=made.skeleton)
            bark = BranchAssetSettings(version=version)
            interface = write_branch_asset(new, root, prim, made.surfaces, record, matrix, bark, foliage)
        else:
            assert leaves is not None
            interface = write_leaf_asset(new, root, leaves, record, settings, edits, appearance, matrix)
    return WrittenAsset(asset=folder / interface.name, remarks=tuple(remarks))


def _access_of_pictures(appearance: LeafAppearance, folder: Path) -> Access:
    """Pictures of the asset that is replaced come along; whose else lie there stay, and are no asset's pictures."""
    pictures = tuple(each for each in (appearance.texture, appearance.jitter_map) if each is not None)
    keeps = pictures if folder.is_dir() and is_asset_folder(folder) else ()
    return Access(reads=pictures, replaces=(folder,), keeps=keeps)


def write_look(
    path: str | Path,
    asset: str | Path,
    edits: LeafEdits,
    *,
    jitter_map: str | Path | None = None,
    prim_path: str | None = None,
    force: bool = False,
) -> Path:
    """Write a look: a layer that gives the leaves of an asset these edits. The asset stays as it is.

    Args:
        path: The `.usda` to write, outside the asset's folder; an earlier look there is replaced.
        asset: The asset's folder or its `.usda`; or a look, and then the new one is a look of that look's asset.
        edits: The edits as the leaves shall have them in the end, those of the asset included. To add to those that it
            has already, give `compose_edits(open_asset(asset).edits, edits)`.
        jitter_map: An image whose first row is one cycle of the jitter. It is referred to where it is.
        prim_path: Edit only the placement at this prim of a scene, such as `/World/plant_1`; all placements without.
        force: Replace a file that is no look too.

    Returns:
        path.

    Raises:
        AssetError: The asset cannot be read or has no leaves; path is no `.usda`, lies in an asset's folder, is read
            itself, is somebody else's file, or cannot be written.
        CaptureError: The jitter map cannot be used.
    """
    wave = None if jitter_map is None else Path(jitter_map)
    check_pictures(None, wave)
    check_access(look_access(Path(path), Path(asset), wave))
    return write_look_layer(Path(path), Path(asset), edits, wave, prim_path, force=force)


def bake(
    asset: str | Path,
    output: str | Path,
    *,
    name: str | None = None,
    representations: Sequence[str] | None = None,
    resolution: tuple[int, int] | None = None,
    source: str = "bezier",
    force: bool = False,
    keep_old: bool = False,
    progress: StepProgress | None = None,
) -> WrittenAsset:
    """Write an asset whose leaves are as the edits of another, or of a look, make them.

    Args:
        asset: The asset's folder, its `.usda`, or a look of it.
        output: The folder of the new asset; that of the asset itself replaces it.
        name: The name of the root prim; by default that of the folder, made an identifier.
        representations: Those of the leaves, `bezier` always among them; by default those that the asset has.
        resolution: Cells of a leaf of the mesh, across (an even number) and along; by default (8, 16).
        source: The representation that is read: `bezier`, or `nurbs` to fit leaves to patches that somebody changed.
        force: Replace an asset of another name or origin too, or one whose record is lost. Files that are not the
            asset's always stay.
        keep_old: Keep the asset that is replaced, in a folder beside the new one that the log names.
        progress: Called with the name of the step and its share that is done, 0 to 1.

    Returns:
        The new asset, and remarks on what it lacks or could not take over.

    Raises:
        FoliageError: The asset cannot be read or has no leaves, an argument cannot be, or the output cannot be written
            or would replace what is read. What was there is unchanged.
    """
    chosen = None if representations is None else read_representations(representations)
    read_settings(chosen or ("bezier",), resolution)
    request = BakeRequest(
        asset=Path(asset),
        output=Path(output),
        name=name,
        representations=chosen,
        resolution=resolution,
        source=source,
        force=force,
        keep_old=keep_old,
    )
    check_access(bake_access(request.asset, request.output))
    baked = bake_asset(request, progress)
    return WrittenAsset(asset=baked.asset, remarks=baked.remarks)
