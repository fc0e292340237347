"""The task that separates the plant of a capture from its surroundings: a capture with masks, and the plant's cloud."""

import json
import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.ply import read_cloud, write_cloud
from usdfoliage.capture.folder.depth_map import DEPTH_SUFFIXES
from usdfoliage.capture.folder.hold_back import choose_withheld
from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, MASKS, file_of, files_below, named
from usdfoliage.capture.folder.raster import apply_orientation, read_image_spec
from usdfoliage.capture.folder.read import Capture, read_capture, read_view, read_view_remarked
from usdfoliage.capture.folder.settings import FILE_NAME
from usdfoliage.capture.lens import scale_lens, undistort
from usdfoliage.errors import CaptureError, FoliageError
from usdfoliage.files.threads import map_ahead, share_cores
from usdfoliage.geometry.point_cells import one_in_each_cell
from usdfoliage.isolation.masks import draw_plant_mask, expect_plant, make_plant_grid
from usdfoliage.isolation.plant import IsolatedPlant, IsolationSettings, PointKind, isolate_plant
from usdfoliage.jobs.capture.results import CLOUD as CLOUD_FILE
from usdfoliage.jobs.plant.call import StageCall
from usdfoliage.jobs.plant.inputs import DEPTH_FOLDER
from usdfoliage.jobs.plant.pages.isolation_pictures import draw_kinds, draw_outline
from usdfoliage.jobs.plant.settings import IsolationStageSettings
from usdfoliage.jobs.plant.stages.capture import capture_folder, capture_name
from usdfoliage.jobs.plant.store import ResultFile, copy_tree
from usdfoliage.jobs.plant.summary import StagePicture, StageSummary, write_summary
from usdfoliage.jobs.plant.tasks import CLOUD, ISOLATION
from usdfoliage.jobs.report.pictures import shrink_view, write_picture
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.results import write_whole
from usdfoliage.remarks import Setting, remark

logger = logging.getLogger(__name__)

GIVEN_DEPTH = "given_depth"  # the folder of the input's own depth, in the capture of the plant
_FLOORLESS = "floorless.txt"  # beside the capture of a cloud that a floor was left out of
_STAND = "stand.json"  # beside a capture of whose plant it is known where it comes out of the soil
_DRAWN = "drawn_masks.txt"  # beside a capture whose masks were drawn here
_MAPS = (IMAGES, CAMERAS, DEPTH_FOLDER, "confidence", "normals")
_PICTURES = "pictures"
_MIN_POINTS = 200  # of a plant
_NO_PLANT, _LITTLE = 0.0005, 0.005  # share of the points: below, it is no plant, or hardly one
_MUCH = 0.9  # share of the points, from which on a floor or a background may be among them
_WORTH = 0.002  # share of the points that must be left out, for masks to be worth having
_EXPECTED_POINTS = 300_000  # of the plant, that are looked for in each photograph
_LONGEST_PX = 3000  # side of the pictures that masks are drawn in; those of larger photographs are enlarged
_PIXELS_AT_ONCE = 50_000_000  # of the photographs that are worked on at a time
_OUTLINED = 3  # photographs with the plant's outline


def isolate_capture(call: StageCall) -> tuple[ResultFile, ...]:
    """The capture of the plant alone; where it cannot be separated from its surroundings, of everything."""
    source = capture_folder(call, CLOUD)
    try:
        _isolate(call, source)
    except FoliageError as error:
        if isinstance(error.__cause__, OSError):
            raise
        logger.warning("the plant is not separated from its surroundings: %s", error.text)
        target = call.out / "capture" / capture_name(call)
        shutil.rmtree(target, ignore_errors=True)  # what was laid out before it failed
        _lay_out(call, source, target)
        copy_tree(source / MASKS, target / MASKS, link=True)
        _link(source / CLOUD_FILE, target / CLOUD_FILE)
        text = f"everything in the photographs is taken for the plant: {error.text}"
        failed = remark("isolation-failed", text, remedy=error.remedy)
        write_summary(call.out, StageSummary(remarks=[failed]))
    return ()


def is_floorless(call: StageCall) -> bool:
    """Whether what the plant stands on was left out of its cloud."""
    return call.has(ISOLATION) and (call.result_of(ISOLATION) / _FLOORLESS).is_file()


