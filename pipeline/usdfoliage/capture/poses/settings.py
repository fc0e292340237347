"""How the cameras of photographs are found, and by which code."""

import importlib.metadata
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from usdfoliage.capture.lens import LENS_MODELS
from usdfoliage.files.code import digest_code
from usdfoliage.files.hashing import digest_text

# What features, matches and poses are made by: a test follows the imports.
CODE_OF_POSES = ("[!_]*.py", "files/**/*", "geometry/**/*", "capture/**/*")


@dataclass(frozen=True, kw_only=True)
class PoseEstimationSettings:
    """How the cameras of photographs are found."""

    # incremental and global are COLMAP's two mappers; auto runs the incremental one, and the global one where that
    # places too few photographs.
    mapper: str = "auto"
    # exhaustive compares all pairs of photographs, sequential those that follow each other, retrieval those that look
    # similar; auto chooses by the number of photographs.
    matching: str = "auto"
    # Features are searched in photographs reduced to this longer side. Unit: pixels. Range: 64 or more.
    max_side_px: int = 1600
    features: int = 4000  # At most this many features of a photograph are used, the coarsest first. Range: 100 or more.
    # Where a photograph has fewer features, finer ones are searched at four times the cost. Range: 0 or more.
    min_features: int = 1000
    # A feature has at least this contrast. Leaves before a dark wall have little. Unit: of 1. Range: above 0, below
    # 1.
    peak_threshold: float = 0.002
    # yes gives all photographs one camera, no gives each its own; auto shares one among photographs of the same size,
    # make, model and focal length.
    one_camera: str = "auto"
    lens_model: str = "SIMPLE_RADIAL"  # This camera model of COLMAP is estimated, from SIMPLE_PINHOLE to FULL_OPENCV.
    # This is the focal length of all photographs at full size; auto takes it from EXIF, or estimates it. Unit:
    # pixels. Range: above 0.
    focal_px: float | None = None
    # A match is kept up to this ratio of the distances to the nearest and the second nearest descriptor. Range: above
    # 0, up to 1.
    max_ratio: float = 0.8
    # This many coarse features of each photograph are compared first, to choose the pairs that are compared in full.
    # Range: 100 or more.
    coarse_features: int = 800
    coarse_matches: int = 16  # A pair with this many coarse matches is compared in full in any case. Range: 0 or more.
    min_matches: int = 15  # A pair counts when one motion explains at least this many matches. Range: 8 or more.
    # Each photograph is compared with this many before and after it, where the photographs are in order. Range: 1 or
    # more.
    sequence_overlap: int = 8
    # This many neighbours of each photograph, those with the most coarse matches, are compared in full in any case.
    # Range: 1 or more.
    neighbors: int = 12
    seed: int = 0  # Every random choice starts from this number. Range: 0 or more.
    threads: int = 0  # At most this many threads work; 0 is one per core. Range: 0 or more.

    def __post_init__(self) -> None:
        for name, allowed in (
            ("mapper", ("auto", "incremental", "global")),
            ("matching", ("auto", "exhaustive", "sequential", "retrieval")),
            ("one_camera", ("auto", "yes", "no")),
            ("lens_model", tuple(LENS_MODELS)),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {', '.join(allowed)}, not {getattr(self, name)!r}")
        if self.max_side_px < 64 or self.features < 100 or self.min_features < 0:
            raise ValueError(f"max_side_px must be at least 64, features at least 100, not {self}")
        if not 0 < self.peak_threshold < 1 or not 0 < self.max_ratio <= 1:
            raise ValueError(f"peak_threshold and max_ratio must be in 0 to 1, not {self}")
        if min(self.coarse_features - 100, self.coarse_matches, self.seed, self.threads) < 0 or self.min_matches < 8:
            raise ValueError(f"counts must not be negative and min_matches at least 8, not {self}")
        if min(self.sequence_overlap, self.neighbors) < 1:
            raise ValueError(f"sequence_overlap and neighbours must be at least 1, not {self}")
        if self.focal_px is not None and not (np.isfinite(self.focal_px) and self.focal_px > 0):
            raise ValueError(f"focal_px must be above 0, not {self.focal_px}")


def name_of(*parts: Any) -> str:
    """A file's name for what it is made from."""
    made_by = [digest_code(CODE_OF_POSES), importlib.metadata.version("pycolmap")]
    return digest_text(json.dumps([*made_by, *parts], sort_keys=True))[:24]
