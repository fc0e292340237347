#!/usr/bin/env python3
"""How near reconstructed leaves are to the true ones.

usage: tools/bench/leaf_truth.py ASSET CAPTURE [--min-confidence 0]     prints every measure of an asset

A true leaf is visible when at least half of its surface, by points spread over it, is what the exact depth of some view
shows. True and found leaves are matched one to one so that their distances sum to the least: the mean of the mean
distances from either surface to the other, over the true leaf's length from base to apex. A pair counts up to 8 %.
Surfaces are compared as points, 33 × 33 of a found leaf and 1500 of a true one, so that the distance of a perfect leaf
is not 0 but about 0.8 % of its length.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.shape.surface import evaluate_points, grid_places

Array = NDArray[np.float64]

APART = 10.0  # the cost of leaves that are nowhere near each other, in lengths
GRID = 33  # points of a found leaf, along either way
DISTANCE_POINTS, VISIBLE_POINTS = 1500, 300  # of a true leaf
COARSE, COARSE_STEP = 0.2, 16  # beyond this distance, in lengths, every sixteenth point is enough


@dataclass(frozen=True, kw_only=True)
class TruthSettings:
    """What counts as visible and as found."""

    visible_within_m: float = 0.004  # between a true point and the depth seen there; for leaves of some 70 mm
    visible_share: float = 0.5
    max_distance: float = 0.08  # of a match, in lengths of the true leaf
    half_hidden: tuple[float, float] = (0.4, 0.6)  # share visible in the best view


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueLeaves:
    """Leaves as points evenly spread over their surfaces."""

    base_m: Array  # (N, 3)
    apex_m: Array  # (N, 3)
    length_m: Array  # (N,), from base to apex
    visible_m: Array  # (N, VISIBLE_POINTS, 3), to measure what is seen
    surface_m: Array  # (N, DISTANCE_POINTS, 3), to measure distances

    def __len__(self) -> int:
        return len(self.base_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class Match:
    """Which found leaf is which true one."""

    true: NDArray[np.int64]  # (K,), numbers of true leaves
    found: NDArray[np.int64]  # (K,), numbers of found leaves
    distance: Array  # (K,), in lengths of the true leaf
    nearest_true: Array  # (N,), the least distance of each true leaf to any found one, APART or less
    nearest_found: Array  # (M,), and of each found leaf to any true one
    max_pairs: int  # pairs that would count if all pairs that do not count had the same cost


@dataclass(frozen=True, kw_only=True)
class Scores:
    """What a reconstruction is measured by; NaN where there is nothing to measure."""

    true: int
    visible: int  # true leaves of which half or more is seen in some view
    found: int
    matched: int
    recall: float  # of the visible leaves
    precision: float
    f1: float
    distance_percent: float  # mean of matched leaves, of the length of each
    distance_mm: float
    axis_error_deg: float  # median, of the line through base and apex, either way
    base_right: float  # share of matched leaves whose base lies at the true base, not at the apex
    tip_error_percent: float  # median of the mean of both ends' errors, after turning leaves the right way
    length_ratio: float  # median, found to true
    length_error: float  # median
    half_hidden: int  # matched leaves that are half hidden even in their best view
    half_hidden_length_error: float  # median
    duplicates: int  # found leaves that lie on a true one which another found leaf has
    poor: int  # found leaves beyond max_distance, but within twice of it
    max_matched: int  # max_pairs of the match: the smallest sum may part good pairs to save bad ones


def true_leaves(arrays: Mapping[str, NDArray[np.generic]]) -> TrueLeaves:
    """Those of the arrays of truth/leaves.npz: triangles, and both ends of the midribs."""
    rng = np.random.default_rng(0)
    vertices_m, faces = np.asarray(arrays["vertices"], np.float64), np.asarray(arrays["faces"], np.int64)
    vertex_offset, face_offset = (np.asarray(arrays[name], np.int64) for name in ("vertex_offset", "face_offset"))
    triangles = [
        vertices_m[faces[face_offset[leaf] : face_offset[leaf + 1]] + vertex_offset[leaf]]
        for leaf in range(len(vertex_offset) - 1)
    ]
    return TrueLeaves(
        base_m=np.asarray(arrays["base"], np.float64),
        apex_m=np.asarray(arrays["apex"], np.float64),
        length_m=np.asarray(arrays["chord"], np.float64),
        visible_m=_spread_points(triangles, VISIBLE_POINTS, rng),
        surface_m=_spread_points(triangles, DISTANCE_POINTS, rng),
    )


def read_true_leaves(capture: Path) -> TrueLeaves:
    """Those of a capture folder that has truth/leaves.npz."""
    with np.load(capture / "truth" / "leaves.npz") as arrays:
        return true_leaves(arrays)


def read_exact_depth(capture: Path) -> list[tuple[Pinhole, NDArray[np.float32]]]:
    """Cameras and depth (H, W) of the views that have depth, from a COLMAP text model of PINHOLE cameras.

    Exact depth that is no part of the capture, as of one of photographs alone, lies in truth/depth.

    Raises:
        ValueError: A camera is of another model, or no view has depth.
    """
    folder = next((each for each in (capture / "truth" / "depth", capture / "depth") if each.is_dir()), None)
    if folder is None:
        raise ValueError(f"{capture} has neither truth/depth nor depth: what can be seen of leaves is not known")
    cameras: dict[str, tuple[int, int, list[float]]] = {}
    for line in _lines(capture / "cameras" / "cameras.txt"):
        if not line.strip():
            continue
        number, model, width, height, *parameters = line.split()
        if model != "PINHOLE":
            raise ValueError(f"{capture / 'cameras' / 'cameras.txt'}: {model}, only PINHOLE is read here")
        cameras[number] = int(width), int(height), [float(parameter) for parameter in parameters]
    views = []
    for line in _lines(capture / "cameras" / "images.txt")[::2]:  # the other half are points
        _, *pose, camera, name = line.split()
        path = folder / Path(name).with_suffix(".exr").name
        if not path.exists():
            continue
        qw, qx, qy, qz, *translation = [float(number) for number in pose]
        width, height, (focal_x, focal_y, center_x, center_y) = cameras[camera]
        rotation = Rotation.from_quat([qx, qy, qz, qw]).as_matrix()
        pinhole = Pinhole(
            width_px=width,
            height_px=height,
            focal_px=(focal_x, focal_y),
            center_px=(center_x, center_y),
            cam_from_world=np.column_stack([rotation, translation]),
        )
        with OpenEXR.File(str(path)) as file:
            views.append((pinhole, np.array(file.channels()["Z"].pixels, np.float32)))
    return views


def visible_shares(
    true: TrueLeaves,
    views: Sequence[tuple[Pinhole, NDArray[np.float32]]],
    settings: TruthSettings = TruthSettings(),
) -> Array:
    """Share (N, V) of each leaf's surface that each view sees, by its exact depth."""
    points = true.visible_m.reshape(-1, 3)
    shares = np.zeros((len(true), len(views)))
    for number, (camera, depth_m) in enumerate(views):
        places, distance_m = camera.project(points)
        column, row = np.floor(np.nan_to_num(places, nan=-1.0)).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < camera.width_px) & (row < camera.height_px)
        seen = np.zeros(len(points), bool)
        gap_m = depth_m[row[inside], column[inside]] - distance_m[inside]
        seen[inside] = np.abs(gap_m) < settings.visible_within_m
        shares[:, number] = seen.reshape(len(true), -1).mean(axis=1)
    return shares


