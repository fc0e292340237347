"""From a cloud alone to an asset of its leaves."""

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.publish import plan_folder
from usdfoliage.branch.foliage.species import GENERIC, load_species
from usdfoliage.capture.cloud_files.leaf_points import write_leaf_points
from usdfoliage.capture.cloud_files.ply import fits_single
from usdfoliage.capture.cloud_files.read import (
    CloudInput,
    CloudInputSettings,
    FilePoints,
    find_cloud,
    is_cloud_input,
    iterate_points,
    read_cloud_input,
)
from usdfoliage.capture.cloud_files.units import UNITS
from usdfoliage.capture.cloud_files.up_axis import find_cloud_up
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.up_turn import axis_vector, turn_to_y_up
from usdfoliage.jobs.leaves.cloud_report import write_cloud_leaves_report
from usdfoliage.jobs.leaves.publish import (
    REPORT,
    LeavesSource,
    MadeLeaves,
    RunFacts,
    frame_report,
    publish_leaves,
    write_found_asset,
)
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.leaves.run import place_plant
from usdfoliage.jobs.plant_cloud import find_plant_ground
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView
from usdfoliage.jobs.report.table import WrittenReport
from usdfoliage.jobs.work.settings_file import list_settings
from usdfoliage.leaf.change import move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.model_file import LeavesModel
from usdfoliage.leaf.reconstruct_cloud import CLOUD_STEPS, CloudReconstruction, reconstruct_cloud_leaves
from usdfoliage.leaf.segmentation.model import Step
from usdfoliage.leaf.shape.jitter import spread_phases
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Remark, Remedy, Setting, label_remarks, remark

logger = logging.getLogger(__name__)

POINTS_FILE = "points.ply"  # in the report: the cloud's points, with the leaf of each
_SAME_PLACE = 1e-6  # of the cloud's extent, within which a point of the file is one that was used
_PREVIEWS = (("front", "preview.png"), ("right", "preview_right.png"))
_PREVIEW = PreviewSettings(width_px=720, height_px=720, complexity="medium", samples=2)


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundCloudLeaves:
    """The leaves of a cloud, before anything is written."""

    source: CloudInput
    found: CloudReconstruction  # in the points that are not ground
    leaf: NDArray[np.int32]  # (N,), which leaf each point of the source is of, -1 for none, as of the ground
    leaves: Leaves  # in the plant's frame
    asset_from_source: NDArray[
        np.float64
    ]  # (4, 4), column vectors, from points of the source, in metres, to that frame
    remarks: tuple[Remark, ...]
    seconds: Mapping[str, float]  # by step

    @property
    def asset_from_capture(self) -> NDArray[np.float64]:
        """(4, 4), column vectors, from the file's own coordinates and unit to the plant's frame."""
        unit = self.source.metres_per_unit
        own = np.diag([unit, unit, unit, 1.0])
        own[:3, 3] = -self.source.origin_m
        return np.asarray(self.asset_from_source @ own)

    @property
    def steps(self) -> Sequence[Step]:
        return self.found.steps

    @property
    def model(self) -> LeavesModel:
        """What a later stage needs of them."""
        color = self.leaves.color
        plain = None if color is None or not len(color) else np.median(color, axis=0)
        return LeavesModel(
            leaves=self.leaves,
            asset_from_capture=self.asset_from_capture,
            certainty=self.found.certainty,
            plain_color=None if plain is None else (float(plain[0]), float(plain[1]), float(plain[2])),
        )


def names_cloud(path: Path) -> bool:
    """Whether leaves are to be found in a cloud alone: a cloud's file, or a folder with a cloud and no photographs."""
    if not path.is_dir():
        return is_cloud_input(path)
    if (path / "images").is_dir():
        return False
    try:
        find_cloud(path)
    except CaptureError:
        return False
    return True


