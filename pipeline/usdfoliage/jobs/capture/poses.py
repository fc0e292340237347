"""Poses of a run: those that are given, or those that are estimated, in the frame and unit that the capture states."""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.colmap.model import find_camera_model
from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, files_below, list_pictures, parse_views
from usdfoliage.capture.folder.photo_set import PhotoSetSettings, read_photo_set
from usdfoliage.capture.folder.read import Capture, read_capture, without_depth
from usdfoliage.capture.folder.settings import FILE_NAME, CaptureSettings, read_capture_settings, read_capture_tables
from usdfoliage.capture.poses.colmap_writer import write_colmap_model
from usdfoliage.capture.poses.given_frame import FrameFacts, read_upright_capture
from usdfoliage.capture.poses.register import Registered, register_photos
from usdfoliage.capture.poses.settings import PoseEstimationSettings
from usdfoliage.capture.poses.world_frame import WorldSettings, level_and_scale, move_registered, read_scale_hints
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.up_turn import turn_to_y_up
from usdfoliage.jobs.capture.find_photographs import GivenPhotographs
from usdfoliage.jobs.capture.folder import Record
from usdfoliage.jobs.capture.settings import CaptureRunSettings, PosesChoice
from usdfoliage.jobs.report.table import Row
from usdfoliage.jobs.work.results import WORK
from usdfoliage.progress import StepProgress, progress_in_step
from usdfoliage.remarks import Argument, Remark, Setting, remark, warnings_of

logger = logging.getLogger(__name__)

POSE_WORK, REGISTERED = "poses", "registered"  # in the work folder: COLMAP's work, and the model of it
_MAX_NAMED = 5  # files
_ESTIMATE = Setting(name="capture.poses", value='"estimate"')
_USE = Setting(name="capture.uncertain_poses", value='"use"')
_ABOUT_DEPTH_MAPS = ("views-without-depth-map", "depth-maps-without-photograph")  # which are not used


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedCapture:
    """A capture whose poses are known by now."""

    capture: Capture  # its depth maps left out
    registered: Registered | None  # None where the poses were given
    frame: FrameFacts  # where up is in the files' coordinates, and how long a unit
    remarks: tuple[Remark, ...]

    def frame_rows(self) -> list[Row]:
        """Up and unit as lines of a table, with what they are from and how sure they are."""
        frame, settings = self.frame, self.capture.settings
        vector = ", ".join(f"{number:.4f}" for number in frame.up)
        up = Row(name="up", value=settings.up_axis if settings.up_vector is None else f"({vector})")
        up = replace(up, remark=f"by {frame.up_from}, to {math.degrees(frame.up_error_rad):.1f}°")
        error = "" if frame.scale_error is None else f", to {100 * frame.scale_error:.1f} %"
        unit = Row(name="unit", value=f"{frame.metres_per_unit:.6g} m", remark=f"by {frame.scale_from}{error}")
        return [up, unit]


def poses_are_given(given: GivenPhotographs, record: Record, wanted: PosesChoice) -> bool:
    """Whether the poses of the input are used; else they are estimated.

    Poses that an earlier run estimated into the same capture are not given: it finds them again in the work folder.

    Raises:
        CaptureError: Poses that are wanted are not there, or are damaged; or they would have to be replaced.
    """
    cameras = given.source / CAMERAS
    there = given.is_capture and cameras.is_dir() and any(cameras.iterdir())
    ours = there and given.in_place and record.made_cameras(given.folder)
    if wanted == "known" and not there:
        raise CaptureError(
            f"{given.source} has no {CAMERAS}/ with known poses; put a COLMAP model there (cameras.txt and images.txt, "
            f"or cameras.bin and images.bin), or let them be estimated",
            ("set ", _ESTIMATE, " for that"),
        )
    if wanted == "estimate":
        if there and given.in_place and not ours:
            raise CaptureError(
                f"{cameras} holds poses that were given and are never replaced",
                ("name another capture for estimated ones with ", Argument(name="output")),
            )
        return False
    if not there or (ours and wanted == "auto"):
        return False
    find_camera_model(cameras)
    return True


def check_world(settings: WorldSettings, *, given: bool) -> None:
    """Raises CaptureError for a scale or direction that poses which are given cannot take."""
    stated = (settings.known_distance, settings.scale_bar, settings.up_vector)
    if given and (any(value is not None for value in stated) or settings.up != "auto" or settings.times != 1):
        raise CaptureError(
            "the given poses keep their frame and unit",
            f"state what these are in {FILE_NAME} (up_axis, "
            "metres_per_unit), and leave the settings of capture.world as they are",
        )


def read_posed(folder: Path, views: str | None) -> PosedCapture:
    """A capture with the poses that are given, and up and unit as capture.toml states them or as they are found.

    Raises:
        CaptureError: As read_upright_capture.
    """
    upright = read_upright_capture(folder, views=views)
    capture = without_depth(upright.capture)
    remarks = tuple(each for each in capture.remarks if each.code not in _ABOUT_DEPTH_MAPS)
    return PosedCapture(capture=capture, registered=None, frame=upright.frame, remarks=remarks)


