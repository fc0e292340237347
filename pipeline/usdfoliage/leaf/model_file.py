"""Leaves that were found in photographs, in a file that one stage hands on to another.

Numbers of leaves are kept as float32, as an asset keeps them: leaves that are read from here are those that one would
read from an asset of the same leaves.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.files.npz import read_arrays, reading_model, write_model
from usdfoliage.leaf.model import Leaves, unit_quaternions

_NUMBERS = ("parameters", "base_m", "length_m", "phase")
_WHOLE = ("view", "origin")  # whole numbers
_FACTS = ("color", "confidence", "residual_m", *_WHOLE)  # which may be unknown
_COLORS = ("plain_color", "texture_color")

Color = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class LeavesModel:
    """The leaves of a capture, and what they have in common."""

    leaves: Leaves  # in their own frame: metres, Y up, the lowest point on the ground
    asset_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the capture's coordinates to that frame
    plain_color: Color | None = None  # linear Rec.709, the median; None where no leaf has a colour
    texture_color: Color | None = None  # likewise, the mean of the average leaf's picture; None without a picture
    certainty: NDArray[np.float64] | None = None  # (N,), 0.5 to 1, the probability that the base is the base


def write_leaves_model(path: Path, model: LeavesModel) -> None:
    """Write leaves to a .npz file, which appears whole; the same bytes for the same leaves.

    Raises:
        WriteError: It cannot be written.
    """
    leaves = model.leaves
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(getattr(leaves, name), np.float32) for name in _NUMBERS}
    arrays["orientation"] = unit_quaternions(leaves.orientation).astype(np.float32)
    for name in _FACTS:
        fact = getattr(leaves, name)
        if fact is not None:
            arrays[name] = np.asarray(fact, np.int32 if name in _WHOLE else np.float32)
    for name in _COLORS:
        color = getattr(model, name)
        if color is not None:
            arrays[name] = np.asarray(color, np.float32)
    if model.certainty is not None:
        arrays["certainty"] = np.asarray(model.certainty, np.float32)
    arrays["asset_from_capture"] = np.asarray(model.asset_from_capture, np.float64)
    write_model(path, arrays)


def read_leaves_model(path: Path) -> LeavesModel:
    """The leaves that write_leaves_model wrote, as float64.

    Raises:
        CaptureError: The file is missing or damaged.
    """
    with reading_model(path, "leaves"):
        arrays = read_arrays(path)
        named = [*_NUMBERS, "orientation", *(name for name in _FACTS if name in arrays)]
        numbers: dict[str, Any] = {
            name: arrays[name] if name in _WHOLE else arrays[name].astype(np.float64) for name in named
        }
        leaves = Leaves(**numbers)
        matrix = arrays["asset_from_capture"]
        if matrix.shape != (4, 4):
            raise ValueError(f"asset_from_capture must be (4, 4), not {matrix.shape}")
        colors = {name: _read_color(arrays[name]) for name in _COLORS if name in arrays}
        certainty = arrays["certainty"].astype(np.float64) if "certainty" in arrays else None
        if certainty is not None and certainty.shape != (len(leaves),):
            raise ValueError(f"certainty must be ({len(leaves)},), not {certainty.shape}")
    return LeavesModel(leaves=leaves, asset_from_capture=matrix, certainty=certainty, **colors)


def _read_color(color: NDArray[Any]) -> Color:
    if color.shape != (3,):
        raise ValueError(f"a colour must be three numbers, not {color.shape}")
    red, green, blue = map(float, color)
    return red, green, blue
