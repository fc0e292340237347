"""How well trees of single photographs fit them: with strokes as they were drawn, shaken, and proposed; and the time.

    .venv/bin/python tools/bench/sketch.py PHOTOS --strokes FOLDER --masks FOLDER [--shaken 5] [--proposed]
        [--measures measures.csv] [--pictures FOLDER]

PHOTOS is a folder of photographs. FOLDER/NAME.json, or NAME.strokes.json, has the strokes of each, and FOLDER/NAME.png
its mask: white on crown and stem. front is the intersection over union of that mask with what leaves and branches
cover, seen from the camera, both closed by 1 % of the mask's width. spread is depth over width of the leaves, or of
the branches of a bare tree, by their second moments. Shaken strokes have normal noise of 2 % of the picture's width at
each point. measures.csv has photo, crown_diameter_cm and height_cm: the height is given, and the diameter compared.
"""

import argparse
import csv
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.masks import read_mask
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.sketch.model import SketchModel, SketchModelSettings, model_tree
from usdfoliage.jobs.sketch.run import SketchRequest, read_sketch_input
from usdfoliage.leaf.shape.mesh import LeafMeshSettings, build_leaf_mesh
from usdfoliage.sketch.drawing import SHIFT, close_gaps, fixed_points
from usdfoliage.sketch.reconstruct import SketchSettings
from usdfoliage.sketch.strokes import TreeStrokes, read_strokes

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLOSED = 0.01  # of the mask's width
SHAKEN = 0.02  # of the picture's width


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """A photograph whose tree is known."""

    name: str
    photo: Photo
    strokes: TreeStrokes | None
    mask: Mask
    height_m: float | None
    diameter_m: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """What came of one photograph."""

    front: float
    spread: float
    width_m: float
    model: SketchModel
    covered: Mask
    seconds: dict[str, float]


def read_samples(options: argparse.Namespace) -> list[Sample]:
    """The photographs that have a mask."""
    measures = {}
    if options.measures:
        with options.measures.open(encoding="utf-8") as file:
            measures = {row["photo"]: row for row in csv.DictReader(file)}
    samples = []
    for path in sorted(options.photos.iterdir()):
        mask_path = options.masks / f"{path.stem}{options.mask_suffix}.png"
        if path.suffix.lower() not in (".jpg", ".png", ".tif") or not mask_path.is_file():
            continue
        if options.only and path.stem not in options.only:
            continue
        photo = read_photo(path)
        drawn = [options.strokes / f"{path.stem}{suffix}" for suffix in (".json", ".strokes.json")]
        drawn = [each for each in drawn if each.is_file()]
        row = measures.get(path.stem)
        samples.append(
            Sample(
                name=path.stem,
                photo=photo,
                strokes=read_strokes(drawn[0]).trees[0] if drawn else None,
                mask=read_mask(mask_path, photo.linear.shape, photo.orientation),
                height_m=float(row["height_cm"]) / 100 if row else None,
                diameter_m=float(row["crown_diameter_cm"]) / 100 if row else None,
            )
        )
    return samples


def make(sample: Sample, strokes: TreeStrokes) -> Result:
    """The tree of one photograph, and how well it fits."""
    settings = SketchModelSettings()
    if sample.height_m is not None:
        settings = replace(settings, tree=SketchSettings(height_m=sample.height_m))
    seconds: dict[str, float] = {}
    model = model_tree(sample.photo.linear, strokes, settings, seconds)
    covered, places = draw_front(model, sample.mask.shape)
    reach = max(1, int(CLOSED * np.ptp(np.flatnonzero(sample.mask.any(axis=0)))))
    one, two = close_gaps(covered, reach), close_gaps(sample.mask, reach)
    return Result(
        front=float((one & two).sum() / (one | two).sum()),
        spread=float(places[:, 2].std() / places[:, 0].std()),
        width_m=float(np.ptp(np.percentile(places[:, 0], (0.2, 99.8)))),
        model=model,
        covered=covered,
        seconds=seconds,
    )


def draw_front(model: SketchModel, shape: tuple[int, ...]) -> tuple[Mask, Floats]:
    """(H, W) what leaves and branches cover in the photograph, and (N, 3) points of the leaves, else of branches."""
    drawn = np.zeros(shape, np.uint8)
    photo_from_asset = np.linalg.inv(model.asset_from_photo)

    def to_photo(points: Floats) -> Floats:
        return (points @ photo_from_asset[:3, :3].T + photo_from_asset[:3, 3])[:, :2]

    cage = model.branches.surfaces.whole
    for corners in fixed_points(to_photo(cage.points_m))[cage.faces]:
        cv2.fillConvexPoly(drawn, corners, 1, shift=SHIFT)
    if model.foliage is None or not len(model.foliage.leaves):
        return drawn > 0, cage.points_m
    mesh = build_leaf_mesh(model.foliage.leaves, LeafMeshSettings(across=4, along=6))
    points = mesh.points_m.astype(np.float64)
    flat = fixed_points(to_photo(points))
    start = np.cumsum(mesh.face_counts) - mesh.face_counts
    for count in np.unique(mesh.face_counts):
        chosen = start[mesh.face_counts == count][:, None] + np.arange(count)
        for corners in flat[mesh.face_vertices[chosen]]:
            cv2.fillConvexPoly(drawn, corners, 1, shift=SHIFT)
    return drawn > 0, points


