"""How near a branch cage's limit surface is to a cloud, and to the radii of its skeleton."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from usdfoliage.branch.cage.build import BranchCage
from usdfoliage.branch.distances import sample_axes
from usdfoliage.branch.model import Skeleton
from usdfoliage.geometry.smooth_mesh import refine_smooth

ABOVE_M = 0.3  # over the lowest point: below it is ground
SAMPLES = 1_000_000  # on the surface
JUDGED = 200_000  # of them, from which the way to the cloud is measured
LEVELS = 2


@dataclass(frozen=True, kw_only=True)
class SurfaceDistances:
    """Metres: mean and standard deviation."""

    scan_to_mesh: tuple[float, float]
    mesh_to_scan: tuple[float, float]


def limit_surface(cage: BranchCage) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Points and quads on the Catmull-Clark limit; each face of the cage becomes 4 ** LEVELS, one after another."""
    return refine_smooth(cage.points_m, cage.faces, LEVELS)


def measure_surface(
    points_m: NDArray[np.float64], quads: NDArray[np.int32], cloud_m: NDArray[np.float64]
) -> SurfaceDistances:
    """Both ways between a surface and a cloud, Y up, of what is more than ABOVE_M over the cloud's lowest point.

    The surface is a million places spread evenly over it, so that the measure is that of other tools' meshes as well.
    """
    rng = np.random.default_rng(0)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    a, b, c = (points_m[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(triangles), SAMPLES, p=area / area.sum())
    root, share = np.sqrt(rng.random(SAMPLES))[:, None], rng.random(SAMPLES)[:, None]
    places = (1 - root) * a[chosen] + root * (1 - share) * b[chosen] + root * share * c[chosen]
    floor_m = cloud_m[:, 1].min() + ABOVE_M
    there, _ = cKDTree(places).query(cloud_m[cloud_m[:, 1] > floor_m], workers=-1)
    judged = places[:JUDGED]
    back, _ = cKDTree(cloud_m).query(judged[judged[:, 1] > floor_m], workers=-1)
    return SurfaceDistances(
        scan_to_mesh=(float(np.mean(there)), float(np.std(there))),
        mesh_to_scan=(float(np.mean(back)), float(np.std(back))),
    )


def radius_deviations(skeleton: Skeleton, cage: BranchCage, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """|distance from the axis / radius - 1| of limit points of the cage's rows, away from forks, ends and bends.

    Left out are faces near forks, and places nearer to an end of their branch than two radii, or where the axis turns:
    there no tube has one radius. Where the cage bends an axis to where its hole found a place, that is counted: it is
    off the skeleton.
    """
    step = 4**LEVELS
    rows = np.ones(len(cage.faces), bool)
    rows[cage.fork_faces] = False
    _, quads = limit_surface(cage)
    corner = quads[::step][rows, 0]  # a vertex of the cage, where its limit is
    curve = cage.curve[rows]
    errors = [np.zeros(0)]
    order = np.argsort(curve, kind="stable")
    ends = np.searchsorted(curve[order], np.arange(len(skeleton) + 1))
    for branch in range(len(skeleton)):
        own = points_m[corner[order[ends[branch] : ends[branch + 1]]]]
        if not len(own):
            continue
        part = skeleton.branch(branch)
        axis_m, radius_m = skeleton.points_m[part], skeleton.radius_m[part]
        step_m = np.diff(axis_m, axis=0)
        square = np.maximum(np.sum(step_m**2, axis=1), 1e-300)
        along = np.sum((own[:, None] - axis_m[:-1]) * step_m, axis=2) / square
        away_m = np.linalg.norm(own[:, None] - axis_m[:-1] - np.clip(along, 0, 1)[..., None] * step_m, axis=2)
        at = away_m.argmin(axis=1)
        row = np.arange(len(own))
        share = np.clip(along[row, at], 0, 1)
        radius = radius_m[at] + share * (radius_m[at + 1] - radius_m[at])
        length_m = np.sqrt(square)
        arc_m = np.concatenate([[0], np.cumsum(length_m)])[at] + share * length_m[at]
        unit = step_m / length_m[:, None]
        turn = np.zeros(len(axis_m))
        turn[1:-1] = np.linalg.norm(np.diff(unit, axis=0), axis=1)
        near_bend = np.maximum(
            turn[at] * (share * length_m[at] < radius), turn[at + 1] * ((1 - share) * length_m[at] < radius)
        )
        inside = (arc_m > 2 * radius) & (arc_m < length_m.sum() - 2 * radius) & (near_bend < 0.1)
        errors.append(np.abs(away_m[row, at] / radius - 1)[inside])
    return np.concatenate(errors)


def cone_volume(skeleton: Skeleton) -> float:
    """Cubic metres inside all branches, as cones from point to point."""
    one, two = skeleton.radius_m[:-1], skeleton.radius_m[1:]
    length = np.linalg.norm(np.diff(skeleton.points_m, axis=0), axis=1)
    length[skeleton.first[1:] - 1] = 0
    return float(np.pi / 3 * np.sum(length * (one**2 + one * two + two**2)))


def diameter_at(skeleton: Skeleton, height_m: float) -> float:
    """Of the thickest axis at a height over the root, metres."""
    places_m, radius_m, _ = sample_axes(skeleton, 0.01)
    level = np.abs(places_m[:, 1] - skeleton.points_m[0, 1] - height_m) < 0.03
    return float(2 * radius_m[level].max()) if level.any() else float("nan")
