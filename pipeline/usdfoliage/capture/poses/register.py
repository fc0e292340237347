"""Cameras and sparse points of photographs: features, matches, and a mapper, each in child processes that may fail.

COLMAP does the geometry; what it is given, and what of its results is reported, is decided here.
"""

import json
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import counted
from usdfoliage.capture.folder.photo_set import PhotoFile, PhotoSet, read_colors
from usdfoliage.capture.lens import Lens, scale_lens
from usdfoliage.capture.poses.child_process import run_items
from usdfoliage.capture.poses.diagnosis import check_cameras, describe_poses, list_failures
from usdfoliage.capture.poses.mapping import MatchedPhotos, Model, drop_unseeing, map_photos
from usdfoliage.capture.poses.pairs import all_pairs, neighbors_in_order, retrieve_pairs
from usdfoliage.capture.poses.refining import refine_cameras
from usdfoliage.capture.poses.result import PairMatches, RegisteredPhoto, project_with
from usdfoliage.capture.poses.result import Registered as Registered  # what callers get
from usdfoliage.capture.poses.settings import PoseEstimationSettings, name_of
from usdfoliage.errors import CaptureError
from usdfoliage.files.unwritten import describe_unwritten
from usdfoliage.progress import Progress, StepProgress, progress_in_step
from usdfoliage.remarks import Remark

logger = logging.getLogger(__name__)

_EXHAUSTIVE_UP_TO = 60  # photographs
_MIN_PARALLAX_DEG = 2.5  # median over points; COLMAP drops points below 1.5


def register_photos(
    photo_set: PhotoSet,
    work: Path,
    settings: PoseEstimationSettings = PoseEstimationSettings(),
    progress: StepProgress | None = None,
) -> Registered:
    """Find the cameras of photographs. What is finished stays in the work folder, and is not done again.

    Where they fall into groups without overlap, the largest is kept. EXIF orientation is ignored: cameras are for the
    pixels as stored, as read_view takes them. The same seed gives the same poses, bit for bit, on one machine.

    Args:
        photo_set: The photographs.
        work: A folder for features, matches and models; made where it is missing.
        settings: How.
        progress: Called with the steps "features", "pairs", "matches", "cameras" and "refining".

    Raises:
        CaptureError: Fewer than two photographs; no two of them overlap; the camera did not move; the work folder
            cannot be written.
    """
    photos = photo_set.photos
    if len(photos) < 2:
        raise CaptureError(
            f"{photo_set.folder} has {counted(len(photos), 'photograph')} that can be used; two at least are needed "
            f"to find cameras, and twenty around the plant to reconstruct it"
        )
    try:
        work.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise describe_unwritten(work, error, goes_on=True) from error
    processes = settings.threads or os.cpu_count() or 1

    features, failed = _find_features(photos, work, settings, processes, progress_in_step("features", progress))
    usable = [index for index in range(len(photos)) if index not in failed]
    cameras = _cameras(photos, features, usable, settings)
    pairs = _choose_pairs(features, usable, work, settings, processes, progress_in_step("pairs", progress))
    match_files = _match(
        features, cameras, usable, pairs, work, settings, processes, progress_in_step("matches", progress)
    )
    found = PairMatches.gather(len(photos), match_files)
    matched = MatchedPhotos(
        photo_set=photo_set, features=tuple(features), cameras=cameras, usable=tuple(usable),
        match_files=tuple(match_files), pairs=found,
    )  # fmt: skip
    model, contradictions = map_photos(matched, work, settings, processes, progress_in_step("cameras", progress))
    used = model.get("pairs")
    seeing = drop_unseeing(model, settings.min_matches)
    if len(seeing["images"]) >= 2:  # of fewer, the checks report what is wrong
        model = seeing
    # Cameras that are probably wrong would only get more points that fit them.
    seen = _measure_photos(matched, model)
    if not _check(seen, settings):
        refined = refine_cameras(matched, model, work, settings, processes, progress_in_step("refining", progress))
        if refined is not model:
            seen_by_refined = _measure_photos(matched, refined)
            if not _check(seen_by_refined, settings):
                model, seen = refined, seen_by_refined
    _check_moved(photo_set, model)
    return _registered(matched, model, seen, failed, contradictions, settings, used)


