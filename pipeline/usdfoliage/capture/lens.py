"""What a camera's lens and sensor do: COLMAP's camera models, and pictures without their distortion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.errors import CaptureError
from usdfoliage.geometry.pinhole import Pinhole

_MAX_SIDE_PX = 32766  # cv2.remap counts pixels in 16 bits
_MAX_CAMERA_PX = 10**6
_MAX_PARAMETER = 1e9
_FOCAL_SHARES = (0.01, 1e5)  # of the larger side: from 179° to half a second of arc a picture
_STRIDE = 8  # of pixels among which a lens's turning back is looked for
_MAX_STRETCHED = 4  # pixels between those where two neighbours of an undistorted picture come from
_PLACE_PX = 1e-3  # how well distortion must lead back to a place

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, kw_only=True)
class LensModel:
    """A camera model of COLMAP: what its parameters mean, in their order."""

    number: int  # in binary models
    focal_lengths: int  # 1: f, 2: fx, fy; cx, cy follow
    distortion: int  # how many numbers follow
    fisheye: bool = False  # they are of cv2.fisheye's polynomial in the angle, not of the plain one

    @property
    def parameters(self) -> int:
        return self.focal_lengths + 2 + self.distortion


# Source: COLMAP, src/colmap/sensor/models.h.
LENS_MODELS: Mapping[str, LensModel] = {
    "SIMPLE_PINHOLE": LensModel(number=0, focal_lengths=1, distortion=0),
    "PINHOLE": LensModel(number=1, focal_lengths=2, distortion=0),
    "SIMPLE_RADIAL": LensModel(number=2, focal_lengths=1, distortion=1),
    "RADIAL": LensModel(number=3, focal_lengths=1, distortion=2),
    "OPENCV": LensModel(number=4, focal_lengths=2, distortion=4),
    "OPENCV_FISHEYE": LensModel(number=5, focal_lengths=2, distortion=4, fisheye=True),
    "FULL_OPENCV": LensModel(number=6, focal_lengths=2, distortion=8),
    "SIMPLE_RADIAL_FISHEYE": LensModel(number=8, focal_lengths=1, distortion=1, fisheye=True),
    "RADIAL_FISHEYE": LensModel(number=9, focal_lengths=1, distortion=2, fisheye=True),
}


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A camera of a COLMAP model: its size in pixels and its parameters.

    The pixel in row i, column j has its centre at x = j + 0.5, y = i + 0.5.
    """

    model: str  # one of LENS_MODELS
    width_px: int
    height_px: int
    parameters: tuple[float, ...]  # in the model's order

    def __post_init__(self) -> None:
        if self.model not in LENS_MODELS:
            raise ValueError(f"the camera model {self.model} is not known; known are {', '.join(LENS_MODELS)}")
        if not (1 <= self.width_px <= _MAX_CAMERA_PX and 1 <= self.height_px <= _MAX_CAMERA_PX):
            raise ValueError(f"the sides must be 1 to {_MAX_CAMERA_PX} px, not {self.width_px}×{self.height_px}")
        needed = LENS_MODELS[self.model].parameters
        if len(self.parameters) != needed:
            raise ValueError(f"{self.model} has {needed} parameters, not {len(self.parameters)}")
        if not all(abs(number) <= _MAX_PARAMETER for number in self.parameters):
            raise ValueError(f"the parameters must be finite, not {', '.join(f'{x:g}' for x in self.parameters)}")
        shortest, longest = (share * max(self.width_px, self.height_px) for share in _FOCAL_SHARES)
        if not (shortest <= min(self.focal_px) and max(self.focal_px) <= longest):
            raise ValueError(
                f"the focal lengths must be in {shortest:g} to {longest:g} px for {self.width_px}×{self.height_px} px, "
                f"not {', '.join(f'{number:g}' for number in self.focal_px)}"
            )

    @property
    def focal_px(self) -> tuple[float, float]:
        count = LENS_MODELS[self.model].focal_lengths
        return self.parameters[0], self.parameters[count - 1]

    @property
    def center_px(self) -> tuple[float, float]:
        count = LENS_MODELS[self.model].focal_lengths
        return self.parameters[count], self.parameters[count + 1]

    @property
    def distortion(self) -> tuple[float, ...]:
        return self.parameters[LENS_MODELS[self.model].focal_lengths + 2 :]

    @property
    def is_pinhole(self) -> bool:
        """Whether its pictures are without distortion as they are. A fisheye never is: it has none at 0 of its own."""
        return not LENS_MODELS[self.model].fisheye and not any(self.distortion)

    def pinhole(self, cam_from_world: NDArray[np.float64]) -> Pinhole:
        """The same camera without distortion, posed: what undistorted pictures are of."""
        return Pinhole(
            width_px=self.width_px,
            height_px=self.height_px,
            focal_px=self.focal_px,
            center_px=self.center_px,
            cam_from_world=cam_from_world,
        )


