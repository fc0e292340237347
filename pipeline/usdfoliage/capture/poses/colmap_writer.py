"""Cameras and points as a COLMAP model in text, for everything that reads one.

Source: COLMAP's documentation, "Output format"; src/colmap/scene/reconstruction_io_text.cc.
"""

import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.capture.lens import Lens
from usdfoliage.capture.poses.result import Registered
from usdfoliage.errors import CaptureError
from usdfoliage.files.atomic import flush_to_disk
from usdfoliage.files.unwritten import describe_unwritten

_FILES = ("cameras.txt", "points3D.txt", "images.txt")  # the last is what a model is known by


def write_colmap_model(folder: Path, registered: Registered) -> None:
    """Write cameras.txt, images.txt and points3D.txt; the same bytes for the same cameras.

    Numbers are written so that reading them gives the same ones. Of the features of a photograph those of points are
    there. A folder that is new appears with all three files or not at all; in one that is there each file is replaced
    whole, images.txt last.

    Args:
        folder: That of the model.
        registered: In any world.

    Raises:
        CaptureError: A photograph's name cannot be written in the format, or a file cannot be written; a folder that
            was there still has a model.
    """
    for photo in registered.photos:
        if photo.name != photo.name.strip() or len(photo.name.splitlines()) != 1:
            raise CaptureError(
                f"the name {photo.name!r} cannot be written into a COLMAP model", "rename the photograph"
            )
    numbers = _camera_numbers(registered)
    places = _places_in_photos(registered)
    texts = {
        "cameras.txt": _camera_lines(numbers),
        "points3D.txt": _point_lines(registered, places),
        "images.txt": _image_lines(registered, numbers, places),
    }
    new = folder.with_name(f".{folder.name}.{uuid.uuid4().hex[:12]}.usdfoliage-new")
    try:
        new.mkdir(parents=True)
        try:
            for name in _FILES:
                with (new / name).open("w", encoding="utf-8", newline="\n") as file:
                    file.writelines(line + "\n" for line in texts[name])
                flush_to_disk(new / name)
            if folder.exists():
                for name in _FILES:
                    (new / name).replace(folder / name)
            else:
                new.replace(folder)
        finally:
            shutil.rmtree(new, ignore_errors=True)
    except UnicodeEncodeError as error:
        raise CaptureError(
            f"a photograph's name is no Unicode and cannot be written into {folder}", "rename it"
        ) from error
    except OSError as error:
        raise describe_unwritten(folder, error) from error


def _camera_numbers(registered: Registered) -> dict[Lens, int]:
    numbers: dict[Lens, int] = {}
    for photo in registered.photos:
        numbers.setdefault(photo.lens, len(numbers) + 1)
    return numbers


def _places_in_photos(registered: Registered) -> NDArray[np.int64]:
    """(T,): which of its photograph's features each place of the tracks is."""
    order = np.argsort(registered.track_photos, kind="stable")
    counts = np.bincount(registered.track_photos, minlength=len(registered.photos))
    places = np.empty(len(order), np.int64)
    starts = np.repeat(np.cumsum(counts) - counts, counts)
    places[order] = np.arange(len(order)) - starts
    return places


def _camera_lines(numbers: dict[Lens, int]) -> Iterator[str]:
    yield "# Camera list with one line of data per camera:"
    yield "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"
    yield f"# Number of cameras: {len(numbers)}"
    for lens, number in numbers.items():
        yield f"{number} {lens.model} {lens.width_px} {lens.height_px} {_text(lens.parameters)}"


def _image_lines(registered: Registered, numbers: dict[Lens, int], places: NDArray[np.int64]) -> Iterator[str]:
    yield "# Image list with two lines of data per image:"
    yield "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
    yield "#   POINTS2D[] as (X, Y, POINT3D_ID)"
    yield f"# Number of images: {len(registered.photos)}"
    points = np.repeat(np.arange(len(registered.points)), np.diff(registered.track_starts)) + 1
    for number, photo in enumerate(registered.photos):
        x, y, z, w = Rotation.from_matrix(photo.cam_from_world[:, :3]).as_quat(canonical=True)
        pose = _text((w, x, y, z, *photo.cam_from_world[:, 3]))
        yield f"{number + 1} {pose} {numbers[photo.lens]} {photo.name}"
        here = np.flatnonzero(registered.track_photos == number)
        here = here[np.argsort(places[here])]
        yield " ".join(f"{_text(registered.track_places_px[place])} {points[place]}" for place in here)


def _point_lines(registered: Registered, places: NDArray[np.int64]) -> Iterator[str]:
    yield "# 3D point list with one line of data per point:"
    yield "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    yield f"# Number of points: {len(registered.points)}"
    for number, point in enumerate(registered.points):
        span = range(registered.track_starts[number], registered.track_starts[number + 1])
        track = " ".join(f"{registered.track_photos[place] + 1} {places[place]}" for place in span)
        red, green, blue = registered.srgb[number]
        yield f"{number + 1} {_text(point)} {red} {green} {blue} {_text([registered.error_px[number]])} {track}"


def _text(numbers: "tuple[float, ...] | list[float] | NDArray[np.float64]") -> str:
    return " ".join(repr(float(number)) for number in numbers)
