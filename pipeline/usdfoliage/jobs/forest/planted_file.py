"""A planted forest as files: an outline that anyone can read, and the arrays of each tile, so that each is read alone.

Numbers come back bit for bit: what is written of them is the same as of the forest in memory.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.materials.ground import GroundMaterial
from usdfoliage.asset.packages.forest_package import ForestTile, PlantedShot
from usdfoliage.asset.packages.interface import TILES
from usdfoliage.asset.packages.lods import AutoPlants
from usdfoliage.asset.parts.crown_leaves import OtherLeaves
from usdfoliage.asset.parts.grass import GrassPrim
from usdfoliage.asset.parts.planted import ForestPrototype, HiddenPlants, PlantedLevel
from usdfoliage.asset.parts.terrain import TerrainPrim
from usdfoliage.asset.provenance import Provenance
from usdfoliage.crown.leafy_crown import LeafCluster
from usdfoliage.files.json import read_json
from usdfoliage.files.npz import read_arrays, reading_model, write_model
from usdfoliage.forest.grass_clump import GrassClump
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.forest.planted import ForestOutline, PlantedForest
from usdfoliage.jobs.forest.report import ForestPicture
from usdfoliage.jobs.report.table import Histogram, Row
from usdfoliage.jobs.work.results import write_whole
from usdfoliage.remarks import remark_from_json

OUTLINE = "outline.json"
WHOLE = "whole"  # the tile of a forest in one piece
_HEADER = "header"  # JSON in bytes, what is no array
_GRASS = ("form", "position_m", "orientation", "scale", "tint", "open_sky")  # of a shot, one row a clump
_ARRAYS = ("prototype", "ids", "position_m", "orientation", "scale", "tint", "jitter")  # of a level, one row a plant


def write_planted(folder: Path, planted: PlantedForest) -> None:
    """Write the outline and the tiles of a forest into folder; the same bytes for the same forest.

    Raises:
        WriteError: A file cannot be written.
    """
    for tile in planted.tiles:
        write_model(_tile_file(folder, tile.name), _pack_tile(tile))
    text = json.dumps(_pack_outline(planted.outline), indent=1, ensure_ascii=False)
    write_whole(folder / OUTLINE, text.encode())


def read_outline(folder: Path) -> ForestOutline:
    """The outline in a folder; CaptureError where it is missing, damaged, or none."""
    path = folder / OUTLINE
    with reading_model(path, "outline of a forest"):
        stored = read_json(path)
        return ForestOutline(
            tiles=[str(name) for name in stored["tiles"]],
            levels=[str(name) for name in stored["levels"]],
            times=stored["times"],
            ground=GroundMaterial(**{**stored["ground"], "color": tuple(stored["ground"]["color"])}),
            has_grass=bool(stored["has_grass"]),
            asset_from_terrain=np.array(stored["asset_from_terrain"], np.float64).reshape(4, 4),
            provenance=Provenance(**stored["provenance"]),
            rows=[Row(**row) for row in stored["rows"]],
            remarks=[remark_from_json(each) for each in stored["remarks"]],
            legend=[Row(**row) for row in stored["legend"]],
            histograms=[Histogram(**each) for each in stored["histograms"]],
            pictures=[_read_picture(each) for each in stored["pictures"]],
        )


def read_tile(folder: Path, name: str) -> ForestTile:
    """A tile of the forest in a folder; CaptureError where its file is missing, damaged, or none."""
    path = _tile_file(folder, name)
    with reading_model(path, "tile of a forest"):
        arrays = read_arrays(path, sealed=True)
        header = json.loads(arrays[_HEADER].tobytes())
        levels = [_read_level(arrays, number, stored) for number, stored in enumerate(header["levels"])]
        by_name = {level.name: level for level in levels}
        return ForestTile(
            name=name,
            terrain=TerrainPrim(
                points_m=arrays["terrain.points_m"], faces=arrays["terrain.faces"], st=arrays["terrain.st"]
            ),
            levels=levels,
            auto=None if header["auto"] is None else _read_auto(header["auto"]),
            shots=[_read_shot(arrays, number, stored, by_name) for number, stored in enumerate(header["shots"])],
        )


def _tile_file(folder: Path, name: str) -> Path:
    return folder / TILES / f"{name or WHOLE}.npz"


def _pack_outline(outline: ForestOutline) -> dict[str, object]:
    return {
        "tiles": list(outline.tiles),
        "levels": list(outline.levels),
        "times": dict(outline.times),
        "ground": asdict(outline.ground),
        "has_grass": outline.has_grass,
        "asset_from_terrain": outline.asset_from_terrain.tolist(),
        "provenance": asdict(outline.provenance),
        "rows": [asdict(row) for row in outline.rows],
        "remarks": [each.as_json() for each in outline.remarks],
        "legend": [asdict(row) for row in outline.legend],
        "histograms": [asdict(each) for each in outline.histograms],
        "pictures": [_pack_picture(each) for each in outline.pictures],
    }


def _pack_picture(picture: ForestPicture) -> dict[str, object]:
    pinhole = picture.pinhole
    return {
        "title": picture.title,
        "file": picture.file,
        "pinhole": None if pinhole is None else {**asdict(pinhole), "cam_from_world": pinhole.cam_from_world.tolist()},
        "level": picture.level,
        "frame": picture.frame,
    }


def _read_picture(stored: Mapping[str, Any]) -> ForestPicture:
    camera = stored["pinhole"]
    pinhole = None
    if camera is not None:
        pinhole = Pinhole(
            width_px=camera["width_px"],
            height_px=camera["height_px"],
            focal_px=tuple(camera["focal_px"]),
            center_px=tuple(camera["center_px"]),
            cam_from_world=np.array(camera["cam_from_world"], np.float64),
        )
    return ForestPicture(**{**stored, "pinhole": pinhole})


def _pack_tile(tile: ForestTile) -> dict[str, NDArray[Any]]:
    """Arrays by name. What a level shares with the first one is there once."""
    header: dict[str, object] = {
        "levels": [_describe_level(level) for level in tile.levels],
        "auto": None if tile.auto is None else asdict(tile.auto),
        "shots": [_describe_shot(shot) for shot in tile.shots],
    }
    arrays: dict[str, NDArray[Any]] = {
        _HEADER: np.frombuffer(json.dumps(header, ensure_ascii=False).encode(), np.uint8),
        "terrain.points_m": tile.terrain.points_m,
        "terrain.faces": tile.terrain.faces,
        "terrain.st": tile.terrain.st,
    }
    for number, level in enumerate(tile.levels):
        for name in _ARRAYS:
            values = getattr(level, name)
            if number == 0 or not np.array_equal(values, getattr(tile.levels[0], name)):
                arrays[f"level.{number}.{name}"] = values
    for number, shot in enumerate(tile.shots):
        arrays |= _pack_grass(shot.grass, f"shot.{number}.grass")
        for place, level in enumerate(shot.levels):
            arrays[f"shot.{number}.{place}.ids"] = level.ids
            hidden = [each.ids for each in level.hidden]
            arrays[f"shot.{number}.{place}.frames"] = np.array([each.frame for each in level.hidden], np.float64)
            arrays[f"shot.{number}.{place}.ends"] = np.cumsum([len(ids) for ids in hidden], dtype=np.int64)
            arrays[f"shot.{number}.{place}.hidden"] = np.concatenate([np.zeros(0, np.int64), *hidden])
    return arrays


def _describe_level(level: PlantedLevel) -> dict[str, object]:
    return {
        "name": level.name,
        "seed": level.seed,
        "lod_distance_m": list(level.lod_distance_m),
        "orthophoto": level.orthophoto,
        "orthophoto_bounds_m": list(level.orthophoto_bounds_m),
        "prototypes": [
            {
                **asdict(replace(each, selections=dict(each.selections), leaves=None)),
                "extent_m": each.extent_m.tolist(),
                "leaves": _describe_leaves(each.leaves),
            }
            for each in level.prototypes
        ],
    }


def _read_auto(stored: Mapping[str, Any]) -> AutoPlants:
    return AutoPlants(**{**stored, "lod_distance_m": tuple(stored["lod_distance_m"])})


def _read_level(arrays: Mapping[str, NDArray[Any]], number: int, stored: Mapping[str, Any]) -> PlantedLevel:
    own: dict[str, Any] = {name: arrays.get(f"level.{number}.{name}", arrays[f"level.0.{name}"]) for name in _ARRAYS}
    return PlantedLevel(
        name=stored["name"],
        prototypes=[_read_prototype(each) for each in stored["prototypes"]],
        seed=stored["seed"],
        lod_distance_m=tuple(stored["lod_distance_m"]),
        orthophoto=stored["orthophoto"],
        orthophoto_bounds_m=tuple(stored["orthophoto_bounds_m"]),
        **own,
    )


def _read_prototype(stored: Mapping[str, Any]) -> ForestPrototype:
    trunk_m = stored["trunk_m"]
    made = {
        "scale_range": tuple(stored["scale_range"]),
        "trunk_m": None if trunk_m is None else tuple(trunk_m),
        "extent_m": np.array(stored["extent_m"], np.float64).reshape(2, 3),
        "leaves": _read_leaves(stored["leaves"]),
    }
    return ForestPrototype(**{**stored, **made})


def _describe_leaves(leaves: OtherLeaves | None) -> dict[str, object] | None:
    if leaves is None:
        return None
    return {
        "leaf_map": leaves.leaf_map,
        "brightness": leaves.brightness,
        "clusters": [
            {each.name: getattr(form, each.name).tolist() for each in fields(form)} for form in leaves.clusters
        ],
        "extent": leaves.extent.tolist(),
    }


def _read_leaves(stored: Mapping[str, Any] | None) -> OtherLeaves | None:
    if stored is None:
        return None
    clusters = [
        LeafCluster(**{name: np.array(values, np.float64) for name, values in form.items()})
        for form in stored["clusters"]
    ]
    return OtherLeaves(
        leaf_map=stored["leaf_map"],
        brightness=stored["brightness"],
        clusters=tuple(clusters),
        extent=np.array(stored["extent"], np.float64).reshape(2, 3),
    )


def _describe_shot(shot: PlantedShot) -> dict[str, object]:
    return {
        "name": shot.name,
        "levels": [level.name for level in shot.levels],
        "clumps": 0 if shot.grass is None else len(shot.grass.forms),
        "frames": list(shot.frames),
        "time_codes_per_second": shot.time_codes_per_second,
        "frames_per_second": shot.frames_per_second,
    }


def _read_shot(
    arrays: Mapping[str, NDArray[Any]], number: int, stored: Mapping[str, Any], levels: Mapping[str, PlantedLevel]
) -> PlantedShot:
    """Its plants are some of those that the tile has in the same levels."""
    seen: Sequence[PlantedLevel] = [
        _read_seen(arrays, f"shot.{number}.{place}", levels[name]) for place, name in enumerate(stored["levels"])
    ]
    return PlantedShot(
        name=stored["name"],
        levels=seen,
        frames=tuple(stored["frames"]),
        time_codes_per_second=stored["time_codes_per_second"],
        frames_per_second=stored["frames_per_second"],
        grass=_read_grass(arrays, f"shot.{number}.grass", stored["clumps"]),
    )


def _pack_grass(grass: GrassPrim | None, prefix: str) -> dict[str, NDArray[Any]]:
    if grass is None:
        return {}
    arrays = {f"{prefix}.{name}": getattr(grass, name) for name in _GRASS}
    for number, form in enumerate(grass.forms):
        arrays |= {f"{prefix}.{number}.{each.name}": getattr(form, each.name) for each in fields(form)}
    return arrays


def _read_grass(arrays: Mapping[str, NDArray[Any]], prefix: str, forms: int) -> GrassPrim | None:
    if not forms:
        return None
    clumps = [
        GrassClump(**{each.name: arrays[f"{prefix}.{number}.{each.name}"] for each in fields(GrassClump)})
        for number in range(forms)
    ]
    return GrassPrim(forms=clumps, **{name: arrays[f"{prefix}.{name}"] for name in _GRASS})


def _read_seen(arrays: Mapping[str, NDArray[Any]], prefix: str, level: PlantedLevel) -> PlantedLevel:
    seen = level.take(np.searchsorted(level.ids, arrays[f"{prefix}.ids"]))  # ids rise in a tile
    frames, ends = arrays[f"{prefix}.frames"], arrays[f"{prefix}.ends"]
    hidden = np.split(arrays[f"{prefix}.hidden"], ends[:-1])[: len(ends)]
    return replace(
        seen,
        hidden=tuple(HiddenPlants(frame=frame, ids=ids) for frame, ids in zip(frames.tolist(), hidden, strict=True)),
    )