def estimate_poses(
    folder: Path,
    views: str | None,
    settings: CaptureRunSettings,
    *,
    threads: int = 0,
    progress: StepProgress | None = None,
) -> PosedCapture:
    """Estimate the poses of a capture's photographs, as far as an earlier run has not, and keep them as its work.

    Args:
        folder: The capture, with its photographs.
        views: Which of them, as parse_views takes it; None for all.
        settings: How.
        threads: 0: one per core.
        progress: Called with the steps.

    Raises:
        CaptureError: The photographs give no poses, or probably wrong ones; or a hint at scale or up is wrong.
    """
    images = folder / IMAGES
    stated, toml_remarks = read_capture_settings(folder)
    photo_settings = PhotoSetSettings(threads=threads)
    names, _ = list_pictures(files_below(images))  # find_photographs has remarks on other files
    if views is not None:
        every = read_photo_set(images, names, photo_settings)
        listed = [photo.name for photo in every.photos]
        names = [listed[place] for place in parse_views(views, listed)]
    photo_set = read_photo_set(images, names, photo_settings, progress_in_step("photographs", progress))
    how: PoseEstimationSettings = replace(settings.pose_estimation, threads=threads)
    try:
        registered = register_photos(photo_set, folder / WORK / POSE_WORK, how, progress)
    except CaptureError as error:
        left_out = "; ".join(f"{item.name} is left out: {item.reason}" for item in photo_set.dropped[:_MAX_NAMED])
        more = len(photo_set.dropped) - _MAX_NAMED
        which = f"{left_out}; and {more} more" if more > 0 else left_out
        raise CaptureError(f"{error.text} ({which})" if which else error.text, error.remedy) from error
    reasons = warnings_of(registered.remarks)
    if reasons and settings.uncertain_poses == "stop":
        raise CaptureError(
            f"the cameras that were found for {images} are probably wrong, and nothing is made of them: "
            f"{'; '.join(each.text for each in reasons)}",
            (*(part for each in reasons if each.remedy for part in (*each.remedy, "; ")), _USE, " goes on with them"),
        )
    world = _with_hints(settings.world, folder)
    if world.up_vector is not None:  # stated in the axes that are written
        x, y, z = np.linalg.solve(stated_from_metric(stated)[:3, :3], world.up_vector)
        world = replace(world, up_vector=(float(x), float(y), float(z)))
    frame = level_and_scale(registered, photo_set.photos, world)
    if not stated.knows_up:
        stated = replace(stated, up_axis="Y")
    registered = move_registered(registered, stated_from_metric(stated) @ frame.world_from_registered)
    model = folder / WORK / REGISTERED
    write_colmap_model(model, registered)
    capture = without_depth(read_capture(folder, cameras=f"{WORK}/{REGISTERED}"))
    improbable = "the estimated poses are probably wrong, and so will be all that follows from them"
    found = f"poses are estimated: up by {frame.up_from}, scale by {frame.scale_from}"
    remarks = (
        *([remark("poses-improbable", improbable)] if reasons else []),
        *toml_remarks,
        *photo_set.remarks,
        *registered.remarks,
        remark("poses-estimated", found),
        *frame.remarks,
    )
    x, y, z = (float(number) for number in stated.up)
    facts = FrameFacts(
        up=(x, y, z),
        up_from=frame.up_from,
        up_error_rad=frame.up_error_rad,
        metres_per_unit=stated.metres_per_unit,
        scale_from=frame.scale_from,
        scale_error=None,
    )
    capture = replace(capture, settings=stated)
    return PosedCapture(capture=capture, registered=registered, frame=facts, remarks=remarks)


def stated_from_metric(stated: CaptureSettings) -> NDArray[np.float64]:
    """(4, 4) for column vectors: from a world in metres, Y up, to the axes and unit that capture.toml states."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn_to_y_up(stated.up).T
    matrix[:3] /= stated.metres_per_unit
    return matrix


def failures_of(posed: PosedCapture, dropped: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Why photographs have no camera, or cannot be used, by name."""
    reasons = dict(dropped)
    if posed.registered is not None:
        reasons.update({failure.name: failure.reason for failure in posed.registered.failures})
    return reasons


def observation_errors_px(posed: PosedCapture) -> NDArray[np.float64] | None:
    """(M,), reprojection error of the point of each observation; None where poses were given."""
    if posed.registered is None:
        return None
    return np.repeat(posed.registered.error_px, np.diff(posed.registered.track_starts))


def _with_hints(settings: WorldSettings, folder: Path) -> WorldSettings:
    """Hints of the settings go before those of capture.toml."""
    if settings.known_distance is not None or settings.scale_bar is not None:
        return settings
    distance, bar = read_scale_hints(read_capture_tables(folder), str(folder / FILE_NAME))
    try:
        return replace(settings, known_distance=distance, scale_bar=bar)
    except ValueError as error:
        raise CaptureError(f"{folder / FILE_NAME}: {error}") from error
