"""Which files of a folder are photographs that can be used, and what their EXIF holds of the camera."""

import logging
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import PHOTO_KINDS, counted, files_below, is_video, list_pictures, named
from usdfoliage.capture.folder.raster import apply_orientation, read_image_spec, read_raster
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import hash_file
from usdfoliage.files.threads import map_threaded, share_cores
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, Remedy, remark

logger = logging.getLogger(__name__)

_FILM_DIAGONAL_MM = math.hypot(36, 24)  # what the 35 mm equivalent of EXIF refers to (CIPA DC-008, 4.6.5)
_UNDO_ORIENTATION = {6: 8, 8: 6}  # the others are their own inverses
_SMOOTHING, _NOTHING = cv2.getGaussianKernel(7, 1.0), np.ones((1, 1))
_SHARPNESS_SIDE_PX = 1600  # photographs of all sizes are compared at this one


@dataclass(frozen=True, kw_only=True)
class PhotoSetSettings:
    """When a photograph is not as good as its companions."""

    blurred_below: float = 0.5  # of the median sharpness of the set
    threads: int = 0  # 0: one per core

    def __post_init__(self) -> None:
        if not 0 <= self.blurred_below < 1:
            raise ValueError(f"blurred_below must be in 0 to 1, not {self.blurred_below}")


@dataclass(frozen=True, kw_only=True)
class PhotoFile:
    """A photograph that can be read. Width and height are those of the stored pixels, as in the camera's model."""

    name: str  # below the folder
    path: Path
    width_px: int
    height_px: int
    orientation: int  # of EXIF, 1 for none or upright
    digest: str  # of the file's bytes
    sharpness: float  # contrast of fine detail over that of coarse detail
    camera: str  # make and model, "" where EXIF has none
    focal_px: float | None  # by EXIF
    gps: tuple[float, float, float] | None  # latitude and longitude in degrees, altitude in metres (NaN for none)
    elevation_deg: float | None  # of the optical axis above the horizon, by EXIF


@dataclass(frozen=True, kw_only=True)
class DroppedFile:
    """A file that is not used."""

    name: str
    reason: str
    remedy: Remedy = ()


@dataclass(frozen=True, kw_only=True)
class PhotoSet:
    """The photographs of a folder."""

    folder: Path
    photos: tuple[PhotoFile, ...]  # by name
    dropped: tuple[DroppedFile, ...]  # by name
    blurred: tuple[str, ...]  # names of photographs far less sharp than the others; they are used
    remarks: tuple[Remark, ...]


def read_photo_set(
    images: Path,
    names: Sequence[str] | None = None,
    settings: PhotoSetSettings = PhotoSetSettings(),
    progress: Progress | None = None,
) -> PhotoSet:
    """Look at every file of a folder; all photographs are read once, and none is kept.

    Files that cannot be read, and copies of others, are left out and named.

    Args:
        images: The folder, with any folders below.
        names: Only these, as files_below calls them; None for all.
        settings: What counts as blurred.
        progress: Called with photographs done, and all.

    Raises:
        CaptureError: There is no folder, no photograph in it, or none can be read; only videos are there.
    """
    if not images.is_dir():
        raise CaptureError(f"{images} is no folder", "give the folder of the photographs")
    found = files_below(images)
    if names is not None:
        missing = sorted(set(names) - set(found))
        if missing:
            raise CaptureError(f"{images} has no {named(missing)}", "give names of files in it")
        found = {name: found[name] for name in sorted(set(names))}
    videos = [name for name in found if is_video(name)]
    pictures, doubles = list_pictures(found)
    if not pictures:
        raise CaptureError(*_without_pictures(images, videos))

    photos: list[PhotoFile] = []
    dropped: list[DroppedFile] = []
    looked_at = map_threaded(
        lambda name: _inspect(name, found[name]), pictures, threads=share_cores(settings.threads)[0]
    )
    for done, result in enumerate(looked_at, 1):
        if isinstance(result, PhotoFile):
            photos.append(result)
        else:
            dropped.append(result)
        if progress is not None:
            progress(done, len(pictures))
    if not photos:
        raise CaptureError(
            f"none of {counted(len(dropped), 'photograph')} in {images} can be read; the first: {dropped[0].reason}",
            dropped[0].remedy,
        )
    unreadable = len(dropped)
    first: dict[str, str] = {}
    for photo in photos:
        if photo.digest in first:
            dropped.append(DroppedFile(name=photo.name, reason=f"a copy of {first[photo.digest]}"))
        first.setdefault(photo.digest, photo.name)
    kept = tuple(photo for photo in photos if first[photo.digest] == photo.name)
    blurred = find_blurred([(photo.name, photo.sharpness) for photo in kept], settings)
    copies = dropped[unreadable:]
    remarks = [remark_unusable([item.name], item.reason, item.remedy) for item in dropped[:unreadable]]
    if copies:
        text = (
            f"{counted(len(copies), 'copy', 'copies')} left out: "
            + "; ".join(f"{item.name} is {item.reason}" for item in copies[:5])
            + ("; …" if len(copies) > 5 else "")
        )
        remarks.append(remark("photograph-copies-left-out", text, subject=named([item.name for item in copies])))
    remarks += remark_other_files(videos, doubles)
    if blurred:
        remarks.append(remark_blurred(blurred))
    sizes = {(photo.width_px, photo.height_px) for photo in kept}
    if len(sizes) > 1:
        listed = ", ".join(f"{width}×{height}" for width, height in sorted(sizes)[:5])
        text = f"photographs of {len(sizes)} sizes ({listed}{', …' if len(sizes) > 5 else ''}), a camera each"
        remarks.append(remark("photograph-sizes-differ", text))
    return PhotoSet(
        folder=images,
        photos=kept,
        dropped=tuple(sorted(dropped, key=lambda item: item.name)),
        blurred=blurred,
        remarks=tuple(remarks),
    )


