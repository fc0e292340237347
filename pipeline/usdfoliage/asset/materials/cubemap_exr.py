"""Cubemaps in OpenEXR files: ``envmap = ENVMAP_CUBE``, one image N × 6N, sampled from edge to edge.

The radius map has one float32 channel ``R``, in metres (Storm reads no other single name); the colour map has half
``R, G, B``, linear with the primaries of Rec.709. What a reader needs beside the pixels is in string attributes whose
names begin with ``foliage:``.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.errors import AssetError
from usdfoliage.files.library_text import library_text
from usdfoliage.files.open_exr import write_open_exr
from usdfoliage.geometry.cubemap import texel_identity

logger = logging.getLogger(__name__)

REC709_CHROMATICITIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # red, green, blue, white: x, y
HALF_MAX = 65504.0
MAX_TEXELS = 8192  # a side of a face that is read
ATTRIBUTE_PREFIX = "foliage:"


@dataclass(frozen=True, kw_only=True, eq=False)
class CubemapFile:
    """What a cubemap file holds."""

    pixels: NDArray[np.floating]  # (6, N, N) of a single channel, (6, N, N, 3) of R, G, B
    attributes: Mapping[str, str]  # the string attributes named foliage:*


def write_radius_cubemap(path: Path, radius_m: NDArray[np.floating], attributes: Mapping[str, str]) -> None:
    """Write distances from a centre, in metres.

    Args:
        path: The file, replaced when it exists.
        radius_m: (6, N, N), finite, positive, borders shared.
        attributes: More string attributes; every name begins with "foliage:".

    Raises:
        ValueError: radius_m is not such a cubemap.
        WriteError: The file cannot be written.
    """
    if radius_m.ndim != 3:
        raise ValueError(f"a radius cubemap must be (6, N, N), not {radius_m.shape}")
    pixels = np.ascontiguousarray(radius_m, dtype=np.float32)
    _check_cubemap(pixels, "radius")
    if pixels.min() <= 0:
        raise ValueError(f"the smallest radius is {pixels.min():g} m; every radius must be above 0")
    header = {"colorInteropID": "data"}
    facts = {"foliage:quantity": "radius", "foliage:unit": "m", **attributes}
    _write(path, {"R": pixels.reshape(-1, pixels.shape[2])}, header, facts)


def write_color_cubemap(path: Path, color: NDArray[np.floating], attributes: Mapping[str, str]) -> None:
    """Write linear Rec.709 colours in half precision; values beyond its range are clamped, with a warning.

    Args:
        path: The file, replaced when it exists.
        color: (6, N, N, 3), finite, borders shared.
        attributes: More string attributes; every name begins with "foliage:".

    Raises:
        ValueError: color is not such a cubemap.
        WriteError: The file cannot be written.
    """
    if color.ndim != 4 or color.shape[3] != 3:
        raise ValueError(f"a colour cubemap must be (6, N, N, 3), not {color.shape}")
    _check_cubemap(color, "colour")
    beyond = int(np.count_nonzero(np.any(np.abs(color) > HALF_MAX, axis=-1)))
    if beyond:
        logger.warning(
            "%d of %d texels of %s exceed %g, the largest half; clamped", beyond, color[..., 0].size, path, HALF_MAX
        )
    pixels = np.clip(color, -HALF_MAX, HALF_MAX).astype(np.float16)
    header = {"colorInteropID": "lin_rec709_scene", "chromaticities": REC709_CHROMATICITIES}
    facts = {"foliage:quantity": "color", "foliage:unit": "linear Rec.709, scene-referred", **attributes}
    _write(path, {"RGB": np.ascontiguousarray(pixels.reshape(-1, color.shape[2], 3))}, header, facts)


def read_cubemap(path: Path) -> CubemapFile:
    """Read a cubemap of one channel or of R, G, B.

    Raises:
        AssetError: The file is missing, no OpenEXR, no cubemap, or has other channels.
    """
    damage = _find_damage(path)  # the OpenEXR module prints on stdout about it
    if damage:
        raise AssetError(f"{path} cannot be read as OpenEXR: {damage}", "write it again")
    try:
        with OpenEXR.File(str(path)) as file:
            header, channels = dict(file.header()), file.channels()  # the file empties its own when it is closed
            names = sorted(channels)
            pixels = [np.array(channels[name].pixels) for name in names]
    except (OSError, RuntimeError, ValueError) as error:
        raise AssetError(f"{path} cannot be read as OpenEXR: {error}") from error
    if header.get("envmap") != OpenEXR.ENVMAP_CUBE:
        raise AssetError(f"{path} is no cubemap; its header must have envmap = ENVMAP_CUBE")
    if len(pixels) != 1 or names[0] not in ("R", "RGB"):
        raise AssetError(f"{path} has the channels {', '.join(names)}; R alone, or R, G and B are needed")
    height, width = pixels[0].shape[:2]
    if height != 6 * width:
        raise AssetError(f"{path} is {width} × {height} pixels; a cubemap is six times as high as wide")
    return CubemapFile(
        pixels=pixels[0].reshape(6, width, width, *pixels[0].shape[2:]),
        attributes={k: v for k, v in header.items() if k.startswith(ATTRIBUTE_PREFIX) and isinstance(v, str)},
    )


def _find_damage(path: Path) -> str:
    """What is wrong with the pixels of a file, "" for nothing."""
    if not path.is_file():
        return "it is missing or no file"
    source = oiio.ImageInput.open(str(path))
    if source is None:
        return library_text(oiio.geterror) or "no image"
    try:
        spec = source.spec()
        if spec.width > MAX_TEXELS or spec.height > 6 * MAX_TEXELS:
            return f"its header states {spec.width} × {spec.height} pixels, at most {MAX_TEXELS} a side are read"
        if source.read_image("half") is None or source.has_error:
            return library_text(source.geterror) or "its pixels end too early"
    finally:
        source.close()
    return ""


def _check_cubemap(cubemap: NDArray[np.floating], what: str) -> None:
    if cubemap.shape[0] != 6 or cubemap.shape[1] != cubemap.shape[2] or cubemap.shape[1] < 2:
        raise ValueError(f"a {what} cubemap has six square faces of 2 texels a side or more, not {cubemap.shape}")
    if not np.all(np.isfinite(cubemap)):
        raise ValueError(f"{np.count_nonzero(~np.isfinite(cubemap))} values of the {what} cubemap are not finite")
    identity = texel_identity(cubemap.shape[1]).ravel()
    _, first, inverse = np.unique(identity, return_index=True, return_inverse=True)
    values = cubemap.reshape(identity.size, -1)
    differ = int(np.count_nonzero(np.any(values != values[first[inverse.ravel()]], axis=1)))
    if differ:
        raise ValueError(
            f"{differ} border texels of the {what} cubemap differ from those they share with the neighbouring face; "
            "share_borders makes them equal"
        )


def _write(
    path: Path, channels: dict[str, NDArray[np.floating]], header: Mapping[str, object], facts: Mapping[str, str]
) -> None:
    foreign = [name for name in facts if not name.startswith(ATTRIBUTE_PREFIX)]
    if foreign:
        raise ValueError(f"attributes are named {ATTRIBUTE_PREFIX}…, not {', '.join(foreign)}")
    cube = {"envmap": OpenEXR.ENVMAP_CUBE, "foliage:cube:sampling": "edge"}
    write_open_exr(path, {**cube, **header, **facts}, channels)
