"""From a cloud on disk to an asset of branches."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.packages.branch_package import write_branch_asset
from usdfoliage.asset.parts.branch_growth import BranchGrowth
from usdfoliage.asset.parts.branch_part import BranchAssetSettings
from usdfoliage.asset.parts.branch_rig import BranchRig
from usdfoliage.asset.parts.branches import SkeletonPrim
from usdfoliage.asset.parts.leaf_motion import RiggedLeaves
from usdfoliage.asset.parts.leaf_part import BranchLeaves
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.internodes import measure_internode_m
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.free_axes import points_of_branches
from usdfoliage.branch.tracing.reconstruct import TracedBranches
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.files.hashing import digest_file
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.jobs.branches.foliage import (
    FoliageRequest,
    describe_foliage,
    grow_leaves,
)
from usdfoliage.jobs.branches.known_stems import KnownStems
from usdfoliage.jobs.branches.likeness import likeness_rows
from usdfoliage.jobs.branches.motion import BranchMotion, grow_branches, rig_branches, rig_grown_leaves
from usdfoliage.jobs.branches.regrowth import GROW, RegrowthRequest, Variation, regrow_branches, vary_branches
from usdfoliage.jobs.branches.report import BranchesReport, branch_rows, write_branches_report
from usdfoliage.jobs.branches.surfaces import build_surfaces, faces_of_cloud
from usdfoliage.jobs.branches.tracing import FindStems, trace_cloud
from usdfoliage.jobs.branches.warnings import NO_STEMS, check_faces, check_motion, check_surface, check_variations
from usdfoliage.jobs.fitted_leaves import FittedLeaves, read_fitted_leaves
from usdfoliage.jobs.no_plant import check_traced
from usdfoliage.jobs.plant_cloud import PlantCloud, PlantCloudRequest, read_plant_cloud
from usdfoliage.jobs.report.table import Row, WrittenReport
from usdfoliage.progress import StepProgress, follow_step
from usdfoliage.remarks import Remark, RenderSetting, Setting, as_plan_setting, label_remarks, merge_remarks, remark

logger = logging.getLogger(__name__)

VARIATIONS = "variations"  # folder of the assets of variations
_LIT = 0.75  # quantile of colours: the middle of their lighter half


@dataclass(frozen=True, kw_only=True)
class BranchesRequest:
    """What the user asked for, checked."""

    cloud: PlantCloudRequest
    output: Path
    name: str
    settings: BranchSettings
    species: str = ""
    regrowth: RegrowthRequest = field(default_factory=RegrowthRequest)
    foliage: FoliageRequest = field(default_factory=FoliageRequest)
    motion: BranchMotion = field(default_factory=BranchMotion)
    asset: BranchAssetSettings = field(default_factory=BranchAssetSettings)
    max_faces: int | None = None  # of the surface; by the points of the cloud where it is not given
    seed: int = 0
    preview: bool = True
    times: bool = True  # whether the report lists how long each step took
    needs_stems: bool = False  # as trace_cloud takes it
    color_of_cloud: bool = False  # branches have the colour of the cloud's wood, where it has colours
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    render_setting: RenderSetting = as_plan_setting  # how the report writes settings

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="branches", source=self.cloud.path.resolve().name)


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeBranches:
    """What was written, and what the user should know of it."""

    asset: Path
    report: Path
    variations: tuple[Path, ...]  # assets of variations of the plant
    remarks: tuple[Remark, ...]
    measures: tuple[Row, ...]
    seconds: dict[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundBranches:
    """The branches of a cloud, before anything is written."""

    plant: PlantCloud  # as it was traced
    traced: TracedBranches
    drawn: TracedBranches  # the same, or regrown, without what the surface lacks
    made: "PlantModel"
    bark: BranchAssetSettings
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]
    stems: KnownStems | None = None  # that were taken in place of those of the cloud


def find_branches(
    request: BranchesRequest,
    fitted: FittedLeaves | None,
    seconds: dict[str, float],
    progress: StepProgress | None = None,
    find_stems: FindStems | None = None,
) -> FoundBranches:
    """Trace the branches of a cloud, with their surface, their leaves and what moves; nothing is written.

    Args:
        request: What was asked for.
        fitted: Leaves to be drawn from; None for leaves of the species, if any.
        seconds: What each step took is added.
        progress: Called at each step.
        find_stems: As trace_cloud takes it.

    Raises:
        NoPlantError: The cloud must be of a plant, and shows none.
        NoStemsError: The request needs stems, and the cloud shows none.
        FoliageError: The input is unusable.
    """
    grows = request.regrowth.method == GROW
    found = trace_cloud(
        request.cloud,
        request.settings,
        seconds,
        progress,
        needs_stems=request.needs_stems,
        find_stems=find_stems,
        grows=grows,
    )
    plant, traced = found.plant, found.traced
    bark = request.asset
    if request.color_of_cloud and plant.colors is not None and traced.wood.any():
        of_stems = points_of_branches(plant.points_m, traced.skeleton.up_to_order(0), traced.spacing_m)
        color = wood_color(plant.colors[of_stems & traced.wood if (of_stems & traced.wood).any() else traced.wood])
        bark = replace(bark, color=color)
    with follow_step("growth", seconds, progress) as advance:
        drawn, of_growth = regrow_branches(
            traced,
            plant,
            request.regrowth,
            request.foliage.species,
            request.seed,
            lambda share: advance(round(1000 * share), 1000),
        )
    made = _make_plant(request, drawn, plant, fitted, request.seed, seconds, progress)
    surface = made.surfaces.whole
    if request.cloud.must_be_plant and not request.cloud.given_roots:
        stem_seen = not any(each.code == NO_STEMS for each in found.remarks)
        unjoined = made.left_out - made.beyond_faces + len(surface.loose)
        check_traced(len(drawn.skeleton), unjoined, stem_seen, plant.source.path)
    remarks = merge_remarks(
        found.remarks,
        # Stems that were found otherwise were not traced through the cloud, whatever of it is leaves.
        describe_leaves(traced, request.settings) if found.stems is None else [],
        of_growth,
        made.remarks,
        check_surface(len(drawn.skeleton), made.left_out - made.beyond_faces, len(surface.loose), grows),
        check_faces(len(drawn.skeleton), made.beyond_faces),
    )
    drawn = made.traced
    rows = branch_rows(
        drawn,
        surface,
        plant.points_m[drawn.wood],
        grown=grows,
        has_circles=found.stems is None,
    )
    return FoundBranches(
        plant=plant,
        traced=traced,
        drawn=drawn,
        made=made,
        bark=bark,
        remarks=remarks,
        rows=(*rows, *made.rows),
        stems=found.stems,
    )


def make_branches_asset(request: BranchesRequest, progress: StepProgress | None = None) -> MadeBranches:
    """Trace the branches of a cloud and publish their asset; the old asset stays until the new one is whole.

    Raises:
        NoStemsError: The request needs stems, and the cloud shows none.
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    seconds: dict[str, float] = {}
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        fitted = _read_fitted(request)
        found = find_branches(request, fitted, seconds, progress)
        plant = found.plant
        request = replace(request, asset=found.bark)
        with follow_step("asset", seconds, progress):
            provenance = Provenance(
                species=request.species,
                capture=plant.source.path.name,
                generator=f"usdfoliage {__version__}",
                seed=request.seed,
                settings=describe_settings(request),
                input_sha256=digest_file(plant.source.path),
            )
            interface = _write_plant(folder, request.name, found.made, provenance, plant, request.asset)
        variations: list[Path] = []
        skeletons: list[Skeleton] = []
        reached: dict[int, float] = {}
        with follow_step("variations", seconds, progress) as advance:
            for number in range(1, request.regrowth.variations + 1):
                variation, model = vary_plant(request, found, number, fitted)
                name = name_variation(request.name, number)
                own = folder / VARIATIONS / name
                own.mkdir(parents=True)
                skeletons.append(model.traced.skeleton)
                reached[number] = variation.reached
                its_own = replace(provenance, seed=variation.seed)
                variations.append(_write_plant(own, name, model, its_own, plant, request.asset))
                advance(number, request.regrowth.variations)
        likeness = likeness_rows(found.drawn.skeleton, skeletons, list(reached.values()))
        found = replace(
            found,
            rows=(*found.rows, *likeness),
            remarks=merge_remarks(found.remarks, check_variations(reached)),
        )
        (folder / "report").mkdir(exist_ok=True)
        drawn = interface if request.preview else None
        written = report_branches(folder / "report", request, found, seconds, drawn, variations, progress)
    return MadeBranches(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        variations=tuple(request.output / made.relative_to(folder) for made in variations),
        remarks=(*found.remarks, *written.remarks),
        measures=found.rows,
        seconds=seconds,
    )


