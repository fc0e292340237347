"""A capture folder: which photographs have cameras, depth and masks, and each of them as a view without distortion."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model, read_model_points
from usdfoliage.capture.folder.depth_map import DEPTH_CHANNEL, DEPTH_SUFFIXES, read_depth
from usdfoliage.capture.folder.depth_scale import check_depth_scale, leave_out_other_units
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.listing import (
    PHOTO_KINDS,
    counted,
    depth_folders,
    file_of,
    files_below,
    folder_below,
    list_pictures,
    named,
    parse_views,
)
from usdfoliage.capture.folder.masks import read_mask
from usdfoliage.capture.folder.photo_set import remark_unusable
from usdfoliage.capture.folder.raster import apply_orientation
from usdfoliage.capture.folder.settings import CaptureSettings, read_capture_settings
from usdfoliage.capture.lens import Lens, Undistortion, scale_lens, undistort
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.geometry.up_turn import turn_to_y_up
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, remark

logger = logging.getLogger(__name__)

_MASK_SUFFIXES = (".png",)
_UNDO_ORIENTATION = {6: 8, 8: 6}  # the others are their own inverses


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureView:
    """A photograph of a capture with its camera; nothing of it is read yet."""

    name: str  # of the file, below images/
    photo: Path
    lens: Lens
    cam_from_world: NDArray[np.float64]  # (3, 4), in metres
    depth: Path | None
    mask: Path | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """What a capture folder holds.

    Its world has the axes of the input files and is in metres: places are those of the files times metres_per_unit.
    """

    folder: Path
    name: str
    settings: CaptureSettings
    views: tuple[CaptureView, ...]  # those chosen, by name unless chosen in another order
    points_m: NDArray[np.float64]  # (N, 3), points of the cameras' model in the world; often none
    remarks: tuple[Remark, ...]  # on what is missing or was not used

    @property
    def asset_from_world(self) -> NDArray[np.float64]:
        """(4, 4) for column vectors: from the views' world to the asset's axes, Y up; both in metres."""
        matrix = np.eye(4)
        matrix[:3, :3] = turn_to_y_up(self.settings.up)
        return matrix

    @property
    def up(self) -> NDArray[np.float64]:
        """(3,), up in the views' world, of length 1."""
        return np.asarray(np.linalg.solve(self.asset_from_world[:3, :3], (0.0, 1.0, 0.0)))

    @property
    def asset_from_capture(self) -> NDArray[np.float64]:
        """(4, 4) for column vectors: from the coordinates in the input files, in their unit, to the asset's."""
        unit = self.settings.metres_per_unit
        return np.asarray(self.asset_from_world @ np.diag([unit, unit, unit, 1.0]))


@dataclass(frozen=True, kw_only=True, eq=False)
class CaptureViews:
    """The views of a capture that could be read."""

    views: tuple[View, ...]
    remarks: tuple[Remark, ...]  # on what was left out, ignored or is improbable


class _ViewRemark(NamedTuple):
    """A remark on one view, whose name is its subject and not in its text; those of one text become one remark."""

    remark: Remark
    detail: str = ""  # that of the first one follows the text
    pixels: int = 0  # added up and put before the text