def match_leaves(true: TrueLeaves, leaves: Leaves, settings: TruthSettings = TruthSettings()) -> Match:
    """Match leaves in the frame of the true ones with them."""
    places = grid_places(np.linspace(-1, 1, GRID), np.linspace(0, 1, GRID))
    found = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    costs = np.full((len(true), len(leaves)), APART)
    if len(leaves):
        found_trees = [cKDTree(surface) for surface in found]
        centers = cKDTree(found.mean(axis=1))
        for number, surface in enumerate(true.surface_m):
            tree, length_m = cKDTree(surface), true.length_m[number]
            for other in centers.query_ball_point(surface.mean(axis=0), length_m):
                for step in (COARSE_STEP, 1):
                    there_m = tree.query(found[other][::step])[0].mean()
                    back_m = found_trees[other].query(surface[::step])[0].mean()
                    costs[number, other] = (there_m + back_m) / 2 / length_m
                    if costs[number, other] > COARSE:
                        break
    rows, columns = linear_sum_assignment(costs)
    near = costs[rows, columns] <= settings.max_distance
    rows, columns = rows[near], columns[near]
    counting = linear_sum_assignment(np.where(costs <= settings.max_distance, costs, APART))
    return Match(
        true=rows,
        found=columns,
        distance=costs[rows, columns],
        nearest_true=costs.min(axis=1, initial=APART),
        nearest_found=costs.min(axis=0, initial=APART),
        max_pairs=int((costs[counting] <= settings.max_distance).sum()),
    )