def shake(strokes: TreeStrokes, width_px: int, seed: int) -> TreeStrokes:
    """The strokes as a less steady hand draws them."""
    rng = np.random.default_rng(seed)

    def moved(line: Floats) -> Floats:
        return line + rng.normal(0, SHAKEN * width_px, line.shape)

    return TreeStrokes(crown_px=moved(strokes.crown_px), branches_px=tuple(moved(each) for each in strokes.branches_px))


def describe(sample: Sample, kind: str, result: Result) -> str:
    """One line of the table."""
    model = result.model
    leaves = 0 if model.foliage is None else len(model.foliage.leaves)
    length = 100 * float(model.foliage.leaves.length_m.mean()) if leaves else 0.0
    diameter = f"{result.width_m / sample.diameter_m - 1:+7.1%}" if sample.diameter_m else f"{result.width_m:7.2f}"
    times = " ".join(f"{name} {value:.1f}" for name, value in result.seconds.items())
    return (
        f"{sample.name:10} {kind:9} {result.front:.3f}  {result.spread:.2f} {diameter} "
        f"{len(model.branches.skeleton.skeleton):6,} {leaves:6,} {length:5.1f}  {times}"
    )


def draw_sheet(sample: Sample, result: Result) -> NDArray[np.uint8]:
    """The photograph, and the cover in it: white both, red the tree alone, blue the mask alone."""
    srgb = result.model.srgb
    size = srgb.shape[1::-1]
    covered, mask = (
        cv2.resize(each.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        for each in (result.covered, sample.mask)
    )
    found = result.model.tree.foliage.mask
    cover = np.stack([255 * mask, 255 * (covered & mask), 255 * covered], axis=-1).astype(np.uint8)
    leaves = np.stack([255 * mask, 255 * (found & mask), 255 * found], axis=-1).astype(np.uint8)
    picture = np.ascontiguousarray(srgb[..., ::-1])
    for branch in result.model.tree.traced.branches:
        cv2.polylines(picture, [fixed_points(branch.points_px)], False, (0, 0, 255), 1, cv2.LINE_AA, SHIFT)
    return np.hstack([np.ascontiguousarray(srgb[..., ::-1]), picture, leaves, cover])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path, help="folder of photographs")
    parser.add_argument("--strokes", type=Path, required=True, help="folder of the strokes")
    parser.add_argument("--masks", type=Path, required=True, help="folder of the masks")
    parser.add_argument("--mask-suffix", default="", help="after the photograph's name, in that of its mask")
    parser.add_argument("--measures", type=Path, help="table of heights and diameters of crowns")
    parser.add_argument("--only", nargs="*", help="names of photographs")
    parser.add_argument("--shaken", type=int, default=0, help="seeds of shaken strokes; the default is 0")
    parser.add_argument("--proposed", action="store_true", help="propose strokes too")
    parser.add_argument("--pictures", type=Path, help="folder for a sheet of each result")
    options = parser.parse_args(arguments)
    samples = read_samples(options)
    if not samples:
        print(f"no photograph of {options.photos} has a mask in {options.masks}", file=sys.stderr)
        return 2
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    print("photograph strokes   front spread diameter branches leaves cm  seconds")
    fronts: dict[str, list[float]] = {}
    for sample in samples:
        tried: list[tuple[str, TreeStrokes]] = []
        if sample.strokes is not None:
            tried.append(("drawn", sample.strokes))
            tried += [(f"shaken {k}", shake(sample.strokes, sample.photo.width_px, k)) for k in range(options.shaken)]
        if options.proposed:
            begun = time.perf_counter()
            request = SketchRequest(photo=sample.photo.path, output=Path(), name="tree")
            proposed = read_sketch_input(request).strokes.trees[0]
            print(f"{sample.name:10} proposed  in {time.perf_counter() - begun:.1f} s")
            tried.append(("proposed", proposed))
        for kind, strokes in tried:
            try:
                result = make(sample, strokes)
            except FoliageError as error:
                print(f"{sample.name:10} {kind:9} failed: {error}")
                fronts.setdefault(kind.split()[0], []).append(0.0)
                continue
            fronts.setdefault(kind.split()[0], []).append(result.front)
            print(describe(sample, kind, result), flush=True)
            if options.pictures:
                name = f"{sample.name}_{kind.replace(' ', '_')}.png"
                cv2.imwrite(str(options.pictures / name), draw_sheet(sample, result))
    for kind, values in fronts.items():
        print(f"{kind}: front {np.mean(values):.3f} mean, {min(values):.3f} the lowest of {len(values)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
