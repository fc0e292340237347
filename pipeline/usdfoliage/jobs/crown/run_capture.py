"""From a capture or a cloud on disk to an asset of its plant's crown."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.asset.materials.leaf import LEAF_COLOR
from usdfoliage.asset.packages.leaf_package import AssetSettings, write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import plan_folder, publish_folder
from usdfoliage.crown.captured_measures import CapturedCrownMeasures
from usdfoliage.crown.leaf_colors import find_green_points, have_color
from usdfoliage.crown.leaf_picture import LeafPicture
from usdfoliage.crown.model import CrownModel
from usdfoliage.crown.model_file import MadeCrown
from usdfoliage.crown.reconstruct import (
    CAPTURED_STEPS,
    CLOUD_STEPS,
    CapturedCrownSettings,
    reconstruct_captured_crown,
    reconstruct_cloud_crown,
)
from usdfoliage.errors import FitError
from usdfoliage.files.hashing import digest_file, hash_each
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.jobs.crown.capture_input import CrownCapture, PlantPoints, read_crown_capture
from usdfoliage.jobs.crown.capture_report import DrawnCrown, captured_rows, draw_captured_crown, write_captured_report
from usdfoliage.jobs.crown.written import describe_mesh_size
from usdfoliage.jobs.leaf_picture import describe_leaf, read_leaf_picture
from usdfoliage.jobs.plant_cloud import PlantCloudRequest
from usdfoliage.jobs.preview.pictures import remark_missing_pictures
from usdfoliage.jobs.report.content import ReportContent
from usdfoliage.jobs.report.published import PublishedAsset
from usdfoliage.jobs.report.table import Row, WrittenReport
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Remark, RenderSetting, as_plan_setting, label_remarks


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedCrownRequest:
    """What the user asked for, checked."""

    cloud: PlantCloudRequest  # its path is the capture's folder, or a cloud
    output: Path
    name: str
    settings: CapturedCrownSettings = field(default_factory=CapturedCrownSettings)
    asset_settings: AssetSettings = field(default_factory=AssetSettings)
    leaf: Path | None = None  # picture of a leaf, or an asset of leaves; None for a plain leaf
    species: str = ""
    force: bool = False
    keep_old: bool = False  # what is replaced stays in a folder beside the new asset
    preview: bool = True
    times: bool = True  # whether the report lists how long each step took
    report_views: int = 6  # photographs that the report shows
    render_setting: RenderSetting = as_plan_setting  # how the report writes settings

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="crown", source=self.cloud.path.resolve().name)


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundCrown:
    """The crown of a capture, before anything is written."""

    read: CrownCapture
    read_s: float  # that reading took
    model: CrownModel
    measures: CapturedCrownMeasures

    @property
    def remarks(self) -> tuple[Remark, ...]:
        return (*self.read.remarks, *self.measures.remarks)

    @property
    def made(self) -> MadeCrown:
        """What a later stage needs of it."""
        overlap = float(np.median([view.cloud_iou for view in self.measures.views]))
        return MadeCrown(model=self.model, overlap=overlap)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Its figures."""
        return tuple(captured_rows(self.model, self.measures))


def find_captured_crown(
    request: CapturedCrownRequest,
    progress: StepProgress | None = None,
    *,
    plant: PlantPoints | None = None,
    asset_from_capture: NDArray[np.float64] | None = None,
) -> FoundCrown:
    """Reconstruct the crown of a capture; nothing is written.

    Args:
        request: What to make of which capture.
        progress: Called at each step.
        plant: Points that were read already, with leaves and frame; the cloud is not read then.
        asset_from_capture: (4, 4), the frame of other stages, where plant has none.

    Raises:
        FoliageError: The input is unusable.
    """
    start = time.perf_counter()
    read = read_crown_capture(request.cloud, plant, asset_from_capture, progress)
    read_s = time.perf_counter() - start
    model, measures = fit_captured_crown(request, read, progress)
    return FoundCrown(read=read, read_s=read_s, model=model, measures=measures)


def make_captured_crown_asset(request: CapturedCrownRequest, progress: StepProgress | None = None) -> PublishedAsset:
    """Reconstruct the crown of a capture and publish its asset; the old asset stays until the new one is whole.

    Raises:
        FoliageError: The input is unusable, or the output cannot be written; nothing was changed.
    """
    with publish_folder(
        request.output, force=request.force, origin=request.origin, keep_old=request.keep_old
    ) as folder:
        leaf = None if request.leaf is None else read_leaf_picture(request.leaf, request.output)
        found = find_captured_crown(request, progress)
        provenance = Provenance(
            species=request.species,
            capture=found.read.name,
            generator=f"usdfoliage {__version__}",
            seed=request.settings.seed,
            settings=describe_settings(request),
            input_sha256=_fingerprint(found.read, leaf),
        )
        interface = write_crown_asset(folder, request.name, found.model, provenance, request.asset_settings, leaf)
        report_folder = folder / "report"
        report_folder.mkdir(exist_ok=True)
        reported = report_crown(report_folder, request, found, interface if request.preview else None, progress)
        views = reported.drawn.views
    return PublishedAsset(
        asset=request.output / interface.name,
        report=request.output / "report" / "index.html",
        preview=request.output / "report" / views[0].file if views else None,
        remarks=reported.remarks,
        rows=found.rows,
    )


