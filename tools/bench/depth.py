#!/usr/bin/env python3
"""Depth and cloud of synthetic captures against their exact depth, with every part of the method switched off once.

usage: tools/bench/depth.py [CAPTURE ...] [--variants ours plain ...] [--quality normal] [--save FOLDER]

The depth is found from the photographs and poses alone: depth, masks, scans and points of the capture are not looked
at. The truth is depth/ (exact, of some or all views) with truth/<photograph>_label.png (1 wood, 2 leaf, 3 other), and
truth/skeleton.json, where it is there, separates twigs (thinner than 10 mm) from other wood.
For each variant: accuracy (share of the cloud's points near the plant that lie within a distance of its surface),
completeness (share of the plant's surface within it of a point; of leaves, of wood), F; of the depth maps the share
of pixels with depth and of these the share within a distance; processor seconds a view. Without captures the two
of ../shared/data/synthetic are used.
"""

import argparse
import json
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from usdfoliage.capture.clear_sky import elevations_deg, find_clear_sky
from usdfoliage.capture.cloud.cleaning import CleaningSettings, drop_floating, drop_outliers
from usdfoliage.capture.cloud.fusion import SeenSurface, merge_views
from usdfoliage.capture.cloud.visibility import VisibilitySettings, drop_seen_through
from usdfoliage.capture.cloud_files.ply import write_cloud
from usdfoliage.capture.folder.read import Capture, read_capture, read_view
from usdfoliage.capture.mvs.agreement import AgreementSettings, DepthEstimate
from usdfoliage.capture.mvs.packed_planes import PackedPlanes, reader_of_planes
from usdfoliage.capture.mvs.rounds import MvsSettings, Round, finish_depth, match_views, plan_depths
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.capture.view import View
from usdfoliage.jobs.capture.settings import PRESETS, QUALITIES

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "synthetic"
CAPTURES = ("dense_foliage", "tree_leaf_on")
WOOD, LEAF, OTHER, TWIG = 1, 2, 3, 4
TWIG_RADIUS_M = 0.005
DISTANCES_MM = (2, 5, 10)
TRUTH_CELL_M = 0.0015
MARGIN_M = 0.02  # around the plant, within which points are judged; nearer to its surface than to others, or to none
MAX_POINTS = 800_000
PLAIN_ITERATIONS = 6


@dataclass(frozen=True, kw_only=True)
class Variant:
    """The method with something switched off."""

    depth: MvsSettings
    sky: bool = True
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)


