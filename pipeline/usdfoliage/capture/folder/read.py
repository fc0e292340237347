"""A capture folder: which photographs have cameras, depth and masks, and each of them as a view without distortion."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model, read_model_points
from usdfoliage.capture.folder.depth_map import DEPTH_CHANNEL, DEPTH_SUFFIXES, read_depth
from usdfoliage.capture.folder.depth_scale import check_depth_scale, leave_out_other_units
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.listing import (
    counted,
    depth_folders,
    file_of,
    files_below,
    folder_below,
    is_picture,
    named,
    parse_views,
)
from usdfoliage.capture.folder.masks import read_mask
from usdfoliage.capture.folder.raster import apply_orientation
from usdfoliage.capture.folder.settings import CaptureSettings, read_capture_settings
from usdfoliage.capture.lens import Lens, Undistortion, scale_lens, undistort
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.progress import Progress

logger = logging.getLogger(__name__)

_MASK_SUFFIXES = (".png",)
_UNDO_ORIENTATION = {6: 8, 8: 6}  # the others are their own inverses
_Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # (x, y, z) -> (x, z, -y)


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
    notes: tuple[str, ...]  # what is missing or was not used, in sentences for the user

    @property
    def asset_from_world(self) -> NDArray[np.float64]:
        """(4, 4) for column vectors: from the views' world to the asset's axes, Y up; both in metres."""
        matrix = np.eye(4)
        if self.settings.up_axis == "Z":
            matrix[:3, :3] = _Y_UP_FROM_Z_UP
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
    notes: tuple[str, ...]  # what was dropped, ignored or is doubtful, in sentences for the user


class _Remark(NamedTuple):
    """What is odd about one view; alike ones become one note."""

    view: str
    text: str
    detail: str = ""  # the first one is told
    pixels: int = 0  # added up and put before the text


def read_capture(
    folder: Path, depth: str = "depth", views: str | Sequence[str | int] | None = None, cameras: str = "cameras"
) -> Capture:
    """Find out what a capture folder holds. Photographs, depth and masks are not opened.

    Args:
        folder: The capture folder, laid out as the first page of the manual says.
        depth: Which folder in it holds the depth maps.
        views: Names of photographs or places in the list of posed photographs, as parse_views takes them; None for all.
        cameras: Which folder in it holds the COLMAP model.

    Raises:
        CaptureError: No folder, photographs or cameras; capture.toml or the cameras are damaged; no photograph has a
            camera; a chosen view or depth folder does not exist.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise CaptureError(f"{folder} is no folder; give a capture folder with images/ and cameras/")
    settings, notes = read_capture_settings(folder)
    photos = files_below(folder_below(folder, "images"))
    if not any(is_picture(name) for name in photos):
        raise CaptureError(f"{folder / 'images'} has no photographs; put them there as JPEG, PNG, TIFF or EXR")
    cameras_folder = folder_below(folder, cameras)
    if not cameras_folder.is_dir():
        raise CaptureError(
            f"{cameras_folder} does not exist; the poses of the photographs are needed: "
            f"put a COLMAP model there (cameras.txt and images.txt, or cameras.bin and images.bin)"
        )
    model = read_camera_model(find_camera_model(cameras_folder))
    posed = [image for image in model.images if image.name in photos]
    without_photo = [image.name for image in model.images if image.name not in photos]
    without_camera = sorted({name for name in photos if is_picture(name)} - {image.name for image in posed})
    if not posed:
        raise CaptureError(
            f"none of the {len(model.images)} images in {model.folder} is in {folder / 'images'}: "
            f"the cameras know {named(without_photo)}, there are {named(without_camera)}; the names must be the same"
        )
    remarks = list(notes)
    if without_photo:
        remarks.append(f"{counted(len(without_photo), 'camera')} without a photograph: {named(without_photo)}")
    if without_camera:
        remarks.append(f"{counted(len(without_camera), 'photograph')} without a camera: {named(without_camera)}")

    depth_folder = folder_below(folder, depth)
    depths = files_below(depth_folder)
    if not any(path.suffix in DEPTH_SUFFIXES for path in depths.values()) and depth != "depth":
        raise CaptureError(f"{depth_folder} has no depth maps; there are {depth_folders(folder)}")
    belonging = {file_of(name, depths, DEPTH_SUFFIXES) for name in photos}
    stray = [name for name, path in depths.items() if path.suffix in DEPTH_SUFFIXES and path not in belonging]
    if stray:
        remarks.append(f"{counted(len(stray), 'depth map')} without a photograph: {named(stray)}")

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
    for what, place, found in (
        ("depth map", depth_folder, [view.depth for view in capture_views]),
        ("mask", folder / "masks", [view.mask for view in capture_views]),
    ):
        without = [view.name for view, path in zip(capture_views, found, strict=True) if path is None]
        if without and (place.is_dir() or what == "depth map"):
            remarks.append(f"{len(without)} of {counted(len(found), 'view')} without a {what}: {named(without)}")

    try:
        points_m = read_model_points(model.folder) * settings.metres_per_unit
    except CaptureError as error:  # they only help to check the scale
        points_m = np.zeros((0, 3))
        remarks.append(f"the points of the cameras' model are not used: {error}")
    return Capture(
        folder=folder,
        name=settings.name or folder.resolve().name,
        settings=settings,
        views=tuple(capture_views),
        points_m=points_m,
        notes=tuple(remarks),
    )


