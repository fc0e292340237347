"""What the options of usdfoliage forest set, checked."""

import argparse

from usdfoliage.asset.plant import asset_name
from usdfoliage.cli.remarks import render_for
from usdfoliage.errors import FoliageError
from usdfoliage.forest.grass import GrassSettings
from usdfoliage.forest.ground_settings import GroundFilterSettings, GroundSettings
from usdfoliage.forest.planting import PlantingSettings
from usdfoliage.forest.shots import ShotSettings
from usdfoliage.forest.sky import SkySettings
from usdfoliage.forest.tree_tops import TreeTopSettings
from usdfoliage.jobs.forest.grass import GrassRequest
from usdfoliage.jobs.forest.inputs import ForestFiles
from usdfoliage.jobs.forest.request import ForestRequest
from usdfoliage.jobs.forest.shots import ShotRequest


def read_forest_request(options: argparse.Namespace) -> ForestRequest:
    """The request; FoliageError for values that cannot be."""
    if not options.camera and options.camera_prim:
        raise FoliageError("--camera-prim is for shots", "give --camera, too")
    lod_distance_m = (options.lod_distance[0], options.lod_distance[1])
    try:
        return ForestRequest(
            files=ForestFiles(
                dem=options.dem,
                plants=options.plants,
                orthophoto=options.orthophoto,
                canopy=options.canopy,
                vegetation=options.vegetation,
                trunks=options.trunks,
                ground=GroundSettings(
                    spacing_m=options.ground_spacing,
                    filter=GroundFilterSettings(widest_object_m=options.widest_object),
                ),
            ),
            output=options.output,
            name=asset_name(options.name or options.output.resolve().name),
            planting=PlantingSettings(
                seed=options.seed,
                tree_tops=TreeTopSettings(radius_m=(options.crown_radius[0], options.crown_radius[1])),
                trees_per_ha=options.trees_per_ha,
                find_classes=not options.no_find_vegetation,
                max_ground_cover=options.max_ground_cover,
            ),
            max_terrain_quads=options.max_terrain_quads,
            lod_distance_m=lod_distance_m,
            clear_ground=not options.no_clear_ground,
            sky=SkySettings(azimuth_deg=options.sky[0], elevation_deg=options.sky[1]) if options.sky else None,
            tile_m=options.tile,
            shots=ShotRequest(
                files=tuple(options.camera),
                prim=options.camera_prim,
                near=options.near_level,
                far=options.far_level,
                settings=ShotSettings(lod_distance_m=lod_distance_m, max_full=options.max_full_plants),
            ),
            grass=GrassRequest(
                grown=not options.no_grass,
                settings=GrassSettings(distance_m=options.grass_distance, max_clumps=options.max_grass_clumps),
            ),
            force=options.force,
            keep_old=options.keep_old,
            preview=not options.no_preview,
            times=not options.reproducible,
            render_setting=render_for("forest"),
        )
    except ValueError as error:
        raise FoliageError(str(error)) from error
