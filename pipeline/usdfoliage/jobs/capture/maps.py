"""Maps of a capture: depth, normals and confidence on the pixels of each photograph, as files that appear whole."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usdfoliage.capture.folder.map_files import write_confidence_map, write_depth_map, write_normal_map
from usdfoliage.capture.lens import undistort
from usdfoliage.capture.mvs.upsampling import enlarge_depth
from usdfoliage.files.hashing import digest_file
from usdfoliage.files.json import read_json
from usdfoliage.files.threads import map_threaded, share_cores
from usdfoliage.jobs.capture.depth_tasks import DepthTasks, in_world, picture_of, read_estimate
from usdfoliage.jobs.work.keys import task_key
from usdfoliage.jobs.work.results import forget, write_whole
from usdfoliage.progress import Progress

MAPS = "maps"  # in the work folder
KINDS = ("depth", "normals", "confidence")  # folders in the capture


@dataclass(frozen=True, kw_only=True)
class ViewMaps:
    """The maps of one photograph, in the work folder."""

    name: str  # of the photograph
    files: tuple[Path, Path, Path]  # as KINDS
    coverage: float  # share of the pixels, of those in the mask where there is one, that have depth
    footprint_m: float  # median size of a pixel on what it sees; NaN without depth


def write_maps(tasks: DepthTasks, *, threads: int = 0, progress: Progress | None = None) -> list[ViewMaps]:
    """Write the maps of every view that has sources into the work folder, unless they are there.

    Raises:
        WriteError: They cannot be written.
    """
    views = [index for index, path in enumerate(tasks.depth) if path is not None]
    maps = []
    for done, written in enumerate(
        map_threaded(lambda index: _write(tasks, index), views, threads=share_cores(threads)[0]), 1
    ):
        maps.append(written)
        if progress is not None:
            progress(done, len(views))
    return maps


def forget_other_maps(tasks: DepthTasks, maps: list[ViewMaps]) -> None:
    """Remove maps in the work folder that are not these."""
    kept = [path for view_maps in maps for path in (*view_maps.files, view_maps.files[0].parent / "record.json")]
    forget(tasks.work / MAPS, kept)


def _write(tasks: DepthTasks, index: int) -> ViewMaps:
    prepared, stored_depth = tasks.views[index], tasks.depth[index]
    key = task_key(
        "maps", "" if stored_depth is None else stored_depth.stem, prepared.lens, prepared.chosen.cam_from_world
    )
    folder = tasks.work / MAPS / key
    depth, normals, confidence = (folder / f"{kind}.exr" for kind in KINDS)
    record = folder / "record.json"
    measured = _read_record(record, (depth, normals, confidence))
    if measured is None:
        estimate = read_estimate(tasks, index)
        if estimate is None:
            raise ValueError(f"{prepared.name} has no sources, and no depth")
        mask = picture_of(tasks, index).mask
        has_depth = estimate.depth_m > 0
        wanted = has_depth if mask is None else has_depth[mask > 0]
        coverage = float(np.mean(wanted)) if wanted.size else 0.0  # a mask may be all black
        middle_m = float(np.median(estimate.depth_m[has_depth])) if has_depth.any() else np.nan
        measured = coverage, middle_m / float(np.sqrt(np.prod(estimate.camera.focal_px)))
        full = enlarge_depth(estimate, prepared.camera)
        maps = full.depth_m, in_world(full.normals, full.camera), full.confidence
        if not prepared.lens.is_pinhole:
            undistortion = undistort(prepared.lens)
            maps = tuple(undistortion.distorted(values) for values in maps)  # type: ignore[assignment]
        write_depth_map(depth, maps[0])
        write_normal_map(normals, maps[1])
        write_confidence_map(confidence, np.clip(maps[2], 0, 1))
        digests = [digest_file(path) for path in (depth, normals, confidence)]
        also = {"digests": digests, "coverage": measured[0], "footprint_m": measured[1]}
        write_whole(record, json.dumps(also).encode())
    files = depth, normals, confidence
    return ViewMaps(name=prepared.name, files=files, coverage=measured[0], footprint_m=measured[1])


def _read_record(record: Path, files: tuple[Path, Path, Path]) -> tuple[float, float] | None:
    """Coverage and footprint of maps that are there as they were written; None for others."""
    try:
        stored = read_json(record)
        if stored["digests"] != [digest_file(path) for path in files if path.is_file()]:
            return None
        return float(stored["coverage"]), float(stored["footprint_m"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
