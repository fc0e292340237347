"""Blades of grass near the cameras of shots, as they are authored."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.grass import GRASS_COLOR
from usdfoliage.asset.parts.grass import GrassPrim
from usdfoliage.forest.grass import GrassClumps, GrassSettings, place_clumps
from usdfoliage.forest.grass_clump import build_clump
from usdfoliage.forest.planting import ForestInput
from usdfoliage.forest.raster import Raster, is_inside, sample_bilinear
from usdfoliage.forest.shots import CameraPath
from usdfoliage.forest.terrain import GroundMesh, mesh_height
from usdfoliage.jobs.forest.ground import GroundLook
from usdfoliage.jobs.forest.levels import turn_and_lean
from usdfoliage.jobs.report.table import Row

FORMS = 6  # of clumps
FORM_SEED = 8  # beside those of forest/grass.py


@dataclass(frozen=True, kw_only=True)
class GrassRequest:
    """Whether shots have grass, and how much."""

    grown: bool = True
    settings: GrassSettings = field(default_factory=GrassSettings)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShotGrass:
    """The grass of a shot."""

    prim: GrassPrim
    ground_m: NDArray[np.float64]  # (N, 2) easting and northing


def grow_grass(
    given: ForestInput,
    vegetated: Raster,
    look: GroundLook,
    mesh: GroundMesh,
    path: CameraPath,
    asset_from_ground: NDArray[np.float64],
    seed: int,
    margin: float,
    settings: GrassSettings,
) -> ShotGrass | None:
    """The grass that a camera sees; None where it comes near to none.

    Args:
        given: The terrain, and its orthophoto where there is one.
        vegetated: (H, W), 1 where the ground has plants of any kind.
        look: How the ground is drawn.
        mesh: The ground as it is drawn.
        path: Of the camera, in the asset's frame.
        asset_from_ground: (4, 4), column vectors, from easting, northing and height in metres.
        seed: Of the draws.
        margin: Of the picture's width and height, beyond its edges.
        settings: How much.
    """

    def height_at(ground_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return mesh_height(mesh, given.terrain, ground_m)

    clumps = place_clumps(vegetated, height_at, path, asset_from_ground, seed, margin, settings)
    if not len(clumps):
        return None
    steep = np.linalg.norm(clumps.slope, axis=1)
    downhill = -clumps.slope / np.maximum(steep, 1e-12)[:, None]
    place = np.column_stack([clumps.ground_m, clumps.elevation_m, np.ones(len(clumps))])
    open_part = np.ones(len(clumps)) if look.open_sky is None else sample_bilinear(look.open_sky, clumps.ground_m)
    prim = GrassPrim(
        forms=[build_clump(np.random.default_rng([seed, FORM_SEED, number])) for number in range(FORMS)],
        form=(clumps.form * FORMS).astype(np.int32),
        position_m=(place @ asset_from_ground.T)[:, :3],
        orientation=turn_and_lean(clumps.turn_deg, np.degrees(np.arctan(steep))[:, None] * downhill),
        scale=np.column_stack([clumps.across, clumps.height_m, clumps.across]),
        tint=ground_color(given.orthophoto, look.colors, clumps),
        open_sky=np.clip(open_part, 0, 1),
    )
    return ShotGrass(prim=prim, ground_m=clumps.ground_m)


def ground_color(orthophoto: Raster | None, colors: Raster | None, clumps: GrassClumps) -> NDArray[np.float64]:
    """(N, 3) linear colour of the ground at each clump, or that of grass where the orthophoto shows nothing.

    Args:
        orthophoto: (H, W, 3), as it was given; None without one.
        colors: (H, W, 3) of the ground as it is drawn; None without an orthophoto.
        clumps: Of the grass.
    """
    color = np.full((len(clumps), 3), np.nan)
    if orthophoto is not None and colors is not None:
        covered = is_inside(orthophoto, clumps.ground_m)
        covered[covered] = np.isfinite(sample_bilinear(orthophoto, clumps.ground_m[covered])).all(axis=1)
        color[covered] = sample_bilinear(colors, clumps.ground_m[covered])
    color[~np.isfinite(color).all(axis=1)] = GRASS_COLOR
    return color * clumps.shade[:, None]


def grass_rows(
    names: Sequence[str], grass: Sequence[ShotGrass | None], vegetated: Raster | None, request: GrassRequest
) -> tuple[Row, ...]:
    """The figures of the grass of shots, for report and terminal.

    Args:
        names: Of the shots.
        grass: Of each.
        vegetated: Where the ground is so; None where nothing shows that.
        request: Whether there is any.
    """
    rows = []
    for name, each in zip(names, grass, strict=True) if request.grown else ():
        if each is not None:
            remark = f"within {request.settings.distance_m:g} m of the camera"
        elif vegetated is None:
            remark = "neither a raster of vegetation nor a picture shows where the ground is vegetated"
        else:
            remark = f"the camera sees no vegetated ground within {request.settings.distance_m:g} m"
        count = 0 if each is None else len(each.prim)
        rows.append(Row(name=f"clumps of grass, {name}", value=f"{count:,}", remark=remark))
    return tuple(rows)