def scale_lens(lens: Lens, width_px: int, height_px: int) -> Lens:
    """The lens of the same pictures, resized.

    The distortion is in units of the focal length and does not change. A model of one focal length keeps the mean of
    the two where rounding made the scales differ.

    Raises:
        ValueError: The size has other proportions, by more than the rounding of a side to whole pixels.
    """
    if abs(width_px * lens.height_px / lens.width_px - height_px) > 1 and (
        abs(height_px * lens.width_px / lens.height_px - width_px) > 1
    ):
        raise ValueError(f"{width_px}×{height_px} has other proportions than {lens.width_px}×{lens.height_px}")
    x, y = width_px / lens.width_px, height_px / lens.height_px
    focal = (lens.focal_px[0] * x, lens.focal_px[1] * y)
    if LENS_MODELS[lens.model].focal_lengths == 1:
        focal = (sum(focal) / 2,)  # type: ignore[assignment]
    center = (lens.center_px[0] * x, lens.center_px[1] * y)
    return replace(lens, width_px=width_px, height_px=height_px, parameters=(*focal, *center, *lens.distortion))


@dataclass(frozen=True, kw_only=True, eq=False)
class Undistortion:
    """Where each pixel of the undistorted picture comes from in the photograph; the two are of one size."""

    x: NDArray[np.float32]  # (H, W), column of the source, whole numbers at pixel centres; far outside for none
    y: NDArray[np.float32]  # (H, W), row

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(H, W), where the photograph shows anything."""
        height, width = self.x.shape
        return np.asarray((self.x > -0.5) & (self.x < width - 0.5) & (self.y > -0.5) & (self.y < height - 0.5))

    def smooth(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A photograph, (H, W, C), interpolated; black where there is nothing."""
        moved = cv2.remap(picture, self.x, self.y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        moved[~self.inside] = 0
        return np.asarray(moved, np.uint8)

    def nearest(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth, (H, W), of the nearest pixel: a mean over an edge would be a surface in mid air. 0 for nothing."""
        moved = cv2.remap(values, self.x, self.y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        return np.asarray(moved, np.float32)

    def distorted(self, values: NDArray[Value]) -> NDArray[Value]:
        """What was found in the undistorted picture, (H, W) or (H, W, C), on the photograph's pixels; 0 for nothing.

        Values are moved, never mixed. Each goes to the very pixel where nearest looks for it, so that nearest gives it
        back, but where several meet in one; pixels where none comes to have that of the nearest beside them.
        """
        taken = values.reshape(self.x.size, *values.shape[2:])[self._sources]
        taken[self._sources < 0] = 0
        return taken

    @cached_property
    def _sources(self) -> NDArray[np.int32]:
        """(H, W), the undistorted pixel that each pixel of the photograph is nearest to; -1 for none."""
        height, width = self.x.shape
        inside = np.flatnonzero(self.inside)
        x, y = self.x.ravel()[inside], self.y.ravel()[inside]
        column = np.clip(np.rint(x), 0, width - 1).astype(np.int32)  # rounds as cv2.remap does
        row = np.clip(np.rint(y), 0, height - 1).astype(np.int32)
        order = np.argsort(-np.hypot(x - column, y - row), kind="stable")  # the nearest one is written last
        sources = np.full((height, width), -1, np.int32)
        sources[row[order], column[order]] = inside[order]
        for _ in range(_MAX_STRETCHED):
            empty = sources < 0
            padded = np.pad(sources, 1, constant_values=-1)
            nearest = np.full((height, width), np.inf, np.float32)
            for down in range(3):
                for across in range(3):
                    beside = padded[down : down + height, across : across + width]
                    candidate = empty & (beside >= 0)
                    rows, columns = np.nonzero(candidate)
                    found = beside[candidate]
                    away = np.hypot(self.x.ravel()[found] - columns, self.y.ravel()[found] - rows)
                    better = away < nearest[candidate]
                    sources[rows[better], columns[better]] = found[better]
                    nearest[rows[better], columns[better]] = away[better]
        return sources


def undistort_places(lens: Lens, places_px: NDArray[np.floating]) -> NDArray[np.float64]:
    """Where places (N, 2) of a photograph, x and y, are in the picture without distortion; NaN where that has none."""
    focal, center = np.array(lens.focal_px), np.array(lens.center_px)
    if lens.is_pinhole or not len(places_px):
        return np.array(places_px, np.float64)
    matrix, coefficients = _cv2_lens(lens)
    distorted = np.ascontiguousarray(places_px, np.float64)[:, None] - 0.5
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    with np.errstate(all="ignore"):
        if LENS_MODELS[lens.model].fisheye:
            flat = cv2.fisheye.undistortPoints(distorted, matrix, coefficients, None, None, None, until)
            again = cv2.fisheye.distortPoints(flat, matrix, coefficients)
        else:
            flat = cv2.undistortPoints(distorted, matrix, coefficients, None, None, None, until)
            ahead = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=2)
            again, _ = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), matrix, coefficients)
        # The iteration ends somewhere for any place; it is right where distortion leads back.
        good = np.all(np.abs(again - distorted) < _PLACE_PX, axis=(1, 2))
    return np.where(good[:, None], flat[:, 0] * focal + center, np.nan)


def undistort(lens: Lens) -> Undistortion:
    """Prepare to take a lens's distortion out of its pictures, keeping size, focal length and principal point.

    Where the distortion's polynomial turns back, far off the axis, the picture has nothing.

    Raises:
        CaptureError: The picture is too large.
    """
    if max(lens.width_px, lens.height_px) > _MAX_SIDE_PX:
        raise CaptureError(
            f"pictures of {lens.width_px}×{lens.height_px} pixels cannot be undistorted; "
            f"at most {_MAX_SIDE_PX} a side: reduce them"
        )
    size = lens.width_px, lens.height_px
    matrix, coefficients = _cv2_lens(lens)
    with np.errstate(all="ignore"):
        if LENS_MODELS[lens.model].fisheye:
            x, y = cv2.fisheye.initUndistortRectifyMap(matrix, coefficients, np.eye(3), matrix, size, cv2.CV_32FC1)
        else:
            x, y = cv2.initUndistortRectifyMap(matrix, coefficients, np.eye(3), matrix, size, cv2.CV_32FC1)
        turned_back = ~np.isfinite(x) | ~np.isfinite(y)
        if _turns_back(x[::_STRIDE, ::_STRIDE], y[::_STRIDE, ::_STRIDE]).any():  # seldom, and costly to find out
            turned_back |= _turns_back(x, y)
    outside = np.float32(-2 * _MAX_SIDE_PX)
    limit = np.float32(2 * _MAX_SIDE_PX)
    return Undistortion(
        x=np.where(turned_back, outside, np.clip(x, outside, limit)).astype(np.float32),
        y=np.where(turned_back, outside, np.clip(y, outside, limit)).astype(np.float32),
    )


def _cv2_lens(lens: Lens) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The camera matrix (3, 3) and distortion (4,) or (8,) that cv2 takes."""
    matrix = np.array(
        [[lens.focal_px[0], 0, lens.center_px[0] - 0.5], [0, lens.focal_px[1], lens.center_px[1] - 0.5], [0, 0, 1]]
    )  # cv2 counts from the centre of the first pixel
    coefficients = np.zeros(4 if LENS_MODELS[lens.model].distortion <= 4 else 8)
    coefficients[: len(lens.distortion)] = lens.distortion
    return matrix, coefficients


def _turns_back(x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Where a map mirrors, (H, W)."""
    if min(x.shape) < 2:
        return np.zeros(x.shape, np.bool_)
    x_down, x_along = np.gradient(x)
    y_down, y_along = np.gradient(y)
    return np.asarray(~(x_along * y_down - x_down * y_along > 0))
