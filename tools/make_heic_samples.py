"""Make tests/data/heic: coded pictures for the tests of HEIC.

usage: python tools/make_heic_samples.py     needs: pip install pillow-heif, in an environment that is not .venv

The encoder in pillow-heif is x265, whose licence is the GPL: it must not come into the environment of the product.
"""

from pathlib import Path

import numpy as np
import pillow_heif

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data" / "heic"
WIDTH, HEIGHT = 96, 64


def draw() -> np.ndarray:
    """(H, W, 3), 0 to 1: red rises to the right, green downwards."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.dstack([0.1 + 0.8 * columns / WIDTH, 0.1 + 0.8 * rows / HEIGHT, np.full((HEIGHT, WIDTH), 0.4)])


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    picture = draw()
    eight = np.rint(255 * picture).astype(np.uint8)
    pillow_heif.from_bytes("RGB", (WIDTH, HEIGHT), eight.tobytes()).save(FOLDER / "tile8.heic", quality=95)
    ten = np.rint(65535 * picture).astype(np.uint16)
    pillow_heif.from_bytes("RGB;16", (WIDTH, HEIGHT), ten.tobytes()).save(FOLDER / "tile10.heic", quality=95)


if __name__ == "__main__":
    main()