def remark_unusable(names: Sequence[str], reason: str, remedy: Remedy = ()) -> Remark:
    """On photographs that cannot be read, or do not fit their camera; reason and remedy are those of the first."""
    text = (
        f"{named(names)} is left out: {reason}"
        if len(names) == 1
        else (f"{named(names)} are left out; the first, as {reason}")
    )
    return remark("photographs-unusable", text, subject=named(names), remedy=remedy)


def remark_blurred(names: Sequence[str]) -> Remark:
    """On photographs that find_blurred has named."""
    text = f"{named(names)} {'is' if len(names) == 1 else 'are'} far less sharp than the others"
    return remark("photographs-blurred", text, subject=named(names), remedy="take better ones, or leave them out")


def remark_other_files(videos: Sequence[str], doubles: Sequence[str]) -> list[Remark]:
    """On videos, and on raw and HEIC files beside a photograph of the same name, by their names."""
    remarks = []
    if videos:
        text = f"{named(videos)} not used, as there are photographs"
        remarks.append(remark("videos-not-used", text, subject=named(videos), remedy=explain_video(videos[0])))
    if doubles:
        text = f"{named(doubles)} not used, as there are photographs of the same name"
        remarks.append(remark("raw-photographs-not-used", text, subject=named(doubles)))
    return remarks


def read_gray(path: Path, max_side_px: int = 0) -> NDArray[np.uint8]:
    """(H, W): a photograph's brightness as displayed, its pixels as stored: EXIF orientation is not applied.

    Floats are taken for linear light, and white for what all but their brightest half percent stay below.

    Args:
        path: The file.
        max_side_px: Reduced so that no side is longer; 0 for never.

    Raises:
        CaptureError: As read_raster.
    """
    color = _read_stored(path)
    gray = color[..., 0] if color.shape[2] == 1 else cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    longest = max(gray.shape)
    if 0 < max_side_px < longest:
        size = [max(1, round(side * max_side_px / longest)) for side in gray.shape[::-1]]
        gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(np.rint(gray), 0, 255), np.uint8)


