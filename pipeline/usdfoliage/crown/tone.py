"""Mean and contrast of a crown's colours, and how a cubemap is given those of the photograph."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.cubemap import FACE_AXES, sample_cubemap

_MAX_DETAIL_GAIN = 6.0  # of log-odds; beyond it, noise and compression would show
_DARKEST = 1 / 512  # half a step of 8 bits: log-odds of 0 and 1 are infinite
_FAR = 2.0  # largest shift of log-odds
_SAMPLES = 20_000  # for which gain and shifts are solved


@dataclass(frozen=True, kw_only=True, eq=False)
class ColorStatistics:
    """Mean and standard deviation of each linear channel over the crown's pixels."""

    mean: NDArray[np.float64]  # (3,)
    std: NDArray[np.float64]  # (3,)


def measure_color_statistics(linear: NDArray[np.floating], mask: NDArray[np.bool_] | None = None) -> ColorStatistics:
    """Statistics of linear colours (..., 3), of all of them or of those in mask (...).

    Raises:
        ValueError: nothing in the mask, or shapes do not fit.
    """
    if linear.shape[-1:] != (3,) or (mask is not None and mask.shape != linear.shape[:-1]):
        shape = None if mask is None else mask.shape
        raise ValueError(f"colours must be (..., 3) with a mask (...), not {linear.shape} and {shape}")
    values = (linear if mask is None else linear[mask]).reshape(-1, 3)
    if len(values) == 0:
        raise ValueError("no pixel to measure the colour of")
    return ColorStatistics(mean=values.mean(axis=0, dtype=np.float64), std=values.std(axis=0, dtype=np.float64))


@dataclass(frozen=True, kw_only=True)
class ToneSettings:
    """How near contrast comes to the photograph's, and where it is added."""

    std_ratio: float = 0.97  # contrast to restore, of the photograph's at its own resolution
    detail_texels: float = 4.0  # what is finer than this (standard deviation of a Gaussian) is detail
    blend: float = 1 / 16  # how far tone is blended beside the photograph, as a fraction of a face

    def __post_init__(self) -> None:
        if not 0 < self.std_ratio <= 1:
            raise ValueError(f"std_ratio must be in (0, 1], not {self.std_ratio}")
        if not self.detail_texels > 0:
            raise ValueError(f"detail_texels must be positive, not {self.detail_texels}")
        if not 0 < self.blend <= 0.25:
            raise ValueError(f"blend must be in (0, 0.25], not {self.blend}")


def blend_tone(
    encoded: NDArray[np.float32], photo: NDArray[np.bool_], settings: ToneSettings = ToneSettings()
) -> NDArray[np.float32]:
    """The cubemap with the tone of what lies beside the photograph drawn to the photograph's.

    A photograph is lit unevenly, and parts of it that the synthesis lays beside it may be darker or brighter on the
    whole. Their mean over a neighbourhood becomes the photograph's where the two meet, and less so with distance.

    Args:
        encoded: (6, N, N, 3), sRGB-encoded, in [0, 1].
        photo: (6, N, N), which texels are the photograph's; they stay.
        settings: how far tone is blended.
    """
    if photo.all() or not photo.any():
        return encoded
    value = _log_odds(encoded)
    share = photo[..., None].astype(np.float32)
    sigma = settings.blend * encoded.shape[1]
    near = blur_colors(np.concatenate([value, value * share, share], axis=-1), sigma)
    of_all, of_photo, near_share = near[..., :3], near[..., 3:6], near[..., 6:]
    step = of_photo / np.maximum(near_share, 1e-3) - (of_all - of_photo) / np.maximum(1 - near_share, 1e-3)
    shift = np.clip(step, -_FAR, _FAR) * np.clip(2 * near_share, 0, 1)  # half of a neighbourhood where they meet
    return np.where(photo[..., None], encoded, 1 / (1 + np.exp(-value - shift)))


def match_statistics(
    encoded: NDArray[np.float32],
    unseen: NDArray[np.float32],
    target: ColorStatistics,
    peak: float,
    settings: ToneSettings = ToneSettings(),
) -> NDArray[np.float32]:
    """Linear colours of a cubemap with the target's mean and nearly its contrast.

    A texel averages many pixels of the photograph, which takes contrast from its finest detail. Detail gets it back by
    one gain a channel, the same in photograph and synthesis so that no border appears between them, on values as
    log(v / (1 − v)), where no gain leaves (0, 1) and dark and bright gain equally. What is missing of the mean is added
    where the photograph does not see.

    Args:
        encoded: (6, N, N, 3), sRGB-encoded, in [0, 1].
        unseen: (6, N, N), from 0 where texels are the photograph's to 1 where it sees nothing.
        target: what all texels shall have; where contrast is within settings.std_ratio it stays.
        peak: the linear value that is encoded as 1.
        settings: how much contrast, and what counts as detail.

    Source: our own, after A. C. Öztireli and M. Gross, Perceptually Based Downscaling of Images, 2015, who restore the
        contrast of each neighbourhood.
    """
    value = _log_odds(encoded)
    smooth = blur_colors(value, settings.detail_texels)
    linear = np.empty_like(encoded)
    for channel in range(3):
        texels = _Texels(smooth[..., channel], value[..., channel] - smooth[..., channel], unseen, peak)
        gain, everywhere, aside = _solve_tone(
            texels.sampled(_SAMPLES), float(target.mean[channel]), float(target.std[channel]), settings.std_ratio
        )
        toned = texels.toned(gain, everywhere, aside)
        missing = (target.mean[channel] - toned.mean(dtype=np.float64)) / max((toned * unseen).mean(), 1e-9)
        linear[..., channel] = toned * (1 + unseen * np.float32(np.clip(missing, -0.1, 0.1)))
    return linear


