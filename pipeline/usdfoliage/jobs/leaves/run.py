"""From a capture's folder to an asset of its leaves."""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings, leaf_texture_file
from usdfoliage.asset.publish import plan_folder
from usdfoliage.capture.folder.hold_back import choose_withheld
from usdfoliage.capture.folder.listing import IMAGES, counted, files_below, is_picture, named
from usdfoliage.capture.folder.read import Capture, CaptureViews, read_view, read_views, without_depth
from usdfoliage.capture.mvs.view_depths import estimate_view_depths
from usdfoliage.capture.poses.given_frame import read_upright_capture
from usdfoliage.capture.view import View
from usdfoliage.capture.view_check import check_views, refuse_inverted_masks
from usdfoliage.errors import CaptureError
from usdfoliage.files.temporary_folder import temporary_folder
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.jobs.leaves.publish import (
    LeavesSource,
    MadeLeaves,
    RunFacts,
    frame_report,
    publish_leaves,
    write_found_asset,
)
from usdfoliage.jobs.leaves.report import LeavesReport, write_leaves_report
from usdfoliage.jobs.leaves.request import LeavesRequest
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, encode_png
from usdfoliage.jobs.report.pictures import shrink_camera
from usdfoliage.jobs.report.table import WrittenReport, choose_evenly
from usdfoliage.jobs.withheld.measure import MeasuredAsset, measure_by_withheld
from usdfoliage.jobs.work.settings_file import list_settings
from usdfoliage.leaf.change import move_leaves
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.model_file import LeavesModel
from usdfoliage.leaf.photographs.average_texture import AverageTexture
from usdfoliage.leaf.reconstruct import STEPS, Reconstruction, reconstruct_leaves
from usdfoliage.leaf.segmentation.model import Step
from usdfoliage.leaf.shape.bounds import leaf_bounds_m
from usdfoliage.leaf.shape.jitter import NO_JITTER, spread_phases
from usdfoliage.progress import Progress, StepProgress, progress_in_step
from usdfoliage.remarks import Remark, Setting, label_remarks, remark

logger = logging.getLogger(__name__)

AUTO, ESTIMATED = "auto", "estimated"  # words for depth that name no folder
DEFAULT_DEPTH = "depth"
_TEXTURE = "leaf.png"  # the average leaf, before the asset has its copy
PREVIEW_PX = 640  # longer side of Storm's pictures, which take more time than all the rest of a report


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesInput:
    """A capture as it was read."""

    capture: Capture
    views: Sequence[View]
    numbers: NDArray[np.int32]  # of each view among all posed photographs of the capture
    remarks: tuple[Remark, ...]
    estimated: bool = False  # whether depth was computed from the photographs


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundLeaves:
    """The leaves of a capture, before anything is written."""

    given: LeavesInput
    found: Reconstruction
    leaves: Leaves  # in the plant's frame
    asset_from_world: NDArray[np.float64]  # (4, 4), to that frame
    seconds: Mapping[str, float]  # by step

    @property
    def asset_from_capture(self) -> NDArray[np.float64]:
        """(4, 4), column vectors, from the capture's own coordinates and unit to the plant's frame."""
        unit = self.given.capture.settings.metres_per_unit
        return np.asarray(self.asset_from_world @ np.diag([unit, unit, unit, 1.0]))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        return (*self.found.remarks, *self.given.remarks)

    @property
    def steps(self) -> Sequence[Step]:
        return self.found.steps

    @property
    def model(self) -> LeavesModel:
        """What a later stage needs of them."""
        color, texture = self.leaves.color, self.found.texture
        return LeavesModel(
            leaves=self.leaves,
            asset_from_capture=self.asset_from_capture,
            certainty=self.found.certainty,
            plain_color=_three(np.median(color, axis=0)) if color is not None and len(color) else None,
            texture_color=median_color(texture) if texture is not None else None,
        )


def find_capture_leaves(request: LeavesRequest, progress: StepProgress | None = None) -> FoundLeaves:
    """Find the leaves of a capture; nothing is written.

    Raises:
        FoliageError: The input is unusable.
    """
    start = time.perf_counter()
    given = read_leaves_input(request, progress)
    seconds = {"capture": time.perf_counter() - start}
    found = reconstruct_leaves(given.views, request.settings, progress)
    seconds.update(found.seconds)
    if not len(found.leaves):
        logger.warning("no leaf was found (%s)", request.capture)
    asset_from_world = place_plant(found.leaves, given.capture.asset_from_world)
    leaves = finish_leaves(found.leaves, asset_from_world, given.numbers)
    return FoundLeaves(given=given, found=found, leaves=leaves, asset_from_world=asset_from_world, seconds=seconds)


