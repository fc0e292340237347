"""The task that makes one asset of a plant's parts, in one frame."""

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from textwrap import shorten

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage import __version__
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.parts.branch_part import PlantBranches
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.asset.provenance import Provenance, combined_sha256, package_versions
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.branch.model_file import TracedPlant
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.capture.cloud_files.ply import read_cloud
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.errors import FitError, FoliageError
from usdfoliage.files.npz import write_arrays
from usdfoliage.jobs.branches.motion import BranchMotion, grow_near_leaves, rig_branches, rig_near_leaves
from usdfoliage.jobs.branches.run import VARIATIONS, name_variation, variation_seed
from usdfoliage.jobs.branches.warnings import check_motion
from usdfoliage.jobs.capture.results import CLOUD as CLOUD_FILE
from usdfoliage.jobs.leaf_picture import picture_of_leaves
from usdfoliage.jobs.plant.asset_facts import AssetFacts, write_asset_facts
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.settings import SKETCH_SETTINGS, STAGE_SETTINGS, BuildSettings
from usdfoliage.jobs.plant.stages.asset_pictures import AssetDrawing
from usdfoliage.jobs.plant.stages.foliage import (
    ChosenFoliage,
    choose_foliage,
    leaf_cover,
    leaves_on_twigs,
    near_leaves,
)
from usdfoliage.jobs.plant.stages.isolate import plant_capture
from usdfoliage.jobs.plant.stages.models import (
    CapturedLeaves,
    read_captured_leaves,
    read_crown,
    read_plant_branches,
    read_traced,
    read_variation,
)
from usdfoliage.jobs.plant.stages.parts import describe_failed_variation, known_species
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StageSummary, read_summary, write_summary
from usdfoliage.jobs.plant.tasks import BRANCHES, CLOUD, CROWN, LEAVES, SKETCH
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.settings_file import list_settings
from usdfoliage.leaf.model import Leaves, count_origins
from usdfoliage.leaf.reconstruct import describe_low_confidence
from usdfoliage.remarks import Remark, Remedy, remark

_FEW = 0.2  # share of the cloud that is near leaves, below which they do not stand for the plant
_EXPLAINED = 0.5  # share of the cloud's leaves that are those that were found, below which most were not found
_UNLIKE = 0.3  # IoU of silhouettes, below which a crown does not stand for the plant
_NEAR, _REACHED = 0.1, 0.5  # of the plant's height, and share of the cloud that is so near to branches or leaves
_BETWEEN = (0.2, 0.4, 0.6, 0.8)  # places on a branch between two of its points
_MAX_POINTS = 50_000  # of the cloud, from which that share is measured
_MAX_CHARACTERS = 400  # characters of why a part could not be made
_LEFT_OUT = ("branches-left-out", "crown-of-no-leaves")  # codes of remarks on why a plant has no such part

_COVER = "of the cloud is near leaves; where leaves are green, of its green points"
LEAF_NUMBERS = "leaf_numbers.npz"  # number (L,): which leaf of the asset each found one is, -1 for none
ASSET_FOLDER = "asset"  # in the result of a stage that writes one


