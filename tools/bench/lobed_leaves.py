"""How well leaves of several lobes are modelled: the figures of eval_lobed, measured on arrays without an asset.

    .venv/bin/python tools/bench/lobed_leaves.py [--data ../shared/data] [--every N] [--turned] [--noise] [--sheet PNG]
    .venv/bin/python tools/bench/lobed_leaves.py --scans [--data ../shared/data] [--sheet PNG]

A figure that is beyond what is asked has an asterisk. IoU and silhouette errors are taken in a picture enlarged four
times. Scans are cut out of their pictures; their truth is a traced polygon, filled by non-zero winding.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from usdfoliage.geometry.lines import arc_lengths, spread_evenly
from usdfoliage.leaf.lobed.cutout import cut_out_leaves
from usdfoliage.leaf.lobed.model import FlatLobedLeaf, model_lobed_leaf
from usdfoliage.leaf.lobed.petiole import split_petiole
from usdfoliage.leaf.lobed.sinuses import open_sinuses
from usdfoliage.leaf.lobed.spline import evaluate_closed
from usdfoliage.leaf.lobed.veins import choose_base, draw_veins, measure_veins

REPO = Path(__file__).resolve().parents[2]
UP = 4
TILE_PX = 280

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A picture of a leaf and what its model is compared with."""

    name: str
    mask: Mask
    true: Mask  # enlarged
    lobed: bool


@dataclass(frozen=True, kw_only=True)
class Figures:
    """As eval_lobed measures them."""

    iou: float
    p95_px: float
    overlap: float
    flipped: int
    bad_corners: float
    spline_iou: float
    controls: int
    ties: int
    lobes: int
    seconds: float

    def misses(self, lobed: bool) -> dict[str, bool]:
        """Which figures are beyond what is asked of each leaf."""
        return {
            "iou": self.iou < 0.96,
            "p95_px": self.p95_px > 2,
            "overlap": self.overlap > 0.002,
            "flipped": self.flipped > 0,
            "bad_corners": self.bad_corners > 0.02,
            "spline_iou": self.spline_iou < 0.98,
            "controls": self.controls > 400,
            "ties": self.ties < 20,
            "lobes": lobed and self.lobes + 1 < 3,  # the axis to the base is a branch too
            "seconds": self.seconds > 2,
        }


def fill_winding(corners: Floats, height: int, width: int) -> Mask:
    """(height, width) a polygon (K, 2) filled where it winds around a pixel at all, so lobes that overlap stay leaf."""
    turns = np.zeros((height, width + 1), np.int32)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        low, high = sorted((y0, y1))
        row = np.arange(max(0, int(np.ceil(low - 0.5))), min(height, int(np.ceil(high - 0.5))))
        across = x0 + (row + 0.5 - y0) * (x1 - x0) / (y1 - y0)
        np.add.at(turns, (row, np.clip(np.ceil(across - 0.5).astype(int), 0, width)), 1 if y1 > y0 else -1)
    return np.asarray(np.cumsum(turns, axis=1)[:, :width] != 0)


def enlarge(mask: Mask) -> Mask:
    """A mask four times as high and wide, its steps rounded."""
    height, width = mask.shape
    large = cv2.resize(mask.astype(np.float32), (width * UP, height * UP), interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.GaussianBlur(large, (0, 0), UP / 2) > 0.5)


def measure(leaf: FlatLobedLeaf, true: Mask, seconds: float) -> Figures:
    """The figures of one leaf."""
    corners = leaf.ties.places()[leaf.ties.quads()] * [1, -1]
    area = leaf.ties.areas()
    filled = np.zeros(true.shape, np.uint8)
    for each in corners:
        cv2.fillPoly(filled, [np.round(each * UP * 16 - 8).astype(np.int32)], 1, shift=4)
    cover = filled > 0
    away = cv2.distanceTransform((~_rim(true)).astype(np.uint8), cv2.DIST_L2, 5)[_rim(cover)] / UP
    before, after = np.roll(corners, 1, axis=1) - corners, np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(before, axis=2), np.linalg.norm(after, axis=2)
    long = (lengths[0] > 1e-6) & (lengths[1] > 1e-6)
    cosine = (before * after).sum(axis=2)[long] / (lengths[0] * lengths[1])[long]
    angle_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    spline = evaluate_closed(leaf.silhouette.control_px, 20) * [1, -1]
    own = fill_winding(spline * UP, *true.shape)
    return Figures(
        iou=float((cover & true).sum() / (cover | true).sum()),
        p95_px=float(np.percentile(away, 95)),
        overlap=float(np.abs(area).sum() * UP * UP / cover.sum() - 1),
        flipped=int((area <= 0).sum()),
        bad_corners=float((angle_deg < 5).mean()),
        spline_iou=float((own & true).sum() / (own | true).sum()),
        controls=len(leaf.silhouette.control_px),
        ties=len(leaf.ties.node),
        lobes=leaf.lobes,
        seconds=seconds,
    )