def make_leaves_asset(request: LeavesRequest, progress: StepProgress | None = None) -> MadeLeaves:
    """Find the leaves of a capture and publish their asset, as publish_leaves."""
    source = LeavesSource(
        find=find_capture_leaves,
        write_asset=_write_asset,
        choose_previews=_choose_previews,
        write_report=_write_report,
        measure=_measure,
    )
    return publish_leaves(request, source, progress)


def report_leaves(
    folder: Path, request: LeavesRequest, made: FoundLeaves, facts: RunFacts, texture: str
) -> WrittenReport:
    """Write the report of leaves into an existing folder.

    Args:
        folder: Of the report.
        request: What was asked for.
        made: The leaves.
        facts: What happened to them; its previews are of the views that the report shows.
        texture: File of the average leaf, as seen from the folder; empty where there is none.
    """
    drawn = choose_evenly(len(made.given.views), request.report_views)
    report = LeavesReport(
        frame=frame_report(
            request, made.given.capture.name, describe_settings(request, estimated=made.given.estimated), facts
        ),
        drawn=drawn,
        numbers=made.given.numbers.tolist(),
        texture=texture,
        previews=dict(zip(drawn, facts.previews, strict=True)) if facts.previews else {},
        withheld=facts.withheld,
    )
    return write_leaves_report(folder, report, made.found, made.given.views, threads=request.settings.threads)


def _write_asset(folder: Path, request: LeavesRequest, made: FoundLeaves, settings: LeafAssetSettings) -> Path:
    capture, model = made.given.capture, made.model
    appearance = LeafAppearance() if model.plain_color is None else LeafAppearance(color=model.plain_color)
    with temporary_folder("leaf") as work:
        if made.found.texture is not None:
            texture = work / _TEXTURE
            texture.write_bytes(encode_texture(made.found.texture))
            appearance = replace(appearance, texture=texture, texture_color=model.texture_color)
        return write_found_asset(
            folder,
            request,
            made,
            settings,
            appearance,
            source=capture.folder,
            described=describe_settings(request, estimated=made.given.estimated),
            inputs=list_inputs(capture),
        )


def _choose_previews(
    folder: Path, request: LeavesRequest, made: FoundLeaves
) -> tuple[list[PreviewView], PreviewSettings]:
    """The asset from the cameras of the photographs that the report shows."""
    given = made.given
    drawn = choose_evenly(len(given.views), request.report_views)
    cameras = [shrink_camera(given.views[number].camera, PREVIEW_PX, made.asset_from_world) for number in drawn]
    files = [folder / f"view_{given.numbers[number]:03}_storm.png" for number in drawn]
    views = [PreviewView(output=file, pinhole=camera) for file, camera in zip(files, cameras, strict=True)]
    return views, PreviewSettings(samples=1)


def _write_report(folder: Path, request: LeavesRequest, made: FoundLeaves, facts: RunFacts) -> WrittenReport:
    texture = f"../{leaf_texture_file(request.name, _TEXTURE)}" if made.found.texture is not None else ""
    return report_leaves(folder, request, made, facts, texture)


def _measure(interface: Path, request: LeavesRequest, folder: Path, progress: Progress) -> MeasuredAsset:
    """The asset against the photographs that are withheld; CaptureError where none of them has a camera."""
    withheld = _withheld(request)
    folder_of_depth = DEFAULT_DEPTH if request.depth in (AUTO, ESTIMATED) else request.depth
    capture = without_depth(read_upright_capture(request.capture, depth=folder_of_depth).capture)
    views = tuple(view for view in capture.views if view.name in withheld)
    if not views:
        raise CaptureError(
            f"none of the photographs that are withheld ({named(withheld)}) has a camera",
            ("withhold others with ", Setting(name="plant.hold_back")),
        )
    return measure_by_withheld(
        interface,
        replace(capture, views=views),
        folder,
        request.hold_back,
        lost=[name for name in withheld if name not in {view.name for view in views}],
        threads=request.settings.threads,
        progress=progress,
    )


