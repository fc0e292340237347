"""The tasks that turn a capture, or a cloud, into parts of a plant: branches, leaves, crown."""

import logging
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.leaf_package import AssetSettings
from usdfoliage.branch.allometry import AllometrySettings
from usdfoliage.branch.foliage.species import Species, load_species
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.radii import RadiusSettings
from usdfoliage.branch.tracing.reconstruct import BranchSettings
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.crown.hull import HullSettings
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.reconstruct import CapturedCrownSettings
from usdfoliage.errors import AssetError, CaptureError, FoliageError
from usdfoliage.jobs.branches.plant_cloud import PlantCloudRequest, read_roots
from usdfoliage.jobs.branches.run import BranchesRequest, make_branches_asset
from usdfoliage.jobs.branches.tracing import NoStemsError
from usdfoliage.jobs.capture.folder import MASKS
from usdfoliage.jobs.crown.capture_input import PlantPoints
from usdfoliage.jobs.crown.run_capture import CapturedCrownRequest, make_captured_crown_asset
from usdfoliage.jobs.leaves.run import LeavesRequest, make_leaves_asset
from usdfoliage.jobs.leaves.settings import LeavesSettings
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.stages.captured_leaves import read_leaf_frame
from usdfoliage.jobs.plant.stages.isolate import GIVEN_DEPTH, is_floorless, plant_capture
from usdfoliage.jobs.plant.store import ResultFile
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import BRANCHES, CLOUD, ISOLATION, LEAVES
from usdfoliage.jobs.work.settings_file import set_everywhere
from usdfoliage.remarks import Setting, as_plan_setting, explain_error, remark

logger = logging.getLogger(__name__)

ASSET_FOLDER = "asset"  # in the result of a part
CROWN_MODEL = "crown.npz"  # likewise
LEAFLESS = 0.05  # share of the cloud that is leaves, below which a plant has none
PLANT_POINTS = "plant.npz"  # likewise: the cloud as branches were traced through it


def trace_branches(call: StageCall) -> tuple[ResultFile, ...]:
    """The branches of the cloud, in an asset of their own; where none can be traced, the plant has none."""
    settings = call.settings.branches
    species = call.settings.plant.species
    roots, given_roots = read_roots(settings.roots)
    known = known_species(species)
    allometry = AllometrySettings(exponent=known.exponent) if known else AllometrySettings()
    request = BranchesRequest(
        cloud=PlantCloudRequest(
            path=_cloud_of(call),
            roots=roots,
            given_roots=given_roots,
            max_points=settings.max_points,
            internode_m=settings.internode_m,
            has_ground=not is_floorless(call),
        ),
        output=call.out / ASSET_FOLDER,
        name=call.request.name,
        settings=BranchSettings(
            internode_m=settings.internode_m, leaves=settings.cloud_leaves, radii=RadiusSettings(allometry=allometry)
        ),
        species=known.name if known else "",
        seed=call.settings.seed,
        preview=False,
        times=False,
        needs_stems=settings.make == "auto",
        color_of_cloud=call.has(CLOUD),  # a scan may be coloured by height or intensity
    )
    try:
        made = make_branches_asset(request, call.progress)
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
        write_summary(call.out, StageSummary(remarks=[left_out]))
        return ()
    except FoliageError as error:
        return _go_without(call, "branches", error)
    skeleton = made.traced.skeleton
    np.savez(
        call.out / PLANT_POINTS,
        points_m=made.plant.points_m,
        wood=made.traced.wood,
        knows_leaves=made.traced.knows_leaves,
        colors=np.zeros((0, 3), np.float32) if made.plant.colors is None else made.plant.colors.astype(np.float32),
        plant_from_capture=made.plant.asset_from_cloud,
        lost=np.array(made.lost, np.int32),
        **{f"skeleton_{field.name}": getattr(skeleton, field.name) for field in fields(Skeleton)},
    )
    report = call.out / ASSET_FOLDER / "report"
    pictures = [
        StagePicture(file=path.relative_to(call.out).as_posix(), caption=caption)
        for kind, caption in (("weights", "Importance of the points"), ("distance", "Distance from cloud to surface"))
        for path in sorted(report.glob(f"*{kind}*.png"))
    ]
    remarks = list(made.remarks)
    if species and known is None:
        text = f"nothing is known of the species {species}; its twigs are those of any tree"
        remarks.append(remark("species-unknown", text))
    summary = StageSummary(
        rows=made.measures,
        remarks=remarks,
        pictures=pictures,
        detail=f"{ASSET_FOLDER}/report/index.html",
    )
    write_summary(call.out, summary)
    return ()


