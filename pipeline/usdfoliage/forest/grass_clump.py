"""The shape of a clump of grass: blades that are narrow, bent and pointed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

POINTS = 5  # of a blade: two at its root, two in its middle, its tip
_FACES = np.array([[0, 1, 3, 2], [2, 3, 4, -1]])  # of a blade, the second one with three corners


@dataclass(frozen=True, kw_only=True)
class ClumpSettings:
    """How the blades of a clump are."""

    blades: int = 28
    radius_m: float = 0.08  # of the disc on which they stand
    width_m: tuple[float, float] = (0.004, 0.008)  # at the root
    reach_m: float = 0.06  # by which the tip of the longest is beside its root
    shade: float = 0.4  # by how much the lightest and the darkest blade differ from the mean
    spread: float = 0.35  # by which normals are turned from the vertical, towards where a blade leans

    def __post_init__(self) -> None:
        if self.blades < 1:
            raise ValueError(f"blades must be at least 1, not {self.blades}")
        if not (self.radius_m >= 0 and self.reach_m >= 0 and self.spread >= 0):
            raise ValueError("radius_m, reach_m and spread must not be below 0")
        if not 0 <= self.shade < 1:
            raise ValueError(f"shade must be 0 to below 1, not {self.shade:g}")
        if not 0 < self.width_m[0] <= self.width_m[1] < np.inf:
            raise ValueError("width_m must be two lengths above 0, the smaller first")


@dataclass(frozen=True, kw_only=True, eq=False)
class GrassClump:
    """A mesh, Y up from 0 to 1 in heights of the clump, across in metres."""

    points: Floats  # (V, 3)
    normals: Floats  # (V, 3), unit, nearly up: grass is lit as the ground is
    face_counts: NDArray[np.int32]  # (F,)
    face_indices: NDArray[np.int32]
    along: Floats  # (V,) from 0 at the root of a blade to 1 at its tip
    shade: Floats  # (V,) about 1, how light a blade is beside others


def build_clump(rng: np.random.Generator, settings: ClumpSettings = ClumpSettings()) -> GrassClump:
    """A clump of blades whose highest is 1 high.

    Args:
        rng: For places, sizes and bends.
        settings: How they are.
    """
    count = settings.blades
    angle = rng.uniform(0, 2 * np.pi, count)
    away_m = settings.radius_m * np.sqrt(rng.random(count))
    root = np.stack([away_m * np.cos(angle), away_m * np.sin(angle)], axis=-1)
    lean = angle + rng.normal(0, 1.0, count)  # outwards, more or less
    towards = np.stack([np.cos(lean), np.sin(lean)], axis=-1)
    tall = rng.uniform(0.45, 1.0, count)
    tall /= tall.max()
    reach_m = settings.reach_m * tall * rng.uniform(0.2, 1.0, count)
    face = lean + np.pi / 2 + rng.normal(0, 0.5, count)  # the blade is wide across its lean
    side = np.stack([np.cos(face), np.sin(face)], axis=-1) * rng.uniform(*settings.width_m, count)[:, None] / 2
    points = np.empty((count, POINTS, 3))
    for number, (up, out, wide) in enumerate(((0, 0, 1), (0, 0, -1), (0.6, 0.3, 0.8), (0.6, 0.3, -0.8), (1, 1, 0))):
        points[:, number, [0, 2]] = root + out * reach_m[:, None] * towards + wide * side
        points[:, number, 1] = up * tall
    shade = rng.uniform(1 - settings.shade, 1 + settings.shade, count)
    normal = np.column_stack([settings.spread * towards[:, 0], np.ones(count), settings.spread * towards[:, 1]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    corners = _FACES + POINTS * np.arange(count)[:, None, None]
    indices = corners.reshape(count, -1)[:, :-1]
    return GrassClump(
        points=points.reshape(-1, 3),
        normals=np.repeat(normal, POINTS, axis=0),
        face_counts=np.tile(np.array([4, 3], np.int32), count),
        face_indices=indices.reshape(-1).astype(np.int32),
        along=np.tile([0, 0, 0.6, 0.6, 1.0], count),
        shade=np.repeat(shade / shade.mean(), POINTS),
    )