def stand_height_m(call: StageCall) -> float | None:
    """Height at which the plant comes out of what it stands on or in, in metres along the capture's up axis, from the
    origin of the capture; None where it is not known."""
    if not call.has(ISOLATION) or not (call.result_of(ISOLATION) / _STAND).is_file():
        return None
    path = call.result_of(ISOLATION) / _STAND
    return float(json.loads(path.read_text(encoding="utf-8"))["height_m"])


def has_drawn_masks(call: StageCall) -> bool:
    """Whether the masks of the plant's capture were drawn, not given; where both are, they hold together."""
    return call.has(ISOLATION) and (call.result_of(ISOLATION) / _DRAWN).is_file()


def plant_capture(call: StageCall) -> Path:
    """The capture that the parts of the plant are made of."""
    return capture_folder(call, ISOLATION if call.has(ISOLATION) else CLOUD)


@dataclass(frozen=True, kw_only=True, eq=False)
class _DrawnMask:
    """What was drawn of a photograph."""

    index: int  # in the capture's views
    share: float  # of its pixels, in the mask
    picture: NDArray[np.uint8] | None  # (h, w, 3), the photograph with the plant's outline


def _isolate(call: StageCall, source: Path) -> None:
    target = call.out / "capture" / capture_name(call)
    capture = read_capture(source)
    cloud = read_cloud(source / CLOUD_FILE, capture.settings.metres_per_unit)
    turn = capture.asset_from_world[:3, :3]
    cameras = [view.lens.pinhole(view.cam_from_world) for view in capture.views]
    found = isolate_plant(
        cloud.points_m @ turn.T,
        cloud.srgb,
        np.array([camera.position_m for camera in cameras]) @ turn.T,
        np.array([camera.cam_from_world[2, :3] for camera in cameras]) @ turn.T,
        isolation_settings(call.settings.isolation),
        _has_given_masks(capture),
    )
    share = found.share(PointKind.PLANT)
    remarks = list(found.remarks)
    plant = found.plant
    if share < _NO_PLANT or int(plant.sum()) < _MIN_POINTS:
        text = (
            f"everything in the photographs is taken for the plant, as no more than {share:.2%} of the cloud's "
            f"{len(cloud):,} points were left without floor and surroundings"
        )
        off = Setting(name="isolation.make", value='"off"')
        remarks.append(remark("isolation-nothing-left", text, remedy=("give masks, or set ", off)))
        plant = np.ones(len(cloud), bool)
    elif share < _LITTLE:
        text = f"only {share:.2%} of the cloud is taken for the plant"
        remarks.append(remark("isolation-plant-small", text, remedy="check the outlines of the stage isolation"))
    elif share > _MUCH and found.focus is not None and not any((source / MASKS).glob("*")):
        text = f"{share:.0%} of the cloud is taken for the plant"
        remedy = (
            "check the outlines of the stage isolation, and give masks where the plant is not all that the "
            "photographs show"
        )
        remarks.append(remark("isolation-plant-large", text, remedy=remedy))
    _lay_out(call, source, target)
    masks: list[_DrawnMask] = []
    if 1 - float(plant.mean()) < _WORTH:
        text = "next to nothing is left out, and photographs have no other masks than they came with"
        remarks.append(remark("isolation-masks-unchanged", text))
        copy_tree(source / MASKS, target / MASKS, link=True)
        plant = np.ones(len(cloud), bool)
    else:
        masks = _draw_masks(call, capture, cloud, plant, target, aimed=found.focus is not None)
        unseen = [capture.views[drawn.index].name for drawn in masks if drawn.share == 0]
        for name in unseen:  # an empty mask would count as none
            (target / IMAGES / name).unlink()
        if unseen:
            text = f"{len(unseen)} of {len(masks)} photographs do not show the plant and are left out"
            remarks.append(remark("photographs-without-plant", text, subject=named(unseen)))
    if plant.all():
        _link(source / CLOUD_FILE, target / CLOUD_FILE)
    else:
        write_cloud(
            target / CLOUD_FILE, cloud.take(plant), [f"usdfoliage {__version__}"], capture.settings.metres_per_unit
        )
        if found.support is not None:
            (call.out / _FLOORLESS).write_text("What the plant stands on is left out of the cloud.\n", encoding="utf-8")
    pictures = _write_pictures(call, cloud.points_m @ turn.T, found, masks)
    rows = _rows(found, len(cloud), int(plant.sum()), masks)
    if found.stands_at_m is not None:
        (call.out / _STAND).write_text(json.dumps({"height_m": found.stands_at_m}) + "\n", encoding="utf-8")
    if masks:
        (call.out / _DRAWN).write_text("The masks of the photographs are drawn from the cloud.\n", encoding="utf-8")
    write_summary(call.out, StageSummary(rows=rows, remarks=remarks, pictures=pictures))


