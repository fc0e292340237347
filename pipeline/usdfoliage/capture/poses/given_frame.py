"""Up and unit of poses that are given: as capture.toml states them, else as cameras, points and depth show them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.capture.folder.depth_map import read_depth
from usdfoliage.capture.folder.photo_set import PhotoFile
from usdfoliage.capture.folder.read import Capture, CaptureView, read_capture
from usdfoliage.capture.folder.settings import FILE_NAME, CaptureSettings, read_capture_tables, read_stated_unit
from usdfoliage.capture.poses.depth_unit import find_depth_unit
from usdfoliage.capture.poses.result import Registered, RegisteredPhoto
from usdfoliage.capture.poses.up_direction import UpDirection, find_ups
from usdfoliage.capture.poses.world_frame import WorldSettings, find_scale, list_disagreements, read_scale_hints
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.geometry.up_turn import AXES, axis_vector
from usdfoliage.remarks import Remark, Remedy, Setting, remark

Array = NDArray[np.float64]

STATED = "capture.toml"
THE_FRAME, NOTHING = "the frame", "nothing"  # that a unit is taken from
_SNAP_RAD = math.radians(3)  # beside the estimate's own error, by which an axis may differ from it and still be up
_WEAK_RAD, _WEAK_SNAP_RAD = math.radians(8), math.radians(30)  # an estimate no better only chooses among the axes
_SURE_RAD = math.radians(5)
_DELIBERATE = ("Y", "Z")  # up axes of frames that somebody has laid: such a frame has a unit too
_PLAUSIBLE_M = (0.05, 300.0)  # from cameras to what they see
_MIN_POINTS = 20
_STATE_UP: Remedy = (
    "state it as ",
    Setting(name="capture.toml:up_axis"),
    " or ",
    Setting(name="capture.toml:up_vector"),
)


@dataclass(frozen=True, kw_only=True)
class FrameFacts:
    """Where up is and how long a unit is in the frame of poses, and how sure that is."""

    up: tuple[float, float, float]  # unit, in that frame
    up_from: str  # STATED, or the method
    up_error_rad: float  # estimated; 0 where it is stated
    metres_per_unit: float
    scale_from: str  # STATED, "distance", "scale bar", "gps", "depth", THE_FRAME or NOTHING
    scale_error: float | None  # relative; None where it is unknown, 0 where it is stated


@dataclass(frozen=True, kw_only=True, eq=False)
class UprightCapture:
    """A capture whose settings state up and unit."""

    capture: Capture  # in metres; its settings and remarks have what was found
    frame: FrameFacts


def read_upright_capture(
    folder: Path, depth: str = "depth", views: str | Sequence[str | int] | None = None, cameras: str = "cameras"
) -> UprightCapture:
    """Read a capture, and find up and unit of its poses by all photographs, as far as capture.toml states neither.

    Args:
        folder: As read_capture.
        depth: As read_capture.
        views: As read_capture; what is found is the same, whichever are chosen.
        cameras: As read_capture.

    Raises:
        CaptureError: As read_capture; or a hint at the scale is wrong.
    """
    capture = read_capture(folder, depth=depth, views=views, cameras=cameras)
    stated_unit = read_stated_unit(folder)
    if capture.settings.knows_up and stated_unit is not None:
        return UprightCapture(capture=capture, frame=_state_facts(capture.settings))
    whole = capture if views is None else read_capture(folder, depth=depth, cameras=cameras)
    facts, settings, remarks = find_given_frame(whole, stated_unit)
    return UprightCapture(capture=_restate(capture, settings, remarks), frame=facts)


def find_given_frame(
    capture: Capture, stated_unit: float | None
) -> tuple[FrameFacts, CaptureSettings, tuple[Remark, ...]]:
    """Up and unit of a capture's poses, with the settings that state them, and remarks on how sure they are.

    Up that is within some degrees of an axis of the frame is that axis, since frames are laid so. The unit is what
    capture.toml states; or what a known distance or a scale bar gives; or depth maps in metres; or, in a frame whose Y
    or Z is up and whose distances are plausible, a metre. In any other frame the median distance to what the cameras
    see is called a metre.

    Args:
        capture: With all its photographs.
        stated_unit: Metres of a unit, where capture.toml states it.

    Raises:
        CaptureError: A hint at the scale is wrong.
    """
    registered = _as_registered(capture)
    poses = np.array([photo.cam_from_world for photo in registered.photos])
    centers = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
    distance = viewing_distance(capture, centers, poses[:, 2, :3])
    facts, settings = _state_facts(capture.settings), capture.settings
    remarks: list[Remark] = []
    if not settings.knows_up:
        files = [_photo_file(view) for view in capture.views]
        ups = find_ups(registered, poses, centers, files, None, distance)
        chosen = min(ups, key=lambda each: each.error_rad)
        direction, axis = snap_to_axis(chosen)
        x, y, z = (float(number) for number in direction)
        stated = replace(settings, up_axis=axis) if axis else replace(settings, up_vector=(x, y, z))
        facts = replace(facts, up=(x, y, z), up_from=chosen.method, up_error_rad=chosen.error_rad)
        remarks = _up_remarks(facts, axis, chosen, ups)
    else:
        stated = settings
    if stated_unit is None:
        factor, scale_from, error = _find_unit(capture, stated, registered, centers, distance)
        unit = settings.metres_per_unit * factor
        facts = replace(facts, metres_per_unit=unit, scale_from=scale_from, scale_error=error)
        stated = replace(stated, metres_per_unit=unit)
        if not settings.knows_up or unit != settings.metres_per_unit:  # who states up means metres
            remarks += _scale_remarks(facts, distance)
    return facts, stated, tuple(remarks)


def snap_to_axis(found: UpDirection) -> tuple[Array, str]:
    """The axis of the frame that an estimate means, and its name as capture.toml has it; itself and "" for none."""
    name = max(AXES, key=lambda each: float(axis_vector(each) @ found.direction))
    apart_rad = math.acos(float(np.clip(axis_vector(name) @ found.direction, -1, 1)))
    limit_rad = _SNAP_RAD + found.error_rad if found.error_rad <= _WEAK_RAD else _WEAK_SNAP_RAD
    if apart_rad <= limit_rad:
        return axis_vector(name), name.removeprefix("+")
    return np.asarray(found.direction / np.linalg.norm(found.direction)), ""


def viewing_distance(capture: Capture, centers: Array, axes: Array) -> float:
    """About how far cameras are from what they see: by the model's points, else by where they look, in metres.

    Args:
        capture: Whose unit is taken as it is.
        centers: (N, 3), of the cameras.
        axes: (N, 3), where they look.
    """
    if len(capture.points_m) >= _MIN_POINTS:
        seen = [_seen_depths(view.lens.pinhole(view.cam_from_world), capture.points_m) for view in capture.views]
        medians = [float(np.median(depth_m)) for depth_m in seen if len(depth_m)]
        if medians:
            return float(np.median(medians))
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    total = across.sum(axis=0)
    values = np.linalg.eigvalsh(total)
    if values[0] > 1e-3 * values[2]:  # the axes differ by some degrees
        place = np.linalg.solve(total, np.einsum("nij,nj->i", across, centers))
        ahead = np.einsum("ni,ni->n", place - centers, axes)
        if float(np.mean(ahead > 0)) > 0.5:
            return float(np.median(ahead[ahead > 0]))
    return float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()) or 1.0


def _state_facts(settings: CaptureSettings) -> FrameFacts:
    """The facts of a frame that capture.toml states."""
    x, y, z = (float(number) for number in settings.up)
    return FrameFacts(
        up=(x, y, z),
        up_from=STATED,
        up_error_rad=0.0,
        metres_per_unit=settings.metres_per_unit,
        scale_from=STATED,
        scale_error=0.0,
    )


def _find_unit(
    capture: Capture, stated: CaptureSettings, registered: Registered, centers: Array, distance: float
) -> tuple[float, str, float | None]:
    """Metres of a unit, what it is taken from, and its relative error."""
    hint, bar = read_scale_hints(read_capture_tables(capture.folder), str(capture.folder / FILE_NAME))
    try:
        world = WorldSettings(known_distance=hint, scale_bar=bar)
    except ValueError as error:
        raise CaptureError(f"{capture.folder / FILE_NAME}: {error}") from error
    scale, scale_from = find_scale(registered, centers, None, distance, world)
    if scale_from != NOTHING:
        return scale, scale_from, None
    if capture.settings.knows_up:  # who states up and no unit means metres; depth that differs gets its own remark
        return 1.0, THE_FRAME, None
    found = _by_depth(capture, distance)
    if found is not None:
        return found[0], "depth", found[1]
    nearest_m, farthest_m = _PLAUSIBLE_M
    is_laid = stated.up_axis in _DELIBERATE and nearest_m <= distance <= farthest_m
    if is_laid:
        return 1.0, THE_FRAME, None
    return scale, scale_from, None


def _by_depth(capture: Capture, distance: float) -> tuple[float, float] | None:
    """Metres of a unit by the capture's depth maps, and how far that may be off; None without maps that agree."""
    cameras: list[Pinhole] = []
    maps: list[NDArray[np.float32]] = []
    for view in capture.views:
        if view.depth is None or not view.lens.is_pinhole:
            continue
        try:
            read = read_depth(view.depth, view.lens.width_px, view.lens.height_px)
        except CaptureError:  # it is reported where depth is read to be used
            continue
        if read.depth_m.any():
            cameras.append(view.lens.pinhole(view.cam_from_world))
            maps.append(read.depth_m)
    return find_depth_unit(cameras, maps, capture.points_m, distance)