def read_colors(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3): red, green, blue of a photograph as displayed, its pixels as stored, as read_gray takes them.

    Raises:
        CaptureError: As read_raster.
    """
    color = np.clip(np.rint(_read_stored(path)), 0, 255).astype(np.uint8)
    return np.asarray(np.repeat(color, 3, axis=2) if color.shape[2] == 1 else color)


def _read_stored(path: Path) -> NDArray[Any]:
    """(H, W, 1) or (H, W, 3), uint8, or float32 up to 255."""
    raster = read_raster(path)
    color = raster.color
    if raster.is_float:
        white = float(np.percentile(color, 99.5)) or 1.0
        color = np.asarray(encode_srgb(np.clip(color / white, 0, 1)) * 255, np.float32)
    elif color.dtype == np.uint16:
        color = color.astype(np.float32) * np.float32(255 / 65535)
    turned = apply_orientation(color, _UNDO_ORIENTATION.get(raster.orientation, raster.orientation))
    return np.ascontiguousarray(turned)


def _inspect(name: str, path: Path) -> PhotoFile | DroppedFile:
    try:
        gray = read_gray(path)
        digest = hash_file(path).hex()
    except CaptureError as error:
        return DroppedFile(name=name, reason=error.text, remedy=error.remedy)
    except OSError as error:
        return DroppedFile(name=name, reason=f"{path} cannot be read: {error.strerror}")
    height, width = gray.shape
    photo = PhotoFile(
        name=name, path=path, width_px=width, height_px=height, orientation=1, digest=digest,
        sharpness=measure_sharpness(gray), camera="", focal_px=None, gps=None,
        elevation_deg=None,
    )  # fmt: skip
    return _with_exif(photo)


def measure_sharpness(gray: NDArray[np.uint8]) -> float:
    """Share of fine detail in what detail a picture (H, W) has: it measures blur, not how much the picture shows.

    Along the direction that has less of it, as a camera that shakes blurs but one.
    """
    longest = max(gray.shape)
    if longest > _SHARPNESS_SIDE_PX:
        size = [max(1, round(side * _SHARPNESS_SIDE_PX / longest)) for side in gray.shape[::-1]]
        gray = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
    picture = gray.astype(np.float32)
    along = [
        picture - cv2.sepFilter2D(picture, -1, across, down)
        for across, down in ((_SMOOTHING, _NOTHING), (_NOTHING, _SMOOTHING))
    ]
    coarse = float(np.std(cv2.GaussianBlur(picture, (0, 0), 2.0) - cv2.GaussianBlur(picture, (0, 0), 8.0)))
    return min(float(np.std(detail)) for detail in along) / coarse if coarse > 0 else 0.0


def find_blurred(
    sharpness: Sequence[tuple[str, float]], settings: PhotoSetSettings = PhotoSetSettings()
) -> tuple[str, ...]:
    """Names of photographs far less sharp than the others.

    Args:
        sharpness: The name of each and its measure_sharpness.
        settings: What counts as blurred.
    """
    if len(sharpness) < 3:
        return ()  # of two, either may be the odd one
    middle = float(np.median([value for _, value in sharpness]))
    return tuple(name for name, value in sharpness if value < settings.blurred_below * middle)


def _with_exif(photo: PhotoFile) -> PhotoFile:
    spec = read_image_spec(photo.path)
    if spec is None:
        return photo
    orientation = spec.get_int_attribute("Orientation", 1)
    camera = " ".join(filter(None, (_text(spec, "Make"), _text(spec, "Model"))))
    return replace(
        photo,
        orientation=orientation if orientation in range(1, 9) else 1,
        camera=camera,
        focal_px=_focal_px(spec, photo.width_px, photo.height_px),
        gps=_gps(spec),
        elevation_deg=_elevation_deg(spec),
    )


def _focal_px(spec: Any, width_px: int, height_px: int) -> float | None:
    """Focal length in pixels by the 35 mm equivalent or by the sensor's resolution; None where EXIF states nothing."""
    equivalent_mm = spec.get_float_attribute("Exif:FocalLengthIn35mmFilm", 0.0) or float(
        spec.get_int_attribute("Exif:FocalLengthIn35mmFilm", 0)
    )
    if 1 <= equivalent_mm <= 5000:
        return float(equivalent_mm / _FILM_DIAGONAL_MM * math.hypot(width_px, height_px))
    focal_mm = spec.get_float_attribute("Exif:FocalLength", 0.0)
    density = spec.get_float_attribute("Exif:FocalPlaneXResolution", 0.0)  # pixels per unit, of the full picture
    unit_mm = {2: 25.4, 3: 10.0, 4: 1.0}.get(spec.get_int_attribute("Exif:FocalPlaneResolutionUnit", 2), 25.4)
    full_px = spec.get_int_attribute("Exif:PixelXDimension", 0) or width_px
    if focal_mm > 0 and density > 0:
        focal_px = focal_mm * density / unit_mm * max(width_px, height_px) / max(full_px, 1)
        if 0.2 <= focal_px / max(width_px, height_px) <= 50:
            return float(focal_px)
    return None


def _gps(spec: Any) -> tuple[float, float, float] | None:
    angles = []
    for which, negative in (("Latitude", "S"), ("Longitude", "W")):
        parts = spec.getattribute(f"GPS:{which}")
        try:
            numbers = [float(part) for part in parts] if isinstance(parts, tuple | list) else [float(parts)]
        except (TypeError, ValueError):
            return None
        angle = sum(number / 60**place for place, number in enumerate(numbers[:3]))
        if not math.isfinite(angle) or abs(angle) > 180:
            return None
        angles.append(-angle if _text(spec, f"GPS:{which}Ref").upper().startswith(negative) else angle)
    if angles == [0.0, 0.0]:
        return None  # what a receiver without satellites writes
    try:
        altitude_m = float(spec.getattribute("GPS:Altitude"))
    except (TypeError, ValueError):
        altitude_m = math.nan
    below = spec.getattribute("GPS:AltitudeRef")
    return angles[0], angles[1], -altitude_m if below in (1, "1", "\x01") else altitude_m


def _elevation_deg(spec: Any) -> float | None:
    try:
        angle = float(spec.getattribute("Exif:CameraElevationAngle"))
    except (TypeError, ValueError):
        return None
    return angle if -90 <= angle <= 90 else None


def _text(spec: Any, name: str) -> str:
    try:
        return " ".join(str(spec.get_string_attribute(name)).replace("\0", " ").split())
    except UnicodeDecodeError:
        return ""


def _without_pictures(images: Path, videos: Sequence[str]) -> tuple[str, str]:
    """What is wrong, and what to do."""
    if videos:
        return f"{images} has no photographs but a video, {videos[0]}", explain_video(str(images / videos[0]))
    return f"{images} has no photographs", f"put them there as {PHOTO_KINDS}"


def explain_video(name: str) -> str:
    """How to use a video that lies among photographs."""
    return f"to use it instead, give the video itself, {shlex.quote(name)}, in place of its folder"