def _find_features(
    photos: Sequence[PhotoFile],
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None,
) -> tuple[list[Path], dict[int, str]]:
    """The file of each photograph's features, and why some have none."""
    job = {
        "task": "features",
        "max_side_px": settings.max_side_px,
        "features": settings.features,
        "min_features": settings.min_features,
        "peak_threshold": settings.peak_threshold,
    }
    files = [work / f"features-{name_of(job, photo.digest)}.npz" for photo in photos]
    items = [{"photo": str(photo.path.resolve()), "out": str(file)} for photo, file in zip(photos, files, strict=True)]
    failures = run_items(job, items, work, processes, progress)
    return files, {failure.number: failure.reason for failure in failures}


def _sizes(files: Sequence[Path], usable: Sequence[int]) -> dict[int, tuple[int, int]]:
    sizes = {}
    for index in usable:
        with np.load(files[index], allow_pickle=False) as arrays:
            width, height = arrays["size"]
        sizes[index] = int(width), int(height)
    return sizes


def _cameras(
    photos: Sequence[PhotoFile], features: Sequence[Path], usable: Sequence[int], settings: PoseEstimationSettings
) -> dict[int, dict[str, Any]]:
    """What COLMAP is given of each photograph's camera, for the size that the features are of."""
    cameras: dict[int, dict[str, Any]] = {}
    groups: dict[tuple[Any, ...], int] = {}
    for index, (width_px, height_px) in _sizes(features, usable).items():
        photo = photos[index]
        reduced = width_px / photo.width_px
        focal_px = settings.focal_px or photo.focal_px
        kind: tuple[Any, ...]
        match settings.one_camera:
            case "yes":  # of several sizes nothing can be one camera
                kind = (width_px, height_px)
            case "no":
                kind = (index,)
            case _:
                kind = (photo.width_px, photo.height_px, photo.camera, None if focal_px is None else round(focal_px, 1))
        cameras[index] = {
            "model": settings.lens_model,
            "focal_px": focal_px * reduced if focal_px else 1.2 * max(width_px, height_px),  # as COLMAP guesses
            "width_px": width_px,
            "height_px": height_px,
            "known": focal_px is not None,
            "group": groups.setdefault(kind, len(groups)),
        }
    return cameras


def _choose_pairs(
    features: Sequence[Path],
    usable: Sequence[int],
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None,
) -> list[tuple[int, int]]:
    """Which photographs are compared in full, the smaller number first."""
    candidates = _candidates(features, usable, settings)
    if settings.matching == "exhaustive":
        return candidates
    job = {"task": "compare", "max_ratio": settings.max_ratio, "coarse_features": settings.coarse_features}
    items = _by_first(candidates, job, features, work, "likeness")
    request = {**job, "features": [str(file.resolve()) for file in features]}
    failures = run_items(request, items, work, processes, progress)
    lost = {failure.number for failure in failures}
    similar = np.full((len(features), len(features)), -1, np.int64)
    for number, item in enumerate(items):
        if number in lost:  # all of its pairs are looked at
            similar[item["first"], item["seconds"]] = settings.coarse_matches
            continue
        with np.load(item["out"], allow_pickle=False) as arrays:
            similar[int(arrays["first"]), arrays["seconds"]] = arrays["similar"]
    similar = np.maximum(similar, similar.T)
    nearest = np.argsort(-similar, axis=1, kind="stable")[:, : settings.neighbors]
    wanted = similar >= settings.coarse_matches
    for first in usable:
        wanted[first, nearest[first]] = True
    wanted |= wanted.T
    return [(first, second) for first, second in candidates if wanted[first, second]]