def find_cloud_leaves(request: LeavesRequest, progress: StepProgress | None = None) -> FoundCloudLeaves:
    """Find the leaves of a cloud; nothing is written.

    Raises:
        FoliageError: The cloud is unusable.
    """
    start = time.perf_counter()
    source = read_cloud_input(
        request.capture,
        CloudInputSettings(metres_per_unit=None if request.unit is None else UNITS[request.unit]),
        progress_in_step("read", progress),
    )
    remarks = list(source.remarks)
    axis, up_remarks = _find_up(source, request.up)
    turn = np.eye(4)
    turn[:3, :3] = turn_to_y_up(axis)
    # On the floor and in grass there are regions like leaves.
    ground = find_plant_ground(source.points_m @ turn[:3, :3].T)
    kept = np.flatnonzero(~ground.ground.points)
    colors = _linear_colors(source)
    seconds = {"read": time.perf_counter() - start}
    found = reconstruct_cloud_leaves(
        source.points_m[kept],
        None if colors is None else colors[kept],
        request.settings.cloud,
        progress,
        min_confidence=request.settings.min_confidence,
        threads=request.settings.threads,
    )
    if not len(found.leaves):
        logger.warning("no leaf was found (%s)", request.capture)
    leaf = np.full(len(source.points_m), -1, np.int32)
    leaf[kept] = found.leaf
    asset_from_source = place_plant(found.leaves, turn)
    leaves = move_leaves(found.leaves, asset_from_source)
    return FoundCloudLeaves(
        source=source,
        found=found,
        leaf=leaf,
        leaves=replace(leaves, phase=spread_phases(len(leaves))),
        asset_from_source=asset_from_source,
        remarks=(*found.remarks, *ground.remarks, *remarks, *up_remarks),
        seconds={**seconds, **found.seconds},
    )


def make_cloud_leaves_asset(request: LeavesRequest, progress: StepProgress | None = None) -> MadeLeaves:
    """Find the leaves of a cloud and publish their asset, as publish_leaves."""
    source = LeavesSource(
        find=find_cloud_leaves,
        write_asset=_write_asset,
        choose_previews=_choose_previews,
        write_report=report_cloud_leaves,
    )
    return publish_leaves(request, source, progress)


def report_cloud_leaves(folder: Path, request: LeavesRequest, made: FoundCloudLeaves, facts: RunFacts) -> WrittenReport:
    """Write the report of a cloud's leaves into an existing folder."""
    frame = frame_report(request, made.source.path.name, describe_cloud_settings(request), facts)
    turned_m = made.source.points_m @ made.asset_from_source[:3, :3].T + made.asset_from_source[:3, 3]
    return write_cloud_leaves_report(folder, frame, made.found, made.leaves, turned_m, made.leaf, facts.previews)


def plan_cloud_leaves_asset(request: LeavesRequest) -> str:
    """What make_cloud_leaves_asset would do, in lines, after reading the cloud; writes nothing."""
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    source = read_cloud_input(
        request.capture, CloudInputSettings(metres_per_unit=None if request.unit is None else UNITS[request.unit])
    )
    _, up_remarks = _find_up(source, request.up)
    steps = ["read", *CLOUD_STEPS, "asset", *(["preview"] if request.preview else [])]
    colors = "with" if source.colors is not None else "without"
    lines = [
        f"cloud: {source.path}, {source.total:,} points {colors} colours, {source.metres_per_unit:g} m a unit",
        *label_remarks([*source.remarks, *up_remarks], request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_cloud_settings(request).items())}",
        f"steps: {', '.join(steps)}",
        would,
    ]
    return "\n".join(lines)


def describe_cloud_settings(request: LeavesRequest) -> dict[str, str]:
    """Every setting that decides the result, those of the command line by the names of their options."""
    return {
        "up": request.up or "auto",
        "unit": request.unit or "auto",
        "representation": " ".join(request.representations) if request.representations else "by the number of leaves",
        "min_confidence": f"{request.settings.min_confidence:g}",
        "seed": str(request.seed),
        **{f"cloud.{name}": value for name, value in list_settings(request.settings.cloud).items()},
    }


