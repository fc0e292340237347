"""Every photograph to an asset through the command line, validated, with one sheet of pictures to look at.

usage: tools/bench/gallery.py [-o out/gallery] [--size 256] [--only NAME …] [--data ../shared/data]

Photographs with a mask use it, the others get a proposal. For each a line: silhouette IoU and its star-shaped bound,
exit code and findings of the validation, seconds. The sheet has one row a photograph: the photograph with the
silhouette, then the front, three-quarter, right and back of the asset.
"""

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from tools.bench.crown import DATA, find_cases

HEIGHT_PX = 300
PICTURES = ("input.jpg", "preview.png", "preview_three_quarter.png", "preview_right.png", "preview_back.png")


def find_unmasked(data: Path) -> list[Path]:
    """Tree photographs of data without a mask."""
    photos = sorted([*data.glob("tree-photos-*/*.jpg")])
    masked = {case.photo for case in find_cases(data)}
    return [photo for photo in photos if photo not in masked]


def run(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "usdfoliage", *map(str, words)], capture_output=True, text=True, check=False
    )


def draw_row(asset: Path) -> np.ndarray:
    """The pictures of one report side by side; grey where one is missing."""
    cells = []
    for name in PICTURES:
        picture = cv2.imread(str(asset / "report" / name))
        if picture is None:
            picture = np.full((HEIGHT_PX, HEIGHT_PX, 3), 128, np.uint8)
        scale = min(HEIGHT_PX / picture.shape[0], HEIGHT_PX / picture.shape[1])
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        cell = np.full((HEIGHT_PX, HEIGHT_PX, 3), 40, np.uint8)
        top, left = (HEIGHT_PX - small.shape[0]) // 2, (HEIGHT_PX - small.shape[1]) // 2
        cell[top : top + small.shape[0], left : left + small.shape[1]] = small
        cells.append(cell)
    return np.hstack(cells)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/gallery"))
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--only", nargs="+")
    parser.add_argument("--data", type=Path, default=DATA)
    options = parser.parse_args()
    jobs = [(case.name, case.photo, case.mask) for case in find_cases(options.data)]
    jobs += [(photo.stem, photo, None) for photo in find_unmasked(options.data)]
    jobs = [job for job in jobs if not options.only or job[0] in options.only]
    rows, failures = [], 0
    for name, photo, mask in jobs:
        asset = options.output / name
        start = time.perf_counter()
        made = run("crown", photo, *(["--mask", mask] if mask else []), "-o", asset, "--size", options.size)
        seconds = time.perf_counter() - start
        if made.returncode:
            print(f"{name}: {made.stderr.strip()}")
            failures += 1
            continue
        checked = run("validate", asset, "--json")
        findings = json.loads(checked.stdout)
        value = dict(re.findall(r"^(.+?): ([\d.]+)$", made.stdout, re.MULTILINE))
        iou, bound = float(value["silhouette IoU, aligned"]), float(value["star-shaped bound"])
        print(
            f"{name}: mask {'given' if mask else 'proposed'}; IoU {value['silhouette IoU']}, aligned {iou:.4f} = "
            f"{iou / bound:.3f} of its bound {bound:.4f}; validate exit {checked.returncode}, "
            f"{summarise(findings)}; {seconds:.1f} s"
        )
        failures += checked.returncode != 0
        rows.append(draw_row(asset))
        sys.stdout.flush()
        cv2.imwrite(str(options.output / "sheet.jpg"), np.vstack(rows))
    print(f"{len(rows)} assets, {failures} failures; {options.output / 'sheet.jpg'}")
    return 1 if failures else 0


def summarise(report: dict[str, object]) -> str:
    return ", ".join(f"{key} {value}" for key, value in report.items() if isinstance(value, int))


if __name__ == "__main__":
    sys.exit(main())
