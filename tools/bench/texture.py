#!/usr/bin/env python3
"""Time the synthesis of a crown's three images from foliage exemplars.

usage: tools/bench/texture.py [EXEMPLAR.png ...] [-o FOLDER] [--size 256] [--seed 0] [--threads 0]
"""

import argparse
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from usdfoliage.crown.texture import TextureSettings, synthesize_sources

EXEMPLARS = Path(__file__).parents[3] / "shared/data/texture-exemplars"


def piece_px(source: np.ndarray) -> float:
    """Side of the piece that the mean pixel was copied with."""
    shift = source - np.stack(np.indices(source.shape[:2]), axis=-1)
    _, area = np.unique(shift.reshape(-1, 2), axis=0, return_counts=True)
    return float(np.sqrt((area.astype(float) ** 2).sum() / area.sum()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("exemplars", nargs="*", type=Path, help=f"pictures of foliage; those of {EXEMPLARS} by default")
    parser.add_argument("-o", "--output", type=Path, help="folder for the images made")
    parser.add_argument("--size", type=int, default=256, help="of the cubemap's faces")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=TextureSettings().threads)
    options = parser.parse_args()

    paths = options.exemplars or sorted(EXEMPLARS.glob("*.png"))
    if not paths:
        print(f"error: no exemplar given and none in {EXEMPLARS}", file=sys.stderr)
        return 2
    band = options.size // 8
    shapes = {"ring": (options.size + 2 * band, 4 * options.size + band)}
    shapes |= dict.fromkeys(("top", "bottom"), (options.size, options.size))

    print(f"{'exemplar':<24}{'image':<8}{'size':>12}{'wall s':>8}{'cpu s':>8}{'piece px':>10}{'unused':>8}")
    for path in paths:
        picture = cv2.imread(str(path))
        if picture is None:
            print(f"error: {path} is not an image", file=sys.stderr)
            return 2
        exemplar = picture.astype(np.float32) / 255
        rng = np.random.default_rng(options.seed)
        total_wall = total_cpu = 0.0
        for name, shape in shapes.items():
            wall, cpu = time.perf_counter(), time.process_time()
            source = synthesize_sources(exemplar, shape, rng, settings=TextureSettings(threads=options.threads))
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            total_wall, total_cpu = total_wall + wall, total_cpu + cpu
            used = np.zeros(exemplar.shape[:2], bool)
            used[source[..., 0], source[..., 1]] = True
            print(
                f"{path.stem:<24}{name:<8}{f'{shape[1]}×{shape[0]}':>12}{wall:8.2f}{cpu:8.2f}"
                f"{piece_px(source):10.1f}{100 * (1 - used.mean()):7.1f}%"
            )
            if options.output is not None:
                options.output.mkdir(parents=True, exist_ok=True)
                target = options.output / f"{path.stem}_{name}.png"
                if not cv2.imwrite(str(target), picture[source[..., 0], source[..., 1]]):
                    print(f"error: cannot write {target}", file=sys.stderr)
                    return 2
        print(f"{path.stem:<24}{'all':<8}{'':>12}{total_wall:8.2f}{total_cpu:8.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