def report_branches(
    folder: Path,
    request: BranchesRequest,
    found: FoundBranches,
    seconds: Mapping[str, float],
    interface: Path | None = None,
    variations: Sequence[Path] = (),
    progress: StepProgress | None = None,
) -> WrittenReport:
    """Write the report of branches into an existing folder.

    Args:
        folder: Of the report.
        request: What was asked for.
        found: The branches.
        seconds: By step.
        interface: Their asset, which Storm draws; None for no such pictures.
        variations: Interface layers of variations of the plant.
        progress: Called at each of Storm's pictures.
    """
    report = BranchesReport(
        name=request.name,
        capture=found.plant.source.path.name,
        generator=f"usdfoliage {__version__}",
        remarks=found.remarks,
        render_setting=request.render_setting,
        settings=describe_settings(replace(request, asset=found.bark)),
        variations=variations,
    )
    times = seconds if request.times else {}
    return write_branches_report(
        folder, interface, report, found.drawn, found.plant.points_m, found.rows, times, progress
    )


def name_variation(name: str, number: int) -> str:
    """The asset of a variation of a plant, from 1 on."""
    return f"{name}_{number:02d}"


def variation_seed(seed: int, number: int) -> int:
    """The seed of a variation of a plant, below 2^32: no other than by chance that of one of another plant's seed."""
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0])


