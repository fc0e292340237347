"""What a run of photographs knows of one of them, for its report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnMaps:
    """A photograph and what was found of its pixels; all of one size, or of the camera's times one factor."""

    srgb: NDArray[np.uint8]  # (H, W, 3)
    depth_m: NDArray[np.floating]  # (H, W), 0 for none
    normals: NDArray[np.floating] | None = None  # (H, W, 3), in the world
    confidence: NDArray[np.floating] | None = None  # (H, W), 0 to 1
    mask: NDArray[np.bool_] | None = None  # (H, W), True on the plant


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturePhotograph:
    """What a run knows of one photograph."""

    name: str
    failure: str = ""  # why it has no camera, in a sentence; empty where it has one
    camera: Pinhole | None = None  # in the capture's world
    error_px: float | None = None  # mean reprojection error of its points; None where its pose was given
    points: int | None = None  # points of the cameras' model that it sees
    sources: Sequence[int] = ()  # photographs, by number, that it was matched with for its depth
    coverage: float | None = None  # share of its pixels, what is masked left out, that has depth
    remark: str = ""  # what is odd about it
    read_maps: Callable[[], DrawnMaps] | None = None  # called once, for those shown; nothing is kept
