"""Where trees, shrubs and grass are, found in the orthophoto and the canopy height where no raster of classes is given.

The thesis segments by hand (Argudo, section 6.1). Ours decides by height where there is a canopy, by green where there
is an orthophoto, and parts crowns from lawns by their texture: leaves and gaps of a crown differ in light from one
half metre to the next, grass does not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from usdfoliage.forest.raster import Raster, is_inside, pixel_grid, sample_nearest
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
class VegetationClasses:
    """Masks over one grid; no two of them have a pixel in common."""

    grid: Raster  # (H, W, …), whose values mean nothing
    tree: Mask  # (H, W)
    shrub: Mask
    grass: Mask


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
    fine = _averaged(orthophoto, FINEST_M)
    index, texture = green_index(fine), crown_texture(fine)
    grid = _averaged(orthophoto, CLASS_M)
    green = _block_mean(index, fine, grid) > _dividing_value(index, GREEN)
    rough = _block_mean(texture, fine, grid) > _dividing_value(texture[index > _dividing_value(index, GREEN)], ROUGH)
    tree = _without_specks(green & rough)
    return VegetationClasses(grid=grid, tree=tree, shrub=np.zeros_like(tree), grass=_without_specks(green & ~tree))


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


def are_rough(orthophoto: Raster, ground_m: Floats, radius_m: Floats) -> Mask:
    """(N,) whether discs have the texture of crowns; lawns that stand out by their colour have not.

    Where few of all have it, the picture is too coarse or too smooth to show any, and all count as rough.

    Args:
        orthophoto: (H, W, 3) linear colours.
        ground_m: (N, 2) middles of the discs, inside the orthophoto.
        radius_m: (N,).
    """
    fine = _averaged(orthophoto, FINEST_M)
    texture = crown_texture(fine)
    bound = _dividing_value(texture[green_index(fine) > GREEN[0]], ROUGH)
    values = Raster(values=texture, ground_from_pixel=fine.ground_from_pixel, crs=fine.crs)
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
    covered = np.zeros(mask.shape, bool)
    pixels = np.flatnonzero(mask)
    places_m = pixel_grid(grid).reshape(-1, 2)[pixels]
    sizes = np.ceil(np.log2(np.maximum(radius_m, DARKEST)))
    for size in np.unique(sizes):  # by size, so that each is looked for as far as it reaches
        own = np.flatnonzero(sizes == size)
        found = cKDTree(ground_m[own]).query(places_m, k=[1, 2, 3, 4], distance_upper_bound=2.0**size)
        away_m, near = (np.asarray(each) for each in found)
        reach_m = np.append(radius_m[own], 0.0)[near]  # what is not found is number N
        covered.flat[pixels[(away_m < reach_m).any(axis=1)]] = True
    return covered


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
    blur = (sigma, sigma) + (0,) * (values.ndim - 2)
    weight = ndimage.gaussian_filter(seen.astype(np.float32), blur, mode="nearest")
    summed = ndimage.gaussian_filter(np.where(seen, values, 0).astype(np.float32), blur, mode="nearest")
    return np.where(seen, summed / np.maximum(weight, 1e-6), np.nan)


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