def _rim(filled: Mask) -> Mask:
    return np.asarray(cv2.morphologyEx(filled.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3))) > 0)


def masks(data: Path) -> Iterator[Case]:
    """The masks of leaf-masks-100species."""
    for kind in ("multi_lobed", "single_lobed"):
        for path in sorted((data / "leaf-masks-100species" / kind).iterdir()):
            mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 127
            yield Case(name=path.stem, mask=mask, true=enlarge(mask), lobed=kind == "multi_lobed")


def disturb(mask: Mask, rng: np.random.Generator) -> Mask:
    """A mask with an outline that is uneven by about a pixel."""
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 1.5)
    return np.asarray(soft + 0.12 * cv2.GaussianBlur(rng.normal(size=mask.shape), (0, 0), 0.8) > 0.5)


def draw(leaf: FlatLobedLeaf, case: Case, text: str) -> NDArray[np.uint8]:
    """A tile with the mask, the ties and the skeleton of a leaf."""
    rows, columns = np.nonzero(case.mask)
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
    scale = (TILE_PX - 24) / float((high - low).max() + 1)
    tile = np.full((TILE_PX, TILE_PX, 3), 255, np.uint8)
    shift = np.array([[scale, 0, 4 - low[0] * scale], [0, scale, 20 - low[1] * scale]])
    gray = cv2.warpAffine(case.mask.astype(np.uint8) * 60, shift, (TILE_PX, TILE_PX))
    tile -= gray[..., None]

    def at(points: Floats) -> NDArray[np.int32]:
        return np.round((points * [1, -1] * scale + [4, 20] - low * scale) * 16).astype(np.int32)

    for node, foot in zip(leaf.ties.nodes[leaf.ties.node], leaf.ties.foot, strict=True):
        cv2.polylines(tile, [at(np.array([node, foot]))], False, (200, 160, 60), 1, cv2.LINE_AA, 4)
    cv2.polylines(tile, [at(leaf.ties.foot)], True, (0, 120, 0), 1, cv2.LINE_AA, 4)
    for nodes in leaf.ties.limb_nodes:
        cv2.polylines(tile, [at(leaf.ties.nodes[nodes])], False, (0, 0, 220), 2, cv2.LINE_AA, 4)
    base = at(leaf.ties.nodes[leaf.ties.base])
    cv2.circle(tile, (int(base[0]), int(base[1])), 48, (255, 0, 255), cv2.FILLED, cv2.LINE_AA, 4)
    cv2.putText(tile, text, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return tile


def line(name: str, figures: Figures, lobed: bool) -> str:
    """One row of the table."""
    missed = figures.misses(lobed)
    cells = [
        f"{getattr(figures, key):{form}}{'*' if missed[key] else ' '}"
        for key, form in (
            ("iou", "7.4f"), ("p95_px", "6.2f"), ("overlap", "8.5f"), ("flipped", "4d"), ("bad_corners", "7.4f"),
            ("spline_iou", "7.4f"), ("controls", "4d"), ("ties", "5d"), ("lobes", "3d"), ("seconds", "6.2f"),
        )
    ]  # fmt: skip
    return f"{name:34}" + " ".join(cells)


def measure_scans(data: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """A row and a tile for each vine scan: along the medial axis, veins that were traced by hand, and found ones."""
    for path in sorted((data / "leaf-scans-grapevine").glob("*.jpg")):
        start = time.process_time()
        found = cut_out_leaves(np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]))
        cut, scale = found.leaves[0], np.array(found.scale)
        (row, column), (height, width) = cut.corner, cut.mask.shape
        picture = np.ascontiguousarray(found.reduced[row : row + height, column : column + width])
        split = split_petiole(picture, cut.mask)
        blade = open_sinuses(split.blade).mask
        traced = measure_veins(picture, split.blade, split.petiole)
        base = choose_base(split.ends, traced, split.blade) * [1, -1] if len(split.ends) else None
        before = time.process_time() - start

        def polygon(
            kind: str, path: Path = path, scale: Floats = scale, low: Floats = np.array([column, row])
        ) -> Floats:
            return (np.loadtxt(path.with_name(f"{path.stem}_{kind}.txt"))[:, :2] + 0.5) / scale - low

        true = fill_winding(polygon("blade") * UP, height * UP, width * UP)
        region = fill_winding(polygon("veins"), height, width)
        away = cv2.distanceTransform((~region).astype(np.uint8), cv2.DIST_L2, 5)
        width_px = np.ptp(np.flatnonzero(true.any(axis=0))) / UP
        for how, veins in (("axis", None), ("given veins", draw_veins(region, blade)), ("found veins", traced)):
            start = time.process_time()
            leaf = model_lobed_leaf(blade, base_px=base, veins=veins)
            figures = measure(leaf, true, time.process_time() - start + before)
            lines = [leaf.ties.nodes[nodes] for nodes in leaf.ties.limb_nodes]
            places = [spread_evenly(each, 300) * [1, -1] for each in lines]
            near = [
                (away[np.clip(each[:, 1].astype(int), 0, height - 1), np.clip(each[:, 0].astype(int), 0, width - 1)]
                < 0.01 * width_px).mean() for each in places
            ]  # fmt: skip
            on_veins = np.average(near, weights=[arc_lengths(each)[-1] for each in lines])
            text = f"{path.stem[-14:]} {how}"
            case = Case(name=text, mask=blade, true=true, lobed=True)
            extra = f"  on veins {on_veins:.3f}, p95 {100 * figures.p95_px / width_px:.2f} % of the width"
            yield line(text, figures, True) + extra, draw(leaf, case, text)