def read_views(capture: Capture, progress: Progress | None = None) -> CaptureViews:
    """Read all views of a capture; those that cannot be read are left out and named.

    Raises:
        CaptureError: No view can be read; or there are depth maps and none can be used.
    """
    views: list[View] = []
    remarks: list[_Remark] = []
    unreadable: list[_Remark] = []
    with_depth_map = 0
    prepared: dict[Lens, Undistortion] = {}
    for done, chosen in enumerate(capture.views):
        if progress is not None:
            progress(done, len(capture.views))
        try:
            view, about = _read_view(capture, chosen, prepared)
        except CaptureError as error:
            unreadable.append(_Remark(chosen.name, "left out", str(error)))
            continue
        views.append(view)
        remarks.extend(about)
        with_depth_map += chosen.depth is not None
    if progress is not None:
        progress(len(capture.views), len(capture.views))
    if not views:
        raise CaptureError(f"none of {counted(len(unreadable), 'view')} can be read; the first: {unreadable[0].detail}")

    ignored = [remark for remark in remarks if remark.text == _DEPTH_IGNORED]
    if ignored and len(ignored) == with_depth_map:
        raise CaptureError(f"none of {counted(len(ignored), 'depth map')} can be used; the first: {ignored[0].detail}")
    in_one_unit, units = leave_out_other_units(views, capture.points_m)
    scale = check_depth_scale(in_one_unit, capture.points_m, capture.settings.metres_per_unit)
    notes = (*_merge(unreadable), *_merge(remarks), *units, *scale)
    return CaptureViews(views=in_one_unit, notes=notes)


def read_view(capture: Capture, index: int) -> View:
    """Read one view; what is odd about it is logged (read_views returns it).

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
    for note in _merge(remarks):
        logger.warning("%s", note)
    return view


def read_view_noted(capture: Capture, index: int) -> tuple[View, tuple[str, ...]]:
    """Read one view as read_view does, and say what is odd about it: texts to follow its name and a colon.

    Raises:
        CaptureError: As read_view.
    """
    view, remarks = _read_view(capture, capture.views[index], {})
    return view, tuple(f"{remark.text}{f'; {remark.detail}' if remark.detail else ''}" for remark in remarks)


_DEPTH_IGNORED = "the depth map is ignored"
_MASK_IGNORED = "the mask is ignored"


def _read_view(capture: Capture, chosen: CaptureView, prepared: dict[Lens, Undistortion]) -> tuple[View, list[_Remark]]:
    """A view and what is odd about it; prepared keeps what the last lens took, as most captures have one."""
    remarks: list[_Remark] = []

    def remark(text: str, detail: str = "", pixels: int = 0) -> None:
        remarks.append(_Remark(chosen.name, text, detail, pixels))

    photo = read_photo(chosen.photo, capture.settings.color_space)
    lens, orientation = _fit_lens(chosen, photo)
    srgb = _turn_back(_encode(photo.linear), orientation)
    if orientation != 1:
        remark(f"EXIF orientation {orientation} is ignored, as the cameras do")
    if (lens.width_px, lens.height_px) != (chosen.lens.width_px, chosen.lens.height_px):
        old, new = (f"{size.width_px}×{size.height_px}" for size in (chosen.lens, lens))
        remark(f"the camera is for pictures of {old} pixels and is scaled to the photograph's {new}")

    depth_m = np.zeros(srgb.shape[:2], np.float32)
    if chosen.depth is not None:
        try:
            depth = read_depth(chosen.depth, lens.width_px, lens.height_px)
        except CaptureError as error:
            remark(_DEPTH_IGNORED, str(error))
        else:
            depth_m = depth.depth_m
            for count, kind in (
                (depth.not_finite, "not finite"),
                (depth.negative, "negative"),
                (depth.far, "too far for any photograph"),
            ):
                if count:
                    remark(f"depths are {kind} and taken as none", pixels=count)
            if depth.channel not in ("", DEPTH_CHANNEL):
                remark(f"the channel {depth.channel} is taken for the depth, whose name is {DEPTH_CHANNEL}")
            if not depth_m.any():
                remark("the depth map has no depth at all")
    mask = None
    if chosen.mask is not None:
        try:
            mask = read_mask(chosen.mask, photo.linear.shape, photo.orientation)
            mask = _turn_back(mask, orientation)
        except CaptureError as error:
            remark(_MASK_IGNORED, str(error))

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
            f"{chosen.lens.height_px}; give the pictures that the cameras were made from, or these resized"
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


def _merge(remarks: Sequence[_Remark]) -> list[str]:
    """One sentence for remarks alike, in the order of the first ones."""
    counts: Counter[str] = Counter()
    by_text: dict[str, list[_Remark]] = {}
    for remark in remarks:
        by_text.setdefault(remark.text, []).append(remark)
        counts[remark.text] += remark.pixels
    notes = []
    for text, alike in by_text.items():
        count = f"{counts[text]:,} " if counts[text] else ""
        detail = f"; {alike[0].detail}" if alike[0].detail else ""
        notes.append(f"{named([remark.view for remark in alike])}: {count}{text}{detail}")
    return notes
