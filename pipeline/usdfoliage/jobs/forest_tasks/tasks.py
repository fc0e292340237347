"""The tasks of a forest: one plants it, and each tile is written by one of its own."""

from collections.abc import Sequence
from dataclasses import dataclass

from usdfoliage.asset.packages.interface import TILES
from usdfoliage.errors import CaptureError
from usdfoliage.jobs.forest.inputs import read_terrain
from usdfoliage.jobs.forest.planted import list_tiles
from usdfoliage.jobs.forest.planted_file import read_outline
from usdfoliage.jobs.forest_tasks.build import ForestBuild, digest_forest
from usdfoliage.jobs.plant.input_digests import DigestBy
from usdfoliage.jobs.plant.store import find_finished
from usdfoliage.jobs.plant.tasks import BuildPlan, Task, build_code_version
from usdfoliage.jobs.plant.times import expect_times
from usdfoliage.jobs.work.keys import task_key

PLANTING = "planting"  # the stage before that of the tiles, which is called as they are in the asset
ASSET, PLANTED = "asset", "planted"  # folders of results: files of the asset, and what tiles are written from


@dataclass(frozen=True, kw_only=True)
class ForestPlan:
    """The tasks of one forest."""

    tasks: BuildPlan
    digests: tuple[tuple[str, str], ...]  # name and SHA-256 of each file
    tiles: Sequence[str]  # their names, by chunk

    @property
    def planting(self) -> Task:
        return self.tasks.tasks[PLANTING]


def plan_forest(build: ForestBuild, digest_by: DigestBy = "bytes", *, with_tiles: bool = True) -> ForestPlan:
    """The tasks of a forest, with times as far as the work folder knows them.

    How many tiles there are is read from the planted forest, or else from its terrain.

    Args:
        build: The forest.
        digest_by: As find_inputs of builds has it.
        with_tiles: Whether the tiles are planned too; whoever only plants need not know them.

    Raises:
        FoliageError: The input cannot be used, or the work folder cannot be written.
    """
    request = build.request
    digests = digest_forest(build, digest_by)
    shots = request.shots
    deciding = (
        request.name,
        request.planting,
        request.max_terrain_quads,
        request.lod_distance_m,
        request.tile_m,
        request.files.ground,
        request.grass,
        (shots.prim, shots.near, shots.far, shots.settings),
        digests,
    )
    size_mb = sum(path.stat().st_size for path in request.files.by_role.values()) / 1e6
    planting = Task(
        name=PLANTING,
        stage=PLANTING,
        key=task_key(build_code_version(PLANTING), PLANTING, deciding),
        estimate_s=5.0 + size_mb,
    )
    tiles = _find_tiles(build, planting) if with_tiles else ()
    tasks = {PLANTING: planting}
    for number, tile in enumerate(tiles):
        name = TILES if len(tiles) == 1 else f"{TILES}/{number + 1}"
        tasks[name] = Task(
            name=name,
            stage=TILES,
            chunk=number,
            chunks=len(tiles),
            needs=(PLANTING,),
            key=task_key(build_code_version(TILES), TILES, tile, planting.key),
            estimate_s=1.0,
        )
    plan = BuildPlan(tasks=tasks, last=tuple(name for name in tasks if name != PLANTING))
    return ForestPlan(tasks=expect_times(plan, build.store), digests=digests, tiles=tiles)


def _find_tiles(build: ForestBuild, planting: Task) -> Sequence[str]:
    """The names of the tiles; CaptureError where there cannot be such."""
    if find_finished(build.store, planting.key, thorough=False) is not None:
        try:
            return read_outline(build.store.result(planting.key) / PLANTED).tiles
        except CaptureError:  # damaged, and made again
            pass
    if build.request.tile_m is None:
        return ("",)
    return list_tiles(build.request, read_terrain(build.request.files))
