"""Where trees, shrubs and grass are, found in the orthophoto and the canopy height where no raster of classes is given.

The thesis segments by hand (Argudo, section 6.1). Ours decides by height where there is a canopy, by green where there
is an orthophoto, and parts crowns from lawns by their texture: leaves and gaps of a crown differ in light from one
half metre to the next, grass does not.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from usdfoliage.forest.raster import Raster, is_inside, pixel_grid, sample_nearest, to_pixels
from usdfoliage.forest.tree_tops import LOWEST_M, fill_canopy

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

FINEST_M = 0.25  # of texture: finer pixels are averaged
CLASS_M = 0.5  # side of the pixels of classes that come from an orthophoto alone
GREEN = 0.05, 0.2  # range in which the least green of vegetation lies
ROUGH = 0.2, 0.35  # range in which the least texture of crowns lies
COLOR_M = 0.5  # standard deviation of the blur of colours
TEXTURE_M = 1.0  # likewise of what texture is measured against, and over
SHRUBS_M = 0.4  # height from which on plants are shrubs
ROOF_M = 0.12  # a canopy that is so near to a plane is a roof
ROOF_PX = 5  # side of the square in which it is asked
FEW = 0.5  # of the crowns that are seen, which have the texture of crowns in a picture that shows it
HIDDEN_M = 3.0  # radius of a crown at least, that a place without one could hold
SPECK_PX = 3  # side of the median that takes single pixels out of classes
DARKEST = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class PhotoTexture:
    """How green and how rough an orthophoto is."""

    grid: Raster  # (H, W, 3) colours that these are of
    green: Floats  # (H, W)
    rough: Floats  # (H, W)


@dataclass(frozen=True, kw_only=True, eq=False)
class VegetationClasses:
    """Masks over one grid; no two of them have a pixel in common."""

    grid: Raster  # (H, W, …), whose values mean nothing
    tree: Mask  # (H, W)
    shrub: Mask
    grass: Mask
    photo: PhotoTexture | None = None  # of the orthophoto, where it alone decided


def find_classes(orthophoto: Raster | None, canopy: Raster | None) -> VegetationClasses | None:
    """Where which kind of plant is; None where neither picture is given.

    Args:
        orthophoto: (H, W, 3) linear colours, NaN where it shows nothing. Without it there is no grass.
        canopy: (H, W) metres above the ground. Without it there are no shrubs, and trees are where it is rough.
    """
    if canopy is not None:
        height_m = fill_canopy(canopy.values)
        green, seen = _green_over(canopy, orthophoto)
        tall = height_m >= LOWEST_M
        roof = tall & _is_flat(height_m) & ~green
        roof = ndimage.binary_opening(roof, np.ones((ROOF_PX, ROOF_PX), bool))
        roof = ndimage.binary_dilation(roof, np.ones((3, 3), bool)) & tall
        known = ndimage.binary_dilation(np.isfinite(canopy.values), iterations=SPECK_PX)  # holes of a few pixels too
        return VegetationClasses(
            grid=canopy,
            tree=tall & ~roof,
            shrub=_without_specks((green | ~seen) & (height_m >= SHRUBS_M) & ~tall),
            grass=_without_specks(green & known & (height_m < SHRUBS_M)),
        )
    if orthophoto is None:
        return None
    photo = measure_texture(orthophoto)
    grid = _averaged(orthophoto, CLASS_M)
    bound = _dividing_value(photo.green, GREEN)
    green = _block_mean(photo.green, photo.grid, grid) > bound
    rough = _block_mean(photo.rough, photo.grid, grid) > _dividing_value(photo.rough[photo.green > bound], ROUGH)
    tree = _without_specks(green & rough)
    grass = _without_specks(green & ~tree)
    return VegetationClasses(grid=grid, tree=tree, shrub=np.zeros_like(tree), grass=grass, photo=photo)


def measure_texture(orthophoto: Raster) -> PhotoTexture:
    """How green and how rough an orthophoto (H, W, 3) of linear colours is, on pixels of FINEST_M or its own."""
    fine = _averaged(orthophoto, FINEST_M)
    return PhotoTexture(grid=fine, green=green_index(fine), rough=crown_texture(fine))


def _green_over(grid: Raster, orthophoto: Raster | None) -> tuple[Mask, Mask]:
    """(H, W) of a grid, where the orthophoto is green, and where it shows anything."""
    shape = grid.values.shape[:2]
    green = np.zeros(shape[0] * shape[1], bool)
    seen = green.copy()
    if orthophoto is not None:
        fine = _averaged(orthophoto, FINEST_M)
        index = green_index(fine)
        places_m = pixel_grid(grid).reshape(-1, 2)
        covered = is_inside(fine, places_m)
        values = Raster(values=index, ground_from_pixel=fine.ground_from_pixel, crs=fine.crs)
        found = sample_nearest(values, places_m[covered])
        seen[covered] = np.isfinite(found)
        green[covered] = found > _dividing_value(index, GREEN)
    return green.reshape(shape), seen.reshape(shape)


def are_rough(photo: PhotoTexture, ground_m: Floats, radius_m: Floats) -> Mask:
    """(N,) whether discs have the texture of crowns; lawns that stand out by their colour have not.

    Where few of all have it, the picture is too coarse or too smooth to show any, and all count as rough.

    Args:
        photo: Of an orthophoto.
        ground_m: (N, 2) middles of the discs, inside the orthophoto.
        radius_m: (N,).
    """
    bound = _dividing_value(photo.rough[photo.green > GREEN[0]], ROUGH)
    values = replace(photo.grid, values=photo.rough)
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    discs = np.concatenate([[(0.0, 0.0)], *(share * ring for share in (0.4, 0.8))])
    places_m = ground_m[:, None] + radius_m[:, None, None] * discs
    found = sample_nearest(values, places_m.reshape(-1, 2)).reshape(len(ground_m), len(discs))
    known = np.isfinite(found)
    mean = np.where(known, found, 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    rough = np.asarray((mean >= bound) | ~known.any(axis=1))
    return rough if rough.mean() >= FEW else np.ones(len(rough), bool)


def find_hidden_trees(classes: VegetationClasses, ground_m: Floats, radius_m: Floats) -> Mask:
    """(H, W) of the ground of trees what no crown covers, without the gaps that are narrower than a crown is.

    Args:
        classes: As they were found.
        ground_m: (N, 2) middles of the crowns that are seen singly.
        radius_m: (N,) their radii.
    """
    left = classes.tree & ~find_covered(classes.grid, classes.tree, ground_m, radius_m)
    typical_m = float(np.median(radius_m)) if len(radius_m) else HIDDEN_M
    size = 2 * max(1, round(max(typical_m, HIDDEN_M) / classes.grid.cell_m)) + 1
    return np.asarray(ndimage.binary_opening(left, _disc(size)))


def find_covered(grid: Raster, mask: Mask, ground_m: Floats, radius_m: Floats) -> Mask:
    """(H, W) of the pixels of a mask those under crowns.

    Args:
        grid: Where the pixels lie.
        mask: (H, W).
        ground_m: (N, 2) middles of crowns.
        radius_m: (N,) their radii.
    """
    height, width = mask.shape
    covered = np.zeros(mask.shape, bool)
    middle = to_pixels(grid, ground_m)
    matrix = grid.ground_from_pixel[:, :2]
    # A circle on the ground reaches so far along columns and along rows, in pixels, whichever way they lie.
    reach = radius_m[:, None] * np.linalg.norm(np.linalg.inv(matrix), axis=1)
    first = np.clip(np.floor(middle - reach), 0, [width, height]).astype(np.int64)
    last = np.clip(np.ceil(middle + reach), 0, [width, height]).astype(np.int64)
    for (left, top), (right, bottom), (x, y), radius in zip(
        first.tolist(), last.tolist(), middle.tolist(), radius_m.tolist(), strict=True
    ):
        across, down = np.arange(left, right) + 0.5 - x, np.arange(top, bottom)[:, None] + 0.5 - y
        east, north = (a * across + b * down for a, b in matrix)
        covered[top:bottom, left:right] |= east * east + north * north < radius * radius
    return covered & mask


def green_index(orthophoto: Raster) -> Floats:
    """(H, W) how green: twice the share of green in the light, less those of red and blue (Woebbecke and others, Color
    indices for weed identification, 1995); NaN where the picture shows nothing. Light and shade do not change it."""
    sigma = COLOR_M / orthophoto.cell_m
    color = np.asarray(_blurred(orthophoto.values, sigma))
    share = color / np.maximum(color.sum(axis=-1, keepdims=True), DARKEST)
    return np.asarray(2 * share[..., 1] - share[..., 0] - share[..., 2])


def crown_texture(orthophoto: Raster) -> Floats:
    """(H, W) standard deviation of the logarithm of light about its mean around a pixel; NaN where nothing is seen."""
    sigma = TEXTURE_M / orthophoto.cell_m
    seen = np.isfinite(orthophoto.values).all(axis=-1)
    light = np.log(np.maximum(orthophoto.values @ np.array([0.2126, 0.7152, 0.0722]), 10 * DARKEST))
    around = _blurred(light, sigma)
    deviation = np.sqrt(_blurred((light - around) ** 2, sigma))
    return np.asarray(np.where(seen, deviation, np.nan))


def _blurred(values: NDArray[np.floating], sigma: float) -> Floats:
    """Blurred over rows and columns, NaN left out of the mean and NaN again."""
    seen = np.isfinite(values)

    def blur(of: NDArray[np.generic]) -> NDArray[np.float32]:
        border = cv2.BORDER_REPLICATE
        return np.asarray(cv2.GaussianBlur(of.astype(np.float32), (0, 0), sigma, borderType=border), np.float32)

    summed = blur(np.where(seen, values, 0))
    if seen.all():
        return summed.astype(np.float64)
    return np.where(seen, summed / np.maximum(blur(seen), np.float32(1e-6)), np.nan)


def _dividing_value(values: Floats, between: tuple[float, float]) -> float:
    """What divides values into two groups best (Otsu, A threshold selection method from gray-level histograms, 1979),
    kept in a range."""
    known = values[np.isfinite(values)]
    if not len(known):
        return between[0]
    counts, edges = np.histogram(known, 256, np.percentile(known, [0.5, 99.5]) + np.array([0.0, 1e-6]))
    middle = (edges[1:] + edges[:-1]) / 2
    below = np.cumsum(counts)
    above = below[-1] - below
    summed = np.cumsum(counts * middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = below * above * (summed / below - (summed[-1] - summed) / above) ** 2
    best = int(np.nanargmax(np.where(above > 0, apart, -1)))
    return float(np.clip(edges[best + 1], *between))


def _is_flat(height_m: Floats) -> Mask:
    """(H, W) whether heights around a pixel are on a plane, within ROOF_M on average."""
    reach = np.arange(ROOF_PX) - ROOF_PX // 2
    count, square = ROOF_PX**2, ROOF_PX * float((reach**2).sum())
    ones = np.ones(ROOF_PX)

    def summed(rows: Floats, columns: Floats, values: Floats) -> Floats:
        return np.asarray(
            ndimage.correlate1d(ndimage.correlate1d(values, rows, 0, mode="nearest"), columns, 1, mode="nearest")
        )

    values = height_m.astype(np.float64)
    mean = summed(ones, ones, values) / count
    down, across = summed(reach.astype(float), ones, values), summed(ones, reach.astype(float), values)
    spread = summed(ones, ones, values**2) - count * mean**2 - (down**2 + across**2) / square
    return np.asarray(np.sqrt(np.maximum(spread, 0) / count) < ROOF_M)


def _disc(size: int) -> Mask:
    """(size, size)."""
    reach = np.arange(size) - size // 2
    return np.asarray(np.hypot(reach[:, None], reach) <= size / 2)


def _without_specks(mask: Mask) -> Mask:
    return np.asarray(ndimage.median_filter(mask.astype(np.uint8), SPECK_PX, mode="nearest").astype(bool) & mask)


def _averaged(raster: Raster, cell_m: float) -> Raster:
    """A raster of square blocks of pixels, at least so large; those beyond the last whole block are left out."""
    factor = min(max(1, round(cell_m / raster.cell_m)), *raster.values.shape[:2])
    if factor == 1:
        return raster
    height, width = (size // factor for size in raster.values.shape[:2])
    blocks = raster.values[: height * factor, : width * factor].reshape(height, factor, width, factor, -1)
    matrix = raster.ground_from_pixel @ np.diag([factor, factor, 1.0])
    mean = blocks.mean(axis=(1, 3))
    return Raster(
        values=mean.reshape(height, width, *raster.values.shape[2:]), ground_from_pixel=matrix, crs=raster.crs
    )


def _block_mean(values: Floats, fine: Raster, grid: Raster) -> Floats:
    """Values of a fine grid over the pixels of a coarser one; NaN becomes below all."""
    places_m = pixel_grid(grid).reshape(-1, 2)
    factor = max(1, round(grid.cell_m / fine.cell_m))
    mean = ndimage.uniform_filter(np.where(np.isfinite(values), values, -1.0), factor, mode="nearest")
    found = np.full(len(places_m), -1.0)
    covered = is_inside(fine, places_m)
    found[covered] = sample_nearest(
        Raster(values=mean, ground_from_pixel=fine.ground_from_pixel, crs=fine.crs), places_m[covered]
    )
    return found.reshape(grid.values.shape[:2])
