"""The colour cubemap of a crown from photographs all around it.

Every texel's place on the surface is looked up in the photographs that see it. A mean of many is right in tone and
blurred, since leaves do not lie on the surface; one photograph is sharp. So what is coarse is the mean's, in linear
light, and what is fine is that of the photograph that sees the neighbourhood best. What none sees is synthesised from
what one of them shows, as for a crown of one photograph (thesis section 4.5); the rest is our own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt

from usdfoliage.crown.color_map import ColorMapSettings, build_color_map
from usdfoliage.crown.projection import Exemplar, make_exemplar
from usdfoliage.crown.silhouette_view import draw_silhouette, nearest_depth
from usdfoliage.crown.tone import blur_colors, measure_color_statistics
from usdfoliage.crown.views import ReducedView
from usdfoliage.errors import FitError
from usdfoliage.geometry.color import luminance
from usdfoliage.geometry.cube_field import solve_dirichlet
from usdfoliage.geometry.cubemap import face_directions, share_borders
from usdfoliage.progress import Progress

_BUFFER = 0.42  # pixels of the depth buffer in a radius, of a face's texels: none of the surface's points is missed
_DENSE = 0.7  # share of a silhouette that is leaves, from which on gaps are left out of what is copied
_LABEL_CELL = 8  # texels a side, for which one photograph gives what is fine


@dataclass(frozen=True, kw_only=True)
class SeenColorSettings:
    """Which photographs count for a texel, and what becomes of those that none shows."""

    min_cosine: float = 0.2  # between the surface's normal and the line of sight
    hidden: float = 0.06  # of the radius, that the crown must be in front of a place to hide it
    before: float = 0.15  # of the radius, that measured depth may be in front of a place
    behind: float = 0.4  # of the radius, that it may be behind; beyond, the picture shows the background
    unmeasured: float = 0.05  # weight of a pixel without depth in a photograph with some: it may show what is behind
    kept: int = 6  # photographs of each texel, those that show it best
    outlier: float = 2.5  # median distances from the median brightness, beyond which a photograph is not believed
    coarse_texels: float = 6.0  # standard deviation of what is coarse
    speck_texels: int = 3  # unseen places no farther than this from seen ones get the colour of these
    min_unseen: float = 0.002  # share of texels, below which nothing is synthesised
    feather_texels: float = 3.0  # over which synthesis becomes photograph
    color_map: ColorMapSettings = field(default_factory=ColorMapSettings)

    def __post_init__(self) -> None:
        if not 0 < self.min_cosine < 1:
            raise ValueError(f"min_cosine must be in (0, 1), not {self.min_cosine}")
        if self.kept < 1 or self.speck_texels < 0:
            raise ValueError(f"kept must be 1 or more and speck_texels not negative, not {self}")
        for name in ("hidden", "before", "behind", "outlier", "coarse_texels", "feather_texels"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class SeenColors:
    """What photographs show of a crown."""

    color: NDArray[np.float32]  # (6, N, N, 3), linear Rec.709; 0 where nothing is seen
    seen: NDArray[np.bool_]  # (6, N, N)
    texels: NDArray[np.int64]  # (V,), that each view sees


@dataclass(frozen=True, eq=False)
class _Surface:
    """Texels as points (M, 3) with normals."""

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    center_m: NDArray[np.float64]
    median_m: float
    size: int


def gather_colors(
    radius_m: NDArray[np.floating],
    center_m: NDArray[np.floating],
    views: Sequence[ReducedView],
    settings: SeenColorSettings = SeenColorSettings(),
    progress: Progress | None = None,
) -> SeenColors:
    """The colours of a crown's texels in the photographs that see them.

    Args:
        radius_m: (6, N, N).
        center_m: (3,), in the cameras' world.
        views: All that were taken.
        settings: Which count.
        progress: (done, total) views.
    """
    surface = _lay_surface(radius_m, center_m)
    count, size = len(surface.points_m), surface.size
    weights = np.zeros((settings.kept, count), np.float32)
    colors = np.zeros((settings.kept, count, 3), np.float32)
    source = np.full((settings.kept, count), -1, np.int16)
    cells = -(-size // _LABEL_CELL)
    worth = np.zeros((len(views), 6, cells, cells), np.float32)
    texels = np.zeros(len(views), np.int64)
    for number, view in enumerate(views):
        weight, color = _sample_view(surface, view, settings)
        seen = np.flatnonzero(weight > 0)
        texels[number] = len(seen)
        worth[number] = _cell_means(weight.reshape(6, size, size), cells)
        last = weights[:, seen].argmin(axis=0)
        better = weight[seen] > weights[last, seen]
        last, taken = last[better], seen[better]
        weights[last, taken] = weight[taken]
        colors[last, taken] = color[taken]
        source[last, taken] = number
        if progress:
            progress(number + 1, len(views))
    seen = weights.max(axis=0) > 0
    weights = _agreeing(colors, weights, settings.outlier)
    mean = np.einsum("kmc,km->mc", colors, weights) / np.maximum(weights.sum(axis=0), 1e-20)[:, None]
    sharp = _sharpest(colors, weights, source, worth, size)
    shape = (6, size, size)
    color = _join_scales(mean.reshape(*shape, 3), sharp.reshape(*shape, 3), seen.reshape(shape), settings)
    return SeenColors(color=color, seen=seen.reshape(shape), texels=texels)


def _lay_surface(radius_m: NDArray[np.floating], center_m: NDArray[np.floating]) -> _Surface:
    size = radius_m.shape[1]
    # Relief of a texel or two turns normals in every direction and does not decide who sees the place.
    smooth = blur_colors(np.asarray(radius_m, np.float32)[..., None], 2.0)[..., 0]
    out = face_directions(size)
    rounded = out * smooth[..., None]
    normals = np.cross(np.gradient(rounded, axis=2), np.gradient(rounded, axis=1))
    normals *= np.sign(np.sum(normals * out, axis=-1, keepdims=True))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    return _Surface(
        points_m=(center_m + out * np.asarray(radius_m, np.float64)[..., None]).reshape(-1, 3),
        normals=normals.reshape(-1, 3),
        center_m=np.asarray(center_m, np.float64),
        median_m=float(np.median(radius_m)),
        size=size,
    )


def _sample_view(
    surface: _Surface, view: ReducedView, settings: SeenColorSettings
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What a view shows of each texel: weight (M,), 0 where it shows nothing, and linear colour (M, 3)."""
    camera = view.camera
    place, depth_m = camera.project(surface.points_m)
    middle_m = float(camera.project(surface.center_m[None])[1][0])
    radius_px = surface.median_m * camera.focal_px[0] / middle_m
    shrink = min(1.0, _BUFFER * surface.size / radius_px / 2)
    coarse = camera.resized(max(1, round(camera.width_px * shrink)), max(1, round(camera.height_px * shrink)))
    scale = np.array([coarse.width_px / camera.width_px, coarse.height_px / camera.height_px])
    nearest_m = nearest_depth(place * scale, depth_m, coarse)

    leaves = view.leaves
    toward = camera.position_m - surface.points_m
    away_m = np.linalg.norm(toward, axis=1)
    cosine = np.einsum("nk,nk->n", toward, surface.normals) / np.maximum(away_m, 1e-12)
    seen = (cosine > settings.min_cosine) & (depth_m > 0)
    seen &= (place >= 1).all(axis=1)
    seen &= (place[:, 0] < camera.width_px - 1) & (place[:, 1] < camera.height_px - 1)
    index = np.flatnonzero(seen)
    column, row = place[index].astype(np.intp).T
    low_column, low_row = (place[index] * scale).astype(np.intp).T
    # Of a slanting surface a pixel of the buffer holds nearer and farther places.
    slant = np.sqrt(1 / cosine[index] ** 2 - 1) / (radius_px * shrink)
    is_seen = depth_m[index] <= nearest_m[low_row, low_column] + (settings.hidden + slant) * surface.median_m
    is_seen &= leaves[row, column]
    if view.depth_m is not None:
        # Where nothing was measured, the crown's own surface decides what hides what.
        ahead_m = view.depth_m[row, column] - depth_m[index]
        measured = view.depth_m[row, column] > 0
        is_seen &= ~measured | (
            (ahead_m > -settings.before * surface.median_m) & (ahead_m < settings.behind * surface.median_m)
        )
    trust = np.ones(len(index))
    if view.depth_m is not None and view.mask is None:
        trust = np.where(view.depth_m[row, column] > 0, 1.0, settings.unmeasured)
    index, trust = index[is_seen], trust[is_seen]
    weight = np.zeros(len(place), np.float32)
    color = np.zeros((len(place), 3), np.float32)
    if len(index):
        texel_px = camera.focal_px[0] * surface.median_m / depth_m[index] / surface.size
        weight[index] = trust * cosine[index] ** 2 * texel_px**2
        rows = -(-len(index) // 1024)  # OpenCV has no wider pictures than 32767 pixels
        at = np.zeros((rows * 1024, 2), np.float32)
        at[: len(index)] = place[index] - 0.5
        x, y = np.ascontiguousarray(at.T.reshape(2, rows, 1024))
        found = cv2.remap(view.linear(), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        color[index] = found.reshape(-1, 3)[: len(index)]
    return weight, color


def _cell_means(weight: NDArray[np.float32], cells: int) -> NDArray[np.float32]:
    """(6, cells, cells) of (6, N, N)."""
    size = weight.shape[1]
    at = np.arange(0, size, _LABEL_CELL)
    sums = np.add.reduceat(np.add.reduceat(weight, at, axis=1), at, axis=2)
    counts = np.diff(np.append(at, size)).astype(np.float32)
    means = sums / (counts[:, None] * counts)
    return np.stack([cv2.GaussianBlur(face, (5, 5), 1.0) for face in means]).reshape(6, cells, cells)


def _agreeing(colors: NDArray[np.float32], weights: NDArray[np.float32], outlier: float) -> NDArray[np.float32]:
    """The weights (K, M) of photographs (K, M, 3), 0 for those far from the median brightness of a texel."""
    light = np.sort(np.where(weights > 0, luminance(colors), np.inf), axis=0)
    count = (weights > 0).sum(axis=0)
    every = np.arange(light.shape[1])
    middle = np.where(count > 0, light[np.maximum(count - 1, 0) // 2, every], 0)
    away = np.abs(luminance(colors) - middle)
    ordered = np.sort(np.where(weights > 0, away, np.inf), axis=0)
    median_away = np.where(count > 0, ordered[np.maximum(count - 1, 0) // 2, every], 0)
    return np.where(away <= outlier * median_away + 0.02 * middle + 1e-4, weights, 0).astype(np.float32)


def _sharpest(
    colors: NDArray[np.float32],
    weights: NDArray[np.float32],
    source: NDArray[np.int16],
    worth: NDArray[np.float32],
    size: int,
) -> NDArray[np.float32]:
    """(M, 3) of one photograph for a neighbourhood, or of that which shows the texel best where that does not."""
    label = np.zeros((6, size, size), np.int16)
    best = np.full((6, size, size), -np.inf, np.float32)
    for number, of_cells in enumerate(worth):
        of_texels = np.stack([cv2.resize(face, (size, size), interpolation=cv2.INTER_CUBIC) for face in of_cells])
        better = of_texels > best
        best[better] = of_texels[better]
        label[better] = number
    # Within a texel the label's photograph comes before all others.
    rank = np.where((source == label.reshape(-1)) & (weights > 0), np.inf, weights).argmax(axis=0)
    return np.asarray(colors[rank, np.arange(colors.shape[1])])


def _join_scales(
    mean: NDArray[np.float32], sharp: NDArray[np.float32], seen: NDArray[np.bool_], settings: SeenColorSettings
) -> NDArray[np.float32]:
    """What is fine of one photograph on what is coarse of the mean of all."""
    share = seen[..., None].astype(np.float32)
    blurred = blur_colors(np.concatenate([mean * share, sharp * share, share], axis=-1), settings.coarse_texels)
    coverage = np.maximum(blurred[..., 6:], 1e-6)
    ratio = (blurred[..., :3] / coverage + 1e-4) / (blurred[..., 3:6] / coverage + 1e-4)
    return np.where(seen[..., None], sharp * np.clip(ratio, 0.2, 5.0), 0).astype(np.float32)


def fill_unseen(
    colors: SeenColors,
    radius_m: NDArray[np.floating],
    center_m: NDArray[np.floating],
    views: Sequence[ReducedView],
    rng: np.random.Generator,
    settings: SeenColorSettings = SeenColorSettings(),
    progress: Progress | None = None,
) -> tuple[NDArray[np.float32], str]:
    """The colour cubemap (6, N, N, 3) without gaps, borders shared, and how they were filled: a sentence for the user.

    Arguments are those of gather_colors, and its result.

    Raises:
        FitError: No photograph shows the crown.
    """
    if not colors.seen.any():
        raise FitError("no photograph shows the crown", "check that the cameras and the cloud are of one world")
    color, seen = _fill_specks(colors, settings.speck_texels)
    if (~seen).mean() < settings.min_unseen:
        return stretch_colors(color, seen), "photographs show all of the crown"
    inner = np.stack([binary_erosion(face, iterations=2, border_value=1) for face in seen])
    weight = np.where(inner, 1.0, np.where(seen, 0.6, 0.0))  # of build_color_map: kept, and free to be cut
    missing = f"{100 * (~colors.seen).mean():.0f} % of the crown"
    best = views[int(colors.texels.argmax())]
    try:
        exemplar = _cut_exemplar(best, radius_m, center_m)
        made = build_color_map(
            exemplar.color,
            exemplar.mask,
            color,
            weight,
            measure_color_statistics(color, seen),
            rng,
            settings.color_map,
            progress,
        )
    except FitError as error:
        return stretch_colors(color, seen), f"{missing} is seen by no photograph, and smooth: {error}"
    # The synthesis' tone is matched as a whole; where photographs see the crown they stay as they are.
    share = blur_colors(inner[..., None].astype(np.float32), settings.feather_texels)
    share = np.where(seen[..., None], np.clip(2 * share - 1, 0, 1), 0)
    filled = share * color + (1 - share) * made
    text = f"{missing} is seen by no photograph, and synthesised from {best.name}"
    return np.asarray(share_borders(np.maximum(filled, 0).astype(np.float32)), np.float32), text


def _fill_specks(colors: SeenColors, texels: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Unseen texels among seen ones take the colour of those around."""
    color, seen = colors.color.copy(), colors.seen.copy()
    closed = np.stack(
        [
            cv2.morphologyEx(
                np.pad(face.astype(np.uint8), texels, mode="edge"),
                cv2.MORPH_CLOSE,
                np.ones((2 * texels + 1, 2 * texels + 1), np.uint8),
            )[texels : texels + len(face), texels : texels + len(face)]
            > 0
            for face in seen
        ]
    )
    specks = closed & ~seen
    share = seen[..., None].astype(np.float32)
    blurred = blur_colors(np.concatenate([color * share, share], axis=-1), max(texels / 2, 0.5))
    specks &= blurred[..., 3] > 1e-3
    color[specks] = blurred[specks][:, :3] / blurred[specks][:, 3:]
    return color, seen | specks


def stretch_colors(color: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.float32]:
    """A colour cubemap (6, N, N, 3) with what is not seen smoothly between what is, borders shared."""
    filled = color
    if not seen.all():
        nothing = np.zeros(seen.shape)
        filled = np.stack([solve_dirichlet(nothing, seen, color[..., channel]) for channel in range(3)], axis=-1)
    return np.asarray(share_borders(np.maximum(filled, 0).astype(np.float32)), np.float32)


def _cut_exemplar(view: ReducedView, radius_m: NDArray[np.floating], center_m: NDArray[np.floating]) -> Exemplar:
    """The crown in the photograph that shows most of it."""
    middle_m = float(view.camera.project(np.asarray(center_m, np.float64)[None])[1][0])
    median_m = float(np.median(radius_m))
    texel_px = median_m * 2 / (radius_m.shape[1] - 1) * view.camera.focal_px[0] / middle_m
    inside = draw_silhouette(radius_m, center_m, view.camera)
    foliage = inside & view.leaves
    if view.depth_m is not None:
        behind = view.depth_m > middle_m + median_m
        foliage &= ~behind
    if not foliage.any():
        raise FitError(f"{view.name} shows nothing of the crown")
    if foliage.sum() >= _DENSE * inside.sum():
        return make_exemplar(view.linear(), inside, texel_px, foliage)
    # In a sparse crown no patch is whole, and a tiny one repeated is a pattern: its leaves grow together.
    nearest = distance_transform_edt(~foliage, return_distances=False, return_indices=True)
    return make_exemplar(view.linear()[tuple(nearest)], inside, texel_px)
