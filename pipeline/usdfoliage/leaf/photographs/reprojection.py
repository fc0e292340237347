"""Leaves laid back over their photographs: what every pixel would show of them, and their axes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.drawn_grids import NO_GRID, draw_grids
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

NO_LEAF = NO_GRID


@dataclass(frozen=True, kw_only=True)
class DrawSettings:
    """How finely leaves are divided into cells to be drawn."""

    # A leaf is drawn with this many cells from silhouette to silhouette. An even number makes the axis an edge.
    # Range: even, 2 or more.
    across: int = 8
    # A leaf is drawn with this many cells from base to apex. At 24, chords of a leaf of 300 pixels are off by a
    # quarter of a pixel at most. Range: 2 or more.
    along: int = 24

    def __post_init__(self) -> None:
        if self.across < 2 or self.across % 2:
            raise ValueError(f"across must be even and 2 or more, not {self.across}")
        if self.along < 2:
            raise ValueError(f"along must be 2 or more, not {self.along}")


class DrawnLeaves(NamedTuple):
    """What a camera would see of leaves if nothing else stood there."""

    ids: NDArray[np.int32]  # (H, W), number of the leaf nearest to the camera, NO_LEAF for none
    depth_m: NDArray[np.float32]  # (H, W), its planar depth, 0 for none


def draw_leaf_ids(
    leaves: Leaves, camera: Pinhole, settings: DrawSettings = DrawSettings(), *, threads: int = 0
) -> DrawnLeaves:
    """Draw leaves, in the world of the camera, with a z-buffer; a pixel shows what its centre shows.

    Cells that reach behind the camera are left out. Of leaves equally near, the first is seen.
    """
    u, v = np.linspace(-1, 1, settings.across + 1), np.linspace(0, 1, settings.along + 1)
    points = evaluate_points(leaves.parameters, grid_places(u, v), placements=leaves.asset_from_leaf(), threads=threads)
    return DrawnLeaves(*draw_grids(points.reshape(len(leaves), len(v), len(u), 3), camera, threads=threads))


def project_axes(leaves: Leaves, camera: Pinhole, steps: int = 24) -> NDArray[np.float64]:
    """Where the axes are seen, from base to apex: (N, steps + 1, 2), x and y in pixels, NaN behind the camera.

    Raises:
        ValueError: steps is below 1.
    """
    if steps < 1:
        raise ValueError(f"steps must be 1 or more, not {steps}")
    uv = np.column_stack([np.zeros(steps + 1), np.arange(steps + 1) / steps])
    points = evaluate_points(leaves.parameters, uv, placements=leaves.asset_from_leaf())
    places, _ = camera.project(points.reshape(-1, 3))
    return places.reshape(len(leaves), steps + 1, 2)