def read_capture(
    folder: Path, depth: str = "depth", views: str | Sequence[str | int] | None = None, cameras: str = "cameras"
) -> Capture:
    """Find out what a capture folder holds. Photographs, depth and masks are not opened.

    Args:
        folder: The capture folder, laid out as the first page of the manual describes.
        depth: Which folder in it holds the depth maps.
        views: Names of photographs or places in the list of posed photographs, as parse_views takes them; None for all.
        cameras: Which folder in it holds the COLMAP model.

    Raises:
        CaptureError: No folder, photographs or cameras; capture.toml or the cameras are damaged; no photograph has a
            camera; a chosen view or depth folder does not exist.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise CaptureError(f"{folder} is no folder", "give a capture folder with images/ and cameras/")
    settings, toml_remarks = read_capture_settings(folder)
    photos = files_below(folder_below(folder, "images"))
    pictures, _ = list_pictures(photos)
    if not pictures:
        raise CaptureError(f"{folder / 'images'} has no photographs", f"put them there as {PHOTO_KINDS}")
    cameras_folder = folder_below(folder, cameras)
    if not cameras_folder.is_dir():
        raise CaptureError(
            f"{cameras_folder} does not exist; the poses of the photographs are needed: "
            f"put a COLMAP model there (cameras.txt and images.txt, or cameras.bin and images.bin)"
        )
    model = read_camera_model(find_camera_model(cameras_folder))
    posed = [image for image in model.images if image.name in photos]
    without_photo = [image.name for image in model.images if image.name not in photos]
    without_camera = sorted(set(pictures) - {image.name for image in posed})
    if not posed:
        raise CaptureError(
            f"none of the {len(model.images)} images in {model.folder} is in {folder / 'images'}: "
            f"the cameras know {named(without_photo)}, there are {named(without_camera)}; the names must be the same"
        )
    remarks = list(toml_remarks)
    if without_photo:
        text = f"{counted(len(without_photo), 'camera')} without a photograph: {named(without_photo)}"
        remarks.append(remark("cameras-without-photograph", text, subject=named(without_photo)))
    if without_camera:
        text = f"{counted(len(without_camera), 'photograph')} without a camera: {named(without_camera)}"
        remarks.append(remark("photographs-without-camera", text, subject=named(without_camera)))

    depth_folder = folder_below(folder, depth)
    depths = files_below(depth_folder)
    if not any(path.suffix in DEPTH_SUFFIXES for path in depths.values()) and depth != "depth":
        raise CaptureError(f"{depth_folder} has no depth maps; there are {depth_folders(folder)}")
    belonging = {file_of(name, depths, DEPTH_SUFFIXES) for name in photos}
    alone = [name for name, path in depths.items() if path.suffix in DEPTH_SUFFIXES and path not in belonging]
    if alone:
        text = f"{counted(len(alone), 'depth map')} without a photograph: {named(alone)}"
        remarks.append(remark("depth-maps-without-photograph", text, subject=named(alone)))

    chosen = range(len(posed)) if views is None else parse_views(views, [image.name for image in posed])
    posed = [posed[index] for index in chosen]
    masks = files_below(folder / "masks")
    capture_views = []
    for image in posed:
        cam_from_world = image.cam_from_world.copy()
        cam_from_world[:, 3] *= settings.metres_per_unit
        capture_views.append(
            CaptureView(
                name=image.name,
                photo=photos[image.name],
                lens=model.lenses[image.camera_id],
                cam_from_world=cam_from_world,
                depth=file_of(image.name, depths, DEPTH_SUFFIXES),
                mask=file_of(image.name, masks, _MASK_SUFFIXES),
            )
        )
    count = counted(len(capture_views), "view")
    without = [view.name for view in capture_views if view.depth is None]
    if without:
        text = f"{len(without)} of {count} without a depth map: {named(without)}"
        remarks.append(remark("views-without-depth-map", text, subject=named(without)))
    without = [view.name for view in capture_views if view.mask is None]
    if without and (folder / "masks").is_dir():
        text = f"{len(without)} of {count} without a mask: {named(without)}"
        remarks.append(remark("views-without-mask", text, subject=named(without)))

    try:
        points_m = read_model_points(model.folder) * settings.metres_per_unit
    except CaptureError as error:  # they only help to check the scale
        points_m = np.zeros((0, 3))
        text = f"the points of the cameras' model are not used: {error.text}"
        remarks.append(remark("model-points-not-used", text, remedy=error.remedy))
    return Capture(
        folder=folder,
        name=settings.name or folder.resolve().name,
        settings=settings,
        views=tuple(capture_views),
        points_m=points_m,
        remarks=tuple(remarks),
    )


def read_views(capture: Capture, progress: Progress | None = None) -> CaptureViews:
    """Read all views of a capture; those that cannot be read are left out and named.

    Raises:
        CaptureError: No view can be read; or there are depth maps and none can be used.
    """
    views: list[View] = []
    remarks: list[_ViewRemark] = []
    unreadable: list[tuple[str, CaptureError]] = []
    with_depth_map = 0
    prepared: dict[Lens, Undistortion] = {}
    for done, chosen in enumerate(capture.views):
        if progress is not None:
            progress(done, len(capture.views))
        try:
            view, about = _read_view(capture, chosen, prepared)
        except CaptureError as error:
            unreadable.append((chosen.name, error))
            continue
        views.append(view)
        remarks.extend(about)
        with_depth_map += chosen.depth is not None
    if progress is not None:
        progress(len(capture.views), len(capture.views))
    if not views:
        first = unreadable[0][1]
        raise CaptureError(
            f"none of {counted(len(unreadable), 'view')} can be read; the first: {first.text}", first.remedy
        )

    ignored = [each for each in remarks if each.remark.code == "depth-map-ignored"]
    if ignored and len(ignored) == with_depth_map:
        raise CaptureError(
            f"none of {counted(len(ignored), 'depth map')} can be used; the first: {ignored[0].detail}",
            ignored[0].remark.remedy,
        )
    in_one_unit, units = leave_out_other_units(views, capture.points_m)
    scale = check_depth_scale(in_one_unit, capture.points_m, capture.settings.metres_per_unit)
    left_out = []
    if unreadable:
        first = unreadable[0][1]
        left_out = [remark_unusable([name for name, _ in unreadable], first.text, first.remedy)]
    return CaptureViews(views=in_one_unit, remarks=(*left_out, *_merge(remarks), *units, *scale))


def without_depth(capture: Capture) -> Capture:
    """The capture as if it had no depth maps."""
    return replace(capture, views=tuple(replace(view, depth=None) for view in capture.views))


def read_view(capture: Capture, index: int) -> View:
    """Read one view; remarks on it are logged (read_views returns them).

    The photograph, its depth and its mask are without lens distortion, of the photograph's size. A camera whose
    pictures were of another size and the same proportions is scaled. EXIF orientation is ignored, as COLMAP does,
    unless only the upright photograph has the camera's proportions.

    Args:
        capture: Where it is.
        index: In capture.views.

    Raises:
        CaptureError: The photograph cannot be read, or its proportions are not its camera's.
    """
    view, remarks = _read_view(capture, capture.views[index], {})
    for each in _merge(remarks):
        logger.warning("%s", each.text)
    return view


def read_view_remarked(capture: Capture, index: int) -> tuple[View, tuple[Remark, ...]]:
    """Read one view as read_view does, with remarks on it: merge_view_remarks puts the names of views before them.

    Raises:
        CaptureError: As read_view.
    """
    view, remarks = _read_view(capture, capture.views[index], {})
    return view, tuple(_with_detail(each) for each in remarks)


def merge_view_remarks(remarks: Sequence[Remark]) -> list[Remark]:
    """One remark for all views of one text, in the order of the first ones, with the names of the views before it."""
    by_text: dict[tuple[str, str], list[Remark]] = {}
    for each in remarks:
        by_text.setdefault((each.code, each.text), []).append(each)
    merged = []
    for same_text in by_text.values():
        names = named([each.subject for each in same_text])
        merged.append(replace(same_text[0], subject=names, text=f"{names}: {same_text[0].text}"))
    return merged


def _read_view(
    capture: Capture, chosen: CaptureView, prepared: dict[Lens, Undistortion]
) -> tuple[View, list[_ViewRemark]]:
    """A view and remarks on it; prepared keeps what the last lens took, as most captures have one."""
    remarks: list[_ViewRemark] = []

    def add(made: Remark, detail: str = "", pixels: int = 0) -> None:
        remarks.append(_ViewRemark(replace(made, subject=chosen.name), detail, pixels))

    photo = read_photo(chosen.photo, capture.settings.color_space)
    for each in photo.remarks:
        add(each)
    lens, orientation = _fit_lens(chosen, photo)
    srgb = _turn_back(_encode(photo.linear), orientation)
    if orientation != 1:
        add(remark("orientation-ignored", f"EXIF orientation {orientation} is ignored, as the cameras do"))
    if (lens.width_px, lens.height_px) != (chosen.lens.width_px, chosen.lens.height_px):
        old, new = (f"{size.width_px}×{size.height_px}" for size in (chosen.lens, lens))
        text = f"the camera is for pictures of {old} pixels and is scaled to the photograph's {new}"
        add(remark("camera-scaled", text))

    depth_m = np.zeros(srgb.shape[:2], np.float32)
    if chosen.depth is not None:
        try:
            depth = read_depth(chosen.depth, lens.width_px, lens.height_px)
        except CaptureError as error:
            add(remark("depth-map-ignored", "the depth map is ignored", remedy=error.remedy), error.text)
        else:
            depth_m = depth.depth_m
            for count, kind in (
                (depth.not_finite, "not finite"),
                (depth.negative, "negative"),
                (depth.far, "too far for any photograph"),
            ):
                if count:
                    add(remark("depths-impossible", f"depths are {kind} and taken as none"), pixels=count)
            if depth.channel not in ("", DEPTH_CHANNEL):
                text = f"the channel {depth.channel} is taken for the depth, whose name is {DEPTH_CHANNEL}"
                add(remark("depth-channel-assumed", text))
            if not depth_m.any():
                add(remark("depth-map-empty", "the depth map has no depth at all"))
    mask = None
    if chosen.mask is not None:
        try:
            mask = read_mask(chosen.mask, photo.linear.shape, photo.orientation)
            mask = _turn_back(mask, orientation)
        except CaptureError as error:
            add(remark("mask-ignored", "the mask is ignored", remedy=error.remedy), error.text)

    if not lens.is_pinhole:
        if lens not in prepared:
            prepared.clear()
            prepared[lens] = undistort(lens)
        undistortion = prepared[lens]
        srgb = undistortion.smooth(srgb)
        depth_m = undistortion.nearest(depth_m) if depth_m.any() else depth_m
        mask = None if mask is None else undistortion.nearest(mask.astype(np.float32)) > 0.5
    view = View(name=chosen.name, camera=lens.pinhole(chosen.cam_from_world), srgb=srgb, depth_m=depth_m, mask=mask)
    return view, remarks


def _fit_lens(chosen: CaptureView, photo: Photo) -> tuple[Lens, int]:
    """The camera for the photograph's size, and the EXIF orientation to take back."""
    upright = photo.width_px, photo.height_px
    stored = upright[::-1] if photo.orientation >= 5 else upright
    try:
        return scale_lens(chosen.lens, *stored), photo.orientation
    except ValueError:
        pass
    try:
        return scale_lens(chosen.lens, *upright), 1
    except ValueError as error:
        raise CaptureError(
            f"{photo.path} is {stored[0]}×{stored[1]} pixels, its camera for {chosen.lens.width_px}×"
            f"{chosen.lens.height_px}",
            "give the pictures that the cameras were made from, or these resized",
        ) from error


