#!/usr/bin/env python3
"""Forests whose every tree is known, lit by a sun of any direction: DEM, canopy height, orthophoto, classes and truth.

usage: tools/synthetic_forest.py OUT [--only NAME …]

Each forest becomes a folder of OUT, with the names of files that shared/data/synthetic/forest has. They differ in
relief, density, crowns, species, pixels and sun. plants.toml names the asset crown beside it.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import from_origin
from scipy import ndimage
from usdfoliage.geometry.color import encode_srgb

Floats = NDArray[np.float64]

WEST, NORTH = 431_000.0, 5_120_000.0
EPSG = 25832
FINE_M = 0.2  # grid that the surface is made on, at most
WATER = np.array([0.02, 0.045, 0.06])
ROAD, ROOFS = np.array([0.17, 0.165, 0.16]), np.array([[0.30, 0.11, 0.07], [0.16, 0.16, 0.17]])


@dataclass(frozen=True, kw_only=True)
class Species:
    """A species of tree."""

    name: str
    share: float
    height_m: tuple[float, float]
    color: tuple[float, float, float]  # linear
    form: float  # radius over height
    cone: float = 0.0  # 0 a dome, 1 a cone


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What a forest is."""

    name: str
    seed: int
    species: tuple[Species, ...]
    side_m: float = 200.0
    relief_m: float = 25.0
    steepest_deg: float = 20.0
    wooded: float = 0.5  # of the ground
    trees_per_ha: float = 300.0  # of wooded ground, that are tried
    radius_m: tuple[float, float] = (1.0, 8.0)
    pixel_m: float = 0.25
    cell_m: float = 0.5  # of DEM, canopy and classes
    sun_deg: tuple[float, float] = (150.0, 45.0)  # azimuth, clockwise from north, and elevation
    noise: float = 0.02  # of the camera, of white
    leafy: float = 0.15  # standard deviation of the logarithm of light from leaf to leaf
    ambient: float = 0.38  # light of the sky over that of the sun
    bumps: float = 0.05  # of a radius, that boughs stand out of a crown
    roads: int = 0
    roofs: int = 0
    ground: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0.14, 0.19, 0.07), (0.16, 0.13, 0.08))


MIXED = (
    Species(name="oak", share=0.5, height_m=(5, 16), color=(0.11, 0.155, 0.047), form=0.27),
    Species(name="pine", share=0.3, height_m=(8, 24), color=(0.04, 0.08, 0.035), form=0.17, cone=0.7),
    Species(name="maple", share=0.2, height_m=(7, 18), color=(0.22, 0.13, 0.033), form=0.24),
)
PARK = (
    Species(name="lime", share=0.6, height_m=(8, 24), color=(0.10, 0.17, 0.05), form=0.33),
    Species(name="copper beech", share=0.2, height_m=(8, 22), color=(0.09, 0.05, 0.045), form=0.34),
    Species(name="birch", share=0.2, height_m=(6, 18), color=(0.17, 0.19, 0.07), form=0.2),
)
NEEDLES = (
    Species(name="spruce", share=0.7, height_m=(8, 28), color=(0.035, 0.065, 0.03), form=0.11, cone=1.0),
    Species(name="larch", share=0.3, height_m=(8, 24), color=(0.14, 0.14, 0.045), form=0.14, cone=0.8),
)
BEECHES = (
    Species(name="beech", share=0.6, height_m=(14, 30), color=(0.09, 0.15, 0.04), form=0.22),
    Species(name="ash", share=0.4, height_m=(12, 28), color=(0.14, 0.17, 0.09), form=0.19),
)
SCENES = (
    Scene(
        name="park",
        seed=11,
        species=PARK,
        side_m=260,
        steepest_deg=8,
        relief_m=6,
        wooded=0.6,
        trees_per_ha=60,
        pixel_m=0.2,
        sun_deg=(225, 50),
        roads=3,
        roofs=6,
        ground=((0.12, 0.20, 0.06), (0.15, 0.20, 0.08)),
    ),
    Scene(
        name="steep",
        seed=12,
        species=MIXED,
        steepest_deg=40,
        relief_m=60,
        wooded=0.7,
        trees_per_ha=420,
        pixel_m=0.25,
        sun_deg=(110, 40),
        roads=1,
    ),
    Scene(
        name="needles",
        seed=13,
        species=NEEDLES,
        steepest_deg=30,
        relief_m=40,
        wooded=0.75,
        trees_per_ha=900,
        radius_m=(1.0, 4.0),
        pixel_m=0.25,
        sun_deg=(180, 55),
    ),
    Scene(
        name="beeches",
        seed=14,
        species=BEECHES,
        steepest_deg=15,
        wooded=0.85,
        trees_per_ha=600,
        radius_m=(2.0, 8.0),
        pixel_m=0.4,
        cell_m=0.8,
        sun_deg=(200, 60),
        roads=1,
    ),
    Scene(
        name="coarse",
        seed=15,
        species=MIXED,
        side_m=300,
        wooded=0.5,
        trees_per_ha=200,
        radius_m=(1.5, 8.0),
        pixel_m=1.0,
        cell_m=1.0,
        sun_deg=(135, 35),
        noise=0.01,
    ),
    Scene(
        name="evening",
        seed=16,
        species=MIXED,
        wooded=0.5,
        trees_per_ha=250,
        pixel_m=0.25,
        sun_deg=(265, 25),
        noise=0.035,
        roofs=3,
        ground=((0.10, 0.16, 0.05), (0.25, 0.21, 0.13)),
    ),
    Scene(
        name="sister",
        seed=17,
        species=MIXED,
        side_m=250,
        wooded=0.6,
        trees_per_ha=330,
        radius_m=(0.9, 5.0),
        sun_deg=(75, 40),
        leafy=0.08,
    ),
)