def plan_leaves_asset(request: LeavesRequest) -> str:
    """What make_leaves_asset would do, in lines, after looking at the capture; writes nothing."""
    would = plan_folder(
        request.output, f"{request.name}.usda", request.force, origin=request.origin, keep_old=request.keep_old
    )
    capture = find_capture(request)
    first = read_view(capture, 0).camera
    depths = sum(view.depth is not None for view in capture.views)
    masks = sum(view.mask is not None for view in capture.views)
    estimated = request.depth == ESTIMATED or (request.depth == AUTO and not depths)
    depth = request.settings.capture.depth
    source = (
        f"from the photographs, at {depth.max_side_px} px at most, in {len(depth.rounds)} rounds, each with "
        f"{depth.sources} others at most"
        if estimated
        else f"of {depths} of them"
    )
    steps = ["capture", *(["depth"] if estimated else []), *STEPS, "asset", *(["preview"] if request.preview else [])]
    withheld = _withheld(request)
    noted = [f"withheld: {named(withheld)}"] if withheld else []
    described = describe_settings(request, estimated=estimated)
    lines = [
        f"capture: {request.capture}, {len(capture.views)} photographs, the first {first.width_px} x "
        f"{first.height_px} px",
        f"depth: {source}; masks: of {masks}",
        *noted,
        *label_remarks(capture.remarks, request.render_setting),
        f"settings: {', '.join(f'{name} {value}' for name, value in described.items())}",
        f"steps: {', '.join(steps)}",
        would,
    ]
    return "\n".join(lines)


def find_capture(request: LeavesRequest) -> Capture:
    """The capture with the photographs asked for, without those that are withheld.

    Raises:
        CaptureError: There are none.
    """
    folder = DEFAULT_DEPTH if request.depth in (AUTO, ESTIMATED) else request.depth
    capture = read_upright_capture(request.capture, depth=folder, views=request.views).capture
    withheld = _withheld(request)
    left = tuple(view for view in capture.views if view.name not in withheld)
    if not left:
        raise CaptureError(
            f"no photograph is left of {counted(len(capture.views), 'photograph')}: they are all withheld",
            ("withhold fewer with ", Setting(name="plant.hold_back")),
        )
    return replace(capture, views=left)


def _withheld(request: LeavesRequest) -> tuple[str, ...]:
    if not request.hold_back:
        return ()
    photographs = [name for name in files_below(request.capture / IMAGES) if is_picture(name)]
    return choose_withheld(photographs, request.hold_back)


def read_leaves_input(request: LeavesRequest, progress: StepProgress | None = None) -> LeavesInput:
    """Read the photographs asked for, with their depth; compute that where there is none.

    Depth maps that hold nothing are not replaced unasked: whoever gave them should hear of it.

    Raises:
        CaptureError: see read_capture, read_views, refuse_inverted_masks and estimate_view_depths.
    """
    capture = find_capture(request)
    if request.depth == ESTIMATED:
        capture = without_depth(capture)
    has_maps = any(view.depth is not None for view in capture.views)
    read = _read_what_can_be(capture, request, progress_in_step("capture", progress))
    views, remarks = list(read.views), [*capture.remarks, *read.remarks]
    if request.settings.capture.mask != "none":
        refuse_inverted_masks(views)
    if request.depth != ESTIMATED and has_maps and not any(view.has_depth for view in views):
        remedy = (Setting(name="leaves.depth", value='"estimated"'), " computes it from the photographs")
        remarks.append(remark("depth-maps-empty", "the depth maps hold no depth that can be used", remedy=remedy))
    estimated = request.depth == ESTIMATED or (request.depth == AUTO and not has_maps)
    if estimated:
        if len(views) < 2:
            raise CaptureError(
                f"{request.capture} has no depth for the one photograph that is used, and it takes two to compute it",
                "give depth maps, or more photographs",
            )
        try:
            found = estimate_view_depths(
                views,
                capture.up,
                capture.points_m,
                request.settings.capture,
                progress_in_step("depth", progress),
                threads=request.settings.threads,
            )
        except CaptureError as error:
            raise CaptureError(
                f"depth cannot be computed from the photographs: {error.text}",
                (*error.remedy, f"; or put depth maps into {request.capture / DEFAULT_DEPTH}"),
            ) from error
        views = list(found.views)
        remarks += found.remarks
        text = "depth was computed from the photographs"
        remarks.append(remark("depth-estimated", text))
    remarks += check_views(views)
    is_whole = request.views is None and not request.hold_back
    everything = capture if is_whole else find_capture(replace(request, views=None, hold_back=0))
    places = {view.name: number for number, view in enumerate(everything.views)}
    numbers = np.array([places[view.name] for view in views], np.int32)
    return LeavesInput(capture=capture, views=views, numbers=numbers, remarks=tuple(remarks), estimated=estimated)


