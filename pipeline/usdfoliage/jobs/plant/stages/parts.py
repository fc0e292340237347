"""The tasks that turn a capture, or a cloud, into parts of a plant: branches, leaves, crown."""

import logging
from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from functools import partial
from pathlib import Path

import numpy as np

from usdfoliage.asset.packages.leaf_package import AssetSettings
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.foliage.species import GENERIC, Species, load_library, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.model_file import BranchesModel, TracedPlant, write_branches_model, write_traced_plant
from usdfoliage.branch.tracing.radii import RadiusSettings
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.capture.folder.listing import MASKS
from usdfoliage.crown.hull import HullSettings
from usdfoliage.crown.model_file import write_crown_model
from usdfoliage.crown.reconstruct import CapturedCrownSettings
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.jobs.branches.foliage import FoliageRequest
from usdfoliage.jobs.branches.likeness import likeness_rows
from usdfoliage.jobs.branches.regrowth import TRACE, Fill, RegrowthRequest
from usdfoliage.jobs.branches.run import BranchesRequest, FoundBranches, find_branches, report_branches, vary_plant
from usdfoliage.jobs.branches.tracing import NoStemsError
from usdfoliage.jobs.branches.warnings import check_variations
from usdfoliage.jobs.crown.capture_input import PlantPoints
from usdfoliage.jobs.crown.run_capture import CapturedCrownRequest, find_captured_crown, report_crown
from usdfoliage.jobs.leaves.cloud_run import POINTS_FILE, find_cloud_leaves, report_cloud_leaves, write_points
from usdfoliage.jobs.leaves.page import measure_rows
from usdfoliage.jobs.leaves.publish import RunFacts
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.leaves.run import encode_texture, find_capture_leaves, report_leaves
from usdfoliage.jobs.leaves.settings import LeavesRunSettings, LeavesSettings
from usdfoliage.jobs.no_plant import NoPlantError
from usdfoliage.jobs.plant.call import StageCall, fails_now
from usdfoliage.jobs.plant.stages.isolate import GIVEN_DEPTH, is_floorless, plant_capture
from usdfoliage.jobs.plant.stages.models import (
    AVERAGE_LEAF,
    BRANCHES_MODEL,
    CROWN_MODEL,
    LEAVES_MODEL,
    PLANT_POINTS,
    REPORT_FOLDER,
    VARIATION_MODEL,
    leafy_points,
    read_leaf_frame,
    read_traced,
)
from usdfoliage.jobs.plant.stages.stems import try_photographed_stems
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import BRANCHES, CLOUD, ISOLATION, LEAVES
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_roots
from usdfoliage.jobs.report.table import Row, WrittenReport
from usdfoliage.jobs.work.settings_file import set_everywhere
from usdfoliage.leaf.model_file import write_leaves_model
from usdfoliage.remarks import Remark, Setting, remark

logger = logging.getLogger(__name__)