def _has_given_masks(capture: Capture) -> bool:
    """Whether most photographs have masks that are used: of five, evenly chosen, three."""
    found = 0
    for index in np.linspace(0, len(capture.views) - 1, min(len(capture.views), 5)).astype(int):
        try:
            found += read_view_remarked(capture, int(index))[0].mask is not None
        except CaptureError:  # the stage that reads all photographs reports it
            continue
    return 2 * found > min(len(capture.views), 5)


def isolation_settings(settings: IsolationStageSettings) -> IsolationSettings:
    """The settings of the stage, as the reconstruction takes them."""
    chosen = IsolationSettings(floor=settings.floor, container=settings.container, outliers=settings.outliers)
    return replace(
        chosen,
        support=replace(chosen.support, layer=settings.floor_layer),
        pieces=replace(chosen.pieces, link_gap=settings.link_gap),
    )


def _lay_out(call: StageCall, source: Path, target: Path) -> None:
    """All of the cloud's capture but masks and cloud, and the input's own depth beside that which was found."""
    for folder in _MAPS:
        copy_tree(source / folder, target / folder, link=True)
    _link(source / FILE_NAME, target / FILE_NAME)
    if call.inputs.has_depth and call.inputs.has_cameras:
        copy_tree(call.request.capture / DEPTH_FOLDER, target / GIVEN_DEPTH, link=True)
        if call.settings.plant.hold_back:
            _remove_withheld(call, target / GIVEN_DEPTH)


def _remove_withheld(call: StageCall, folder: Path) -> None:
    """Depth maps of photographs that are withheld."""
    maps = files_below(folder)
    for name in choose_withheld(list(call.inputs.photographs), call.settings.plant.hold_back):
        if path := file_of(name, maps, DEPTH_SUFFIXES):
            path.unlink()


def _link(path: Path, there: Path) -> None:
    if path.is_file():
        there.parent.mkdir(parents=True, exist_ok=True)
        there.unlink(missing_ok=True)
        try:
            there.hardlink_to(path)
        except OSError:
            there.write_bytes(path.read_bytes())


