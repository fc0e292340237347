"""Growth of branches in USD: time samples over the skeleton and the branch surface, in a layer of its own.

The layer goes over those of the branches in a variant. It holds no values but those of its frames: at the default time
the plant is the reconstruction, as it is in the last frame.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, Vt

from usdfoliage.asset.layer import FIRST_FRAME, author_frames, export_layer, new_layer
from usdfoliage.asset.look_layer import each_variant
from usdfoliage.asset.parts.leaf_motion import LeafMotion
from usdfoliage.asset.plant import BRANCHES, SKELETON


@dataclass(frozen=True, kw_only=True, eq=False)
class BranchGrowth:
    """What there is in each of T frames, one after another; each is gone through once."""

    frames: int  # T
    skeleton: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]  # points (V, 3) and radii (V,)
    surfaces: Mapping[str, Iterable[NDArray[np.float64]]]  # points (P, 3), by variant of the set branches
    leaves: LeafMotion | None = None  # in a layer of their own


def write_growth_layer(path: Path, name: str, growth: BranchGrowth) -> None:
    """Write the frames."""
    stage = new_layer(path, name)
    root = Sdf.Path(f"/{name}")
    author_frames(stage, growth.frames)
    author_growing_skeleton(UsdGeom.BasisCurves(stage.OverridePrim(root.AppendPath(SKELETON))), growth.skeleton)
    for variant in each_variant(stage, root, "branches", list(growth.surfaces)):
        surface = UsdGeom.Mesh(stage.OverridePrim(root.AppendPath(BRANCHES)))
        author_growing_surface(surface, growth.surfaces[variant])
    export_layer(stage, path)


def author_growing_skeleton(
    curves: UsdGeom.BasisCurves, frames: Iterable[tuple[NDArray[np.float64], NDArray[np.float64]]]
) -> None:
    """Points, widths and extent of curves in every frame."""
    for frame, (points_m, radius_m) in enumerate(frames, FIRST_FRAME):
        points = Vt.Vec3fArray.FromNumpy(points_m.astype(np.float32))
        widths = Vt.FloatArray.FromNumpy((2 * radius_m).astype(np.float32))
        curves.CreatePointsAttr().Set(points, frame)
        curves.CreateWidthsAttr().Set(widths, frame)
        curves.CreateExtentAttr().Set(UsdGeom.Curves.ComputeExtent(points, widths), frame)


def author_growing_surface(mesh: UsdGeom.Mesh, frames: Iterable[NDArray[np.float64]]) -> None:
    """Points and extent of a mesh in every frame."""
    for frame, points_m in enumerate(frames, FIRST_FRAME):
        points = Vt.Vec3fArray.FromNumpy(points_m.astype(np.float32))
        mesh.CreatePointsAttr().Set(points, frame)
        mesh.CreateExtentAttr().Set(UsdGeom.PointBased.ComputeExtent(points), frame)
