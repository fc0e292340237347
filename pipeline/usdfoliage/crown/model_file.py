"""A crown, in a file that one stage hands on to another."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.crown.model import CrownModel
from usdfoliage.files.npz import read_arrays, reading_model, write_model

_SHAPES = ("radius_m", "color", "center_m", "asset_from_photo")


@dataclass(frozen=True, kw_only=True, eq=False)
class MadeCrown:
    """A crown, and how well it stands for the plant."""

    model: CrownModel
    overlap: float  # of its silhouettes with those of the points, median IoU


def write_crown_model(path: Path, made: MadeCrown) -> None:
    """Write a crown to a .npz file, which appears whole; the same bytes for the same crown.

    Raises:
        WriteError: It cannot be written.
    """
    arrays = {name: np.asarray(getattr(made.model, name)) for name in _SHAPES}
    arrays |= {"relief_weight": np.array(made.model.relief_weight), "overlap": np.array(made.overlap)}
    write_model(path, arrays)


def read_crown_model(path: Path) -> MadeCrown:
    """The crown that write_crown_model wrote.

    Raises:
        CaptureError: The file is missing or damaged.
    """
    with reading_model(path, "crown"):
        arrays = read_arrays(path, (*_SHAPES, "relief_weight", "overlap"))
        texels = arrays["radius_m"].shape
        expected = {"radius_m": texels, "color": (*texels, 3), "center_m": (3,), "asset_from_photo": (4, 4)}
        wrong = [name for name, shape in expected.items() if arrays[name].shape != shape]
        if wrong or len(texels) != 3 or texels[0] != 6:
            raise ValueError(f"{', '.join(wrong) or 'radius_m'} has the shape of no crown")
        return MadeCrown(
            model=CrownModel(**{name: arrays[name] for name in _SHAPES}, relief_weight=float(arrays["relief_weight"])),
            overlap=float(arrays["overlap"]),
        )
