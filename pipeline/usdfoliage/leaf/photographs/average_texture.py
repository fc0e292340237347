"""The average leaf of a scene as a picture: what photographs show of its leaves, laid out over (u, v).

Colours are those that leaves have on average. Averaged veins are a blur, since no two leaves have theirs at the same
places; they come from the leaves that are most like the average one, brought into register: a few, or many where
leaves are similar. Medians leave out shadows and what stands before leaves, as long as most leaves have none there. Our
own.
"""

import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.view import View
from usdfoliage.geometry.color import luminance
from usdfoliage.leaf.model import Leaves
from usdfoliage.leaf.photographs.colors import DARKEST, DECODED, weighted_median
from usdfoliage.leaf.photographs.reprojection import DrawnLeaves, draw_leaf_ids
from usdfoliage.leaf.photographs.visibility import (
    ABSENT,
    PRESUMED,
    SEEN,
    VisibilitySettings,
    estimate_spread,
    find_sights,
)
from usdfoliage.leaf.shape.surface import grid_places

logger = logging.getLogger(__name__)

_MAX_SIDE_PX = 8192

GREY = 0.18  # linear, of a leaf that nobody saw
VIEWS_A_LEAF = 2  # at most, so that few leaves that are often seen do not make up the average
MIXED_PX = 1.5  # how far from a leaf's silhouette, or from what stands before it, pixels show something else besides
MIN_SEEN = 0.2  # of a leaf; showing less, a photograph adds more seams than leaf
ACROSS = 0.5  # places at which is looked what is seen, across a leaf for one along it: one of these for each pixel
MIN_ROWS = 24
TYPICAL_STEP = 3  # of so many texels along and across, one is enough for the typical colour
REDUCED = 4  # texels a side that share a low frequency
MIN_SHARE = 0.25  # of the pictures: where fewer show leaf, colours come from around
VEIN = 0.02  # of the height: standard deviation that parts single veins from what is wider
MAX_TYPICAL = 24  # of the pictures, the most typical: what veins come from
SIMILAR = 0.75  # of the likeness of the likest: pictures as like as this, or more, all give their veins
OFTEN_SEEN = 0.4  # of the pictures: where fewer show leaf, veins fade
SMOOTH = 0.06  # of the height: standard deviation that parts colour and shade from veins
REACH = 0.05  # of the height: farthest that veins are moved to fit others
FLOW_SMOOTH = 0.06  # of the width
CLEAR = 2.0  # standard deviations to which veins are drawn as they are
STRONGEST = 3.0  # factor by which veins may be strengthened to what they are on single leaves
OCTAVES_TO_BYTES = 100.0  # of the pictures that optical flow compares


