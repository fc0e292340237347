"""What lies on the ground of a forest, as pictures: the orthophoto, and how dark it is under plants."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.ground import GROUND_SHADER, GroundMaterial
from usdfoliage.asset.parts.part import MAPS, SHADERS
from usdfoliage.forest.clear_ground import clear_crowns
from usdfoliage.forest.contact import count_texels, open_sky
from usdfoliage.forest.kinds import PlantKind
from usdfoliage.forest.planting import ForestInput, Planting
from usdfoliage.forest.raster import Raster, upright_grid
from usdfoliage.geometry.color import encode_srgb
from usdfoliage.jobs.report.pictures import write_picture

MAX_SIDE_PX = 8192  # of the orthophoto's copy in the asset
LOSSLESS_PIXELS = 4_000_000  # up to which it is a PNG
CONTACT_SIDE_PX = 2048  # at most, of the picture of what is dark under plants
GRASS_SIDE_PX = 4096  # at most, of the picture of vegetated ground
CONTACT_TEXEL_M = 0.25  # at least
CONTACT_TEXELS = 1.5e7  # under all crowns together, which take a second, where they may be so large
COARSEST = 2.0  # radii of the median crown, that a texel is at most


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundLook:
    """How the ground is drawn."""

    material: GroundMaterial  # paths as seen from the payload's folder
    orthophoto: str = ""  # likewise, as it was taken; empty without one
    colors: Raster | None = None  # (H, W, 3) of the ground, linear; None without an orthophoto
    open_sky: Raster | None = None  # (H, W), the part of the sky's light that plants leave; None where there are none


def write_ground_maps(
    folder: Path,
    name: str,
    given: ForestInput,
    planting: Planting,
    *,
    grass: bool = True,
    clear: bool = True,
    seed: int = 0,
) -> GroundLook:
    """Write the pictures of the ground into an asset's maps, all over the rectangle around the DEM, north up.

    Args:
        folder: Of the asset.
        name: Of the asset, with which their names begin.
        given: The terrain, and its orthophoto where there is one.
        planting: What stands on it, and where it is vegetated.
        grass: Whether vegetated ground has the hues of grass.
        clear: Whether the ground has colours from beside the crowns that the orthophoto shows, in their places.
        seed: Of what varies in these places.

    Raises:
        WriteError: A file cannot be written.
    """
    onto = upright_grid(given.terrain.heights)
    texture, orthophoto, pixel_m = "", "", GroundMaterial.photo_pixel_m
    colors: Raster | None = None
    if given.orthophoto is not None:
        copied = lay_photo(given.orthophoto, onto)
        pixel_m = max(copied.cell_m, given.orthophoto.cell_m)
        height, width = copied.values.shape[:2]
        suffix = ".png" if height * width <= LOSSLESS_PIXELS else ".jpg"
        texture = orthophoto = f"{name}_orthophoto{suffix}"
        _write_colors(folder / "maps" / orthophoto, copied)
        trees = planting.seen & np.array([row.kind == PlantKind.TREE for row in given.plants.rows])[planting.row]
        colors = copied
        if clear and trees.any():
            colors = clear_crowns(copied, planting.ground_m[trees], planting.radius_m[trees], seed)
        if colors is not copied:
            texture = f"{name}_ground{suffix}"
            _write_colors(folder / "maps" / texture, colors)
    contact, sky_map = "", None
    crowned = np.array([row.kind != PlantKind.GRASS for row in given.plants.rows])[planting.row]
    if crowned.any():
        contact = f"{name}_contact.png"
        radius_m = planting.radius_m[crowned]
        grid = contact_grid(onto, radius_m)
        sky = open_sky(grid, planting.ground_m[crowned], radius_m, planting.height_m[crowned])
        (folder / "maps").mkdir(exist_ok=True)
        write_picture(folder / "maps" / contact, encode_8_bits(sky))
        sky_map = replace(grid, values=sky)
    vegetated = ""
    if grass and planting.vegetated is not None and planting.vegetated.values.any():
        vegetated = f"{name}_grass.png"
        (folder / "maps").mkdir(exist_ok=True)
        write_picture(folder / "maps" / vegetated, encode_8_bits(lay_vegetated(planting.vegetated, onto).values))
    return GroundLook(
        material=GroundMaterial(
            texture=f"{MAPS}/{texture}" if texture else "",
            contact_map=f"{MAPS}/{contact}" if contact else "",
            grass_map=f"{MAPS}/{vegetated}" if vegetated else "",
            shader=f"{SHADERS}/{GROUND_SHADER}",
            photo_pixel_m=pixel_m,
        ),
        orthophoto=f"{MAPS}/{orthophoto}" if orthophoto else "",
        colors=colors,
        open_sky=sky_map,
    )


def _write_colors(path: Path, colors: Raster) -> None:
    """Write linear colours (H, W, 3) as a picture."""
    path.parent.mkdir(exist_ok=True)
    write_picture(path, encode_8_bits(encode_srgb(colors.values)), jpeg_quality=92)


def lay_photo(photo: Raster, onto: Raster) -> Raster:
    """The orthophoto (H, W, 3) over the rectangle of the DEM, linear, as fine as it is itself."""
    return _lay_over(photo, onto, MAX_SIDE_PX)


def lay_vegetated(vegetated: Raster, onto: Raster) -> Raster:
    """The part of the ground (H, W) that is vegetated over the rectangle of the DEM, 0 where nothing shows it."""
    inside = np.pad(np.nan_to_num(vegetated.values), 1)  # beyond it nothing is
    matrix = vegetated.ground_from_pixel @ np.array([[1.0, 0, -1], [0, 1, -1], [0, 0, 1]])
    return _lay_over(replace(vegetated, values=inside, ground_from_pixel=matrix), onto, GRASS_SIDE_PX)


def _lay_over(photo: Raster, onto: Raster, max_side_px: int) -> Raster:
    """A picture over the rectangle of the DEM, as fine as it is itself, or with this longest side."""
    height, width = onto.values.shape
    finer = max(1.0, onto.cell_m / photo.cell_m)
    factor = min(finer, max_side_px / max(height, width))
    size = max(1, round(width * factor)), max(1, round(height * factor))
    target = _divide(onto, size)
    # From a pixel of the copy to one of the orthophoto, both counted from the middle of the first pixel.
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    matrices = [np.vstack([each, [0, 0, 1]]) for each in (photo.ground_from_pixel, target)]
    source = np.linalg.inv(half) @ np.linalg.inv(matrices[0]) @ matrices[1] @ half
    picture = cv2.warpAffine(
        np.ascontiguousarray(np.nan_to_num(photo.values), np.float32),
        source[:2],
        size,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return Raster(values=picture, ground_from_pixel=target, crs=onto.crs)


def contact_grid(onto: Raster, radius_m: NDArray[np.float64]) -> Raster:
    """Pixels over the rectangle of the DEM, of CONTACT_TEXEL_M, or larger ones where these or crowns (N,) are many."""
    height, width = onto.values.shape
    sides_m = np.linalg.norm(onto.ground_from_pixel[:, :2], axis=0) * [width, height]
    texel_m = max(CONTACT_TEXEL_M, float(sides_m.max()) / CONTACT_SIDE_PX)
    coarsest_m = COARSEST * float(np.median(radius_m)) if len(radius_m) else 0.0
    while texel_m < coarsest_m and count_texels(texel_m, radius_m) > CONTACT_TEXELS:
        texel_m = min(1.25 * texel_m, coarsest_m)
    columns, rows = (max(1, round(side_m / texel_m)) for side_m in sides_m.tolist())
    return Raster(values=np.zeros((rows, columns)), ground_from_pixel=_divide(onto, (columns, rows)), crs=onto.crs)


def encode_8_bits(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Numbers from 0 to 1 as bytes."""
    return np.rint(np.clip(np.asarray(values), 0, 1) * 255).astype(np.uint8)


def _divide(onto: Raster, size: tuple[int, int]) -> NDArray[np.float64]:
    """(2, 3) ground_from_pixel of the same rectangle with other numbers of columns and rows."""
    height, width = onto.values.shape[:2]
    return np.asarray(onto.ground_from_pixel @ np.diag([width / size[0], height / size[1], 1.0]))