def waves(rng: np.random.Generator, shape: tuple[int, int], cell_m: float, length_m: float, octaves: int = 4) -> Floats:
    """(H, W) smooth noise of mean 0 and deviation 1, whose largest features are so long."""
    total = np.zeros(shape)
    for octave in range(octaves):
        across_m = length_m / 2**octave
        size = tuple(int(np.ceil(n * cell_m / across_m)) + 4 for n in shape)
        coarse = rng.standard_normal(size)
        rows, columns = np.meshgrid(*(np.arange(n) * cell_m / across_m + 1 for n in shape), indexing="ij")
        total += 0.5**octave * ndimage.map_coordinates(coarse, [rows, columns], order=1, mode="nearest")
    return (total - total.mean()) / total.std()


def plant_trees(scene: Scene, rng: np.random.Generator, wood: NDArray[np.bool_], fine_m: float) -> Floats:
    """(N, 5) easting and northing from the south-west corner, height, radius, species; those that overlap more than a
    quarter are left out."""
    patches = np.stack([waves(rng, (64, 64), scene.side_m / 64, 60.0, 3) for _ in scene.species])
    share = np.log([each.share for each in scene.species])
    kept: list[tuple[float, float, float, float, int]] = []
    cells: dict[tuple[int, int], list[int]] = {}
    for _ in range(int(scene.trees_per_ha * wood.mean() * scene.side_m**2 / 1e4) * 2):
        x, y = rng.uniform(2, scene.side_m - 2, 2)
        row = int((scene.side_m - y) / fine_m)
        if not wood[row, int(x / fine_m)]:
            continue
        at = int((scene.side_m - y) / scene.side_m * 63), int(x / scene.side_m * 63)
        kind = int(np.argmax(share + 1.1 * patches[:, at[0], at[1]] + 0.5 * rng.gumbel(size=len(scene.species))))
        species = scene.species[kind]
        low, high = species.height_m
        height = float(np.clip(low + (high - low) * rng.beta(1.7, 2.2), low, high))
        radius = float(np.clip(species.form * height * np.exp(0.12 * rng.standard_normal()), *scene.radius_m))
        cell = int(x // 8), int(y // 8)
        near = [
            n for i in (-2, -1, 0, 1, 2) for j in (-2, -1, 0, 1, 2) for n in cells.get((cell[0] + i, cell[1] + j), [])
        ]
        if all(np.hypot(kept[n][0] - x, kept[n][1] - y) > 0.78 * (kept[n][3] + radius) for n in near):
            cells.setdefault(cell, []).append(len(kept))
            kept.append((x, y, height, radius, kind))
            if len(kept) >= scene.trees_per_ha * wood.mean() * scene.side_m**2 / 1e4:
                break
    return np.array(kept)


def make(scene: Scene, folder: Path) -> None:
    """Write one forest."""
    rng = np.random.default_rng(scene.seed)
    fine_m = min(FINE_M, scene.pixel_m / 2)
    fine_m = scene.pixel_m / round(scene.pixel_m / fine_m)
    size = round(scene.side_m / fine_m)
    shape = (size, size)
    ground = scene.relief_m * waves(rng, shape, fine_m, scene.side_m / 2.5, 5)
    down, across = np.gradient(ndimage.gaussian_filter(ground, 1.0 / fine_m), fine_m)
    steepest = np.percentile(np.hypot(down, across), 99.5)
    ground *= np.tan(np.radians(scene.steepest_deg)) / steepest
    ground = ndimage.gaussian_filter(ground, 1.0 / fine_m) + 400
    field = waves(rng, shape, fine_m, 80.0)
    wood = field > np.quantile(field, 1 - scene.wooded)
    wet = ground < np.quantile(ground, 0.03)
    shrubs = (np.abs(field - np.quantile(field, 1 - scene.wooded)) < 0.1) & ~wood
    grass_field = waves(rng, shape, fine_m, 30.0)
    road, roof, roof_m = np.zeros(shape, bool), np.zeros(shape, bool), np.zeros(shape)
    roof_color = np.zeros((*shape, 3))
    y, x = np.mgrid[:size, :size] * fine_m
    for _ in range(scene.roads):
        a, phase = rng.uniform(0, np.pi), rng.uniform(0, 6)
        off = (x - rng.uniform(0.2, 0.8) * scene.side_m) * np.cos(a) + (y - scene.side_m / 2) * np.sin(a)
        road |= np.abs(off + 8 * np.sin((x + y) / 40 + phase)) < rng.uniform(1.5, 3.5)
    for _ in range(scene.roofs):
        a = rng.uniform(0, np.pi)
        cx, cy = rng.uniform(15, scene.side_m - 15, 2)
        u, v = (x - cx) * np.cos(a) + (y - cy) * np.sin(a), -(x - cx) * np.sin(a) + (y - cy) * np.cos(a)
        width, depth = rng.uniform(5, 10), rng.uniform(4, 6)
        inside = (np.abs(u) < width) & (np.abs(v) < depth)
        roof |= inside
        roof_m = np.where(inside, 4 + 0.5 * (depth - np.abs(v)), roof_m)
        roof_color[inside] = ROOFS[rng.integers(len(ROOFS))]
    road &= ~roof
    blocked = ndimage.binary_dilation(road | roof | wet, iterations=int(0.5 / fine_m))
    trees = plant_trees(scene, rng, wood & ~blocked, fine_m)
    canopy, color = np.zeros(shape), np.zeros((*shape, 3))
    dry = 1 / (1 + np.exp(-2.5 * grass_field))[..., None]
    color = np.array(scene.ground[0]) * (1 - dry) + np.array(scene.ground[1]) * dry
    color *= np.exp(0.06 * waves(rng, shape, fine_m, 3.0))[..., None]
    color[road], color[wet] = ROAD, WATER
    color[roof] = roof_color[roof]
    bush = waves(rng, shape, fine_m, 2.5, 2)
    shrubs &= ~(road | roof | wet)
    canopy = np.where(shrubs, np.clip(0.8 + 0.4 * bush, 0.1, 1.8), 0.0)
    color[shrubs] = np.array([0.08, 0.11, 0.045])
    crown = np.zeros(shape, bool)
    bumps, leaves = waves(rng, shape, fine_m, 1.5, 2), waves(rng, shape, fine_m, 0.5, 2)
    for east, north, height, radius, kind in trees:
        species = scene.species[int(kind)]
        reach = int(1.25 * radius / fine_m) + 1
        row, column = int((scene.side_m - north) / fine_m), int(east / fine_m)
        rows, columns = slice(max(0, row - reach), row + reach + 1), slice(max(0, column - reach), column + reach + 1)
        across_m, up_m = x[rows, columns] + fine_m / 2 - east, scene.side_m - y[rows, columns] - fine_m / 2 - north
        angle = np.arctan2(up_m, across_m)
        rim = radius * (1 + 0.06 * np.sin(3 * angle + east) + 0.05 * np.sin(5 * angle + north))
        off = np.hypot(across_m, up_m) / rim
        deep = 0.5 + 0.3 * species.cone  # of the height, that the crown is
        dome = (1 - species.cone) * np.sqrt(np.clip(1 - off**2, 0, 1)) + species.cone * np.clip(1 - off, 0, 1)
        top = height * (1 - deep) + height * deep * dome + scene.bumps * radius * bumps[rows, columns] * (off < 0.9)
        top = np.minimum(top, height)
        higher = (off < 1) & (top > canopy[rows, columns])
        canopy[rows, columns] = np.where(higher, top, canopy[rows, columns])
        tone = np.array(species.color) * np.exp(0.12 * rng.standard_normal() + 0.07 * rng.standard_normal(3))
        color[rows, columns] = np.where(higher[..., None], tone, color[rows, columns])
        crown[rows, columns] |= higher
    light = lit(ground + np.maximum(canopy, roof_m), fine_m, scene.sun_deg, scene.ambient)
    color = color * light[..., None] * np.where(crown, np.exp(scene.leafy * leaves), 1.0)[..., None]
    factor = round(scene.pixel_m / fine_m)
    photo = color.reshape(size // factor, factor, size // factor, factor, 3).mean(axis=(1, 3))
    encoded = np.asarray(encode_srgb(np.clip(1.5 * photo, 0, 1)))
    encoded += scene.noise * rng.standard_normal(encoded.shape)
    coarse = round(scene.cell_m / fine_m)
    blocks = (size // coarse, coarse, size // coarse, coarse)
    tall = np.maximum(canopy, roof_m).reshape(blocks).max(axis=(1, 3))
    bare = ground.reshape(blocks).mean(axis=(1, 3))
    classes = np.where(grass_field > -0.2, 3, 0)
    classes[shrubs], classes[wood], classes[road | roof | wet] = 2, 1, 0
    classes[crown & ~(road | roof | wet)] = 1
    codes = classes[coarse // 2 :: coarse, coarse // 2 :: coarse]
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    write(folder / "dem.tif", bare[None].astype(np.float32), scene.cell_m, nodata=-9999)
    write(folder / "canopy_height.tif", tall[None].astype(np.float32), scene.cell_m)
    write(folder / "vegetation.tif", codes[None].astype(np.uint8), scene.cell_m)
    photo8 = np.rint(np.clip(encoded, 0, 1) * 255).astype(np.uint8)
    write(folder / "orthophoto.tif", np.moveaxis(photo8, -1, 0), scene.pixel_m)
    table = trees + np.array([WEST, NORTH - scene.side_m, 0, 0, 0])
    np.savetxt(
        folder / "truth" / "trees.csv",
        table,
        fmt="%.2f %.2f %.2f %.2f %d",
        header="easting northing height_m crown_radius_m species",
    )
    truth = {"trees": len(trees), "sun_deg": scene.sun_deg, "species": [each.name for each in scene.species]}
    (folder / "truth" / "truth.json").write_text(json.dumps(truth))
    (folder / "plants.toml").write_text("\n".join(plant_row(each) for each in scene.species))


def lit(surface: Floats, cell_m: float, sun_deg: Sequence[float], ambient: float) -> Floats:
    """(H, W) light by sun and sky on a surface of heights, with the shadows that it casts; rows go south."""
    azimuth, elevation = np.radians(sun_deg)
    down, across = np.gradient(surface, cell_m)
    normal = np.stack([-across, down, np.ones_like(surface)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    sun = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    direct = np.clip(normal @ sun, 0, None)
    reach_m = (np.percentile(surface, 99.9) - np.percentile(surface, 0.1)) / np.tan(elevation)
    shade = np.zeros(surface.shape, bool)
    for away_m in np.arange(2 * cell_m, min(reach_m, 70.0), 1.5 * cell_m):
        step = -np.cos(azimuth) * away_m / cell_m, np.sin(azimuth) * away_m / cell_m
        moved = np.roll(surface, (-round(step[0]), -round(step[1])), axis=(0, 1))
        shade |= moved > surface + away_m * np.tan(elevation) + 0.1
    return np.asarray(np.where(shade, 0.0, direct) + ambient * (0.4 + 0.6 * normal[..., 2]))


def write(path: Path, bands: NDArray[np.generic], cell_m: float, **more: float) -> None:
    """Write a GeoTIFF of bands (C, H, W)."""
    count, height, width = bands.shape
    profile = {"driver": "GTiff", "compress": "deflate", "crs": f"EPSG:{EPSG}", "dtype": bands.dtype, **more}
    profile |= {"count": count, "height": height, "width": width, "transform": from_origin(WEST, NORTH, cell_m, cell_m)}
    with rasterio.open(path, "w", **profile) as file:
        file.write(bands)


def plant_row(species: Species) -> str:
    """A [[plant]] of plants.toml."""
    low, high = species.height_m
    return (
        f'[[plant]]\nspecies = "{species.name}"\nkind = "tree"\nasset = "crown"\nshare = {species.share}\n'
        f"height_m = [{low}, {high}]\ncolor = {list(species.color)}\nform = {species.form}\n"
    )


def main() -> int:
    """Make the forests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", metavar="OUT", type=Path)
    parser.add_argument("--only", nargs="+", choices=[scene.name for scene in SCENES])
    options = parser.parse_args()
    for scene in SCENES:
        if options.only is None or scene.name in options.only:
            make(scene, options.output / scene.name)
            print(options.output / scene.name)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