def assemble_asset(call: StageCall) -> tuple[ResultFile, ...]:
    """One asset of the branches, leaves and crown that were made.

    Raises:
        FitError: None was made; the message gives the reasons, since there is no report.
        FoliageError: Leaves are wanted that there are none of.
    """
    traced = read_traced(call.result_of(BRANCHES)) if call.has(BRANCHES) else None
    captured = read_captured_leaves(call.result_of(LEAVES)) if call.has(LEAVES) else None
    made = read_crown(call.result_of(CROWN)) if call.has(CROWN) else None
    crown = made.model if made is not None else None
    plant_from_capture = plant_frame(traced, captured, crown.asset_from_photo if crown is not None else None)
    chosen = choose_foliage(captured, traced, call.settings, plant_from_capture)
    branches = read_plant_branches(call.result_of(BRANCHES)) if call.has(BRANCHES) else None
    cover = None
    if traced is None and chosen.leaves is not None and call.has(CLOUD):
        cover = _cover(call, chosen.leaves.leaves, plant_from_capture)
    few = cover is not None and cover < _FEW
    reached = 1.0 if traced is None else _reached(traced, chosen)
    # Stems of photographs are seen where the cloud shows none, so that it is no measure for them.
    little = reached < (_FEW if traced is not None and traced.of_photographs else _REACHED)
    if branches is None and chosen.leaves is None and crown is None:
        why, remedy = _why_none(call)
        text = f"neither branches nor leaves nor a crown could be made of {call.request.capture}. {why}"
        raise FitError(text, remedy)

    remarks = list(chosen.remarks)
    if made is not None and made.overlap < _UNLIKE and (branches is not None or chosen.leaves is not None):
        crown = None
        text = (
            f"the crown is left out: its silhouettes and the plant's have {made.overlap:.0%} in common; the plant is "
            "too slender or too sparse for one, or more than one"
        )
        remarks.append(remark("crown-left-out", text))

    crown_leaf, of_crown_leaf = average_crown_leaf(captured) if crown is not None else (None, [])
    remarks += of_crown_leaf
    branches, of_motion = add_motion(branches, chosen.leaves, call.settings, "the plant")
    remarks += of_motion
    if call.settings.branches.variations and branches is None:
        text = "the plant has no variations: no branches were traced"
        remarks.append(remark("variations-without-branches", text))
    if few:
        instead = ", so that the lod crown is shown" if crown is not None else ""
        text = (
            f"the leaves that were found cover {cover:.0%} of the cloud, without branches for others{instead}; leaves "
            "are too small in the photographs, or these show something else"
        )
        remarks.append(remark("leaves-cover-little", text))
    if little:
        instead = "; the lod crown is shown" if crown is not None else ""
        text = (
            f"branches and leaves reach {reached:.0%} of the cloud{instead}; its points are too far apart for "
            "branches, or it shows more than one plant"
        )
        remarks.append(remark("plant-reaches-little", text))
    # Leaves that stand where they were found, and most of which are wrong.
    wrong = chosen.kind == "captured" and chosen.found is not None and bool(describe_low_confidence(chosen.found))
    guessed = describe_guessed_leaves(chosen)
    of_leaves = read_summary(call.result_of(LEAVES)).remarks if guessed else ()
    if guessed and not any(each.code == "leaves-guessed" and each.text == guessed for each in of_leaves):
        small = [each.text for each in of_leaves if each.code == "leaves-small"]
        first = ["the lod crown is shown"] if wrong and crown is not None else []
        remarks.append(remark("plant-leaves-guessed", "; ".join([guessed, *first, *small])))
    variations: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="usdfoliage-thumbnail-", dir=call.out) as work:
        drawing = AssetDrawing(settings=call.settings.pictures, folder=Path(work))
        folder = call.out / ASSET_FOLDER
        folder.mkdir()
        write_plant_asset(
            folder,
            call.request.name,
            provenance=provenance_of(call),
            asset_from_capture=plant_from_capture,
            branches=branches,
            foliage=chosen.leaves,
            crown=crown,
            crown_leaf=crown_leaf,
            settings=PlantAssetSettings(
                crown_mesh_size=call.settings.crown.mesh_size,
                version=call.settings.plant.version,
                lod="crown" if few or little or wrong else None,
            ),
            pictures=drawing.draw,
        )
        if branches is not None:
            variations, of_variations = _write_variations(call, folder, plant_from_capture, captured, chosen)
            remarks += of_variations
    remarks += drawing.remarks
    facts = AssetFacts(
        leaves=0 if chosen.leaves is None else len(chosen.leaves.leaves),
        foliage=chosen.kind,
        branches=0 if traced is None else len(traced.skeleton),
        shape=drawing.shapes[0],
        origins={} if chosen.leaves is None else count_origins(chosen.leaves.leaves),
        is_drawable=not drawing.is_late,
    )
    write_asset_facts(call.out, facts)
    if captured is not None:
        number_of = np.full(len(captured.fitted.leaves), -1, np.int32)
        number_of[chosen.kept] = np.arange(len(chosen.kept))
        write_arrays(call.out / LEAF_NUMBERS, {"number": number_of})
    rows = [
        *facts.count_rows(),
        *([Row(name="cover", value=f"{cover:.0%}", remark=_COVER)] if cover is not None else []),
        *chosen.rows,
        *variations,
    ]
    write_summary(call.out, StageSummary(rows=rows, remarks=remarks, poor=bool(drawing.remarks)))
    return ()


