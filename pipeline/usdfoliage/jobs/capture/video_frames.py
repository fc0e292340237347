"""The frames of a video that a run is given in place of photographs, kept as work under the hash of video and settings.

They appear whole or not at all, and another run with the same video and settings takes those that are there.
"""

import json
import logging
import os
import shutil
import uuid
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from usdfoliage.capture.folder.listing import IMAGES, VIDEOS, counted, is_video, named
from usdfoliage.capture.video.frames import TakenFrames, take_frames
from usdfoliage.capture.video.settings import VideoSettings
from usdfoliage.errors import CaptureError
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.json import read_json
from usdfoliage.files.unwritten import describe_unwritten
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark, Setting, remark

logger = logging.getLogger(__name__)

FACTS = "frames.json"  # beside the frames: what was taken


@dataclass(frozen=True, kw_only=True)
class VideoFrames:
    """Photographs that were taken out of a video."""

    video: Path
    folder: Path
    photos: Mapping[str, Path]  # by name, in the order of time
    remarks: tuple[Remark, ...]


def find_video(source: Path) -> Path | None:
    """The video that a source is, or that it has in videos/ in place of images/; None where it is no such source.

    Raises:
        CaptureError: There are several videos, or none, in videos/.
    """
    if not source.is_dir():
        return source if is_video(source.name) and source.is_file() else None
    folder = source / VIDEOS
    if (source / IMAGES).is_dir() or not folder.is_dir():
        return None
    try:
        videos = sorted(path for path in folder.iterdir() if is_video(path.name) and path.name[0] != ".")
    except OSError as error:
        raise CaptureError(f"{folder} cannot be read: {error.strerror}", "check its permissions") from error
    if len(videos) != 1:
        raise CaptureError(
            f"{folder} has {counted(len(videos), 'video')}: {named([path.name for path in videos])}",
            "put one video there, or photographs into images/",
        )
    return videos[0]


def lay_frames(
    video: Path,
    work: Path,
    settings: VideoSettings = VideoSettings(),
    *,
    digest: str = "",
    progress: Progress | None = None,
) -> VideoFrames:
    """Take the frames of a video, unless they are there already.

    Args:
        video: The file.
        work: The folder that has a folder for each video and settings.
        settings: Which frames.
        digest: SHA-256 of the file; it is computed where it is empty.
        progress: Called with frames read, and how many there are.

    Raises:
        CaptureError: As take_frames.
        WriteError: The work folder cannot be written.
    """
    try:
        digest = digest or digest_file(video)
    except OSError as error:
        raise CaptureError(f"{video} cannot be read: {error.strerror}", "check its permissions") from error
    folder = work / task_key("frames", digest, settings)
    taken = _read_taken(folder)
    if taken is None:
        new = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:12]}.new")
        try:
            taken = take_frames(video, new, settings, progress)
            (new / FACTS).write_text(json.dumps(asdict(taken)), encoding="utf-8")
            shutil.rmtree(folder, ignore_errors=True)  # what is there is damaged
            try:
                new.rename(folder)
            except OSError:
                if _read_taken(folder) is None:  # else another run was faster
                    raise
        except OSError as error:
            raise describe_unwritten(folder, error, goes_on=True) from error
        finally:
            shutil.rmtree(new, ignore_errors=True)
    else:
        with suppress(OSError):  # of another user, or read-only
            os.utime(folder / FACTS)  # when it was last used
    return VideoFrames(
        video=video,
        folder=folder,
        photos={name: folder / name for name in taken.names},
        remarks=_remark_taken(video, taken, settings),
    )


def _read_taken(folder: Path) -> TakenFrames | None:
    """What was taken, where all of it is there."""
    try:
        stored = read_json(folder / FACTS)
        taken = TakenFrames(**{**stored, "names": tuple(stored["names"])})
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, TypeError, KeyError) as error:
        logger.warning("%s is damaged (%s) and is made again", folder, error)
        return None
    return taken if all((folder / name).is_file() for name in taken.names) else None


def _remark_taken(video: Path, taken: TakenFrames, settings: VideoSettings) -> tuple[Remark, ...]:
    text = (
        f"{len(taken.names)} frames of {taken.seconds:.0f} s of {video.name} are used, "
        f"one for each {taken.stretch:.1%} of the picture that it moves by"
    )
    remarks = [remark("video-frames-taken", text, subject=video.name)]
    if taken.stretch > settings.min_motion:
        text = (
            f"{video.name} moves by more than {settings.max_frames} times {settings.min_motion:.1%} of the picture; "
            f"frames are {taken.stretch:.1%} apart"
        )
        remedy = ("cut the video, or raise ", Setting(name="capture.video.max_frames"))
        remarks.append(remark("video-frames-limited", text, subject=video.name, remedy=remedy))
    return tuple(remarks)