def nearest_distances(true: TrueLeaves, leaves: Leaves) -> Array:
    """(N,), distance of each leaf to the true one that it is nearest to, in lengths of that; APART for none near it.

    As match_leaves measures it, with a fifth of the points: there may be thousands of leaves.
    """
    places = grid_places(np.linspace(-1, 1, GRID // 2), np.linspace(0, 1, GRID // 2))
    found = evaluate_points(leaves.parameters, places, placements=leaves.asset_from_leaf())
    thin = [surface[::5] for surface in true.surface_m]
    trees, centers = [cKDTree(surface) for surface in thin], cKDTree(true.surface_m.mean(axis=1))
    nearest = np.full(len(leaves), APART)
    for number, surface in enumerate(found):
        own = cKDTree(surface)
        for other in centers.query_ball_point(surface.mean(axis=0), 0.5 * float(true.length_m.max())):
            there_m = trees[other].query(surface)[0].mean()
            if there_m < 2 * nearest[number] * true.length_m[other]:
                both_m = (there_m + own.query(thin[other])[0].mean()) / 2
                nearest[number] = min(nearest[number], both_m / true.length_m[other])
    return nearest


def score_leaves(
    true: TrueLeaves,
    best_share: Array,
    leaves: Leaves,
    settings: TruthSettings = TruthSettings(),
    match: Match | None = None,
) -> Scores:
    """Measure leaves in the frame of the true ones.

    Args:
        best_share: (N,), share of each true leaf that is visible in its best view.
        match: What match_leaves gives; found here by default.
    """
    matched = match_leaves(true, leaves, settings) if match is None else match
    rows, columns = matched.true, matched.found
    visible = best_share >= settings.visible_share
    recall = float(visible[rows].sum() / visible.sum()) if visible.any() else np.nan
    precision = len(rows) / len(leaves) if len(leaves) else np.nan
    matrix = leaves.asset_from_leaf()[columns]
    base_m, apex_m = matrix[:, :, 3], matrix[:, :, 3] + matrix[:, :, 1]
    true_base_m, true_apex_m, true_length_m = true.base_m[rows], true.apex_m[rows], true.length_m[rows]
    along, true_along = apex_m - base_m, true_apex_m - true_base_m
    length_m = np.linalg.norm(along, axis=1)
    sine, cosine = np.linalg.norm(np.cross(along, true_along), axis=1), np.abs((along * true_along).sum(axis=1))
    upright = _distance(base_m, true_base_m) + _distance(apex_m, true_apex_m)
    turned = _distance(base_m, true_apex_m) + _distance(apex_m, true_base_m)
    length_error = np.abs(length_m / true_length_m - 1)
    low, high = settings.half_hidden
    half_hidden = (best_share[rows] >= low) & (best_share[rows] <= high)
    unmatched = np.setdiff1d(np.arange(len(leaves)), columns)
    nearest = matched.nearest_found[unmatched]
    return Scores(
        true=len(true),
        visible=int(visible.sum()),
        found=len(leaves),
        matched=len(rows),
        recall=recall,
        precision=precision,
        f1=2 * recall * precision / (recall + precision) if recall + precision > 0 else np.nan,
        distance_percent=100 * _mean(matched.distance),
        distance_mm=1000 * _mean(matched.distance * true_length_m),
        axis_error_deg=_median(np.degrees(np.arctan2(sine, cosine))),
        base_right=_mean(_distance(base_m, true_base_m) < _distance(base_m, true_apex_m)),
        tip_error_percent=100 * _median(np.minimum(upright, turned) / 2 / true_length_m),
        length_ratio=_median(length_m / true_length_m),
        length_error=_median(length_error),
        half_hidden=int(half_hidden.sum()),
        half_hidden_length_error=_median(length_error[half_hidden]),
        duplicates=int((nearest <= settings.max_distance).sum()),
        poor=int(((nearest > settings.max_distance) & (nearest <= 2 * settings.max_distance)).sum()),
        max_matched=matched.max_pairs,
    )


def read_asset_leaves(asset: Path) -> Leaves:
    """All leaves of an asset, in its capture's frame, without edits.

    Raises:
        FoliageError: It is no asset of leaves.
        ValueError: It has several prims of leaves.
    """
    from pxr import Usd
    from usdfoliage.asset.locate import find_interface, require_leaves
    from usdfoliage.asset.parts.leaves import read_leaves

    interface = find_interface(asset)
    stage = Usd.Stage.Open(str(interface))
    prims = require_leaves(stage, interface)
    if len(prims) > 1:
        raise ValueError(f"{asset}: {len(prims)} prims hold leaves, those of one are measured here")
    leaves = read_leaves(prims[0]).leaves
    attribute = stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset")
    asset_from_capture = np.array(attribute.Get()).T if attribute and attribute.HasValue() else np.eye(4)
    return move_leaves(leaves, np.linalg.inv(asset_from_capture))


def move_leaves(leaves: Leaves, similarity: Array) -> Leaves:
    """Leaves in another frame; similarity is (4, 4), for column vectors: a turn, an even scale and a shift."""
    scale = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    turn = Rotation.from_matrix(similarity[:3, :3] / scale)
    return replace(
        leaves,
        base_m=leaves.base_m @ similarity[:3, :3].T + similarity[:3, 3],
        orientation=(turn * Rotation.from_quat(leaves.orientation)).as_quat(canonical=True),
        length_m=leaves.length_m * scale,
    )


def _spread_points(triangles: Sequence[Array], count: int, rng: np.random.Generator) -> Array:
    """Points (N, count, 3), even on the surfaces of N leaves' triangles (F, 3, 3)."""
    points = np.empty((len(triangles), count, 3))
    for leaf, corners in enumerate(triangles):
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        first, second, third = np.moveaxis(corners[rng.choice(len(area), count, p=area / area.sum())], 1, 0)
        along, across = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
        points[leaf] = (1 - along) * first + along * (1 - across) * second + along * across * third
    return points


def _lines(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


def _distance(first: Array, second: Array) -> Array:
    return np.asarray(np.linalg.norm(first - second, axis=1))


def _mean(values: NDArray[np.generic]) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _median(values: Array) -> float:
    return float(np.median(values)) if len(values) else np.nan


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("capture", type=Path, help="with truth/ and exact depth/")
    parser.add_argument("--min-confidence", type=float, default=0.0)
    options = parser.parse_args()
    leaves = read_asset_leaves(options.asset)
    if leaves.confidence is not None:
        leaves = leaves.take(leaves.confidence >= options.min_confidence)
    true = read_true_leaves(options.capture)
    scores = score_leaves(true, visible_shares(true, read_exact_depth(options.capture)).max(axis=1), leaves)
    for entry in fields(scores):
        print(f"{entry.name:<28}{getattr(scores, entry.name):.6g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
