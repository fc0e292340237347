"""Colours of HEIC pictures and of videos, as numbers state them, to linear Rec.709.

Sources: ITU-T H.273, tables 2 and 3; ITU-R BT.2100-2, tables 4 and 5; ITU-R BT.2087, section 2 of annex 2; ITU-R
BT.2408-7, 2.1: diffuse white is 203 cd/m², or 75 % of the signal of HLG.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.color import decode_srgb

_REC2020, _DISPLAY_P3 = 9, 12  # primaries
_PQ, _HLG, _LINEAR = 16, 18, 8  # transfer characteristics
_WHITE_CD_M2 = 203.0

# Linear Rec.709 from linear colours of these primaries, all of white D65.
_FROM_REC2020 = np.array(
    [[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349], [-0.018151, -0.100579, 1.118730]]
)
_FROM_DISPLAY_P3 = np.array([[1.224940, -0.224940, 0.0], [-0.042057, 1.042057, 0.0], [-0.019638, -0.078636, 1.098274]])


@dataclass(frozen=True, kw_only=True)
class CodedColor:
    """Colour as a box "colr" of the kind nclx states it."""

    primaries: int = 2  # 2: unspecified
    transfer: int = 2

    @property
    def is_srgb(self) -> bool:
        """Whether the picture is shown rightly as sRGB: the curves of SDR video differ from it by less than screens."""
        return self.primaries not in (_REC2020, _DISPLAY_P3) and self.transfer not in (_PQ, _HLG, _LINEAR)

    @property
    def is_display_p3(self) -> bool:
        """Whether it is Display P3."""
        return self.primaries == _DISPLAY_P3 and self.transfer not in (_PQ, _HLG, _LINEAR)

    @property
    def is_hdr(self) -> bool:
        """Whether highlights above white are coded."""
        return self.transfer in (_PQ, _HLG)


def read_coded_color(content: bytes) -> CodedColor | None:
    """What a box "colr" states; None where that is a profile or nothing."""
    if content[:4] not in (b"nclx", b"nclc") or len(content) < 8:
        return None
    return CodedColor(primaries=int.from_bytes(content[4:6], "big"), transfer=int.from_bytes(content[6:8], "big"))


def linear_from_coded(encoded: NDArray[np.floating], color: CodedColor) -> NDArray[np.float32]:
    """Scene-referred linear Rec.709, 1 for diffuse white, not negative.

    Args:
        encoded: (..., 3), red, green and blue as coded, 0 to 1.
        color: How.
    """
    encoded = np.asarray(encoded, np.float32)
    if color.transfer == _PQ:
        linear = _decode_pq(encoded) / _WHITE_CD_M2
    elif color.transfer == _HLG:
        linear = _decode_hlg(encoded) / _decode_hlg(np.array(0.75, np.float32))
    elif color.transfer == _LINEAR:
        linear = encoded
    else:
        linear = np.asarray(decode_srgb(encoded), np.float32)
    matrix = {_REC2020: _FROM_REC2020, _DISPLAY_P3: _FROM_DISPLAY_P3}.get(color.primaries)
    if matrix is not None:
        linear = linear @ matrix.T.astype(np.float32)
    return np.maximum(linear, 0).astype(np.float32)


def _decode_pq(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """cd/m² (BT.2100-2, table 4)."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    power = np.clip(encoded, 0, 1) ** (1 / m2)
    return np.asarray(10_000 * (np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1), np.float32)


def _decode_hlg(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light of the scene, 0 to 1 (BT.2100-2, table 5)."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    signal = np.clip(encoded, 0, 1)
    bright = (np.exp((np.maximum(signal, 0.5) - c) / a) + b) / 12
    return np.asarray(np.where(signal <= 0.5, signal**2 / 3, bright), np.float32)