def _up_remarks(facts: FrameFacts, axis: str, chosen: UpDirection, ups: Sequence[UpDirection]) -> list[Remark]:
    what = axis or f"({', '.join(f'{number:.3f}' for number in facts.up)})"
    error_deg = math.degrees(facts.up_error_rad)
    text = f"up is {what} in the frame of the given poses, by {facts.up_from}, to {error_deg:.1f}°"
    remarks = [remark("up-estimated", text), *list_disagreements(chosen, ups, _STATE_UP)]
    if facts.up_error_rad > _SURE_RAD:
        text = f"up is found by {facts.up_from} and may be wrong by {error_deg:.0f}°"
        remarks.append(remark("up-uncertain", text, remedy=_STATE_UP))
    return remarks


def _scale_remarks(facts: FrameFacts, distance: float) -> list[Remark]:
    if facts.scale_from == NOTHING:
        text = (
            f"the scale is unknown, and the median distance from the cameras to what they see, {distance:.3g} units of "
            f"the given poses, is taken for 1 m"
        )
        remedy: Remedy = (
            "state how long a unit is, as ",
            Setting(name="capture.toml:metres_per_unit"),
            ", or put a known distance between two cameras, or a scale bar, there",
        )
        return [remark("scale-unknown", text, remedy=remedy)]
    if facts.scale_from == THE_FRAME:
        text = f"a unit of the given poses is taken for 1 m: the cameras are {distance:.3g} m from what they see"
    else:
        sure = "" if facts.scale_error is None else f", to {100 * facts.scale_error:.1f} %"
        text = f"a unit of the given poses is {facts.metres_per_unit:.5g} m, by {facts.scale_from}{sure}"
    other = ("if it is another length, state it as ", Setting(name="capture.toml:metres_per_unit"))
    return [remark("scale-estimated", text, remedy=other)]


