"""Photographs: files in, linear Rec.709 out."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from usdfoliage.capture.folder.raster import Raster, read_raster
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.remarks import Remark, Setting, remark

logger = logging.getLogger(__name__)

SRGB = "sRGB"
LINEAR = "linear"

# Names people use, and what OpenColorIO's own configuration calls the same.
_OCIO_NAMES = {
    "srgb": "srgb_rec709_scene",
    "linear": "lin_rec709_scene",
    "adobe rgb": "g22_adobergb_scene",
    "display p3": "srgb_p3d65_scene",
    "acescg": "lin_ap1_scene",
    "aces2065-1": "lin_ap0_scene",
    "linear rec.2020": "lin_rec2020_scene",
}
_OWN_CONFIG = "ocio://default"  # comes with OpenImageIO
_LINEAR_NAMES = ("lin_rec709_scene", "lin_rec709", "lin_srgb", "Linear Rec.709 (sRGB)", "Utility - Linear - sRGB")

# x, y of red, green, blue and white, as an EXR states them.
_CHROMATICITIES = {
    LINEAR: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    "ACEScg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "ACES2065-1": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
    "linear Rec.2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Photo:
    """A photograph, upright."""

    path: Path
    linear: NDArray[np.float32]  # (H, W, 3), linear Rec.709, scene-referred, not negative
    alpha: NDArray[np.float32] | None  # (H, W) in [0, 1], a hint at the mask; None where it states nothing
    color_space: str  # what the file was read as
    orientation: int  # EXIF orientation that was undone, 1 for none
    remarks: tuple[Remark, ...] = ()  # on its colours

    @property
    def width_px(self) -> int:
        return int(self.linear.shape[1])

    @property
    def height_px(self) -> int:
        return int(self.linear.shape[0])


def read_photo(path: Path, color_space: str | None = None) -> Photo:
    """Read a photograph: JPEG, HEIC, PNG, TIFF, EXR and what else OpenImageIO reads, and raw files of cameras.

    Integers are sRGB and floats linear Rec.709 unless the file's ICC profile, EXIF or EXR chromaticities state another.
    The colour is straight: divided by alpha where the file keeps it multiplied, 0 where alpha is 0.

    Args:
        path: The file; of several pictures in it the first is taken.
        color_space: Read as this, whatever the file states: sRGB, linear, Adobe RGB, Display P3, ACEScg, ACES2065-1,
            linear Rec.2020, or a name of the OpenColorIO configuration ($OCIO, else OpenColorIO's own).

    Raises:
        CaptureError: The file cannot be used (see read_raster), or the colour space is unknown.
    """
    raster = read_raster(Path(path))
    space, remarks = (color_space, ()) if color_space else _stated_color_space(raster)
    alpha = None if raster.alpha is None else np.clip(_as_float(raster.alpha), 0, 1)
    linear = _to_linear(raster, alpha, space)
    if alpha is not None and float(alpha.min()) == float(alpha.max()):
        alpha = None
    if linear.shape[2] == 1:
        linear = np.repeat(linear, 3, axis=2)
    logger.info("%s: %d×%d, read as %s", raster.path, linear.shape[1], linear.shape[0], space)
    return Photo(
        path=raster.path, linear=linear, alpha=alpha, color_space=space, orientation=raster.orientation, remarks=remarks
    )


def _stated_color_space(raster: Raster) -> tuple[str, tuple[Remark, ...]]:
    """What the file states of its colours; for silence, sRGB for integers and linear for floats. With remarks on it."""
    if raster.chromaticities:
        for space, expected in _CHROMATICITIES.items():
            if np.allclose(raster.chromaticities, expected, atol=2e-3):
                return space, ()
        raise CaptureError(
            f"{raster.path} has chromaticities {', '.join(f'{value:g}' for value in raster.chromaticities)}, "
            f"of none of {', '.join(_CHROMATICITIES)}",
            "convert it to linear Rec.709 or state its colour space",
        )
    if raster.is_float:
        return LINEAR, ()
    profile = raster.profile.lower()
    if "adobe rgb" in profile or raster.interoperability == "R03":
        return "Adobe RGB", ()
    if "display p3" in profile or "p3 d65" in profile:  # as Apple calls it, and as Samsung does
        return "Display P3", ()
    if profile and "srgb" not in profile:
        text = f"the colour profile {raster.profile!r} is not known, and the photograph is read as sRGB"
        remedy = ("convert it to sRGB, or state ", Setting(name="capture.toml:color_space"))
        return SRGB, (remark("color-profile-unknown", text, subject=raster.path.name, remedy=remedy),)
    return SRGB, ()


def _to_linear(raster: Raster, alpha: NDArray[np.float32] | None, space: str) -> NDArray[np.float32]:
    straight = alpha is None or not raster.premultiplied
    if space.lower() in (SRGB.lower(), LINEAR):
        decode = decode_srgb if space.lower() == SRGB.lower() else np.asarray
        if straight and not raster.is_float:  # a table costs a fraction of the power function
            levels = np.iinfo(raster.color.dtype).max
            table = np.asarray(decode(np.arange(levels + 1) / levels), np.float32)
            return np.asarray(table[raster.color])
        return np.asarray(decode(_straight_color(raster, alpha)), np.float32)

    encoded = _straight_color(raster, alpha)
    linear = _convert_by_ocio(raster.path, encoded, space)
    outside = int(np.count_nonzero(linear < 0))
    if outside:
        logger.info("%s: %d values outside Rec.709 are set to 0", raster.path, outside)
    return np.maximum(linear, 0)


def _straight_color(raster: Raster, alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    color = _as_float(raster.color)
    if alpha is None or not raster.premultiplied:
        return color
    covered = alpha[..., None] > 0
    return np.where(covered, color / np.where(covered, alpha[..., None], 1), 0).astype(np.float32)


def _as_float(values: NDArray[Any]) -> NDArray[np.float32]:
    if values.dtype == np.float32:
        return np.asarray(values, np.float32)
    return np.asarray(values / np.float32(np.iinfo(values.dtype).max), np.float32)


def _convert_by_ocio(path: Path, encoded: NDArray[np.float32], space: str) -> NDArray[np.float32]:
    name = _OCIO_NAMES.get(space.lower(), space)
    for source in ("", _OWN_CONFIG):  # "" is $OCIO
        config = oiio.ColorConfig(source)
        if config.geterror() or config.getColorSpaceIndex(name) < 0:
            continue
        target = next((target for target in _LINEAR_NAMES if config.getColorSpaceIndex(target) >= 0), None)
        if target is None:
            continue
        rgb = encoded if encoded.shape[2] == 3 else np.repeat(encoded, 3, axis=2)
        result = oiio.ImageBufAlgo.colorconvert(oiio.ImageBuf(rgb), name, target, False, "", "", source)
        if not result.has_error:
            return np.asarray(result.get_pixels(oiio.FLOAT), np.float32)
    raise CaptureError(
        f"the colour space {space!r} of {path} is unknown",
        f"use {', '.join([SRGB, *list(_OCIO_NAMES)[1:]])}, or a name of the OpenColorIO configuration",
    )