def _read_what_can_be(capture: Capture, request: LeavesRequest, progress: Progress | None) -> CaptureViews:
    """The views; without depth where all of its maps are damaged and none was asked for by its folder."""
    try:
        return read_views(capture, progress)
    except CaptureError as error:
        if request.depth != AUTO or all(view.depth is None for view in capture.views):
            raise
        bare = read_views(without_depth(capture), progress)  # raises what is wrong with the photographs, if they are
        return replace(bare, remarks=(*bare.remarks, remark("depth-maps-unusable", error.text, remedy=error.remedy)))


def place_plant(leaves: Leaves, turned_from_world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where a plant of these leaves stands: (4, 4) for column vectors, from the world to the asset.

    The lowest point of the leaves is on the ground, and the origin is below the middle of them all.
    """
    if not len(leaves):
        return turned_from_world
    low, high = leaf_bounds_m(move_leaves(leaves, turned_from_world), NO_JITTER)
    moved = np.eye(4)
    moved[:3, 3] = -(low[0] + high[0]) / 2, -low[1], -(low[2] + high[2]) / 2
    return np.asarray(moved @ turned_from_world)


def finish_leaves(leaves: Leaves, asset_from_world: NDArray[np.float64], numbers: NDArray[np.int32]) -> Leaves:
    """The leaves in the asset's frame, with the numbers of the photographs among the capture's."""
    view = None if leaves.view is None else np.where(leaves.view >= 0, numbers[leaves.view], -1).astype(np.int32)
    return replace(move_leaves(leaves, asset_from_world), view=view, phase=spread_phases(len(leaves)))


def encode_texture(texture: AverageTexture) -> bytes:
    """A PNG of the average leaf, sRGB, with its opacity."""
    rgba = np.dstack([encode_srgb(texture.rgba[..., :3]), texture.rgba[..., 3]])
    return encode_png(np.rint(np.clip(rgba, 0, 1) * 255).astype(np.uint8))


def median_color(texture: AverageTexture) -> tuple[float, float, float]:
    """The mean colour of the average leaf where it is opaque, linear; black nowhere, for leaves are divided by it."""
    opacity = texture.rgba[..., 3].astype(np.float64)
    opacity = opacity if opacity.any() else np.ones_like(opacity)
    mean = np.average(texture.rgba[..., :3].reshape(-1, 3).astype(np.float64), axis=0, weights=opacity.ravel())
    return _three(np.maximum(mean, 1e-4))


def list_inputs(capture: Capture) -> list[Path]:
    """The files that a capture's views are read from, sorted."""
    files = [path for view in capture.views for path in (view.photo, view.depth, view.mask) if path is not None]
    cameras = [path for path in (capture.folder / "cameras").rglob("*") if path.is_file()]
    toml = capture.folder / "capture.toml"
    return sorted({*files, *cameras, *([toml] if toml.is_file() else [])})


def describe_settings(request: LeavesRequest, *, estimated: bool) -> dict[str, str]:
    """Every setting that decides the result, those of the command line by the names of their options.

    Args:
        request: What was asked for.
        estimated: Whether depth is computed from the photographs.
    """
    unused = ("cloud.",) if estimated else ("cloud.", "capture.")
    other = "paper" if request.settings.method == "dense" else "dense"
    return {
        "depth": request.depth,
        "views": request.views or "all",
        "hold_back": str(request.hold_back),
        "representation": " ".join(request.representations) if request.representations else "by the number of leaves",
        "seed": str(request.seed),
        **{
            name: value
            for name, value in list_settings(request.settings).items()
            # The number of threads changes nothing; the other method was not used, nor is there a cloud alone.
            if not name.endswith("threads") and not name.startswith((f"{other}.", f"{other}_fit.", *unused))
        },
    }


def _three(color: NDArray[np.floating]) -> tuple[float, float, float]:
    red, green, blue = map(float, color)
    return red, green, blue