def _restate(capture: Capture, settings: CaptureSettings, remarks: Sequence[Remark]) -> Capture:
    """The capture in the unit of other settings."""
    factor = settings.metres_per_unit / capture.settings.metres_per_unit
    views = []
    for view in capture.views:
        cam_from_world = view.cam_from_world.copy()
        cam_from_world[:, 3] *= factor
        views.append(replace(view, cam_from_world=cam_from_world))
    return replace(
        capture,
        settings=settings,
        views=tuple(views),
        points_m=capture.points_m * factor,
        remarks=(*capture.remarks, *remarks),
    )


def _seen_depths(camera: Pinhole, points_m: Array) -> Array:
    places, depth_m = camera.project(points_m)
    with np.errstate(invalid="ignore"):  # NaN behind the camera
        inside = np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1) & (depth_m > 0)
    return depth_m[inside]


def _as_registered(capture: Capture) -> Registered:
    count = len(capture.points_m)
    photos = tuple(
        RegisteredPhoto(name=view.name, lens=view.lens, cam_from_world=view.cam_from_world, error_px=0.0, points=0)
        for view in capture.views
    )
    return Registered(
        photos=photos,
        points=capture.points_m,
        srgb=np.zeros((count, 3), np.uint8),
        error_px=np.zeros(count),
        track_starts=np.zeros(count + 1, np.int64),
        track_photos=np.zeros(0, np.int64),
        track_places_px=np.zeros((0, 2)),
        names=tuple(photo.name for photo in photos),
        matches=np.zeros((len(photos), len(photos)), np.int64),
        failures=(),
        remarks=(),
    )


def _photo_file(view: CaptureView) -> PhotoFile:
    """What the photograph's header states of its orientation; nothing else of it is read."""
    orientation = 1
    source = oiio.ImageInput.open(str(view.photo))
    if source is None:  # it is reported where it is read
        library_text(oiio.geterror)
    else:
        spec = source.spec()
        is_stored = (spec.width > spec.height) == (view.lens.width_px > view.lens.height_px)
        orientation = int(spec.get_int_attribute("Orientation", 1)) if is_stored else 1
        source.close()
    return PhotoFile(
        name=view.name,
        path=view.photo,
        width_px=view.lens.width_px,
        height_px=view.lens.height_px,
        orientation=orientation if 1 <= orientation <= 8 else 1,
        digest="",
        sharpness=0.0,
        camera="",
        focal_px=None,
        gps=None,
        elevation_deg=None,
    )
