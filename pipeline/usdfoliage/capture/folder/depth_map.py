"""Depth maps: files in, metres along the optical axis out."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.capture.folder.raster import read_raster
from usdfoliage.errors import CaptureError
from usdfoliage.files.library_text import library_text

DEPTH_SUFFIXES = (".exr", ".png")
DEPTH_CHANNEL = "Z"
_OTHER_CHANNELS = ("Y", "R", "depth")  # what other programs call a single one
_FAR_M = 1e6  # renderers write 1e10 where a ray meets nothing
_MM = 0.001


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthMap:
    """What a depth file states."""

    depth_m: NDArray[np.float32]  # (H, W), along the optical axis, finite, 0 where there is none
    channel: str  # where it stood, "Z" in a right OpenEXR, "" in a PNG
    not_finite: int  # pixels that were NaN or infinite, now 0
    negative: int  # pixels, now 0
    far: int  # pixels beyond any photograph, now 0


class _Window(NamedTuple):
    """A rectangle of pixels of an EXR."""

    left: int
    top: int
    width: int
    height: int

    @property
    def size(self) -> tuple[int, int]:
        return self.width, self.height


def read_depth(path: Path, width_px: int, height_px: int) -> DepthMap:
    """Read a depth map: OpenEXR in metres, channel Z; or PNG of 16 bits in millimetres, as depth cameras write.

    Values that are not finite, negative, or beyond 1000 km are taken as none, and counted. An OpenEXR may have a single
    channel of another common name (Y, R, depth) instead.

    Args:
        path: The file.
        width_px: Of its photograph.
        height_px: Of its photograph.

    Raises:
        CaptureError: The file cannot be read, has another size than its photograph, or no channel of depth.
    """
    if path.suffix.lower() == ".png":
        values, channel = _read_millimetres(path, width_px, height_px), ""
    else:
        values, channel = _read_exr(path, width_px, height_px)
    not_finite = ~np.isfinite(values)
    values[not_finite] = 0
    negative, far = values < 0, values > _FAR_M
    values[negative | far] = 0
    counts = [int(np.count_nonzero(bad)) for bad in (not_finite, negative, far)]
    return DepthMap(depth_m=values, channel=channel, not_finite=counts[0], negative=counts[1], far=counts[2])


def _read_millimetres(path: Path, width_px: int, height_px: int) -> NDArray[np.float32]:
    raster = read_raster(path)
    height, width, channels = raster.color.shape
    _check_size(path, (width, height), (width_px, height_px))
    if raster.color.dtype != np.uint16 or channels != 1:
        raise CaptureError(
            f"{path} has {channels} channels of {raster.color.dtype}; "
            f"depth in PNG must be grey of 16 bits, in millimetres"
        )
    return np.asarray(raster.color[..., 0] * np.float32(_MM))


def _read_exr(path: Path, width_px: int, height_px: int) -> tuple[NDArray[np.float32], str]:
    if not path.is_file():
        raise CaptureError(f"{path} does not exist or is no file", "give a depth map")
    # By OpenImageIO: the OpenEXR module prints on stdout about what is damaged.
    source = oiio.ImageInput.open(str(path))
    if source is None or source.format_name() != "openexr":
        reason = library_text(oiio.geterror) or "no reason given"
        raise CaptureError(f"{path} is no OpenEXR file that can be read ({reason})", "copy it again")
    try:
        spec = source.spec()
        if spec.deep or spec.depth > 1:
            raise CaptureError(f"{path} is a deep or volume image", "give one depth a pixel")
        data = _Window(spec.x, spec.y, spec.width, spec.height)
        display = _Window(spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        if (width_px, height_px) not in (data.size, display.size):  # before memory is taken for a damaged size
            _check_size(path, data.size, (width_px, height_px))
        names = [str(name) for name in spec.channelnames]
        name = _choose_channel(path, names)
        channel = names.index(name)
        pixels = source.read_image(0, 0, channel, channel + 1, "float")
        failure = library_text(source.geterror) or "no reason given"
        if pixels is None or source.has_error:
            raise CaptureError(f"{path} is truncated or damaged ({failure})", "copy it again")
    except UnicodeDecodeError as error:
        raise CaptureError(f"{path} has names that are not Unicode", "copy it again") from error
    finally:
        source.close()
    values = np.array(pixels, np.float32).reshape(data.height, data.width)
    return values if data.size == (width_px, height_px) else _displayed(values, data, display), name


def _displayed(values: NDArray[np.float32], data: _Window, display: _Window) -> NDArray[np.float32]:
    """The display window of a cropped or overscanned map; 0 where it has no data."""
    displayed = np.zeros((display.height, display.width), np.float32)
    left, top = max(data.left, display.left), max(data.top, display.top)
    right = min(data.left + data.width, display.left + display.width)
    bottom = min(data.top + data.height, display.top + display.height)
    if right > left and bottom > top:
        displayed[top - display.top : bottom - display.top, left - display.left : right - display.left] = values[
            top - data.top : bottom - data.top, left - data.left : right - data.left
        ]
    return displayed


def _choose_channel(path: Path, names: list[str]) -> str:
    if DEPTH_CHANNEL in names:
        return DEPTH_CHANNEL
    if len(names) == 1 and names[0].lower() in [name.lower() for name in _OTHER_CHANNELS]:
        return names[0]
    raise CaptureError(
        f"{path} has the channels {', '.join(names)[:80] or 'none'}; depth needs one called {DEPTH_CHANNEL}"
    )


def _check_size(path: Path, size: tuple[int, int], photo: tuple[int, int]) -> None:
    if size != photo:
        raise CaptureError(
            f"the depth map {path} is {size[0]}×{size[1]} pixels, its photograph {photo[0]}×{photo[1]}; "
            f"they must have the same size"
        )