def write_sheet(path: Path, tiles: list[NDArray[np.uint8]]) -> None:
    """Tiles beside and below each other in one picture."""
    across = 7 if len(tiles) > 9 else 3
    tiles = tiles + [np.full_like(tiles[0], 255)] * (-len(tiles) % across)
    cv2.imwrite(str(path), np.vstack([np.hstack(tiles[k : k + across]) for k in range(0, len(tiles), across)]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=REPO.parent / "shared" / "data")
    parser.add_argument("--every", type=int, default=1, help="measure each so manieth mask")
    parser.add_argument("--only", default="", help="measure masks whose names contain this")
    parser.add_argument("--turned", action="store_true", help="turn each mask by 90, 180 and 270 degrees too")
    parser.add_argument("--noise", action="store_true", help="make each outline uneven by about a pixel too")
    parser.add_argument("--scans", action="store_true", help="measure the vine scans instead of masks")
    parser.add_argument("--sheet", type=Path, help="write a picture of masks, skeletons and ties here")
    options = parser.parse_args()
    if not options.data.is_dir():
        print(f"{options.data} is absent", file=sys.stderr)
        return 2
    print(f"{'leaf':34}    IoU     p95  overlap flip  corners  spline ctrl  ties lobe    CPU")
    if options.scans:
        tiles = []
        for text, tile in measure_scans(options.data):
            print(text, flush=True)
            tiles.append(tile)
        if options.sheet:
            write_sheet(options.sheet, tiles)
        return 0
    found: list[tuple[Case, Figures]] = []
    tiles = []
    changed: list[str] = []
    rng = np.random.default_rng(0)
    cases = [case for case in masks(options.data) if options.only.lower() in case.name.lower()][:: options.every]
    for case in cases:
        leaf, figures = _run(case)
        found.append((case, figures))
        print(line(case.name, figures, case.lobed), flush=True)
        others = [(f"turned {90 * k}", np.rot90(case.mask, k)) for k in (1, 2, 3) if options.turned]
        others += [("noise", disturb(case.mask, rng))] * options.noise
        for how, mask in others:
            other, own = _run(replace(case, name=how, mask=mask, true=enlarge(mask)))
            if own.lobes != figures.lobes or own.iou < 0.96 or own.flipped:
                changed.append(
                    f"{case.name} {how}: {figures.lobes} lobes, then {own.lobes}; {line('', own, case.lobed)}"
                )
                tiles.append(draw(other, replace(case, mask=mask), f"{case.name[:22]} {how} {own.lobes}"))
        tiles.append(draw(leaf, case, f"{case.name[:28]} {figures.lobes}"))
    print(*changed, sep="\n")
    every = np.array([each.iou for _, each in found])
    print(
        f"{len(found)} leaves: IoU mean {every.mean():.4f}, lowest {every.min():.4f}; "
        f"p95 highest {max(each.p95_px for _, each in found):.2f} px; "
        f"overlap highest {max(each.overlap for _, each in found):.5f}; "
        f"flipped {sum(each.flipped for _, each in found)}; "
        f"corners highest {max(each.bad_corners for _, each in found):.4f}; "
        f"spline IoU lowest {min(each.spline_iou for _, each in found):.4f}; "
        f"CPU mean {np.mean([each.seconds for _, each in found]):.2f} s; "
        f"beyond what is asked {sum(any(each.misses(case.lobed).values()) for case, each in found)}; "
        f"changed by turns and noise {len(changed)}"
    )
    if options.sheet:
        write_sheet(options.sheet, tiles)
    return 0


def _run(case: Case) -> tuple[FlatLobedLeaf, Figures]:
    start = time.process_time()
    leaf = model_lobed_leaf(case.mask)
    return leaf, measure(leaf, case.true, time.process_time() - start)


if __name__ == "__main__":
    raise SystemExit(main())