def trace_branches(call: StageCall) -> tuple[ResultFile, ...]:
    """The branches of the cloud, as models; where none can be traced, the plant has none."""
    settings = call.settings.branches
    species = call.settings.plant.species
    roots, given_roots = read_roots(settings.roots)
    known = known_species(species)
    allometry = AllometrySettings(exponent=known.exponent) if known else AllometrySettings()
    # Of what is known to be leaves nothing is grown, and what grew has come to all that it can.
    unknown = not call.has(CLOUD) and settings.cloud_leaves == "auto" and settings.method == TRACE
    fill: Fill = "off" if settings.fill == "auto" and not unknown else settings.fill
    request = BranchesRequest(
        cloud=PlantCloudRequest(
            path=_cloud_of(call),
            roots=roots,
            given_roots=given_roots,
            max_points=settings.max_points,
            internode_m=settings.internode_m,
            has_ground=not is_floorless(call),
            # Of photographs isolation knows what stands beside the plant.
            must_be_plant=settings.make == "auto" and not call.has(CLOUD),
        ),
        output=call.out,
        name=call.request.name,
        settings=BranchSettings(
            internode_m=settings.internode_m, leaves=settings.cloud_leaves, radii=RadiusSettings(allometry=allometry)
        ),
        species=known.name if known else "",
        foliage=FoliageRequest(species=known) if known else FoliageRequest(),
        regrowth=RegrowthRequest(
            method=settings.method,
            fill=fill,
            internode_m=settings.internode_m,
            variations=settings.variations,
            variation_spread=settings.variation_spread,
        ),
        max_faces=settings.max_faces,
        seed=call.settings.seed,
        times=False,
        # Photographs show that a plant is one of leaves; a scan alone is traced as the command for branches traces it.
        needs_stems=settings.make == "auto" and call.has(CLOUD),
        color_of_cloud=call.has(CLOUD),  # a scan may be coloured by height or intensity
    )
    seconds: dict[str, float] = {}
    by_photographs = call.has(CLOUD) and settings.photographs and not given_roots
    failures: list[Remark] = []
    if call.has(CLOUD) and settings.photographs and given_roots:
        text = "stems were not looked for in the photographs: places of roots are given, from which the cloud is traced"
        remedy = (Setting(name="branches.roots", value='"auto"'), " has both looked for")
        failures.append(remark("stems-from-given-roots", text, remedy=remedy))
    stems_of_photographs = partial(try_photographed_stems, call, failures) if by_photographs else None
    try:
        found = find_branches(request, None, seconds, call.progress, stems_of_photographs)
    except NoPlantError:
        raise
    except NoStemsError:
        left_out = remark(
            "branches-left-out",
            "the plant has no branches: the cloud shows no stem at a root and hardly a round branch, as of a hedge or "
            "a wall of leaves",
            remedy=(
                Setting(name="branches.make", value='"on"'),
                " traces them nevertheless, best with ",
                Setting(name="branches.roots"),
            ),
        )
        write_summary(call.out, StageSummary(remarks=[left_out, *failures]))
        return ()
    except FoliageError as error:
        return _go_without(call, "branches", error, failures)
    report = _report_folder(call)
    written = report_branches(report, request, found, seconds)
    skeleton = found.made.skeleton
    model = BranchesModel(
        skeleton=skeleton.skeleton,
        surfaces=found.made.surfaces,
        color=found.bark.color,
        growth=skeleton.growth,
    )
    write_branches_model(call.out / BRANCHES_MODEL, model)
    write_traced_plant(
        call.out / PLANT_POINTS,
        TracedPlant(
            points_m=found.plant.points_m,
            wood=found.drawn.wood,
            knows_leaves=found.drawn.knows_leaves,
            colors=found.plant.colors,
            plant_from_capture=found.plant.asset_from_cloud,
            skeleton=found.drawn.skeleton,
            of_photographs=found.stems is not None,
            turned=np.zeros(0, np.int32) if found.stems is None else found.stems.turned,
            unjoined=np.zeros(0, np.int32) if found.stems is None else found.stems.unjoined,
        ),
    )
    likeness, of_variations = _write_variations(call, request, found)
    remarks = [*found.remarks, *failures, *of_variations]
    remarks += remark_unknown_species(species)
    summary = StageSummary(
        rows=[*found.rows, *likeness],
        remarks=remarks,
        pictures=_pictures_of(written),
        detail=f"{REPORT_FOLDER}/index.html",
    )
    write_summary(call.out, summary)
    return ()


def _write_variations(
    call: StageCall, request: BranchesRequest, found: FoundBranches
) -> tuple[list[Row], list[Remark]]:
    """Models of further plants that grow through the cloud; how they differ, and what the user should know."""
    if not request.regrowth.variations:
        return [], []
    if found.stems is not None:
        text = "the plant has no variations: its stems are lines in photographs, and the cloud does not show them"
        return [], [remark("variations-without-branches", text)]
    skeletons: list[Skeleton] = []
    reached: dict[int, float] = {}
    failed: list[Remark] = []
    for number in range(1, request.regrowth.variations + 1):
        try:
            variation, made = vary_plant(request, found, number)
        except FoliageError as error:
            failed.append(describe_failed_variation(number, error))
            continue
        model = BranchesModel(
            skeleton=made.traced.skeleton,
            surfaces=made.surfaces,
            color=found.bark.color,
            growth=made.skeleton.growth,
        )
        write_branches_model(call.out / VARIATION_MODEL.format(number=number), model)
        skeletons.append(model.skeleton)
        reached[number] = variation.reached
    rows = likeness_rows(found.drawn.skeleton, skeletons, list(reached.values()))
    return rows, [*failed, *check_variations(reached)]


