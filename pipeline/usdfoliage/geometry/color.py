"""Colour encodings: linear Rec.709 <-> sRGB, and luminance.

Both curves go on past [0, 1]: below 0 along their straight piece, above 1 along the power, so that they stay monotone
and nothing is clipped. float32 in gives float32 out, anything else float64.

Source: IEC 61966-2-1:1999 (sRGB), ITU-R BT.709-6.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

_REC709_LUMINANCE = (0.2126, 0.7152, 0.0722)


def encode_srgb(linear: ArrayLike) -> NDArray[np.floating]:
    """sRGB-encoded values of linear ones, any shape."""
    x = _as_floating(linear)
    power = np.maximum(x, 0.0031308) ** x.dtype.type(1 / 2.4)
    return np.where(x <= 0.0031308, x * x.dtype.type(12.92), x.dtype.type(1.055) * power - x.dtype.type(0.055))


def decode_srgb(encoded: ArrayLike) -> NDArray[np.floating]:
    """Linear values of sRGB-encoded ones, any shape."""
    x = _as_floating(encoded)
    power = ((np.maximum(x, 0.04045) + x.dtype.type(0.055)) / x.dtype.type(1.055)) ** x.dtype.type(2.4)
    return np.where(x <= 0.04045, x / x.dtype.type(12.92), power)


def luminance(linear: ArrayLike) -> NDArray[np.floating]:
    """Relative luminance (...) of linear Rec.709 colours (..., 3)."""
    x = _as_floating(linear)
    if x.shape[-1:] != (3,):
        raise ValueError(f"colours must be (..., 3), not {x.shape}")
    return np.asarray(x @ np.array(_REC709_LUMINANCE, x.dtype))


def _as_floating(values: ArrayLike) -> NDArray[np.floating]:
    x = np.asarray(values)
    return x if x.dtype == np.float32 else x.astype(np.float64)