@dataclass(frozen=True, kw_only=True)
class ReportedCrown:
    """The report of a crown."""

    written: WrittenReport
    drawn: DrawnCrown
    remarks: tuple[Remark, ...]  # all remarks on the crown


def report_crown(
    folder: Path,
    request: CapturedCrownRequest,
    found: FoundCrown,
    interface: Path | None = None,
    progress: StepProgress | None = None,
) -> ReportedCrown:
    """Write the report of a crown into an existing folder.

    Args:
        folder: Of the report.
        request: What was asked for.
        found: The crown.
        interface: Its asset, which Storm draws; None for no such pictures.
        progress: Called at each of Storm's pictures.
    """
    drawn = draw_captured_crown(interface, folder, found.model, found.read.views, request.report_views, progress)
    remarks = found.remarks
    if drawn.failure is not None:
        remarks += (remark_missing_pictures(drawn.failure),)
    report = ReportContent(
        name=request.name,
        capture=found.read.name,
        generator=f"usdfoliage {__version__}",
        remarks=remarks,
        render_setting=request.render_setting,
        settings=describe_settings(request),
        views=drawn.views,
        seconds={"cloud": found.read_s, **found.measures.seconds} if request.times else {},
    )
    written = write_captured_report(folder, report, found.model, found.measures, drawn)
    return ReportedCrown(written=written, drawn=drawn, remarks=remarks)


def fit_captured_crown(
    request: CapturedCrownRequest, read: CrownCapture, progress: StepProgress | None = None
) -> tuple[CrownModel, CapturedCrownMeasures]:
    """The crown of a capture that was read, without writing anything.

    Raises:
        FitError: It has no crown, or no photograph shows it.
    """
    try:
        if read.capture is None:
            return reconstruct_cloud_crown(
                read.plant.points_m,
                request.settings,
                plain=LEAF_COLOR,
                colors=_leaf_colors(read.plant),
                foliage=read.plant.foliage,
                asset_from_capture=read.plant.asset_from_capture,
                progress=progress,
            )
        return reconstruct_captured_crown(
            read.plant.points_m,
            read.views,
            request.settings,
            foliage=read.plant.foliage,
            asset_from_capture=read.plant.asset_from_capture,
            progress=progress,
        )
    except FitError as error:
        raise FitError(f"{error.text} ({request.cloud.path})", error.remedy) from error


def _leaf_colors(plant: PlantPoints) -> NDArray[np.float64] | None:
    """(N, 3), linear, NaN where a point has none; None where the cloud has no colours that show leaves."""
    if plant.colors is None or find_green_points(plant.points_m, plant.colors) is None:
        return None
    light = np.asarray(decode_srgb(plant.colors / 255), np.float64)
    light[~have_color(plant.colors)] = np.nan
    return light


def plan_captured_crown_asset(request: CapturedCrownRequest) -> str:
    """What make_captured_crown_asset would do, in lines, after checking the input; writes nothing."""
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    if request.leaf is not None:
        read_leaf_picture(request.leaf, request.output)
    read = read_crown_capture(request.cloud)
    views = () if read.capture is None else read.capture.views
    masks, depths = (sum(getattr(view, what) is not None for view in views) for what in ("mask", "depth"))
    described = f", {len(views)} photographs with cameras, {masks} with masks, {depths} with depth"
    steps = CLOUD_STEPS if read.capture is None else CAPTURED_STEPS
    lines = [
        f"capture: {request.cloud.path}{described if read.capture is not None else ', a cloud alone'}",
        f"cloud: {len(read.plant.points_m):,} points of the plant, {np.ptp(read.plant.points_m[:, 1]):.2f} m high",
        *label_remarks(read.remarks, request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in describe_settings(request).items())}",
        f"steps: {', '.join(steps)}{', preview' if request.preview else ''}",
        would,
    ]
    return "\n".join(lines)


def describe_settings(request: CapturedCrownRequest) -> dict[str, str]:
    """Every setting that decides the result, by the name of its option."""
    cloud = request.cloud.describe()
    cloud.pop("most-points")
    return {
        **cloud,
        "size": str(request.settings.size),
        "mesh-size": describe_mesh_size(request.asset_settings, request.settings.size),
        **describe_leaf(request.leaf),
        "seed": str(request.settings.seed),
    }


def _fingerprint(read: CrownCapture, leaf: LeafPicture | None) -> str:
    """Of the cloud, or of the points that were given, with their colours where these count, of the photographs, and of
    the picture of a leaf."""
    return hash_each(_parts_of(read, leaf)).hex()


def _parts_of(read: CrownCapture, leaf: LeafPicture | None) -> Iterator[bytes]:
    if leaf is not None:
        yield leaf.rgba.tobytes()
    yield np.ascontiguousarray(read.plant.points_m).tobytes()
    yield np.ascontiguousarray(read.plant.asset_from_capture, np.float64).tobytes()
    if read.capture is None:
        if read.plant.colors is not None:
            yield np.ascontiguousarray(read.plant.colors, np.float64).tobytes()
        return
    for view in read.capture.views:
        yield np.ascontiguousarray(view.cam_from_world).tobytes()
        for path in (view.photo, view.mask, view.depth):
            if path is not None:
                yield digest_file(path).encode()
