"""What a build starts from: the files of a capture, a point cloud, or one photograph and its strokes, and digests."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from usdfoliage.capture.cloud_files.read import CLOUD_SUFFIXES, check_cloud_file, is_cloud_input
from usdfoliage.capture.folder.listing import CAMERAS, IMAGES, MASKS, VIDEOS, files_below, is_picture
from usdfoliage.capture.folder.raster import read_image_spec
from usdfoliage.capture.folder.settings import FILE_NAME, read_capture_settings
from usdfoliage.capture.video.settings import VideoSettings
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.capture.find_photographs import find_photographs, require_there
from usdfoliage.jobs.capture.video_frames import VideoFrames, find_video, lay_frames
from usdfoliage.jobs.plant.input_digests import DigestBy, digest_inputs
from usdfoliage.jobs.plant.settings import LeafDepth
from usdfoliage.jobs.plant.store import Store
from usdfoliage.progress import Progress
from usdfoliage.remarks import Remark
from usdfoliage.sketch.strokes import find_strokes, read_strokes

DEPTH_FOLDER = "depth"
FRAMES = "views/frames"  # in the work folder: of videos


@dataclass(frozen=True, kw_only=True)
class BuildInputs:
    """The files that decide a plant."""

    source: Path  # the capture's folder, a cloud, or one photograph
    name: str
    photographs: Mapping[str, Path]  # by name; none for a cloud, and for one photograph
    has_cameras: bool
    has_depth: bool  # of its own
    files: Mapping[str, Path]  # by their names in the capture
    digests: tuple[tuple[str, str], ...]  # name and SHA-256 of each file
    megapixels: float  # of the first photograph
    frames: VideoFrames | None = None  # where the photographs are those of a video
    photo: Path | None = None  # the one photograph that a tree is made of
    strokes: Path | None = None  # over it; None: proposed
    trees: int = 1  # that the strokes are of
    remarks: tuple[Remark, ...] = ()

    @property
    def photograph_count(self) -> int:
        """How many photographs there are, of a capture or the one of a tree."""
        return len(self.photographs) + (self.photo is not None)


def find_inputs(
    source: Path,
    store: Store,
    depth: LeafDepth = "auto",
    digest_by: DigestBy = "bytes",
    *,
    video: VideoSettings = VideoSettings(),
    progress: Progress | None = None,
) -> BuildInputs:
    """The files of a capture that a build reads; the frames of a video are put into the work folder.

    Args:
        source: A capture, a folder of photographs, a video, a point cloud, or one photograph of a tree.
        store: Where digests are remembered.
        depth: Which depth leaves are fitted to.
        digest_by: bytes reads every file; memory trusts what is remembered of those whose size and time are the same;
            files does so too, and remembers nothing; names reads no others either: their digest is "". A video whose
            digest is unknown is always read: the tasks depend on its frames.
        video: Which frames of a video are taken.
        progress: Called while frames are taken, with those that were read, and how many there are.

    Raises:
        CaptureError: There is nothing to build from, or a file cannot be read, or has a name that cannot be recorded.
    """
    try:
        is_file = source.is_file()
    except OSError as error:  # such a name cannot be
        raise CaptureError(f"{str(source)[:80]}… cannot be read: {error.strerror}", "name a capture") from error
    if not is_file and source.suffix.lower() not in CLOUD_SUFFIXES and not source.exists():
        require_there(source)
    if is_cloud_input(source):
        check_cloud_file(source)
    given_video = find_video(source)
    if is_file and given_video is None:
        if is_picture(source.name):
            return _find_photograph(source, store, digest_by)
        if not is_cloud_input(source):
            raise CaptureError(
                f"{source} is neither a folder nor a photograph nor a video nor a point cloud "
                f"({', '.join(CLOUD_SUFFIXES)})",
                "name a folder of photographs",
            )
        files = {source.name: source}
        _require_names(files)
        return BuildInputs(
            source=source,
            name=source.stem,
            photographs={},
            has_cameras=False,
            has_depth=False,
            files=files,
            digests=digest_inputs(source, files, store, digest_by=digest_by),
            megapixels=0.0,
        )
    frames = None
    if given_video is None:
        given = find_photographs(source, source.parent / f".{source.name}.none")
        files = {f"{IMAGES}/{name}": path for name, path in given.photos.items()}
    else:
        files = {f"{VIDEOS}/{given_video.name}": given_video}
        _require_names(files)
        (name_and_digest,) = digest_inputs(
            source, files, store, digest_by="memory" if digest_by == "names" else digest_by, part=VIDEOS
        )
        places = store.folder / FRAMES
        frames = lay_frames(given_video, places, video, digest=name_and_digest[1], progress=progress)
        given = find_photographs(source, source.parent / f".{source.name}.none", frames)
    has_cameras = has_depth = False
    if given.is_capture:
        folders = [MASKS, CAMERAS]
        has_depth = depth != "estimated" and frames is None and bool(files_below(source / DEPTH_FOLDER))
        if depth == "given" and not has_depth:
            raise CaptureError(f"{source} has no {DEPTH_FOLDER}/", "set leaves.depth to estimated, or put maps there")
        for folder in [*folders, *([DEPTH_FOLDER] if has_depth else [])]:
            files.update({f"{folder}/{name}": path for name, path in files_below(source / folder).items()})
        has_cameras = any(name.startswith(f"{CAMERAS}/") for name in files)
        if (source / FILE_NAME).is_file():
            files[FILE_NAME] = source / FILE_NAME
        read_capture_settings(source)  # its errors are raised before anything runs
    _require_names(files)
    first = next(iter(given.photos.values()))
    return BuildInputs(
        source=source,
        name=source.resolve().stem if is_file else source.resolve().name,
        photographs=given.photos,
        has_cameras=has_cameras,
        has_depth=has_depth,
        files=files,
        digests=digest_inputs(source, files, store, digest_by=digest_by),
        megapixels=_megapixels(first),
        frames=frames,
        remarks=given.remarks,
    )


def _find_photograph(photo: Path, store: Store, digest_by: DigestBy) -> BuildInputs:
    """One photograph of a tree, and the strokes beside it."""
    strokes = find_strokes(photo)
    files = {path.name: path for path in (photo, strokes) if path is not None}
    _require_names(files)
    trees = 1 if strokes is None else len(read_strokes(strokes).trees)  # its errors are raised before anything runs
    return BuildInputs(
        source=photo,
        name=photo.stem,
        photographs={},
        has_cameras=False,
        has_depth=False,
        files=files,
        digests=digest_inputs(photo, files, store, digest_by=digest_by),
        megapixels=_megapixels(photo),
        photo=photo,
        strokes=strokes,
        trees=trees,
    )


def _require_names(files: Mapping[str, Path]) -> None:
    """An asset records the names of its inputs as others read them: with slashes, in Unicode.

    Raises:
        CaptureError: A file has another name.
    """
    for name, path in files.items():
        if "\\" in name:
            raise CaptureError(f"{path} has a backslash in its name, which is another folder elsewhere", "rename it")
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise CaptureError(f"{path} has a name that is not in UTF-8", "rename it") from error


def _megapixels(photo: Path) -> float:
    """Of a photograph, by its header; for one that has none, as cameras compress."""
    spec = read_image_spec(photo)
    if spec is None or not spec.width * spec.height:
        return max(photo.stat().st_size / 350_000, 0.1)
    return float(spec.width * spec.height / 1e6)