def _turn_back(upright: NDArray, orientation: int) -> NDArray:  # type: ignore[type-arg]
    """Pixels as the file stores them."""
    if orientation == 1:
        return upright
    return np.ascontiguousarray(apply_orientation(upright, _UNDO_ORIENTATION.get(orientation, orientation)))


def _encode(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(H, W, 3), linear to sRGB; exact for what was sRGB of 8 bits."""
    levels = 2**16 - 1  # fine enough: near black a level of 8 bits has 20 of these
    table = np.round(encode_srgb(np.arange(levels + 1) / levels) * 255).astype(np.uint8)
    scaled = np.minimum(linear, 1)
    scaled *= levels
    scaled += 0.5
    return np.asarray(table.take(scaled.astype(np.uint16)))


def _merge(remarks: Sequence[_ViewRemark]) -> list[Remark]:
    """One remark for those of one text, in the order of the first ones."""
    by_text: dict[tuple[str, str], list[_ViewRemark]] = {}
    for each in remarks:
        by_text.setdefault((each.remark.code, each.remark.text), []).append(each)
    merged = []
    for same_text in by_text.values():
        first, pixels = _with_detail(same_text[0]), sum(each.pixels for each in same_text)
        names = named([each.remark.subject for each in same_text])
        merged.append(replace(first, subject=names, text=f"{names}: {f'{pixels:,} ' if pixels else ''}{first.text}"))
    return merged


def _with_detail(found: _ViewRemark) -> Remark:
    return replace(found.remark, text=f"{found.remark.text}; {found.detail}") if found.detail else found.remark
