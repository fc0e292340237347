"""Maps of photographs as pictures, and what their colours mean."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.report.pictures import TURBO, VIRIDIS, color_table, color_values

NOTHING = (46, 48, 52)  # where a map has no value
LEGEND_STOPS = 12
RANGE = (0.01, 0.99)  # quantiles of what a map shows that take the ends of the colours


@dataclass(frozen=True, kw_only=True)
class Legend:
    """What the colours of a picture mean, from left to right."""

    low: str
    high: str
    stops: str  # of a CSS gradient


@dataclass(frozen=True, kw_only=True)
class LegendPicture:
    """A picture with what it shows, and what its colours mean."""

    file: str
    caption: str
    width: int
    legend: Legend | None = None


def depth_limits(depth_m: NDArray[np.floating], mask: NDArray[np.bool_] | None = None) -> tuple[float, float] | None:
    """Nearest and farthest depth (H, W) that colours resolve, of the plant where a mask is; None without depth."""
    known = depth_m > 0
    if mask is not None and (known & mask).any():
        known = known & mask
    if not known.any():
        return None
    near, far = np.quantile(depth_m[known], RANGE)
    return float(near), float(far)


def draw_depth(depth_m: NDArray[np.floating], limits: tuple[float, float] | None) -> NDArray[np.uint8]:
    """(H, W, 3), near is red, far is blue, in even steps of inverse depth, as pixels resolve it."""
    picture = np.full((*depth_m.shape, 3), NOTHING, np.uint8)
    known = depth_m > 0
    if limits is not None:
        picture[known] = color_values(1 / depth_m[known].astype(np.float64), 1 / limits[1], 1 / limits[0], TURBO)
    return picture


def draw_normals(
    normals: NDArray[np.floating], camera: Pinhole, known: NDArray[np.bool_] | None = None
) -> NDArray[np.uint8]:
    """(H, W, 3), normals of the world as the camera sees them: red to the right, green up, blue towards it."""
    in_camera = normals @ camera.cam_from_world[:, :3].T * (1, -1, -1)
    picture = np.rint(np.clip(127.5 + 127.5 * in_camera, 0, 255)).astype(np.uint8)
    has_normal = np.any(normals != 0, axis=2)
    picture[~(has_normal if known is None else has_normal & known)] = NOTHING
    return picture


def draw_confidence(confidence: NDArray[np.floating], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(H, W, 3), from 0, dark blue, to 1, yellow, where anything is known."""
    picture = color_values(confidence, 0, 1, VIRIDIS)
    picture[~known] = NOTHING
    return picture


def draw_shared(shared: NDArray[np.floating], longest_px: int = 640) -> NDArray[np.uint8]:
    """A square for each pair (N, N), brighter where they share more, by the root; white where nothing is shared."""
    count = max(len(shared), 1)
    values = np.zeros((count, count)) if not len(shared) else np.sqrt(np.maximum(shared, 0))
    picture = color_values(values, 0, float(values.max(initial=0)) or 1.0, VIRIDIS)
    picture[values == 0] = (255, 255, 255)
    np.einsum("iic->ic", picture)[:] = (215, 215, 212)
    side = max(1, longest_px // count)
    large = np.repeat(np.repeat(picture, side, axis=0), side, axis=1)
    if side >= 8:  # else lines would be all there is
        large[::side] = large[:, ::side] = (235, 235, 232)
    return large


def in_words(length_m: float) -> str:
    """A length in the unit in which it reads well."""
    for unit, metres in (("km", 1000.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if length_m >= metres * (1 - 1e-9):
            return f"{length_m / metres:.3g} {unit}"
    return f"{length_m * 1e6:.3g} µm"


def make_legend(low: str, high: str, colors: int) -> Legend:
    """What the colours of one of cv2's maps mean."""
    table = color_table(colors)[np.linspace(0, 255, LEGEND_STOPS).astype(int)]
    return Legend(low=low, high=high, stops=", ".join(f"rgb({r}, {g}, {b})" for r, g, b in table.tolist()))
