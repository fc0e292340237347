"""How well masks are proposed: IoU with the masks beside real and synthetic photographs, and the time it takes.

    .venv/bin/python tools/bench/mask_proposal.py [--data ../shared/data] [--overlays FOLDER]

Masks of the urban street set include the stem and are a few pixels wide of the leaves; they bound the IoU below 1.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.masks import read_mask
from usdfoliage.capture.mask_proposal.propose import propose_mask
from usdfoliage.errors import FitError
from usdfoliage.geometry.color import encode_srgb

REPO = Path(__file__).resolve().parents[2]


def photographs(data: Path) -> Iterator[tuple[str, Path, Path | None]]:
    """Name, photograph and, where there is one, mask."""
    for photo in sorted(data.glob("tree-photos-*/*.jpg")):
        candidates = photo.parent / "masks" / f"{photo.stem}.png", photo.parent / f"{photo.stem}_mask.png"
        yield photo.stem, photo, next((mask for mask in candidates if mask.exists()), None)
    for tree in sorted(data.glob("synthetic/tree_photo/*")):
        yield f"synthetic {tree.name}", tree / "images" / "000.jpg", tree / "truth" / "crown_mask_filled.png"


def overlay(linear: np.ndarray, proposed: np.ndarray, truth: np.ndarray | None) -> np.ndarray:
    """The photograph with the proposed silhouette in red and the true one in magenta."""
    picture = np.ascontiguousarray(np.rint(encode_srgb(np.clip(linear[..., ::-1], 0, 1)) * 255).astype(np.uint8))
    width_px = max(1, max(picture.shape) // 250)
    for mask, color in ((truth, (255, 0, 255)), (proposed, (0, 0, 255))):
        if mask is not None:
            lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(picture, lines, -1, color, width_px)
    return picture


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=REPO.parent / "shared" / "data")
    parser.add_argument("--overlays", type=Path, help="write a picture of each silhouette here")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if not options.data.is_dir():
        print(f"{options.data} is absent", file=sys.stderr)
        return 2
    if options.overlays:
        options.overlays.mkdir(parents=True, exist_ok=True)

    scores = []
    print(f"{'photograph':42} {'IoU':>5} {'conf.':>5} {'time':>6}  remark")
    for name, photo_path, mask_path in photographs(options.data):
        photo = read_photo(photo_path)
        start = time.perf_counter()
        try:
            proposal = propose_mask(photo.linear, seed=options.seed)
        except FitError as error:
            print(f"{name:42} {'':5} {'':5} {time.perf_counter() - start:5.2f}s  {error}")
            continue
        seconds = time.perf_counter() - start
        truth = read_mask(mask_path, photo.linear.shape, photo.orientation) if mask_path else None
        iou = ""
        if truth is not None:
            scores.append(np.count_nonzero(proposal.mask & truth) / np.count_nonzero(proposal.mask | truth))
            iou = f"{scores[-1]:.3f}"
        print(f"{name:42} {iou:>5} {proposal.confidence:5.2f} {seconds:5.2f}s  {proposal.remark}")
        if options.overlays:
            cv2.imwrite(str(options.overlays / f"{name}.jpg"), overlay(photo.linear, proposal.mask, truth))
    if scores:
        print(
            f"mean IoU {np.mean(scores):.3f}, median {np.median(scores):.3f}, "
            f"{sum(score >= 0.9 for score in scores)} of {len(scores)} at least 0.9"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
