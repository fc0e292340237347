"""What a user asks a forest to be, checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from usdfoliage.asset.asset_record import AssetOrigin
from usdfoliage.forest.ground_files import is_ground_file
from usdfoliage.forest.planting import PlantingSettings
from usdfoliage.forest.sky import SkySettings
from usdfoliage.jobs.forest.grass import GrassRequest
from usdfoliage.jobs.forest.inputs import ForestFiles
from usdfoliage.jobs.forest.shots import ShotRequest
from usdfoliage.remarks import RenderSetting, as_plan_setting

MAX_TERRAIN_QUADS = 50_000_000


@dataclass(frozen=True, kw_only=True)
class ForestRequest:
    """What the user asked for, checked."""

    files: ForestFiles
    output: Path
    name: str
    planting: PlantingSettings = field(default_factory=PlantingSettings)
    max_terrain_quads: int = 1_000_000
    lod_distance_m: tuple[float, float] = (100.0, 200.0)  # as the thesis has it, section 7.3
    shots: ShotRequest = field(default_factory=ShotRequest)
    clear_ground: bool = True  # no colours of crowns on the ground, where trees stand
    grass: GrassRequest = field(default_factory=GrassRequest)  # near the cameras of shots
    sky: SkySettings | None = None  # where the sun is; None for a forest without lights
    tile_m: float | None = None  # side of tiles; None for a forest in one piece
    force: bool = False
    keep_old: bool = False
    preview: bool = True
    times: bool = True
    render_setting: RenderSetting = as_plan_setting

    def __post_init__(self) -> None:
        if not 1 <= self.max_terrain_quads <= MAX_TERRAIN_QUADS:
            raise ValueError(f"max_terrain_quads must be 1 to {MAX_TERRAIN_QUADS:,}, not {self.max_terrain_quads}")
        near_m, far_m = self.lod_distance_m
        if not 0 <= near_m <= far_m < np.inf:
            raise ValueError(
                f"lod_distance must be two distances from 0 on, the nearer first, not {near_m:g} {far_m:g}"
            )
        if self.tile_m is not None and not (np.isfinite(self.tile_m) and self.tile_m > 0):
            raise ValueError(f"tile must be a length above 0, not {self.tile_m:g}")

    @property
    def origin(self) -> AssetOrigin:
        """Of the asset."""
        return AssetOrigin(name=self.name, command="forest", source=self.files.dem.resolve().name)


def describe_settings(request: ForestRequest) -> Mapping[str, str]:
    """Every setting that decides the result, by the name of its option."""
    planting = request.planting
    low_m, high_m = planting.tree_tops.radius_m
    return {
        "seed": str(planting.seed),
        "crown-radius": f"{low_m:g} {high_m:g}",
        "trees-per-ha": f"{planting.trees_per_ha:g}",
        **({} if planting.find_classes else {"no-find-vegetation": "yes"}),
        "max-ground-cover": str(planting.max_ground_cover),
        "lod-distance": "{:g} {:g}".format(*request.lod_distance_m),
        "max-terrain-quads": str(request.max_terrain_quads),
        **({} if request.files.ground.spacing_m is None else {"ground-spacing": f"{request.files.ground.spacing_m:g}"}),
        **(
            {"widest-object": f"{request.files.ground.filter.widest_object_m:g}"}
            if is_ground_file(request.files.dem)
            else {}
        ),
        **({} if request.clear_ground else {"no-clear-ground": "yes"}),
        **({} if request.sky is None else {"sky": f"{request.sky.azimuth_deg:g} {request.sky.elevation_deg:g}"}),
        **({} if request.tile_m is None else {"tile": f"{request.tile_m:g}"}),
        **_describe_shots(request.shots),
        **_describe_grass(request),
    }


def _describe_shots(shots: ShotRequest) -> dict[str, str]:
    """What decides how shots, and near and far tiles, are drawn."""
    named = {"camera-prim": shots.prim, "near-level": shots.near, "far-level": shots.far}
    return {
        **({"max-full-plants": str(shots.settings.max_full)} if shots.files else {}),
        **{name: value for name, value in named.items() if value is not None},
    }


def _describe_grass(request: ForestRequest) -> dict[str, str]:
    """What decides how much grass there is."""
    if not request.grass.grown:
        return {"no-grass": "yes"}
    if not request.shots.files:
        return {}
    settings = request.grass.settings
    return {"max-grass-clumps": str(settings.max_clumps), "grass-distance": f"{settings.distance_m:g}"}