def write_points(path: Path, made: FoundCloudLeaves, threads: int = 0) -> int:
    """Write the points of the cloud's file, in its order and coordinates, with the leaf of each; returns how many.

    Points that were not used, as they are not finite or the file marks them, are of no leaf; those that were thinned
    are of the leaf of the nearest point that was kept.

    Raises:
        WriteError: The file cannot be written.
    """
    source, leaf = made.source, made.leaf

    def parts() -> Iterator[FilePoints]:
        return iterate_points(source.path)

    used = sum(int(np.count_nonzero(part.used)) for part in parts())
    if used == len(leaf):
        place = 0

        def leaf_of(points: NDArray[np.float64]) -> NDArray[np.int32]:
            nonlocal place
            place += len(points)
            return leaf[place - len(points) : place]
    else:
        tree = cKDTree(source.points_m)
        thinned_m = (
            np.inf
            if used > 2 * len(leaf) or any(r.code == "cloud-file-thinned" for r in source.remarks)
            else (_SAME_PLACE * float(np.ptp(source.points_m, axis=0).max()))
        )

        def leaf_of(points: NDArray[np.float64]) -> NDArray[np.int32]:
            own_m = points * source.metres_per_unit - source.origin_m
            away_m, nearest = tree.query(own_m, distance_upper_bound=thinned_m, workers=threads or -1)
            return np.where(np.isfinite(away_m), np.append(leaf, np.int32(-1))[nearest], -1).astype(np.int32)

    coordinates = (source.points_m + source.origin_m) / source.metres_per_unit
    return write_leaf_points(path, parts, leaf_of, single=fits_single(coordinates))


def _find_up(source: CloudInput, given: str | None) -> tuple[NDArray[np.float64], list[Remark]]:
    """The axis that is up, as it is given, stated or found, and a remark where it was found."""
    if given is not None:
        return axis_vector(given), []
    up = find_cloud_up(source.points_m, source.stated_up, source.format_up)
    is_stated = up.sure and source.stated_up is not None
    remedy: Remedy = () if is_stated else ("give ", Setting(name="capture.toml:up_axis"), " if that is wrong")
    return up.axis, [remark("cloud-up", up.how, remedy=remedy)]


def _linear_colors(source: CloudInput) -> NDArray[np.float64] | None:
    """(N, 3), linear Rec.709, NaN where a point is black, which is none; None of a cloud without colours."""
    if source.colors is None:
        return None
    colors = np.asarray(decode_srgb(source.colors.astype(np.float64) / 255), np.float64)
    colors[~source.colors.any(axis=1)] = np.nan
    return colors


def _write_asset(folder: Path, request: LeavesRequest, made: FoundCloudLeaves, settings: LeafAssetSettings) -> Path:
    """The asset, and in its report the points of the cloud."""
    interface = write_found_asset(
        folder,
        request,
        made,
        settings,
        LeafAppearance(color=made.model.plain_color or _species_color(request.species)),
        source=made.source.path,
        described=describe_cloud_settings(request),
        inputs=[made.source.path],
    )
    write_points(folder / REPORT / POINTS_FILE, made, request.settings.threads)
    return interface


def _choose_previews(
    folder: Path, request: LeavesRequest, _made: FoundCloudLeaves
) -> tuple[list[PreviewView], PreviewSettings]:
    """The asset from two sides."""
    pictures = _PREVIEWS if request.report_views else ()
    return [PreviewView(output=folder / file, direction=direction) for direction, file in pictures], _PREVIEW


def _species_color(name: str) -> tuple[float, float, float]:
    """Of the leaves of a species; of one that is not known, that of leaves in general."""
    try:
        return load_species(name or GENERIC).color
    except FoliageError:
        return load_species(GENERIC).color