def vary_plant(
    request: BranchesRequest, found: FoundBranches, number: int, fitted: FittedLeaves | None = None
) -> tuple[Variation, "PlantModel"]:
    """A variation of a plant, and what its asset is written from.

    Args:
        request: What was asked for.
        found: The branches of the plant itself.
        number: Of the variation, from 1 on.
        fitted: As find_branches takes it.

    Raises:
        FoliageError: It cannot be made.
    """
    seed = variation_seed(request.seed, number)
    varied = vary_branches(found.traced, found.plant, request.regrowth, request.foliage.species, seed)
    return varied, _make_plant(request, varied.traced, found.plant, fitted, seed, {}, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantModel:
    """What an asset of branches is written from."""

    traced: TracedBranches  # without the branches that the surface lacks
    left_out: int  # of these
    beyond_faces: int  # of these, for the number of faces
    skeleton: SkeletonPrim
    surfaces: BranchSurfaces
    leaves: BranchLeaves | None
    rig: BranchRig | None
    growth: BranchGrowth | None
    rigged_leaves: RiggedLeaves | None
    remarks: tuple[Remark, ...]
    rows: tuple[Row, ...]


def _read_fitted(request: BranchesRequest) -> FittedLeaves | None:
    """The leaves that are drawn from; None where none are."""
    source = request.foliage.source
    return None if source is None else read_fitted_leaves(source, request.output)


def _make_plant(
    request: BranchesRequest,
    traced: TracedBranches,
    plant: PlantCloud,
    fitted: FittedLeaves | None,
    seed: int,
    seconds: dict[str, float],
    progress: StepProgress | None,
) -> PlantModel:
    """The surface of branches, their leaves, and what moves."""
    with follow_step("surface", seconds, progress):
        made = build_surfaces(traced.skeleton, request.max_faces or faces_of_cloud(len(plant.points_m)))
    surfaces, remarks = made.surfaces, list(made.remarks)
    traced = replace(traced, skeleton=made.skeleton)
    with follow_step("leaves", seconds, progress):
        grown = grow_leaves(traced.skeleton, request.foliage, fitted, seed)
        remarks.extend(grown.remarks if grown else ())
    motion = request.motion
    if not len(surfaces.whole.curve):
        remarks += check_motion(motion.rig is not None, motion.growth_frames > 0)
        motion = BranchMotion()
    with follow_step("motion", seconds, progress):
        rig = rig_branches(traced.skeleton, surfaces, motion, seed)
        growth = grow_branches(traced, surfaces, motion, grown)
    if rig is not None:
        text = f"the rig has {len(rig.rig)} joints"
        remarks.append(remark("rig-joints", text, remedy="select rig=skel to move it"))
    return PlantModel(
        traced=traced,
        left_out=made.left_out,
        beyond_faces=made.beyond_faces,
        skeleton=SkeletonPrim(skeleton=traced.skeleton, growth=growth_of(traced)),
        surfaces=surfaces,
        leaves=grown.foliage if grown else None,
        rig=rig,
        growth=growth,
        rigged_leaves=rig_grown_leaves(rig, grown),
        remarks=tuple(remarks),
        rows=grown.rows if grown else (),
    )


def _write_plant(
    folder: Path,
    name: str,
    made: PlantModel,
    provenance: Provenance,
    plant: PlantCloud,
    settings: BranchAssetSettings,
) -> Path:
    return write_branch_asset(
        folder,
        name,
        made.skeleton,
        made.surfaces,
        provenance,
        plant.asset_from_cloud,
        settings,
        made.leaves,
        made.rig,
        made.growth,
        made.rigged_leaves,
    )


def wood_color(colors: NDArray[np.float64]) -> tuple[float, float, float]:
    """The median colour, linear, of the lit half of points (N, 3): red, green, blue, 0 to 255, display-encoded."""
    red, green, blue = decode_srgb(np.quantile(colors, _LIT, axis=0) / 255).tolist()
    return red, green, blue


def describe_leaves(traced: TracedBranches, settings: BranchSettings) -> list[Remark]:
    """What the user should know of the cloud's leaves."""
    share = float(1 - traced.wood.mean())
    if share > 0:
        text = f"{100 * share:.0f} % of the cloud's points are leaves and left out"
        remedy = ("give ", Setting(name="branches.cloud_leaves", value='"off"'), " if that is wrong")
        return [remark("cloud-leaves-left-out", text, remedy=remedy)]
    if settings.leaves == "auto" and not traced.knows_leaves:
        text = (
            f"points are {1000 * traced.spacing_m:.0f} mm from their sixth neighbour, too far to separate leaves "
            "from wood; all are taken for wood"
        )
        remedy = ("give ", Setting(name="branches.cloud_leaves", value='"on"'), " if the plant has leaves")
        return [remark("cloud-leaves-unknown", text, remedy=remedy)]
    return []


def growth_of(traced: TracedBranches) -> dict[str, float]:
    """What of the growth parameters is known; of stems that were found otherwise, the internodes that they show."""
    growth = {"rootDiameter": float(2 * traced.skeleton.radius_m[0])}
    internode_m = measure_internode_m(traced.skeleton) if traced.found_otherwise else traced.internode_m
    if not traced.found_otherwise:
        growth["allometryExponent"] = traced.radii.exponent
    return growth if internode_m is None else {"internodeLength": internode_m, **growth}


def describe_settings(request: BranchesRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    return {
        **request.cloud.describe(),
        "internode": "auto" if request.settings.internode_m is None else f"{request.settings.internode_m:g}",
        "cloud-leaves": request.settings.leaves,
        **request.regrowth.describe(),
        "species": request.species or "none",
        **describe_foliage(request.foliage),
        "bark-color": " ".join(f"{channel:g}" for channel in request.asset.color),
        "seed": str(request.seed),
        "most-faces": "auto" if request.max_faces is None else f"{request.max_faces}",
        **request.motion.describe(),
    }


def plan_branches_asset(request: BranchesRequest) -> str:
    """What make_branches_asset would do, in lines, after reading the cloud; writes nothing."""
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    fitted = _read_fitted(request)
    plant = read_plant_cloud(request.cloud)
    height_m = float(np.ptp(plant.points_m[:, 1]))
    lines = [
        f"cloud: {plant.source.path}, {plant.source.total:,} points; {len(plant.points_m):,} of the plant, "
        f"{height_m:.2f} m high",
        f"roots: {len(plant.roots_m)}",
        *([f"leaves: drawn from the {len(fitted.leaves):,} of {request.foliage.source}"] if fitted else []),
        *label_remarks(plant.remarks, request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        would,
    ]
    return "\n".join(lines)
