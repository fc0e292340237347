"""Cameras and points that were found in photographs, and what pairs of photographs have in common."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.remarks import Remark

_PANORAMIC = (5, 6)  # COLMAP's configurations PANORAMIC and PLANAR_OR_PANORAMIC
_CONFIGURED = (2, 3, 4, 5, 6)  # those that a motion or a plane explains


@dataclass(frozen=True, kw_only=True, eq=False)
class RegisteredPhoto:
    """A photograph whose camera is known."""

    name: str
    lens: Lens  # at the photograph's full size
    cam_from_world: NDArray[np.float64]  # (3, 4), in units of the reconstruction
    error_px: float  # mean distance of its features from where the points are seen, at full size
    points: int  # that it sees


@dataclass(frozen=True, kw_only=True)
class Unregistered:
    """A photograph whose camera is not known."""

    name: str
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Registered:
    """Cameras of photographs, and points. Unit, place and turn of their world are arbitrary."""

    photos: tuple[RegisteredPhoto, ...]  # by name
    points: NDArray[np.float64]  # (N, 3)
    srgb: NDArray[np.uint8]  # (N, 3)
    error_px: NDArray[np.float64]  # (N,), mean over the photographs that see the point, at full size
    track_starts: NDArray[np.int64]  # (N + 1,): point k is seen at places track_starts[k] to track_starts[k + 1]
    track_photos: NDArray[np.int64]  # (T,), numbers in photos
    track_places_px: NDArray[np.float64]  # (T, 2), x and y at full size
    names: tuple[str, ...]  # of all photographs, by name
    matches: NDArray[np.int64]  # (P, P), features of all photographs that one motion explains; symmetric
    failures: tuple[Unregistered, ...]  # by name
    remarks: tuple[Remark, ...]  # a warning among them: the cameras are probably wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class PairMatches:
    """What is known of all pairs."""

    verified: NDArray[np.int64]  # (P, P), symmetric
    similar: NDArray[np.int64]  # (P, P), how many descriptors match, of the pairs that were compared
    panoramic: NDArray[np.bool_]  # (P, P), what is verified shows a turn, not a move

    @classmethod
    def gather(cls, count: int, files: Sequence[Path]) -> "PairMatches":
        verified = np.zeros((count, count), np.int64)
        similar = np.zeros((count, count), np.int64)
        panoramic = np.zeros((count, count), np.bool_)
        for file in files:
            with np.load(file, allow_pickle=False) as arrays:
                first, seconds = int(arrays["first"]), arrays["seconds"]
                good = np.isin(arrays["configs"], _CONFIGURED)
                verified[first, seconds] = np.where(good, arrays["counts"], 0)
                similar[first, seconds] = arrays["similar"]
                panoramic[first, seconds] = np.isin(arrays["configs"], _PANORAMIC)
        return cls(verified=verified + verified.T, similar=similar + similar.T, panoramic=panoramic | panoramic.T)


def project_with(lens: Lens, cam_from_world: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 2), x and y where a lens with its distortion shows points (N, 3) of the world; those behind it anywhere."""
    if not len(points):
        return np.zeros((0, 2))
    matrix = np.array([[lens.focal_px[0], 0, lens.center_px[0]], [0, lens.focal_px[1], lens.center_px[1]], [0, 0, 1.0]])
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(cam_from_world[:, :3]))
    model = LENS_MODELS[lens.model]
    coefficients = np.zeros(4 if model.distortion <= 4 else 8)
    coefficients[: len(lens.distortion)] = lens.distortion
    project = cv2.fisheye.projectPoints if model.fisheye else cv2.projectPoints
    places, _ = project(
        np.ascontiguousarray(points, np.float64).reshape(-1, 1, 3), turn, cam_from_world[:, 3].copy(), matrix,
        coefficients,
    )  # fmt: skip
    return np.asarray(places, np.float64).reshape(-1, 2)
