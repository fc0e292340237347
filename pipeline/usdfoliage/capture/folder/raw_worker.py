"""The part of reading a camera's raw file that calls LibRaw, in a process of its own: what it prints is not shown, and
where it crashes, only that process ends.

usage: python -P raw_worker.py FILE MAX_PIXELS

It is run by its path and imports nothing of usdfoliage, so that it starts at once. The standard output has a line of
JSON, with "error" or with width, height and the orientation that was undone, and then the pixels: 16 bits, red, green,
blue, row by row.
"""

import json
import sys
from collections.abc import Sequence
from typing import Any

_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}  # EXIF orientation by LibRaw's flip


def main(arguments: Sequence[str]) -> int:
    """Develop one file; 0, or 1 where that cannot be."""
    path, max_pixels = arguments[0], int(arguments[1])
    import rawpy

    try:
        with rawpy.imread(path) as raw:
            sizes = raw.sizes
            if sizes.raw_width * sizes.raw_height > max_pixels:
                return _report({"too_large": [sizes.raw_width, sizes.raw_height]})
            pixels = raw.postprocess(
                # Nothing is decided by what a photograph shows: so those of one camera remain comparable.
                use_camera_wb=False,  # neither: the camera's daylight, the same for all
                use_auto_wb=False,
                no_auto_bright=True,
                adjust_maximum_thr=0.0,  # white is where the sensor saturates, not the brightest pixel
                gamma=(1, 1),
                output_bps=16,
                output_color=rawpy.ColorSpace.sRGB,
                highlight_mode=rawpy.HighlightMode.Clip,
            )
    except (rawpy.LibRawError, rawpy.NotSupportedError, ValueError, RuntimeError, OSError, MemoryError) as error:
        reason = error.args[0] if error.args else type(error).__name__
        return _report({"error": reason.decode(errors="replace") if isinstance(reason, bytes) else str(reason)})
    _report({"width": pixels.shape[1], "height": pixels.shape[0], "orientation": _FLIPS.get(sizes.flip, 1)})
    sys.stdout.buffer.write(pixels.tobytes())
    sys.stdout.buffer.flush()
    return 0


def _report(line: dict[str, Any]) -> int:
    sys.stdout.buffer.write(json.dumps(line).encode() + b"\n")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