def known_species(name: str) -> Species | None:
    """What is known of a species; None where its name is one for the asset alone."""
    try:
        return load_species(name)
    except FoliageError:
        return None


def find_leaves(call: StageCall) -> tuple[ResultFile, ...]:
    """The leaves that photographs show, in an asset of their own; where none can be looked for, the plant has none."""
    settings = call.settings.leaves
    given = call.inputs.has_depth and settings.depth != "estimated" and call.inputs.has_cameras
    # Masks of the plant lie beside the depth that was found, and beside that which was given.
    isolated = call.has(ISOLATION)
    capture = call.request.capture if given and not isolated else plant_capture(call)
    if not given and settings.depth == "given":
        raise CaptureError(f"{capture} has depth but no cameras/ that it belongs to; set leaves.depth to estimated")
    held = {field.name: getattr(settings, field.name) for field in fields(LeavesSettings)}
    chosen = set_everywhere(set_everywhere(LeavesSettings(**held), "threads", call.threads), "seed", call.settings.seed)
    request = LeavesRequest(
        capture=capture,
        output=call.out / ASSET_FOLDER,
        name=call.request.name,
        settings=chosen,
        depth=GIVEN_DEPTH if given and isolated else "depth",
        representations=("bezier",),
        species=call.settings.plant.species,
        seed=call.settings.seed,
        report_views=6,
        preview=False,
        times=False,
    )
    try:
        made = make_leaves_asset(request, call.progress)
    except FoliageError as error:
        return _go_without(call, "leaves", error)
    report = call.out / ASSET_FOLDER / "report"
    pictures = [
        StagePicture(file=path.relative_to(call.out).as_posix(), caption=f"{caption}, photograph {path.stem[5:8]}")
        for kind, caption in (("fit", "Fitted leaves over the photograph"),)
        for path in sorted(report.glob(f"view_*_{kind}*"))
    ]
    texture = sorted((call.out / ASSET_FOLDER / "maps").glob("*_leaf.png"))
    pictures += [
        StagePicture(file=path.relative_to(call.out).as_posix(), caption="The average leaf") for path in texture
    ]
    summary = StageSummary(
        rows=made.measures,
        remarks=made.remarks,
        pictures=pictures,
        detail=f"{ASSET_FOLDER}/report/index.html",
    )
    write_summary(call.out, summary)
    return ()


def make_crown(call: StageCall) -> tuple[ResultFile, ...]:
    """The crown of the cloud and of photographs, if any, in the plant's frame; where none can be made, it has none."""
    settings = call.settings.crown
    traced = read_traced_plant(call.result_of(BRANCHES)) if call.has(BRANCHES) else None
    plant = None
    if traced is not None and traced.is_leafless:
        bare = remark("crown-of-no-leaves", "the plant has no crown: it has no leaves")
        write_summary(call.out, StageSummary(remarks=[bare]))
        return ()
    if traced is not None:
        plant = PlantPoints(
            points_m=traced.points_m,
            foliage=~traced.wood if traced.knows_leaves and not traced.wood.all() else None,
            colors=traced.colors,
            asset_from_capture=traced.plant_from_capture,
        )
    frame = read_leaf_frame(call.result_of(LEAVES) / ASSET_FOLDER) if call.has(LEAVES) and traced is None else None
    request = CapturedCrownRequest(
        cloud=PlantCloudRequest(path=_cloud_of(call), roots=RootSettings(), has_ground=not is_floorless(call)),
        output=call.out / ASSET_FOLDER,
        name=call.request.name,
        settings=CapturedCrownSettings(
            size=settings.size,
            seed=call.settings.seed,
            threads=call.threads,
            hull=HullSettings(drawn_masks=call.has(ISOLATION) and not _has_masks(call)),
        ),
        asset_settings=AssetSettings(crown_mesh_size=settings.mesh_size),
        species=call.settings.plant.species,
        preview=False,
        times=False,
    )
    try:
        made = make_captured_crown_asset(request, call.progress, plant=plant, asset_from_capture=frame)
    except FoliageError as error:
        return _go_without(call, "crown", error)
    model = {field.name: getattr(made.model, field.name) for field in fields(CrownModel)}
    np.savez(call.out / CROWN_MODEL, overlap=made.overlap, **model)
    report = call.out / ASSET_FOLDER / "report"
    pictures = [
        StagePicture(file=path.relative_to(call.out).as_posix(), caption=path.stem.replace("_", " "))
        for path in sorted(report.glob("*.png"))
    ]
    summary = StageSummary(
        rows=made.measures,
        remarks=made.remarks,
        pictures=pictures,
        detail=f"{ASSET_FOLDER}/report/index.html",
    )
    write_summary(call.out, summary)
    return ()


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeCrown:
    """A crown, and how well it stands for the plant."""

    model: CrownModel
    overlap: float  # of its silhouettes with those of the points, median IoU


