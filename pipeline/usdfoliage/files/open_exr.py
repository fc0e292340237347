"""OpenEXR files that are compared with what was written to them."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from usdfoliage.files.atomic import whole_file
from usdfoliage.files.unwritten import UNCHANGED, describe_failed


def write_open_exr(path: Path, header: Mapping[str, object], channels: Mapping[str, NDArray[np.floating]]) -> None:
    """Write an image, ZIP compressed and without a date: the same pixels, the same bytes.

    Args:
        path: The file, replaced when it exists.
        header: Attributes beside compression and type.
        channels: By their names (H, W) each, or RGB (H, W, 3).

    Raises:
        WriteError: The file cannot be written, or does not hold what was written to it; what was there is unchanged.
    """
    whole = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    planes = {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    separate = all(plane.ndim == 2 for plane in planes.values())
    with whole_file(path) as new:
        try:
            OpenEXR.File(whole, dict(planes)).write(str(new))  # it changes the dictionaries it is given
            with OpenEXR.File(str(new), separate_channels=separate) as file:
                written = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
        except (RuntimeError, ValueError) as error:
            raise describe_failed(path, error, scratch=new, outcome=UNCHANGED) from error
        # OpenEXR's module reports no full disk: the file is there, and ends too early or holds zeros.
        if written.keys() != planes.keys() or any(not np.array_equal(written[name], planes[name]) for name in planes):
            raise describe_failed(path, "it does not hold what was written to it", scratch=new, outcome=UNCHANGED)