@dataclass(frozen=True, kw_only=True)
class AverageTextureSettings:
    """Size of the picture, and what goes into it."""

    width_px: int = 128  # The texture is this wide, from silhouette to silhouette. Unit: pixels. Range: 16 to 8192.
    height_px: int = 256  # The texture is this high, from base to apex. Unit: pixels. Range: 16 to 8192.
    # The texture is made of at most this many unwrapped leaves, those seen largest first. Range: 1 or more.
    max_pictures: int = 64
    vein_pictures: int = 3  # Veins come from this many of them; 0 draws no veins. Range: 0 or more.
    # Opacity rises from 0 to 1 between these two shares of the leaves that reach a place. Range: 0 to 1, rising.
    edge: tuple[float, float] = (0.25, 0.75)
    visibility: VisibilitySettings = field(default_factory=VisibilitySettings)

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 16:
            raise ValueError(
                f"the picture must be 16 pixels wide and high or more, not {self.width_px, self.height_px}"
            )
        if max(self.width_px, self.height_px) > _MAX_SIDE_PX:
            raise ValueError(
                f"the picture must be at most {_MAX_SIDE_PX} pixels wide and high, not {self.width_px, self.height_px}"
            )
        if self.max_pictures < 1 or self.vein_pictures < 0:
            raise ValueError(
                f"max_pictures must be 1 or more and vein_pictures 0 or more, not {self.max_pictures} and "
                f"{self.vein_pictures}"
            )
        if not 0 <= self.edge[0] < self.edge[1] <= 1:
            raise ValueError(f"edge must rise, from 0 to 1, not {self.edge}")

    @property
    def uv(self) -> NDArray[np.float64]:
        """(height_px * width_px, 2), row by row from the top, where v is 1."""
        u = (np.arange(self.width_px) + 0.5) / self.width_px * 2 - 1
        return grid_places(u, 1 - (np.arange(self.height_px) + 0.5) / self.height_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class AverageTexture:
    """A picture of a leaf in its st = ((u + 1) / 2, v): the base is the last row, the apex the first."""

    rgba: NDArray[np.float32]  # (H, W, 4), linear Rec.709, not multiplied by opacity
    leaves: int  # how many leaves are in it


class _Unwrapped(NamedTuple):
    """K pictures of single leaves over (u, v)."""

    octaves: NDArray[np.float32]  # (K, H, W, 3), logarithms of linear colours
    weight: NDArray[np.float32]  # (K, H, W), 0 where the leaf is not seen
    reached: NDArray[np.float32]  # (H, W), how many of them have leaf there
    absent: NDArray[np.float32]  # (H, W), how many show what lies behind instead


def average_leaf_texture(
    leaves: Leaves,
    views: Sequence[View],
    settings: AverageTextureSettings = AverageTextureSettings(),
    *,
    threads: int = 0,
) -> AverageTexture:
    """Unwrap the leaves that are seen best and average them.

    The opacity is how far real leaves fill the surfaces that were fitted to them. Where no leaf was seen, colours
    come from around. Without any leaf seen the picture is plain grey.

    Args:
        leaves: In the world of the views, base and apex distinguished.
        threads: 0: one per core. The result is the same.
    """
    spread = estimate_spread(leaves, views, settings.visibility)
    drawn = [
        draw_leaf_ids(leaves, view.camera, settings.visibility.draw) if (view.depth_m <= 0).any() else None
        for view in views
    ]
    pairs = _choose_pictures(leaves, views, drawn, spread, settings)
    if not pairs:
        rgba = np.full((settings.height_px, settings.width_px, 4), GREY, np.float32)
        rgba[..., 3] = 1
        return AverageTexture(rgba=rgba, leaves=0)
    unwrapped = _unwrap(pairs, leaves, views, drawn, spread, settings, threads)
    typical = np.stack([_typical(one, seen) for one, seen in zip(*unwrapped[:2], strict=True)])
    octaves = unwrapped.octaves - typical[:, None, None]  # leaves differ in colour, photographs in exposure
    shade = _low_frequencies(octaves, unwrapped.weight)
    average = np.median(typical, axis=0) + _average_shade(shade, unwrapped.weight, settings)
    if settings.vein_pictures:
        veins = luminance(octaves - _enlarge(shade, settings)).astype(np.float32)
        average += _pick_veins(veins, unwrapped.weight, settings.vein_pictures, threads)[..., None]
    rgba = np.dstack([2**average, _opacity(unwrapped, settings)]).astype(np.float32)
    count = len({leaf for _, leaf in pairs})
    logger.info("an average leaf of %d pictures of %d leaves", len(pairs), count)
    return AverageTexture(rgba=rgba, leaves=count)


def _choose_pictures(
    leaves: Leaves,
    views: Sequence[View],
    drawn: Sequence[DrawnLeaves | None],
    spread: float,
    settings: AverageTextureSettings,
) -> list[tuple[int, int]]:
    """Numbers of view and leaf, all of the side that is seen more.

    Those first that show most pixels; leaves come a second time, from another view, only where there are too few.
    """
    uv = grid_places((np.arange(6) + 0.5) / 3 - 1, (np.arange(10) + 0.5) / 10)
    pixels = np.zeros((len(views), len(leaves)))
    for number, view in enumerate(views):
        sights = find_sights(leaves, view, uv, spread, settings.visibility, drawn[number])
        away = np.linalg.norm(leaves.base_m - view.camera.position_m, axis=1)
        seen = np.mean(sights.inner * sights.facing, axis=1)
        seen[np.mean(sights.inner, axis=1) < MIN_SEEN] = 0
        pixels[number] = seen * (leaves.length_m * max(view.camera.focal_px) / np.maximum(away, 1e-12)) ** 2
    pixels *= 1 if pixels.sum() >= 0 else -1
    order = np.argsort(-pixels, axis=0, kind="stable")[:VIEWS_A_LEAF]  # best views of each leaf first
    best = np.take_along_axis(pixels, order, axis=0)
    rank, leaf = np.nonzero(best > 0)
    chosen = np.lexsort((leaf, -best[rank, leaf], rank))[: settings.max_pictures]
    return [(int(order[rank[place], leaf[place]]), int(leaf[place])) for place in chosen]


def _unwrap(
    pairs: list[tuple[int, int]],
    leaves: Leaves,
    views: Sequence[View],
    drawn: Sequence[DrawnLeaves | None],
    spread: float,
    settings: AverageTextureSettings,
    threads: int,
) -> _Unwrapped:
    size = (settings.height_px, settings.width_px)
    octaves, weight = np.zeros((len(pairs), *size, 3), np.float32), np.zeros((len(pairs), *size), np.float32)

    def unwrap(number: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Into octaves and weight, what one view shows; returns its shares of reached and absent."""
        view = views[number]
        places = [place for place, pair in enumerate(pairs) if pair[0] == number]
        leaves_seen = leaves.take([pairs[place][1] for place in places])
        # Finer than the photograph, nothing is to be learnt of what is seen where.
        away = np.linalg.norm(leaves_seen.base_m - view.camera.position_m, axis=1)
        length_px = float(np.max(leaves_seen.length_m / np.maximum(away, 1e-12))) * max(view.camera.focal_px)
        rows, columns = (max(MIN_ROWS, int(share * length_px)) for share in (1, ACROSS))
        coarse = (min(size[0], rows), min(size[1], columns))
        uv = replace(settings, height_px=coarse[0], width_px=coarse[1]).uv
        sights = find_sights(leaves_seen, view, uv, spread, settings.visibility, drawn[number])
        reached, absent = np.zeros(size, np.float32), np.zeros(size, np.float32)
        for one, place in enumerate(places):
            at = sights.places_px[one].reshape(*coarse, 2)
            clear = _leave_out_mixed(sights.inner[one].reshape(coarse), at)
            octaves[place] = np.log2(_sample(view, _resize(at.astype(np.float32), size)))
            weight[place] = _resize(clear * np.abs(sights.facing[one]).reshape(coarse).astype(np.float32), size)
            state = sights.state[one].reshape(coarse)
            reached += _resize(((state == SEEN) | (state == PRESUMED)).astype(np.float32), size)
            absent += _resize((state == ABSENT).astype(np.float32), size)
        return reached, absent

    numbers = sorted({number for number, _ in pairs})
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        shares = list(pool.map(unwrap, numbers))
    reached, absent = np.sum(np.array(shares), axis=0)
    return _Unwrapped(octaves, weight, reached, absent)


def _sample(view: View, at: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W, 3), linear colours at places (H, W, 2) of the photograph; beyond it, those of its border."""
    # OpenCV counts from the centre of the first pixel.
    last = np.array([view.camera.width_px, view.camera.height_px], np.float32) - 1
    at = np.clip(np.nan_to_num(at - np.float32(0.5)), 0, last)
    x, y = at[..., 0], at[..., 1]
    left, top, right, bottom = int(x.min()), int(y.min()), int(x.max()), int(y.max())
    part = DECODED[view.srgb[top : bottom + 2, left : right + 2]].astype(np.float32)
    at -= np.array([left, top], np.float32)
    seen = cv2.remap(part, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.maximum(seen, np.float32(DARKEST))


def _leave_out_mixed(inner: NDArray[np.bool_], at: NDArray[np.float64]) -> NDArray[np.float32]:
    """(H, W), 1 where a leaf is seen, falling to 0 where pixels show something else besides.

    Args:
        inner: (H, W), where it is seen.
        at: (H, W, 2), place in the photograph.
    """
    rows, columns = inner.shape
    along_px = np.linalg.norm(np.diff(at[:, columns // 2], axis=0), axis=1).mean()
    across_px = np.linalg.norm(np.diff(at[rows // 2], axis=0), axis=1).mean()
    # Odd numbers of rows and columns; of a leaf that is seen from its edge, nothing is left.
    down, aside = (
        2 * min(int(np.ceil(MIXED_PX / max(px, 1e-6))), limit) + 1
        for px, limit in ((along_px, rows), (across_px, columns))
    )
    border = cv2.BORDER_CONSTANT
    clear = cv2.erode(inner.astype(np.float32), np.ones((down, aside), np.uint8), borderType=border, borderValue=0)
    return np.asarray(cv2.blur(clear, (aside, down)) * clear, np.float32)


def _resize(picture: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w[, C]) as (H, W[, C])."""
    if picture.shape[:2] == size:
        return picture
    return np.asarray(cv2.resize(picture, size[::-1], interpolation=cv2.INTER_LINEAR))


def _typical(octaves: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """(3,), the median colour of a picture (H, W, 3) where it is seen."""
    some, counted = octaves[::TYPICAL_STEP, ::TYPICAL_STEP], weight[::TYPICAL_STEP, ::TYPICAL_STEP]
    if not counted.any():
        some, counted = octaves, np.maximum(weight, 1e-6)
    return weighted_median(some[counted > 0], counted[counted > 0]).astype(np.float32)


def _low_frequencies(octaves: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colour and shade without veins, reduced: (K, h, w, 3); what is not seen does not count."""
    height, width = weight.shape[1:]
    reduced = (max(4, width // REDUCED), max(4, height // REDUCED))
    sigma = SMOOTH * reduced[1]
    shade = np.empty((len(octaves), reduced[1], reduced[0], 3), np.float32)
    for place, (one, seen) in enumerate(zip(octaves, weight, strict=True)):
        known = np.dstack([one * seen[..., None], seen])
        known = cv2.GaussianBlur(cv2.resize(known, reduced, interpolation=cv2.INTER_AREA), (0, 0), sigma)
        shade[place] = known[..., :3] / np.maximum(known[..., 3:], 1e-4)
    return shade


def _enlarge(shade: NDArray[np.float32], settings: AverageTextureSettings) -> NDArray[np.float32]:
    """(K, H, W, 3) of (K, h, w, 3)."""
    size = (settings.width_px, settings.height_px)
    return np.stack([cv2.resize(one, size, interpolation=cv2.INTER_LINEAR) for one in shade])


def _average_shade(
    shade: NDArray[np.float32], weight: NDArray[np.float32], settings: AverageTextureSettings
) -> NDArray[np.float32]:
    """Median over pictures, (H, W, 3), of those that show a place, filled in from around where none does."""
    height, width = shade.shape[1:3]
    seen = np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_AREA) for one in weight])
    used = seen > 0.05
    middle = _median_of_pictures(shade, np.where(used, seen, 0)[..., None])
    known = used.sum(axis=0) >= max(1, MIN_SHARE * len(shade))
    filled = np.where(known[..., None], middle, 0).astype(np.float32)
    near = known.astype(np.float32)
    sigma = 1.0
    while not known.all() and sigma < 2 * height:
        share = cv2.GaussianBlur(near, (0, 0), sigma)
        around = cv2.GaussianBlur(filled * near[..., None], (0, 0), sigma) / np.maximum(share, 1e-6)[..., None]
        new = ~known & (share > 1e-3)
        filled[new] = around[new]
        known |= new
        sigma *= 2
    return np.asarray(cv2.resize(filled, (settings.width_px, settings.height_px), interpolation=cv2.INTER_CUBIC))


def _median_of_pictures(values: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Weighted median over the first axis of values (K, ...); 0 where weights (K, ...) are."""
    weight = np.broadcast_to(weight, values.shape)
    order = np.argsort(values, axis=0)
    summed = np.cumsum(np.take_along_axis(weight, order, axis=0), axis=0)
    place = np.argmax(summed >= summed[-1] / 2, axis=0)
    middle = np.take_along_axis(values, np.take_along_axis(order, place[None], axis=0), axis=0)[0]
    return np.where(summed[-1] > 0, middle, np.float32(0))


def _pick_veins(
    veins: NDArray[np.float32], weight: NDArray[np.float32], count: int, threads: int
) -> NDArray[np.float32]:
    """Light and dark (H, W) of the most typical picture and those most like it, their median.

    Args:
        veins: (K, H, W), octaves about the low frequencies.
        count: How many pictures at least.
    """
    median = np.median([_deviation(one, seen) for one, seen in zip(veins, weight, strict=True)])
    limit = CLEAR * median  # beyond are shadows and the dark of edges
    veins = np.clip(veins, -limit, limit)
    total = np.maximum(weight.sum(axis=0), 1e-6)
    mean = np.sum(veins * weight, axis=0) / total
    often = np.mean(weight > 0, axis=0)
    typical = np.array(
        [_likeness(one, mean, seen) * np.mean(seen > 0) for one, seen in zip(veins, weight, strict=True)]
    )
    first = np.argsort(-typical, kind="stable")[: max(count, MAX_TYPICAL)]
    veins, weight, best = veins[first], weight[first], 0
    moved, moved_weight = _register(veins, weight, best, threads)
    likeness = np.array(
        [_likeness(one, veins[best], seen * weight[best]) for one, seen in zip(moved, moved_weight, strict=True)]
    )
    order = np.argsort(-likeness, kind="stable")
    similar = order[: max(count, int(np.count_nonzero(likeness >= SIMILAR * np.sort(likeness)[-2:].min())))]
    summed, used = np.zeros(mean.shape, np.float32), np.zeros(mean.shape, np.float32)
    for place in order:
        share = np.minimum(np.clip(4 * moved_weight[place], 0, 1), count - used)
        summed += share * (moved[place] - _blur_seen(moved[place], moved_weight[place]))
        used += share
    lines = np.where(used > 0, summed / np.maximum(used, 1e-6), 0)
    # Laid over each other, veins are fainter than on any leaf.
    fine = np.median([_deviation(one - _blur_seen(one, seen), seen) for one, seen in zip(veins, weight, strict=True)])
    lines *= min(STRONGEST, max(1.0, fine / max(_deviation(lines, used), 1e-6)))
    # What is wider than veins and on some leaves only is shadow: the median of many has none.
    wide = _median_of_pictures(moved[similar], moved_weight[similar])
    seen = np.clip(4 * np.sum(moved_weight[similar], axis=0), 0, 1)
    picked = lines + _blur_seen(wide, seen)
    # Where few leaves are seen, they are seen by mistake: others' edges and shadows.
    inside = np.minimum(used, 1) * np.clip(often / OFTEN_SEEN, 0, 1)
    return np.asarray(inside * limit * np.tanh(picked / max(limit, 1e-6)))


def _blur_seen(veins: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """What is wider than single veins of a picture (H, W), from where it is seen."""
    sigma = VEIN * len(veins)
    near = cv2.GaussianBlur(weight, (0, 0), sigma)
    return np.asarray(cv2.GaussianBlur(veins * weight, (0, 0), sigma) / np.maximum(near, 1e-4), np.float32)


def _register(
    veins: NDArray[np.float32], weight: NDArray[np.float32], best: int, threads: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Veins and weights moved, a little and smoothly, to where those of one picture are."""
    height, width = weight.shape[1:]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    target = _as_bytes(veins[best], weight[best])
    moved, moved_weight = veins.copy(), weight.copy()

    def move(places: list[int]) -> None:
        flow_between = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)  # it keeps a state: one a thread
        for place in places:
            flow = flow_between.calc(target, _as_bytes(veins[place], weight[place]), None)
            flow = np.clip(cv2.GaussianBlur(flow, (0, 0), FLOW_SMOOTH * width), -REACH * height, REACH * height)
            map_x, map_y = x + flow[..., 0], y + flow[..., 1]
            moved[place] = cv2.remap(veins[place], map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            moved_weight[place] = cv2.remap(weight[place], map_x, map_y, cv2.INTER_LINEAR)

    others = [place for place in range(len(veins)) if place != best]
    workers = threads or os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(move, [others[start::workers] for start in range(workers)]))
    return moved, moved_weight


def _as_bytes(veins: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip(128 + OCTAVES_TO_BYTES * veins * (weight > 0), 0, 255).astype(np.uint8)


def _likeness(first: NDArray[np.float32], second: NDArray[np.float32], weight: NDArray[np.float32]) -> float:
    """Correlation about zero."""
    norm = float(np.sum(first**2 * weight)) * float(np.sum(second**2 * weight))
    return float(np.sum(first * second * weight)) / np.sqrt(norm) if norm > 0 else 0.0


def _deviation(veins: NDArray[np.float32], weight: NDArray[np.float32]) -> float:
    """Standard deviation from the median, since shadows and edges are stronger than veins."""
    seen = np.abs(veins[weight > 0])
    return 1.4826 * float(np.median(seen)) if len(seen) else 0.0


def _opacity(unwrapped: _Unwrapped, settings: AverageTextureSettings) -> NDArray[np.float32]:
    """(H, W), from the share of leaves that reach a place; 1 where nothing is known of any."""
    known = unwrapped.reached + unwrapped.absent
    share = np.where(known > 0, unwrapped.reached / np.maximum(known, 1), 1)
    low, high = settings.edge
    t = np.clip((cv2.GaussianBlur(share, (0, 0), 1.0) - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)