def read_crown(folder: Path) -> MadeCrown | None:
    """The crown that make_crown left in its folder; None where none could be made."""
    path = folder / CROWN_MODEL
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as held:
        model = CrownModel(
            radius_m=held["radius_m"],
            color=held["color"],
            center_m=held["center_m"],
            relief_weight=float(held["relief_weight"]),
            asset_from_photo=held["asset_from_photo"],
        )
        return MadeCrown(model=model, overlap=float(held["overlap"]))


@dataclass(frozen=True, kw_only=True, eq=False)
class TracedPlant:
    """What the other parts must know of the branches. The plant's frame: metres, Y up, the first root at the origin."""

    points_m: NDArray[np.float64]  # (N, 3), the cloud without its ground
    wood: NDArray[np.bool_]  # (N,), points of branches; the others are of leaves
    knows_leaves: bool  # whether the cloud is dense enough to tell them apart
    colors: NDArray[np.float64] | None  # (N, 3), red, green and blue, 0 to 255
    plant_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the capture's coordinates
    skeleton: Skeleton
    lost: NDArray[np.int32]  # branches that the surface lacks

    @property
    def is_leafless(self) -> bool:
        """Whether the cloud surely shows a plant without leaves."""
        return self.knows_leaves and float((~self.wood).mean()) < LEAFLESS


def read_traced_plant(folder: Path) -> TracedPlant | None:
    """What trace_branches left in its folder; None where no branches could be traced."""
    path = folder / PLANT_POINTS
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as held:
        return TracedPlant(
            points_m=held["points_m"],
            wood=held["wood"],
            knows_leaves=bool(held["knows_leaves"]),
            colors=held["colors"].astype(np.float64) if len(held["colors"]) else None,
            plant_from_capture=held["plant_from_capture"],
            skeleton=Skeleton(**{field.name: held[f"skeleton_{field.name}"] for field in fields(Skeleton)}),
            lost=held["lost"],
        )


def _cloud_of(call: StageCall) -> Path:
    """What photographs gave, with what its capture.toml states, or the file that the user gave."""
    return plant_capture(call) if call.has(CLOUD) else call.request.capture


def _has_masks(call: StageCall) -> bool:
    """Whether the user gave some."""
    return any(name.startswith(f"{MASKS}/") for name in call.inputs.files)


def _go_without(call: StageCall, what: str, error: FoliageError) -> tuple[ResultFile, ...]:
    """A part that cannot be made is left out, and the report says so first.

    Raises:
        FoliageError: It cannot be made here and now, as on a full disk; on another day it can.
    """
    if isinstance(error, AssetError) or isinstance(error.__cause__, OSError):
        raise error
    logger.warning("no %s: %s", what, error)
    text = explain_error(error, as_plan_setting).replace(str(call.store.folder), "…")
    failed = remark("part-failed", f"the plant has no {what}: {text}", subject=what)
    write_summary(call.out, StageSummary(failure=text, remarks=[failed]))
    return ()