@dataclass(frozen=True, eq=False)
class _Texels:
    """One channel of texels, log-odds of encoded values."""

    smooth: NDArray[np.float32]
    detail: NDArray[np.float32]
    unseen: NDArray[np.float32]  # 0 the photograph's … 1 far from them
    peak: float

    def sampled(self, count: int) -> "_Texels":
        """About so many of them, evenly spread."""
        step = max(1, self.smooth.size // count)
        return _Texels(self.smooth.ravel()[::step], self.detail.ravel()[::step], self.unseen.ravel()[::step], self.peak)

    def toned(self, gain: float, everywhere: float, aside: float) -> NDArray[np.float32]:
        """Linear values with a gain on detail, a shift everywhere and one where the photograph does not see."""
        log_odds = self.smooth + np.float32(gain) * self.detail + np.float32(everywhere)
        log_odds += np.float32(aside) * self.unseen
        return np.asarray(decode_srgb(1 / (1 + np.exp(-log_odds))) * np.float32(self.peak), np.float32)


def _log_odds(encoded: NDArray[np.float32]) -> NDArray[np.float32]:
    value = np.clip(encoded, _DARKEST, 1 - _DARKEST)
    return np.log(value / (1 - value))


def _solve_tone(texels: _Texels, mean: float, std: float, std_ratio: float) -> tuple[float, float, float]:
    """Gain and shifts, as in _Texels.toned, that reach the mean, and the std within std_ratio, with least change."""
    untouched = float(texels.toned(1, 0, 0).mean())

    def shifts(gain: float) -> tuple[float, float]:
        everywhere = _solve_increasing(lambda x: float(texels.toned(gain, x, 0).mean()), untouched, -_FAR, 0, _FAR)
        aside = _solve_increasing(lambda x: float(texels.toned(gain, everywhere, x).mean()), mean, -_FAR, 0, _FAR)
        return everywhere, aside

    def contrast(gain: float) -> float:
        return float(texels.toned(gain, *shifts(gain)).std()) / max(std, 1e-9)

    wanted = float(np.clip(contrast(1), std_ratio, 1 / std_ratio))
    gain = _solve_increasing(contrast, wanted, 0, 1, _MAX_DETAIL_GAIN)
    return gain, *shifts(gain)


def _solve_increasing(
    function: Callable[[float], float], wanted: float, low: float, preferred: float, high: float
) -> float:
    """Where in [low, high] an increasing function is nearest to the wanted value; preferred if it is there already."""
    at_preferred = function(preferred)
    if at_preferred == wanted:
        return preferred
    end = high if at_preferred < wanted else low
    if (function(end) - wanted) * (at_preferred - wanted) >= 0:
        return end
    return float(brentq(lambda x: function(x) - wanted, preferred, end, xtol=1e-3))


def blur_colors(cubemap: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Gaussian blur (standard deviation in texels) of a cubemap (6, N, N, C) across the edges of the cube."""
    size = cubemap.shape[1]
    reach = min(int(np.ceil(2.5 * sigma)), size // 2)
    lattice = np.arange(-reach, size + reach) * (2 / (size - 1)) - 1  # a little past the edges, on the neighbours
    normal, right, up = (FACE_AXES[:, k, None, None, :] for k in range(3))
    directions = normal + lattice[None, None, :, None] * right - lattice[None, :, None, None] * up
    padded = np.empty((6, len(lattice), len(lattice), cubemap.shape[3]), np.float32)
    padded[:, reach:-reach, reach:-reach] = cubemap
    outside = np.ones(padded.shape[1:3], bool)
    outside[reach:-reach, reach:-reach] = False
    padded[:, outside] = sample_cubemap(cubemap, directions[:, outside])
    window = (2 * reach + 1, 2 * reach + 1)
    out = np.empty_like(cubemap)
    for face in range(6):
        blurred = cv2.GaussianBlur(padded[face], window, sigma)[reach:-reach, reach:-reach]
        out[face] = blurred.reshape(out[face].shape)  # OpenCV drops the axis of a single channel
    return out