def describe_failed_variation(number: int, error: FoliageError) -> Remark:
    """A remark on a variation that cannot be made, without which the plant remains.

    Raises:
        FoliageError: It cannot be made here and now, as on a full disk; on another day it can.
    """
    if fails_now(error):
        raise error
    logger.warning("no variation %d: %s", number, error.text)
    return remark("variation-failed", f"variation {number} is left out: {error.text}", remedy=error.remedy)


def known_species(name: str) -> Species | None:
    """What is known of a species; None where its name is one for the asset alone."""
    try:
        return load_species(name)
    except FoliageError:
        return None


def remark_unknown_species(name: str) -> tuple[Remark, ...]:
    """A remark on a species of which nothing is known, with the one that may be meant; none where it is known or ""."""
    if not name or known_species(name) is not None:
        return ()
    known = sorted(set(load_library(None)) - {GENERIC})
    close = get_close_matches(name.lower(), known, 1)
    text = (
        f"nothing is known of the species {name}, whose name is written into the asset and whose twigs are those of "
        "any tree"
    )
    meant = f"is {close[0]} meant?" if close else f"known are {', '.join(known)}"
    return (remark("species-unknown", text, remedy=meant),)


def find_leaves(call: StageCall) -> tuple[ResultFile, ...]:
    """The leaves that photographs or a cloud show, as a model; where none can be looked for, the plant has none."""
    if not call.has(CLOUD):
        return _find_in_cloud(call)
    settings = call.settings.leaves
    given = call.inputs.has_depth and settings.depth != "estimated" and call.inputs.has_cameras
    # Masks of the plant lie beside the depth that was found, and beside that which was given.
    isolated = call.has(ISOLATION)
    capture = call.request.capture if given and not isolated else plant_capture(call)
    if not given and settings.depth == "given":
        raise CaptureError(f"{capture} has depth but no cameras/ that it belongs to", "set leaves.depth to estimated")
    request = LeavesRequest(
        capture=capture,
        output=call.out,
        name=call.request.name,
        settings=_leaves_settings(call),
        hold_back=call.settings.plant.hold_back if given and not isolated else 0,
        depth=GIVEN_DEPTH if given and isolated else "depth",
        representations=("bezier",),
        species=call.settings.plant.species,
        seed=call.settings.seed,
        report_views=6,
        times=False,
    )
    try:
        found = find_capture_leaves(request, call.progress)
    except FoliageError as error:
        return _go_without(call, "leaves", error)
    # Masks that the photographs came with were checked before anything was matched within them.
    remarks = [each for each in found.remarks if each.code != "masks-beside-plant"]
    report = _report_folder(call)
    texture = ""
    if found.found.texture is not None:
        texture = AVERAGE_LEAF
        for folder in (call.out, report):
            (folder / texture).write_bytes(encode_texture(found.found.texture))
    written = report_leaves(report, request, found, RunFacts(remarks=remarks, seconds=found.seconds), texture)
    write_leaves_model(call.out / LEAVES_MODEL, found.model)
    pictures = _pictures_of(written)
    if texture:
        pictures.append(StagePicture(file=texture, caption="The average leaf"))
    summary = StageSummary(
        rows=measure_rows(found.leaves),
        remarks=remarks,
        pictures=pictures,
        detail=f"{REPORT_FOLDER}/index.html",
    )
    write_summary(call.out, summary)
    return ()


def _find_in_cloud(call: StageCall) -> tuple[ResultFile, ...]:
    """The leaves that the cloud shows by itself, as a model; none where they are too few to stand for the plant's."""
    request = LeavesRequest(
        capture=call.request.capture,
        output=call.out,
        name=call.request.name,
        settings=_leaves_settings(call),
        representations=("bezier",),
        species=call.settings.plant.species,
        seed=call.settings.seed,
        times=False,
    )
    try:
        made = find_cloud_leaves(request, call.progress)
    except FoliageError as error:
        return _go_without(call, "leaves", error)
    report = _report_folder(call)
    remarks = list(made.remarks)
    confidence = made.leaves.confidence
    right, min_right = float(np.sum(confidence)) if confidence is not None else 0.0, call.settings.leaves.min_in_cloud
    if len(made.leaves) and right >= min_right:
        write_leaves_model(call.out / LEAVES_MODEL, made.model)
        write_points(report / POINTS_FILE, made, call.threads)
    else:
        text = (
            f"{len(made.leaves)} leaves were found in the cloud, of which some {right:.0f} are right and "
            f"{min_right:g} are needed: the plant's leaves are not its own"
        )
        remedy = ("set ", Setting(name="leaves.min_in_cloud"), " lower to have them nevertheless")
        remarks.append(remark("cloud-leaves-few", text, remedy=remedy))
    written = report_cloud_leaves(report, request, made, RunFacts(remarks=remarks, seconds=made.seconds))
    summary = StageSummary(
        rows=measure_rows(made.leaves),
        remarks=remarks,
        pictures=_pictures_of(written),
        detail=f"{REPORT_FOLDER}/index.html",
    )
    write_summary(call.out, summary)
    return ()


