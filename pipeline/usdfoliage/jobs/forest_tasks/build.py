"""A forest that is made of tasks, and the files that decide it."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from usdfoliage.asset.locate import find_interface
from usdfoliage.asset.packages.planted_assets import needed_files, reference_path
from usdfoliage.errors import AssetError
from usdfoliage.forest.ground_files import is_ground_file
from usdfoliage.forest.plants_file import read_plants_file
from usdfoliage.forest.raster_files import list_raster_files
from usdfoliage.jobs.forest.inputs import ForestFiles
from usdfoliage.jobs.forest.request import ForestRequest
from usdfoliage.jobs.plant.input_digests import DigestBy, digest_inputs
from usdfoliage.jobs.plant.store import Store
from usdfoliage.remarks import as_plan_setting

_USD = (".usd", ".usda", ".usdc", ".usdz")
_RASTERS = ("dem", "orthophoto", "canopy", "vegetation")


@dataclass(frozen=True, kw_only=True)
class ForestBuild:
    """A forest whose tasks leave their results in a work folder. Paths are absolute: workers are elsewhere."""

    request: ForestRequest
    work: Path

    @property
    def capture(self) -> Path:
        """What the forest is planted on."""
        return self.request.files.dem

    @property
    def output(self) -> Path:
        return self.request.output

    @property
    def name(self) -> str:
        return self.request.name

    @property
    def store(self) -> Store:
        return Store(folder=self.work)


def build_of(request: ForestRequest, work: Path) -> ForestBuild:
    """The forest that a user asks for, as workers are sent it."""
    files = request.files
    paths = {role: path.absolute() for role, path in files.by_role.items()}
    return ForestBuild(
        request=replace(
            request,
            files=ForestFiles(**paths, ground=files.ground),
            shots=replace(request.shots, files=tuple(file.absolute() for file in request.shots.files)),
            output=request.output.absolute(),
            render_setting=as_plan_setting,  # that of a command is a function that no worker can be sent
        ),
        work=work.absolute(),
    )


def digest_forest(build: ForestBuild, digest_by: DigestBy) -> tuple[tuple[str, str], ...]:
    """Name and digest of every file that decides where plants stand, and how large their assets are.

    Raises:
        CaptureError: A file cannot be read.
    """
    files = dict(_list_files(build))
    return digest_inputs(build.capture, files, build.store, digest_by, f"forest {build.output}")


def _list_files(build: ForestBuild) -> Iterator[tuple[str, Path]]:
    """Files by what they are. Plants' assets have their paths from the forest, as its layers name them."""
    request = build.request
    for role, path in request.files.by_role.items():
        is_raster = role in _RASTERS and not is_ground_file(path)
        for file in list_raster_files(path) if is_raster else (path,):
            yield f"{role}/{os.path.relpath(file, path.parent)}", file
    for number, shot in enumerate(request.shots.files):
        for file in needed_files(shot) if shot.is_file() else (shot,):
            yield f"camera_{number + 1}/{os.path.relpath(file, shot.parent)}", file
    rows = read_plants_file(request.files.plants).rows
    for asset in dict.fromkeys(each for row in rows for each in (row.asset, row.leaf) if each is not None):
        if asset.is_file() and asset.suffix.lower() not in _USD:  # a picture of a leaf
            yield f"leaves/{reference_path(asset, build.output)}", asset
            continue
        try:
            layer = find_interface(asset)
        except AssetError:  # the task that measures it names the row
            continue
        for file in needed_files(layer):
            yield f"plants/{reference_path(file, build.output)}", file