def _draw_masks(
    call: StageCall, capture: Capture, cloud: Cloud, plant: NDArray[np.bool_], target: Path, *, aimed: bool
) -> list[_DrawnMask]:
    """Write the mask of every photograph: of the plant's pixels those that are in the photograph's own mask too.

    Where the photographs are aimed at one plant, pixels without depth are not of it, and the plant's points are drawn.
    Where they are aimed at nothing, such pixels are of the plant, and the other points are drawn.
    """
    drawn = plant if aimed else ~plant
    grid = make_plant_grid(cloud.points_m, drawn)
    own_m = cloud.points_m[drawn]
    chosen, apart_m = one_in_each_cell(own_m, _EXPECTED_POINTS)
    expected_m, apart_m = own_m[chosen], apart_m or grid.cell_m
    count = len(capture.views)
    outlined = set(np.linspace(0, count, min(count, _OUTLINED), endpoint=False).astype(int).tolist())

    undistorted = lru_cache(maxsize=4)(undistort)  # most captures have one lens

    def draw(index: int) -> tuple[NDArray[np.bool_] | None, NDArray[np.uint8] | None]:
        """The mask, as the photograph is shown, and a picture of it; None of a photograph that cannot be read."""
        try:
            view = read_view(capture, index)
        except CaptureError as error:  # every stage that reads the view reports it
            logger.info("no mask: %s", error)
            return None, None
        size, given = view.depth_m.shape, view.mask
        view = shrink_view(view, _LONGEST_PX)  # depth is no finer, and memory is finite
        mask = draw_plant_mask(view.srgb, view.points(), grid, expect_plant(view.camera, expected_m, apart_m))
        mask = mask if aimed else ~mask
        mask = mask if view.mask is None else mask & view.mask
        picture = draw_outline(view.srgb, mask) if index in outlined else None
        stored_view = capture.views[index]
        if not stored_view.lens.is_pinhole:
            mask = undistorted(scale_lens(stored_view.lens, view.camera.width_px, view.camera.height_px)).distorted(
                mask
            )
        mask = _enlarge(mask, size)
        if given is not None and stored_view.lens.is_pinhole:  # whose outline may be finer
            mask &= given
        return _as_displayed(stored_view.photo, mask), picture

    largest_px = max(view.lens.width_px * view.lens.height_px for view in capture.views)
    at_once = max(1, min(share_cores(call.threads)[0], _PIXELS_AT_ONCE // largest_px))
    masks: list[_DrawnMask] = []
    for index, (mask, picture) in enumerate(map_ahead(draw, range(count), at_once)):
        if mask is None:
            continue
        if mask.any() and not mask.all():
            good, encoded = cv2.imencode(".png", mask.astype(np.uint8) * 255)
            assert good  # a picture of bytes always can be
            write_whole(target / MASKS / f"{capture.views[index].name}.png", encoded.tobytes())
        masks.append(_DrawnMask(index=index, share=float(mask.mean()), picture=picture))
        if call.report_parts is not None:
            call.report_parts(index + 1, count)
    return masks


def _enlarge(mask: NDArray[np.bool_], size: tuple[int, ...]) -> NDArray[np.bool_]:
    """The mask (h, w) at the photograph's size (H, W), its outline smooth."""
    if mask.shape == size:
        return mask
    large = cv2.resize(mask.astype(np.uint8) * 255, size[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(large > 127)


def _as_displayed(photo: Path, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A mask on the pixels that the cameras know, turned as the photograph is shown: so masks are read."""
    spec = read_image_spec(photo)
    if spec is None:  # it was read before
        return mask
    orientation = int(spec.get_int_attribute("Orientation", 1))
    size = spec.height, spec.width
    return mask if mask.shape != size else np.ascontiguousarray(apply_orientation(mask, orientation))


def _write_pictures(
    call: StageCall, points_m: NDArray[np.float64], found: IsolatedPlant, masks: Sequence[_DrawnMask]
) -> list[StagePicture]:
    folder = call.out / _PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for name, picture in draw_kinds(points_m, found):
        file = write_picture(folder / f"kinds_{name}.png", picture)
        caption = f"Plant (green), floor (grey), container (blue), outliers (red), {name}"
        pictures.append(StagePicture(file=f"{_PICTURES}/{file}", caption=caption))
    for drawn in masks:
        if drawn.picture is not None:
            file = write_picture(folder / f"mask_{drawn.index:03d}.jpg", drawn.picture)
            caption = f"What is taken for the plant, photograph {drawn.index + 1}"
            pictures.append(StagePicture(file=f"{_PICTURES}/{file}", caption=caption))
    return pictures


def _rows(found: IsolatedPlant, points: int, kept: int, masks: Sequence[_DrawnMask]) -> list[Row]:
    rows = [Row(name="points kept", value=f"{kept:,}", remark=f"{kept / max(points, 1):.1%} of the cloud")]
    for kind, what in (
        (PointKind.FLOOR, "what the plant stands on, and what is measured below"),
        (PointKind.CONTAINER, "and its soil"),
        (PointKind.OUTLIER, "not linked with the plant"),
    ):
        name = {PointKind.OUTLIER: "outliers"}.get(kind, kind.name.lower())
        rows.append(Row(name=name, value=f"{found.share(kind):.1%}", remark=f"of the cloud: {what}"))
    if found.support is not None:
        slope_deg = float(np.degrees(np.arctan(np.hypot(*found.support.plane[:2]))))
        rows.append(Row(name="slope of the floor", value=f"{slope_deg:.1f}°"))
    if masks:
        middle = float(np.median([drawn.share for drawn in masks]))
        rows.append(Row(name="plant in a photograph", value=f"{middle:.1%}", remark="of the median one's pixels"))
    return rows