def _leaves_settings(call: StageCall) -> LeavesRunSettings:
    """The settings of leaves as their job takes them."""
    settings = call.settings.leaves
    values = {field.name: getattr(settings, field.name) for field in fields(LeavesSettings)}
    threaded = set_everywhere(LeavesRunSettings(**values), "threads", call.threads)
    return set_everywhere(threaded, "seed", call.settings.seed)


def make_crown(call: StageCall) -> tuple[ResultFile, ...]:
    """The crown of the cloud and of photographs, if any, in the plant's frame; where none can be made, it has none."""
    settings = call.settings.crown
    traced = read_traced(call.result_of(BRANCHES)) if call.has(BRANCHES) else None
    plant = None
    if traced is not None and traced.is_leafless:
        bare = remark("crown-of-no-leaves", "the plant has no crown: it has no leaves")
        write_summary(call.out, StageSummary(remarks=[bare]))
        return ()
    if traced is not None:
        plant = PlantPoints(
            points_m=traced.points_m,
            foliage=leafy_points(traced) if traced.knows_leaves and not traced.wood.all() else None,
            colors=traced.colors,
            asset_from_capture=traced.plant_from_capture,
        )
    frame = read_leaf_frame(call.result_of(LEAVES)) if call.has(LEAVES) and traced is None else None
    request = CapturedCrownRequest(
        cloud=PlantCloudRequest(path=_cloud_of(call), roots=RootSettings(), has_ground=not is_floorless(call)),
        output=call.out,
        name=call.request.name,
        settings=CapturedCrownSettings(
            size=settings.size,
            seed=call.settings.seed,
            threads=call.threads,
            hull=HullSettings(drawn_masks=call.has(ISOLATION) and not _has_masks(call)),
        ),
        asset_settings=AssetSettings(crown_mesh_size=settings.mesh_size),
        species=call.settings.plant.species,
        times=False,
    )
    try:
        found = find_captured_crown(request, call.progress, plant=plant, asset_from_capture=frame)
    except FoliageError as error:
        return _go_without(call, "crown", error)
    report = _report_folder(call)
    written = report_crown(report, request, found).written
    write_crown_model(call.out / CROWN_MODEL, found.made)
    summary = StageSummary(
        rows=found.rows,
        remarks=found.remarks,
        pictures=_pictures_of(written),
        detail=f"{REPORT_FOLDER}/index.html",
    )
    write_summary(call.out, summary)
    return ()


def _report_folder(call: StageCall) -> Path:
    """A new folder for the report of the stage alone."""
    folder = call.out / REPORT_FOLDER
    folder.mkdir()
    return folder


def _pictures_of(written: WrittenReport) -> list[StagePicture]:
    """The pictures of the stage's own report that the report of the plant has too."""
    return [
        StagePicture(file=f"{REPORT_FOLDER}/{picture.file}", caption=picture.caption) for picture in written.pictures
    ]


def _cloud_of(call: StageCall) -> Path:
    """What photographs gave, with what its capture.toml states, or the file that the user gave."""
    return plant_capture(call) if call.has(CLOUD) else call.request.capture


def _has_masks(call: StageCall) -> bool:
    """Whether the user gave some."""
    return any(name.startswith(f"{MASKS}/") for name in call.inputs.files)


def _go_without(
    call: StageCall, what: str, error: FoliageError, others: Sequence[Remark] = ()
) -> tuple[ResultFile, ...]:
    """A part that cannot be made is left out, and the report begins with that warning; others come after it.

    Raises:
        FoliageError: It cannot be made here and now, as on a full disk; on another day it can.
    """
    if fails_now(error):
        raise error
    logger.warning("no %s: %s", what, error.text)
    failed = remark("part-failed", f"the plant has no {what}: {error.text}", subject=what, remedy=error.remedy)
    write_summary(call.out, StageSummary(failure=error.text, remedy=error.remedy, remarks=[failed, *others]))
    return ()
