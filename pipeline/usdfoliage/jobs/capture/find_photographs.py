"""The photographs of a run: found where the user named them, before anything is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.capture.folder.listing import IMAGES, counted, files_below, is_picture, named
from usdfoliage.capture.folder.photo_set import RAW, explain_video, is_video, remark_other_files
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.work.results import WORK
from usdfoliage.remarks import Argument, Remark, remark


@dataclass(frozen=True, kw_only=True)
class GivenPhotographs:
    """What a run starts from."""

    source: Path  # as the user named it
    photos: Mapping[str, Path]  # by their names below images/
    folder: Path  # the capture that is filled
    is_capture: bool  # whether source is a capture, else it is a folder of photographs
    remarks: tuple[Remark, ...]  # on files that are no photographs and are not used

    @property
    def in_place(self) -> bool:
        """Whether the capture is the very folder that was given."""
        return self.is_capture and is_same_file(self.source, self.folder)

    @property
    def work(self) -> Path:
        return self.folder / WORK


def find_photographs(source: Path, output: Path | None) -> GivenPhotographs:
    """What a user means by an input and an output; nothing is written.

    Args:
        source: A capture, with a folder images, or a folder of photographs.
        output: The capture to fill; None where that is the input.

    Raises:
        CaptureError: There are no two photographs, or nowhere to put what is made of them.
    """
    if is_video(source.name) and not source.is_dir():
        raise CaptureError(f"{source} is a video", explain_video(str(source)))
    if source.is_file():
        raise CaptureError(f"{source} is one file", "give the folder of at least two photographs, or a capture")
    if not source.is_dir():
        raise CaptureError(f"{source} does not exist", f"give a folder of photographs, or a capture with {IMAGES}/")
    is_capture = (source / IMAGES).is_dir()
    images = source / IMAGES if is_capture else source
    below = files_below(images) if is_capture else _files_in(images)
    photos = {name: path for name, path in below.items() if is_picture(name)}
    if len(photos) < 2:
        raise CaptureError(_too_few(images, photos, list(below)))
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
        folder=output,
        is_capture=is_capture,
        remarks=_remark_unused(images, photos, list(below), is_capture),
    )


def _files_in(folder: Path) -> dict[str, Path]:
    try:
        return {path.name: path for path in sorted(folder.iterdir()) if path.is_file() and path.name[0] != "."}
    except OSError as error:
        raise CaptureError(f"{folder} cannot be read: {error.strerror}", "check its permissions") from error


def _remark_unused(
    images: Path, photos: Mapping[str, Path], every: Sequence[str], is_capture: bool
) -> tuple[Remark, ...]:
    """Remarks on files beside the photographs."""
    videos = [name for name in every if is_video(name)]
    raws = [name for name in every if name not in photos and Path(name).suffix.lower() in RAW]
    remarks = remark_other_files(videos, raws)
    others = [name for name in every if name not in photos and name not in videos and name not in raws]
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


def _too_few(images: Path, photos: Mapping[str, Path], others: Sequence[str]) -> str:
    videos = [name for name in others if is_video(name)]
    if videos:
        return f"{images} has {counted(len(photos), 'photograph')} and a video; {explain_video(videos[0])}"
    if photos:
        return f"{images} has one photograph, {named(list(photos))}; a cloud takes two at least, from different places"
    deeper = sorted({path.parent.name for path in _pictures_deeper(images)})
    hint = f"; there are some in {named(deeper)}, name that folder" if deeper else ""
    there = f", only {named(list(others))}" if others else ""
    return f"{images} has no photographs{there}; put them there as JPEG, PNG, TIFF or EXR{hint}"


def is_same_file(first: Path, second: Path) -> bool:
    """Whether both paths lead to one file or folder that is there."""
    try:
        return first.samefile(second)
    except OSError:
        return False