def _candidates(
    features: Sequence[Path], usable: Sequence[int], settings: PoseEstimationSettings
) -> list[tuple[int, int]]:
    """All pairs of a few photographs; of many those near in sequence, and those that look similar."""
    few = len(usable) <= _EXHAUSTIVE_UP_TO
    if settings.matching == "exhaustive" or (settings.matching == "auto" and few):
        places = set(all_pairs(len(usable)))
    else:
        places = set()
        if settings.matching in ("auto", "sequential"):
            places |= set(neighbors_in_order(len(usable), settings.sequence_overlap))
        if settings.matching in ("auto", "retrieval"):
            descriptors = []
            for index in usable:
                with np.load(features[index], allow_pickle=False) as arrays:
                    descriptors.append(arrays["descriptors"][: settings.coarse_features])
            rng = np.random.default_rng(settings.seed)
            places |= retrieve_pairs(descriptors, 4 * settings.neighbors, rng)
    return sorted((usable[first], usable[second]) for first, second in places)


def _by_first(
    pairs: Sequence[tuple[int, int]], job: dict[str, Any], made_from: Sequence[Any], work: Path, kind: str
) -> list[dict[str, Any]]:
    """An item for each photograph with all its later companions, and a file named by what it is made from."""
    seconds: dict[int, list[int]] = {}
    for first, second in pairs:
        seconds.setdefault(first, []).append(second)
    items = []
    for first, others in seconds.items():
        sources = [str(made_from[index]).rsplit("/", 1)[-1] for index in (first, *others)]
        name = f"{kind}-{name_of(job, first, others, sources)}.npz"
        items.append({"first": first, "seconds": others, "out": str(work / name)})
    return items


def _match(
    features: Sequence[Path],
    cameras: dict[int, dict[str, Any]],
    usable: Sequence[int],
    pairs: Sequence[tuple[int, int]],
    work: Path,
    settings: PoseEstimationSettings,
    processes: int,
    progress: Progress | None,
) -> list[Path]:
    """Files with the matches of each photograph with later ones."""
    job = {
        "task": "match",
        "max_ratio": settings.max_ratio,
        "seed": settings.seed,
    }
    made_from = [f"{json.dumps(cameras.get(index))} {file.name}" for index, file in enumerate(features)]
    items = _by_first(pairs, job, made_from, work, "matches")
    request = {
        **job,
        "features": [str(file.resolve()) for file in features],
        "cameras": [cameras.get(index) for index in range(len(features))],
    }
    # A photograph whose matching ends the process has no matches, and a warning reports it.
    failures = run_items(request, items, work, processes, progress)
    lost = {failure.number for failure in failures}
    for failure in failures:
        logger.warning("matches of photograph %d are lost: %s", items[failure.number]["first"], failure.reason)
    return [Path(str(item["out"])) for number, item in enumerate(items) if number not in lost]


