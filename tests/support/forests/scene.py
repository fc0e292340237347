"""A small terrain whose every tree is known, and its files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import Affine
from usdfoliage.forest.raster import Raster, pixel_grid
from usdfoliage.geometry.color import encode_srgb

ORIGIN_M = (455_000.0, 4_660_000.0)  # of the north-west corner
CELL_M = 0.5
SIZE_PX = 160
EPSG = 25831
COLORS = np.array([[0.11, 0.155, 0.047], [0.22, 0.13, 0.033]])  # of the two species, linear
GROUND = np.array([0.11, 0.11, 0.07])
PLANTS = """
[[plant]]
species = "oak"
kind = "tree"
asset = "oak"
share = 3
height_m = [5, 14]
color = [0.11, 0.155, 0.047]
form = 0.28

[[plant]]
species = "maple"
kind = "tree"
asset = "oak"
share = 1
height_m = [5, 14]
color = [0.22, 0.13, 0.033]
form = 0.28
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class ForestScene:
    """Rasters, and the trees that they show."""

    dem: Raster
    canopy: Raster
    orthophoto: Raster  # linear
    vegetation: Raster
    trees_m: np.ndarray  # (N, 2)
    height_m: np.ndarray  # (N,)
    radius_m: np.ndarray  # (N,)
    species: np.ndarray  # (N,)


def frame(cell_m: float = CELL_M) -> np.ndarray:
    return np.array([[cell_m, 0, ORIGIN_M[0]], [0, -cell_m, ORIGIN_M[1]]])


def forest_scene(seed: int = 0) -> ForestScene:
    """Crowns as paraboloids on a slope, lit from above, each at least its own width from others."""
    rng = np.random.default_rng(seed)
    raster = Raster(values=np.zeros((SIZE_PX, SIZE_PX)), ground_from_pixel=frame())
    ground = pixel_grid(raster)
    side_m = SIZE_PX * CELL_M
    places = [(x, y) for x in np.arange(6.0, side_m - 4, 8.0) for y in np.arange(6.0, side_m - 4, 8.0)]
    trees_m = np.array(places) + rng.uniform(-1.2, 1.2, (len(places), 2))
    trees_m = np.column_stack([ORIGIN_M[0] + trees_m[:, 0], ORIGIN_M[1] - trees_m[:, 1]])
    height_m = rng.uniform(6, 13, len(trees_m))
    radius_m = 0.28 * height_m * rng.uniform(0.9, 1.1, len(trees_m))
    species = (rng.random(len(trees_m)) < 0.25).astype(np.int64)
    dem = 300 + 0.1 * (ground[..., 0] - ORIGIN_M[0]) + 0.05 * (ground[..., 1] - ORIGIN_M[1])
    canopy = np.zeros((SIZE_PX, SIZE_PX))
    color = np.broadcast_to(GROUND, (SIZE_PX, SIZE_PX, 3)) * rng.uniform(0.9, 1.1, (SIZE_PX, SIZE_PX, 1))
    for place, height, radius, kind in zip(trees_m, height_m, radius_m, species, strict=True):
        off = np.linalg.norm(ground - place, axis=-1) / radius
        top = height * (1 - 0.45 * off**2)
        higher = (off < 1) & (top > canopy)
        canopy[higher] = top[higher]
        color[higher] = COLORS[kind] * (1.1 - 0.3 * off[higher, None] ** 2)
    return ForestScene(
        dem=Raster(values=dem, ground_from_pixel=frame()),
        canopy=Raster(values=canopy, ground_from_pixel=frame()),
        orthophoto=Raster(values=color, ground_from_pixel=frame()),
        vegetation=Raster(values=np.where(canopy > 0, 1.0, 3.0), ground_from_pixel=frame()),
        trees_m=trees_m,
        height_m=height_m,
        radius_m=radius_m,
        species=species,
    )


def write_raster(path: Path, values: np.ndarray, epsg: int | None = EPSG, matrix: np.ndarray | None = None, **more):
    """Write a GeoTIFF of values (H, W) or (H, W, C)."""
    bands = values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0)
    row = (frame() if matrix is None else matrix).reshape(-1)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=bands.shape[2],
        height=bands.shape[1],
        count=len(bands),
        dtype=bands.dtype,
        crs=None if epsg is None else f"EPSG:{epsg}",
        transform=Affine(*row),
        **more,
    ) as file:
        file.write(bands)
    return path


def write_forest_files(folder: Path, scene: ForestScene) -> dict[str, Path]:
    """The scene as files, by the names of the options of usdfoliage forest; plants.toml names the asset oak."""
    folder.mkdir(parents=True, exist_ok=True)
    photo = np.rint(np.clip(encode_srgb(scene.orthophoto.values), 0, 1) * 255).astype(np.uint8)
    (folder / "plants.toml").write_text(PLANTS)
    return {
        "dem": write_raster(folder / "dem.tif", scene.dem.values.astype(np.float32)),
        "canopy": write_raster(folder / "canopy.tif", scene.canopy.values.astype(np.float32)),
        "vegetation": write_raster(folder / "vegetation.tif", scene.vegetation.values.astype(np.uint8)),
        "orthophoto": write_raster(folder / "photo.tif", photo),
        "plants": folder / "plants.toml",
    }


def match(found_m: np.ndarray, true_m: np.ndarray, within_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs (found, true) of which each is the other's nearest, within so much (true,)."""
    away = np.linalg.norm(found_m[:, None] - true_m, axis=2)
    found = np.argmin(away, axis=0)
    true = np.arange(len(true_m))
    good = (np.argmin(away, axis=1)[found] == true) & (away[found, true] < within_m)
    return found[good], true[good]