def average_crown_leaf(captured: CapturedLeaves | None) -> tuple[LeafPicture | None, list[Remark]]:
    """The picture that the leaves of a crown have, of the average leaf that was found; None where photographs gave no
    such picture, with a remark where it cannot be used."""
    if captured is None or captured.fitted.appearance.texture is None:
        return None, []
    try:
        return picture_of_leaves(captured.fitted), []
    except FoliageError as error:
        text = f"the crown's leaves are plain ones: {error.text}"
        return None, [remark("crown-leaf-plain", text, remedy=error.remedy)]


def add_motion(
    branches: PlantBranches | None, foliage: BranchLeaves | None, settings: BuildSettings, whose: str
) -> tuple[PlantBranches | None, list[Remark]]:
    """The branches with the sway and the growth that are asked for, and remarks where they have no surface to move."""
    wanted = settings.plant
    if branches is None or not len(branches.surfaces.whole.curve):
        return branches, check_motion(wanted.sway_frames > 0, wanted.growth_frames > 0, whose)
    if wanted.sway_frames:
        branches = add_sway(branches, foliage, settings)
    if wanted.growth_frames:
        branches = add_growth(branches, foliage, settings)
    return branches, []


def add_sway(branches: PlantBranches, foliage: BranchLeaves | None, settings: BuildSettings) -> PlantBranches:
    """The branches with joints and a sway; leaves follow the branch whose bark is nearest to their base."""
    wanted = settings.plant
    motion = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=wanted.sway_frames), sway_clips=wanted.sway_clips)
    skeleton, surfaces = branches.skeleton.skeleton, branches.surfaces
    rig = rig_branches(skeleton, surfaces, motion, settings.seed)
    assert rig is not None
    leaves = None if foliage is None or not len(foliage.leaves) else foliage.leaves
    drawn = np.unique(surfaces.whole.curve)
    return replace(
        branches,
        rig=rig,
        rigged_leaves=None if leaves is None else rig_near_leaves(rig, skeleton, leaves, drawn),
    )


def add_growth(branches: PlantBranches, foliage: BranchLeaves | None, settings: BuildSettings) -> PlantBranches:
    """The branches with their growth; leaves come out of the branch whose bark is nearest to their base."""
    skeleton, known = branches.skeleton.skeleton, branches.skeleton.growth
    height_m = float(np.ptp(skeleton.points_m, axis=0).max())
    exponent = (known_species(settings.plant.species) or load_species(GENERIC)).exponent  # of stems in photographs
    return replace(
        branches,
        growth=grow_near_leaves(
            skeleton,
            branches.surfaces,
            BranchMotion(growth_frames=settings.plant.growth_frames),
            known.get("internodeLength", BranchSettings.internode_of_height * height_m),
            known.get("allometryExponent", exponent),
            None if foliage is None or not len(foliage.leaves) else foliage.leaves,
        ),
    )


def _write_variations(
    call: StageCall,
    folder: Path,
    plant_from_capture: NDArray[np.float64],
    captured: CapturedLeaves | None,
    chosen: ChosenFoliage,
) -> tuple[list[Row], list[Remark]]:
    """Assets of further plants that grew through the same cloud, each with leaves on its twigs; how many there are, and
    what the user should know."""
    settings, wanted = call.settings, call.settings.branches.variations
    remarks: list[Remark] = []
    made = 0
    for number in range(1, wanted + 1):
        branches = read_variation(call.result_of(BRANCHES), number)
        if branches is None:
            continue
        name = name_variation(call.request.name, number)
        own = folder / VARIATIONS / name
        seed = variation_seed(settings.seed, number)
        try:
            foliage = leaves_on_twigs(branches.skeleton.skeleton, captured, chosen, settings, seed)
            moving, of_motion = add_motion(branches, foliage, settings, f"variation {number}")
            own.mkdir(parents=True)
            write_plant_asset(
                own,
                name,
                provenance=replace(provenance_of(call), seed=seed),
                asset_from_capture=plant_from_capture,
                branches=moving,
                foliage=foliage,
                crown=None,
                settings=PlantAssetSettings(version=settings.plant.version),
            )
        except FoliageError as error:
            remarks.append(describe_failed_variation(number, error))
            shutil.rmtree(own, ignore_errors=True)
            continue
        remarks += of_motion
        made += 1
    rows = [Row(name="variations", value=str(made) if made == wanted else f"{made} of {wanted}")] if wanted else []
    return rows, remarks


