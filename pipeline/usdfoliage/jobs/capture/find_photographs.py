"""The photographs of a run: found where the user named them, before anything is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.capture.folder.listing import (
    IMAGES,
    PHOTO_KINDS,
    VIDEOS,
    counted,
    files_below,
    is_picture,
    is_video,
    list_pictures,
    named,
)
from usdfoliage.capture.folder.photo_set import explain_video, remark_other_files
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture.video_frames import VideoFrames
from usdfoliage.jobs.work.results import WORK
from usdfoliage.remarks import Argument, Remark, remark


@dataclass(frozen=True, kw_only=True)
class GivenPhotographs:
    """What a run starts from."""

    source: Path  # as the user named it
    photos: Mapping[str, Path]  # by their names below images/
    images: Path  # the folder that they are in or below
    folder: Path  # the capture that is filled
    is_capture: bool  # whether source is a capture, else it is a folder of photographs or a video
    remarks: tuple[Remark, ...]  # on files that are no photographs and are not used

    @property
    def in_place(self) -> bool:
        """Whether the capture is the very folder that was given."""
        return self.is_capture and is_same_file(self.source, self.folder)

    @property
    def work(self) -> Path:
        return self.folder / WORK


def require_there(source: Path) -> None:
    """Raise a CaptureError where a source is no folder that exists."""
    if not source.is_dir():
        raise CaptureError(
            f"{source} does not exist", f"give a folder of photographs, a video, or a capture with {IMAGES}/"
        )


def find_photographs(source: Path, output: Path | None, frames: VideoFrames | None = None) -> GivenPhotographs:
    """What a user means by an input and an output; nothing is written.

    Args:
        source: A capture, with a folder images, or a folder of photographs; or a video, or a capture with one.
        output: The capture to fill; None where that is the input.
        frames: Of that video.

    Raises:
        CaptureError: There are no two photographs, or nowhere to put what is made of them.
    """
    if frames is not None:
        return _as_photographs(source, check_video_output(source, output), frames)
    if source.is_file():
        raise CaptureError(f"{source} is one file", "give the folder of at least two photographs, or a capture")
    require_there(source)
    is_capture = (source / IMAGES).is_dir()
    images = source / IMAGES if is_capture else source
    below = files_below(images) if is_capture else _files_in(images)
    pictures, doubles = list_pictures(below)
    photos = {name: below[name] for name in pictures}
    if len(photos) < 2:
        raise CaptureError(*_too_few(images, photos, list(below)))
    if output is None:
        if not is_capture:
            raise CaptureError(
                f"{source} is a folder of photographs",
                (
                    "name the capture to be made of it, as in ",
                    Argument(name="output", value=f"{source.resolve().name}_capture"),
                ),
            )
        output = source
    if output.exists() and not output.is_dir():
        raise CaptureError(f"{output} is a file", "name a folder for the capture")
    if not is_capture and is_same_file(source, output):
        raise CaptureError(
            f"{output} holds the photographs themselves",
            ("name another folder for the capture with ", Argument(name="output")),
        )
    return GivenPhotographs(
        source=source,
        photos=photos,
        images=images,
        folder=output,
        is_capture=is_capture,
        remarks=_remark_unused(images, doubles, list(below), is_capture),
    )


def check_video_output(source: Path, output: Path | None) -> Path:
    """The capture that the frames of a video are to be put into.

    Raises:
        CaptureError: None is named, or it is a file or the folder of the video.
    """
    if output is None or is_same_file(source, output):
        raise CaptureError(
            f"{source} {'has' if source.is_dir() else 'is'} a video",
            (
                "name the capture to be made of it, as in ",
                Argument(name="output", value=f"{source.resolve().stem}_capture"),
            ),
        )
    if output.exists() and not output.is_dir():
        raise CaptureError(f"{output} is a file", "name a folder for the capture")
    return output


def _as_photographs(source: Path, output: Path, frames: VideoFrames) -> GivenPhotographs:
    return GivenPhotographs(
        source=source,
        photos=frames.photos,
        images=frames.folder,
        folder=output,
        is_capture=source.is_dir(),
        remarks=frames.remarks,
    )


def _files_in(folder: Path) -> dict[str, Path]:
    try:
        return {path.name: path for path in sorted(folder.iterdir()) if path.is_file() and path.name[0] != "."}
    except OSError as error:
        raise CaptureError(f"{folder} cannot be read: {error.strerror}", "check its permissions") from error


def _remark_unused(images: Path, doubles: Sequence[str], every: Sequence[str], is_capture: bool) -> tuple[Remark, ...]:
    """Remarks on files beside the photographs."""
    videos = [name for name in every if is_video(name)]
    beside = images.parent / VIDEOS if is_capture else None
    if beside is not None and beside.is_dir():
        videos += [f"../{VIDEOS}/{path.name}" for path in sorted(beside.iterdir()) if is_video(path.name)]
    remarks = remark_other_files(videos, doubles)
    others = [name for name in every if not is_picture(name) and not is_video(name)]
    if others:
        text = f"{named(others)} not used: no photographs"
        remarks.append(remark("other-files-not-used", text, subject=named(others)))
    deeper = [] if is_capture else _pictures_deeper(images)
    if deeper:
        folders = sorted({path.parent.name for path in deeper})
        text = f"{counted(len(deeper), 'photograph')} in folders below ({named(folders)}) not used"
        remedy = "put what belongs together into one"
        remarks.append(remark("photographs-in-folders-below", text, subject=named(folders), remedy=remedy))
    return tuple(remarks)


def _pictures_deeper(images: Path) -> list[Path]:
    return [path for path in images.glob("*/*") if is_picture(path.name) and path.parent.name != WORK.split("/")[0]]


def _too_few(images: Path, photos: Mapping[str, Path], others: Sequence[str]) -> tuple[str, str]:
    """What is wrong, and what to do."""
    videos = [name for name in others if is_video(name)]
    if videos:
        count = counted(len(photos), "photograph") if photos else "no photographs"
        return f"{images} has {count} and a video, {videos[0]}", explain_video(str(images / videos[0]))
    if photos:
        text = f"{images} has one photograph, {named(list(photos))}"
        return text, "a cloud takes two at least, from different places"
    deeper = sorted({path.parent.name for path in _pictures_deeper(images)})
    hint = f"; there are some in {named(deeper)}, name that folder" if deeper else ""
    there = f", only {named(list(others))}" if others else ""
    return f"{images} has no photographs{there}", f"put them there as {PHOTO_KINDS}{hint}"


def is_same_file(first: Path, second: Path) -> bool:
    """Whether both paths lead to one file or folder that is there."""
    try:
        return first.samefile(second)
    except OSError:
        return False