def variants_of(depth: MvsSettings) -> Mapping[str, Variant]:
    """By the name of what is off."""
    matching, agreement = depth.matching, depth.agreement
    fine = tuple(replace(each, segments=False) for each in depth.rounds)
    blind = tuple(replace(each, segments=False, coherent=False) for each in depth.rounds)
    no_color = replace(matching, brightness_weight=0.0, tint_weight=0.0)
    uncut = replace(agreement, smoothness=0.0)
    unfiltered = replace(agreement, filter_px=0)
    one_round = (Round(level=0, iterations=PLAIN_ITERATIONS, coherent=False),)
    keep_all = VisibilitySettings(through=np.inf)
    ours = Variant(depth=depth)
    return {
        "ours": ours,
        "no graph cut (eq. 4)": replace(ours, depth=replace(depth, agreement=uncut)),
        "no guided filter": replace(ours, depth=replace(depth, agreement=unfiltered)),
        "no cleaning": replace(ours, cleaning=CleaningSettings(neighbors=0, isolation=0), visibility=keep_all),
        "no segments (eq. 2)": replace(ours, depth=replace(depth, rounds=fine)),
        "no coherence (eq. 3)": replace(ours, depth=replace(depth, rounds=blind)),
        "no colour": replace(ours, depth=replace(depth, matching=no_color)),
        "no sky": replace(ours, sky=False),
        "plain": Variant(
            depth=replace(
                depth, rounds=one_round, matching=no_color, agreement=replace(uncut, filter_px=0, through=1e9)
            ),
            sky=False,
            cleaning=CleaningSettings(neighbors=0, isolation=0),
            visibility=keep_all,
        ),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """The surface that the views of a capture see."""

    points_m: NDArray[np.float64]  # (N, 3)
    label: NDArray[np.uint8]  # (N,)
    depths: Mapping[str, tuple[NDArray[np.float32], NDArray[np.uint8]]]  # by view: depth and label, (H, W)


def read_truth(capture: Capture) -> Truth:
    """The exact depth of a capture, as far as it has any."""
    points, labels, depths = [], [], {}
    for view in capture.views:
        stem = Path(view.name).with_suffix("")
        depth_file = capture.folder / "depth" / f"{stem}.exr"
        label_file = capture.folder / "truth" / f"{stem}_label.png"
        if not depth_file.is_file() or not label_file.is_file():
            continue
        depth_m = np.asarray(oiio.ImageBuf(str(depth_file)).get_pixels(oiio.FLOAT), np.float32)[..., 0]
        label = np.asarray(cv2.imread(str(label_file), cv2.IMREAD_UNCHANGED), np.uint8)
        depths[view.name] = depth_m, label
        rows, columns = np.nonzero((depth_m > 0) & (label > 0))
        camera = view.lens.pinhole(view.cam_from_world)
        points.append(camera.unproject(np.column_stack([columns + 0.5, rows + 0.5]), depth_m[rows, columns]))
        labels.append(label[rows, columns])
    if not points:
        raise SystemExit(f"{capture.folder} has no exact depth with labels")
    places, label = np.concatenate(points), np.concatenate(labels)
    _, first = np.unique(np.floor(places / TRUTH_CELL_M).astype(np.int64), axis=0, return_index=True)
    return Truth(points_m=places[first], label=part_twigs(capture, places[first], label[first]), depths=depths)


def part_twigs(capture: Capture, points_m: NDArray[np.float64], label: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The labels (N,) of points (N, 3), wood that is a twig's apart, as far as the skeleton is known."""
    skeleton = capture.folder / "truth" / "skeleton.json"
    if not skeleton.is_file():
        return label
    content = json.loads(skeleton.read_text(encoding="utf-8"))
    _, nearest = cKDTree(np.asarray(content["nodes"], float)).query(points_m, workers=-1)
    thin = np.asarray(content["radius"], float)[nearest] < TWIG_RADIUS_M
    return np.where((label == WOOD) & thin, np.uint8(TWIG), label)


def score_cloud(points_m: NDArray[np.float64], truth: Truth) -> dict[str, float]:
    """Accuracy, completeness and F of a cloud (N, 3), by distance in millimetres."""
    rng = np.random.default_rng(0)
    if len(points_m) > MAX_POINTS:
        points_m = points_m[rng.choice(len(points_m), MAX_POINTS, replace=False)]
    plant = truth.label != OTHER
    low, high = truth.points_m[plant].min(axis=0) - MARGIN_M, truth.points_m[plant].max(axis=0) + MARGIN_M
    near = points_m[((points_m > low) & (points_m < high)).all(axis=1)]
    scores: dict[str, float] = {}
    away_m, nearest = cKDTree(truth.points_m).query(near, workers=-1)
    away_m = np.asarray(away_m)[plant[nearest] | (np.asarray(away_m) > MARGIN_M)]
    tree = cKDTree(near)
    found = {}
    twig = truth.label == TWIG
    for name, chosen in (
        ("plant", plant),
        ("leaf", truth.label == LEAF),
        ("wood", twig | (truth.label == WOOD)),
        ("twigs", twig),
    ):
        surface = truth.points_m[chosen]
        if len(surface) > MAX_POINTS:
            surface = surface[rng.choice(len(surface), MAX_POINTS, replace=False)]
        found[name] = np.asarray(tree.query(surface, workers=-1)[0])
    for distance in DISTANCES_MM:
        accuracy = float(np.mean(away_m <= distance / 1000)) if len(away_m) else 0.0
        for name, gap_m in found.items():
            scores[f"{name} {distance}"] = float(np.mean(gap_m <= distance / 1000)) if len(gap_m) else np.nan
        complete = scores[f"plant {distance}"]
        scores[f"accuracy {distance}"] = accuracy
        scores[f"F {distance}"] = 2 * accuracy * complete / max(accuracy + complete, 1e-9)
    return scores


def score_depth(found: Mapping[str, DepthEstimate], truth: Truth) -> dict[str, float]:
    """Share of pixels with depth, and of these the share within 5 mm, by label; over the views that have truth."""
    scores = {}
    for name, label in (("leaf", LEAF), ("wood", WOOD), ("other", OTHER)):
        pixels = with_depth = right = 0
        for view, (depth_m, labels) in truth.depths.items():
            if view not in found:
                continue
            of_label = (labels == label) & (depth_m > 0)
            own = found[view].depth_m
            pixels += int(of_label.sum())
            with_depth += int((of_label & (own > 0)).sum())
            right += int((of_label & (own > 0) & (np.abs(own - depth_m) <= 0.005)).sum())
        scores[f"{name} with depth"] = with_depth / max(pixels, 1)
        scores[f"{name} within 5 mm"] = right / max(with_depth, 1)
    return scores


def cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


@dataclass(frozen=True, kw_only=True, eq=False)
class Matched:
    """What variants that differ after matching alone have in common."""

    views: Sequence[View]
    planes: Sequence[PackedPlanes | None]
    cpu_s: float
    wall_s: float


def match(capture: Capture, variant: Variant) -> Matched:
    start, wall = cpu_seconds(), time.perf_counter()
    views: list[View] = []
    for index in range(len(capture.views)):
        view = read_view(capture, index)
        elevation_deg = elevations_deg(view.camera, capture.up)
        sky = find_clear_sky(view.srgb, elevation_deg=elevation_deg) if variant.sky else None
        views.append(replace(view, depth_m=np.zeros_like(view.depth_m), mask=None if sky is None else ~sky))
    plan = plan_depths([view.camera for view in views], None, variant.depth)
    planes = match_views(views, plan, variant.depth)
    return Matched(views=views, planes=planes, cpu_s=cpu_seconds() - start, wall_s=time.perf_counter() - wall)


def run(matched: Matched, variant: Variant, truth: Truth, save: Path | None) -> dict[str, float]:
    """Scores and processor seconds a view of one variant."""
    start, wall = cpu_seconds(), time.perf_counter()
    views, planes = matched.views, matched.planes
    cameras = [view.camera for view in views]
    plan, read_planes = plan_depths(cameras, None, variant.depth), reader_of_planes(planes, cameras)
    found = {
        view.name: finish_depth(index, plan, views.__getitem__, read_planes, variant.depth)
        for index, view in enumerate(views)
        if planes[index] is not None
    }

    def surfaces() -> Sequence[SeenSurface]:
        seen = []
        for view in views:
            if view.name in found:
                each = found[view.name]
                size = each.depth_m.shape[1], each.depth_m.shape[0]
                turned = each.normals.reshape(-1, 3) @ each.camera.cam_from_world[:, :3]
                seen.append(
                    SeenSurface(
                        camera=each.camera,
                        depth_m=each.depth_m,
                        normals=turned.reshape(each.normals.shape).astype(np.float32),
                        srgb=cv2.resize(view.srgb, size, interpolation=cv2.INTER_AREA),
                        confidence=each.confidence,
                        agreeing=each.agreeing,
                    )
                )
        return seen

    depths = [(each.camera, each.depth_m) for each in found.values()]
    cloud = drop_seen_through(merge_views(surfaces()), depths, variant.visibility)
    cloud = drop_floating(drop_outliers(cloud, variant.cleaning), variant.cleaning)
    used, wall = cpu_seconds() - start + matched.cpu_s, time.perf_counter() - wall + matched.wall_s
    if save is not None:
        write_cloud(save, cloud)
    return {
        **score_cloud(cloud.points_m, truth),
        **score_depth(
            {view.name: enlarge_depth(found[view.name], view.camera) for view in views if view.name in found}, truth
        ),
        "points": float(len(cloud)),
        "cpu s a view": used / len(views),
        "wall s": wall,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", metavar="CAPTURE", type=Path, nargs="*")
    parser.add_argument("--variants", nargs="+", metavar="NAME", help="ours, plain, or what is to be off (all)")
    parser.add_argument("--quality", choices=QUALITIES, default="normal")
    parser.add_argument("--save", type=Path, help="folder for the clouds")
    options = parser.parse_args()
    variants = variants_of(PRESETS[options.quality].depth)
    chosen = options.variants or list(variants)
    unknown = [name for name in chosen if name not in variants]
    if unknown:
        parser.error(f"there is no variant {', '.join(unknown)}; there are {', '.join(variants)}")
    captures = options.captures or [folder for name in CAPTURES if (folder := DATA / name).is_dir()]
    if not captures:
        print(f"not measured: {DATA} is not there, and no captures with exact depth are given")
    for folder in captures:
        capture = replace(read_capture(folder), points_m=np.zeros((0, 3)))
        bare = replace(capture, views=tuple(replace(view, depth=None, mask=None) for view in capture.views))
        truth = read_truth(capture)
        print(f"{folder.name}: {len(capture.views)} views, truth of {len(truth.depths)}")
        matched: dict[tuple[MvsSettings, bool], Matched] = {}
        print(
            "variant | F 2/5/10 mm | accuracy | leaf | wood | twigs of it | depth maps: leaf, wood | points | "
            "cpu s a view, wall s"
        )
        for name in chosen:
            if options.save is not None:
                options.save.mkdir(parents=True, exist_ok=True)
            save = None if options.save is None else options.save / f"{folder.name}_{name.split(' (')[0]}.ply"
            variant = variants[name]
            key = replace(variant.depth, agreement=AgreementSettings()), variant.sky
            if key not in matched:
                matched = {key: match(bare, variant)}  # of one at a time: it is large
            scores = run(matched[key], variant, truth, save)
            three = [
                " / ".join(f"{scores[f'{what} {distance}']:.3f}" for distance in DISTANCES_MM)
                for what in ("F", "accuracy", "leaf", "wood", "twigs")
            ]
            maps = ", ".join(
                f"{scores[f'{what} with depth']:.2f} × {scores[f'{what} within 5 mm']:.2f}" for what in ("leaf", "wood")
            )
            cost = f"{scores['points']:,.0f} | {scores['cpu s a view']:.1f}, {scores['wall s']:.0f}"
            print(" | ".join([name, *three, maps, cost]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