def describe_guessed_leaves(chosen: ChosenFoliage) -> str:
    """A sentence where most of the plant's leaves are none that were found, or are wrong; else empty."""
    if chosen.found is None or chosen.leaves is None or chosen.kind not in ("captured", "filled"):
        return ""
    found, others = len(chosen.found), len(chosen.leaves.leaves) - len(chosen.found)
    if others > found:
        return f"{found:,} of {found + others:,} leaves were found, and the others are drawn from them"
    if chosen.explained is not None and chosen.explained < _EXPLAINED:
        return f"the leaves that were found are {chosen.explained:.0%} of those that the cloud shows"
    return describe_low_confidence(chosen.found)


def _why_none(call: StageCall) -> tuple[str, Remedy]:
    """Why no part was made, and what to do: the reasons and remedies from the summaries of the parts' stages."""
    reasons = []
    remedy: Remedy = ()
    for stage in (BRANCHES, LEAVES, CROWN):
        if not call.has(stage):
            reasons.append(f"{stage.capitalize()}: not asked for")
            continue
        summary = read_summary(call.result_of(stage))
        why = summary.failure or next((each.text for each in summary.remarks if each.code in _LEFT_OUT), "")
        what = shorten(why or "none found", _MAX_CHARACTERS, placeholder=" …")
        reasons.append(f"{stage.capitalize()}: {what}")
        if summary.remedy:
            remedy = (*remedy, f"{'; ' if remedy else ''}for the {stage}, ", *summary.remedy)
    return ". ".join(reasons), remedy


def _cover(call: StageCall, leaves: Leaves, plant_from_capture: NDArray[np.float64]) -> float:
    """Which share of the plant's cloud lies near its leaves."""
    folder = plant_capture(call)
    cloud = read_cloud(folder / CLOUD_FILE)
    some = np.linspace(0, len(cloud) - 1, min(len(cloud), _MAX_POINTS)).astype(np.int64)
    points_m = cloud.points_m[some] @ plant_from_capture[:3, :3].T + plant_from_capture[:3, 3]
    return leaf_cover(points_m, leaves, None if cloud.srgb is None else cloud.srgb[some])


def _reached(traced: TracedPlant, chosen: ChosenFoliage) -> float:
    """Which share of the plant's points lies near its branches and leaves."""
    some = np.linspace(0, len(traced.points_m) - 1, min(len(traced.points_m), _MAX_POINTS)).astype(np.int64)
    points_m = traced.points_m[some]
    if not len(points_m):
        return 1.0
    leaves = None if chosen.leaves is None else chosen.leaves.leaves
    ends_m = traced.skeleton.points_m
    joined = np.flatnonzero(np.diff(traced.skeleton.curve) == 0)  # to the next point
    between_m = [ends_m[joined] + share * (ends_m[joined + 1] - ends_m[joined]) for share in _BETWEEN]
    drawn_m = np.concatenate([ends_m, *between_m, *([leaves.base_m] if leaves is not None else [])])
    away_m = np.asarray(cKDTree(drawn_m).query(points_m)[0])
    reached = away_m <= _NEAR * float(np.ptp(points_m[:, 1]))
    if leaves is not None and chosen.kind in ("captured", "filled"):  # few and large, they reach far from their bases
        reached |= near_leaves(points_m, leaves)
    return float(reached.mean())


def plant_frame(
    traced: TracedPlant | None, captured: CapturedLeaves | None, crown_from_capture: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Where the plant stands, (4, 4) for column vectors from the capture's coordinates: as the first part that is there
    has it, branches before leaves before the crown."""
    if traced is not None:
        return traced.plant_from_capture
    if captured is not None:
        return captured.own_from_capture
    return np.eye(4) if crown_from_capture is None else crown_from_capture


def provenance_of(call: StageCall) -> Provenance:
    """What is recorded of the run: every setting, every version, every input file."""
    stages = {
        name: {key: text for key, text in list_settings(getattr(call.settings, name)).items() if _decides(key)}
        for name in (SKETCH_SETTINGS if call.has(SKETCH) else STAGE_SETTINGS)
    }
    inputs = dict(call.inputs.digests)
    return Provenance(
        species=call.settings.plant.species,
        capture=call.inputs.source.resolve().name,
        generator=f"usdfoliage {__version__}",
        seed=call.settings.seed,
        input_sha256=combined_sha256(inputs),
        inputs=inputs,
        stages=stages,
        versions=package_versions(),
    )


def _decides(key: str) -> bool:
    """Whether a setting is listed: the number of threads changes no result, and the seed is listed once."""
    return key.rsplit(".", 1)[-1] not in ("threads", "seed")