def _check_moved(photo_set: PhotoSet, model: Model) -> None:
    """Raise where the cameras have no baseline: what little parallax there is then is that of errors."""
    poses = model["cam_from_world"]
    centers = np.zeros((len(photo_set.photos), 3))
    centers[model["images"]] = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
    starts, track = model["track_starts"], model["track"]
    if len(starts) < 2:
        return
    rays = np.repeat(model["points"], np.diff(starts), axis=0) - centers[track[:, 0]]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    widest = [np.min(own @ own.T) for own in np.split(rays, starts[1:-1])]  # cosine
    angle_deg = float(np.degrees(np.arccos(np.clip(np.median(widest), -1, 1))))
    if angle_deg < _MIN_PARALLAX_DEG:
        raise CaptureError(
            f"the camera only turned between the photographs in {photo_set.folder} and did not move, or hardly: points "
            f"are seen from directions {angle_deg:.1f}° apart, {_MIN_PARALLAX_DEG}° are needed",
            "walk around the plant",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _MeasuredPhotos:
    """What the photographs of a model see of its points."""

    photos: tuple[RegisteredPhoto, ...]
    track_photos: NDArray[np.int64]  # (T,), numbers in photos
    places_px: NDArray[np.float64]  # (T, 2), x and y at full size
    errors_px: NDArray[np.float64]  # (T,)
    point_of: NDArray[np.int64]  # (T,)


def _measure_photos(matched: MatchedPhotos, model: Model) -> _MeasuredPhotos:
    photos, features, cameras = matched.photo_set.photos, matched.features, matched.cameras
    images = model["images"]
    place_in = np.full(len(photos), -1, np.int64)
    place_in[images] = np.arange(len(images))
    track = model["track"]
    places_px = np.zeros((len(track), 2))
    scale = np.ones(len(photos))  # of the photograph over the picture that its features are of
    counts: dict[int, int] = {}
    lenses = []
    for place, index in enumerate(images):
        photo, camera = photos[index], cameras[index]
        scale[index] = photo.width_px / camera["width_px"]
        with np.load(features[index], allow_pickle=False) as arrays:
            keypoints = arrays["keypoints"]
        here = track[:, 0] == index
        both = np.array([photo.width_px / camera["width_px"], photo.height_px / camera["height_px"]])
        places_px[here] = keypoints[track[here, 1], :2] * both
        lens = Lens(
            model=camera["model"], width_px=camera["width_px"], height_px=camera["height_px"],
            parameters=tuple(float(value) for value in model["parameters"][place]),
        )  # fmt: skip
        lenses.append(scale_lens(lens, photo.width_px, photo.height_px))
    points = model["points"]
    point_of = np.repeat(np.arange(len(points)), np.diff(model["track_starts"]))
    errors = np.zeros(len(track))
    for place, index in enumerate(images):
        here = track[:, 0] == index
        seen = project_with(lenses[place], model["cam_from_world"][place], points[point_of[here]])
        errors[here] = np.linalg.norm(seen - places_px[here], axis=1)
        counts[place] = int(here.sum())
    own = [errors[track[:, 0] == index] for index in images]
    registered = tuple(
        RegisteredPhoto(
            name=photos[index].name,
            lens=lenses[place],
            cam_from_world=model["cam_from_world"][place],
            error_px=float(own[place].mean()) if len(own[place]) else float("nan"),
            points=counts[place],
        )
        for place, index in enumerate(images)
    )
    return _MeasuredPhotos(
        photos=registered,
        track_photos=place_in[track[:, 0]],
        places_px=places_px,
        errors_px=errors,
        point_of=point_of,
    )


def _check(seen: _MeasuredPhotos, settings: PoseEstimationSettings) -> tuple[Remark, ...]:
    """Warnings by which the cameras are probably wrong."""
    return check_cameras(seen.photos, seen.track_photos, seen.places_px, settings.min_matches)


def _registered(
    matched: MatchedPhotos,
    model: Model,
    seen: _MeasuredPhotos,
    failed: dict[int, str],
    contradictions: tuple[Remark, ...],
    settings: PoseEstimationSettings,
    used: NDArray[np.int64] | None,
) -> Registered:
    photo_set, found, images, points = matched.photo_set, matched.pairs, model["images"], model["points"]
    photos = photo_set.photos
    seen_by = np.maximum(np.diff(model["track_starts"]), 1)
    checks = _check(seen, settings)
    return Registered(
        photos=seen.photos,
        points=points,
        srgb=_colors(photos, images, len(points), seen.point_of, seen.track_photos, seen.places_px),
        error_px=np.bincount(seen.point_of, seen.errors_px, len(points)) / seen_by,
        track_starts=model["track_starts"],
        track_photos=seen.track_photos,
        track_places_px=seen.places_px,
        names=tuple(photo.name for photo in photos),
        matches=found.verified,
        failures=list_failures(photo_set, matched.features, model["group"], found, failed, settings.min_matches, used),
        remarks=(*checks, *contradictions, *describe_poses(photos, images, found, seen.photos, settings.min_matches)),
    )


def _colors(
    photos: Sequence[PhotoFile],
    images: NDArray[np.int64],
    count: int,
    point_of: NDArray[np.int64],
    track_photos: NDArray[np.int64],
    places_px: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """(N, 3), the mean of the pixels that show each point."""
    sums = np.zeros((count, 3))
    for place, index in enumerate(images):
        here = np.flatnonzero(track_photos == place)
        pixels = read_colors(photos[index].path)
        columns = np.clip(places_px[here, 0].astype(np.int64), 0, pixels.shape[1] - 1)
        rows = np.clip(places_px[here, 1].astype(np.int64), 0, pixels.shape[0] - 1)
        np.add.at(sums, point_of[here], pixels[rows, columns])
    seen_by = np.maximum(np.bincount(point_of, minlength=count), 1)
    return np.rint(sums / seen_by[:, None]).astype(np.uint8)
