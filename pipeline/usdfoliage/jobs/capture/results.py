"""What a run over photographs writes: maps in their folders, cloud, layer, capture.toml, and facts for the report."""

import os
import shutil
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from usdfoliage import __version__
from usdfoliage.asset.capture_layer import CaptureCamera, CaptureLayerSettings, write_capture_layer
from usdfoliage.asset.plant import asset_name
from usdfoliage.capture.cloud.model import Cloud
from usdfoliage.capture.cloud_files.ply import write_cloud
from usdfoliage.capture.folder.listing import CAMERAS
from usdfoliage.capture.folder.read import Capture
from usdfoliage.capture.folder.settings import FILE_NAME, complete_capture_settings, frame_values
from usdfoliage.files.reading import read_regular
from usdfoliage.files.unwritten import describe_unwritten
from usdfoliage.jobs.capture.depth_tasks import DepthTasks, PreparedViews, in_world, picture_of, read_estimate
from usdfoliage.jobs.capture.maps import KINDS, ViewMaps
from usdfoliage.jobs.capture.photograph import CapturePhotograph, DrawnMaps
from usdfoliage.jobs.capture.poses import PosedCapture, failures_of
from usdfoliage.jobs.work.results import write_whole

CLOUD, LAYER, LAYER_CLOUD, REPORT = "cloud.ply", "capture.usda", "capture_cloud.usdc", "report"


def written_names() -> tuple[str, ...]:
    """The files and folders of a capture that a run replaces whole."""
    return (CLOUD, LAYER, LAYER_CLOUD, REPORT, *KINDS)


def lay_maps(new: Path, maps: Sequence[ViewMaps], places: Sequence[str]) -> None:
    """Links to the maps, in folders as the capture is to have them.

    Raises:
        WriteError: They cannot be written.
    """
    stems = Counter(PurePosixPath(view_maps.name).with_suffix("") for view_maps in maps)
    for view_maps in maps:
        stem = PurePosixPath(view_maps.name).with_suffix("")
        name = f"{stem if stems[stem] == 1 else view_maps.name}.exr"  # a.jpg beside a.png
        for place, path in zip(places, view_maps.files, strict=True):
            there = new / place / name
            try:
                there.parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(path, there)
                except OSError:  # no links on this disk, or the disk is full: then the copy raises
                    shutil.copyfile(path, there)
            except OSError as error:
                raise describe_unwritten(there, error, goes_on=True) from error


def write_results(new: Path, capture: Capture, prepared: PreparedViews, cloud: Cloud) -> None:
    """Cloud, layer and capture.toml, into a folder of their own.

    Raises:
        FoliageError: They cannot be written.
    """
    settings = capture.settings
    cameras = [
        CaptureCamera(
            name=view.name,
            photo=f"images/{view.name}",
            camera=view.camera,
            lens=None if view.lens.is_pinhole else view.lens,
        )
        for view in prepared.views
    ]
    layer_settings = CaptureLayerSettings(asset_from_world=capture.asset_from_world)
    if settings.up_vector is None and settings.up_axis in ("Y", "Z"):
        layer_settings = CaptureLayerSettings(up_axis=settings.up_axis)
    write_capture_layer(new / LAYER, cameras, cloud, asset_name(capture.name), layer_settings)
    write_cloud(new / CLOUD, cloud, [f"usdfoliage {__version__}"], settings.metres_per_unit)
    settings_file = capture.folder / FILE_NAME
    text = read_regular(settings_file).decode("utf-8") if settings_file.is_file() else ""
    completed = complete_capture_settings(text, frame_values(settings))
    if completed != text:
        write_whole(new / FILE_NAME, completed.encode("utf-8"))


def lay_cameras(new: Path, model: Path) -> None:
    """A copy of the model of estimated poses, as the capture is to have it.

    Raises:
        WriteError: It cannot be written.
    """
    try:
        shutil.copytree(model, new / CAMERAS)
    except OSError as error:
        raise describe_unwritten(new / CAMERAS, error, goes_on=True) from error


def describe_photographs(
    posed: PosedCapture, prepared: PreparedViews, tasks: DepthTasks, maps: Sequence[ViewMaps]
) -> list[CapturePhotograph]:
    """What the report states of each photograph, those without a camera last."""
    coverage = {view_maps.name: view_maps.coverage for view_maps in maps}
    failures = failures_of(posed, prepared.dropped)
    numbers = {view.name: number for number, view in enumerate(tasks.views)}
    registered = {} if posed.registered is None else {photo.name: photo for photo in posed.registered.photos}
    photographs = []
    for index, view in enumerate(tasks.views):
        found = registered.get(view.name)
        photographs.append(
            CapturePhotograph(
                name=view.name,
                camera=view.camera,
                error_px=None if found is None else found.error_px,
                points=None if found is None else found.points,
                sources=[numbers[tasks.views[k].name] for k in tasks.plan.sources[index]],
                coverage=coverage.get(view.name, 0.0),
                read_maps=partial(_show, tasks, index) if view.name in coverage else None,
            )
        )
    return photographs + [CapturePhotograph(name=name, failure=failures[name]) for name in sorted(failures)]


def shared_matches(posed: PosedCapture, photographs: Sequence[CapturePhotograph]) -> NDArray[np.float64] | None:
    """(N, N), features that two photographs share; None where poses were given."""
    if posed.registered is None:
        return None
    places = {name: place for place, name in enumerate(posed.registered.names)}
    listed = [places.get(photograph.name, -1) for photograph in photographs]
    padded = np.pad(posed.registered.matches, (0, 1))  # the last row is of those that nobody looked at
    return np.asarray(padded[np.ix_(listed, listed)], np.float64)


def _show(tasks: DepthTasks, index: int) -> DrawnMaps:
    """The maps of one photograph as they were found."""
    estimate = read_estimate(tasks, index)
    if estimate is None:
        raise ValueError(f"view {index} has no depth")
    picture = picture_of(tasks, index)
    return DrawnMaps(
        srgb=picture.srgb,
        depth_m=estimate.depth_m,
        normals=in_world(estimate.normals, estimate.camera),
        confidence=estimate.confidence,
        mask=None if picture.mask is None else picture.mask > 0,
    )


def list_results(new: Path) -> list[str]:
    """What is to be published beside the maps, the cloud last: where it is new, all is."""
    return [name for name in (CAMERAS, LAYER_CLOUD, LAYER, FILE_NAME, REPORT, CLOUD) if (new / name).exists()]
