"""The plants of a forest as the camera of a shot sees them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.forest_package import PlantedShot
from usdfoliage.asset.packages.lods import AutoPlants
from usdfoliage.asset.parts.planted import HiddenPlants, PlantedLevel
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.shot_camera import ShotCamera, read_shot_camera
from usdfoliage.errors import AssetError, CaptureError
from usdfoliage.forest.shots import ShotForm, ShotPlan, ShotSettings, plan_shot
from usdfoliage.jobs.forest.levels import CROWN, FULL, LEAVES, RELIEF
from usdfoliage.jobs.report.table import Row
from usdfoliage.remarks import Argument, Remark, remark

LONGEST_NAME = 100  # letters of a shot
LEAN = 0.2  # of its height, that the middle of a leaning plant is aside at most
NEAR_LEVELS, FAR_LEVELS = (LEAVES, CROWN), (RELIEF, CROWN)  # the first that the forest has, unless the user names one


@dataclass(frozen=True, kw_only=True)
class ShotRequest:
    """The shots of a forest that are planned."""

    files: tuple[Path, ...] = ()  # with a camera each
    prim: str | None = None  # path of the camera in all of them; None where each has one
    near: str | None = None  # level of near plants; None for the best that the forest has
    far: str | None = None
    settings: ShotSettings = field(default_factory=ShotSettings)

    def __post_init__(self) -> None:
        for level in (self.near, self.far):
            if level not in (None, CROWN, RELIEF, LEAVES):
                raise ValueError(f"a level of near and far plants is one of {CROWN}, {RELIEF}, {LEAVES}, not {level}")
        named: dict[str, Path] = {}
        for file in self.files:
            name = shot_name(file)
            if len(name) > LONGEST_NAME:
                raise ValueError(f"the name of {file} has more than {LONGEST_NAME} letters: rename the file")
            other = named.setdefault(name.casefold(), file)  # some disks take letters of both cases for one
            if other is not file:
                raise ValueError(f"the shots {other} and {file} would both be {name}: rename one, or give it once")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedShot:
    """A shot of a forest, and how it was planned."""

    planted: PlantedShot
    plan: ShotPlan
    camera: ShotCamera


def shot_name(file: Path) -> str:
    """The variant of a shot: shot_ and the name of its file, which may begin so itself."""
    return asset_name(file.stem if file.stem.lower().startswith("shot") else f"shot_{file.stem}")


def read_cameras(request: ShotRequest) -> tuple[ShotCamera, ...]:
    """The camera of each shot.

    Raises:
        CaptureError: One cannot be read, or their frame rates differ.
    """
    cameras = []
    for file in request.files:
        try:
            cameras.append(read_shot_camera(file, request.prim))
        except AssetError as error:
            raise CaptureError(error.text, error.remedy) from error
    rates = sorted({(camera.time_codes_per_second, camera.frames_per_second) for camera in cameras})
    if len(rates) > 1:
        raise CaptureError(
            f"the shots have {' and '.join(f'{rate:g}' for rate, _ in rates)} frames per second",
            "plant one forest for the shots of each rate",
        )
    return tuple(cameras)


def remark_units(files: Sequence[Path], cameras: Sequence[ShotCamera]) -> list[Remark]:
    """A remark on each shot that states no unit."""
    return [
        remark(
            "shot-without-unit",
            f"{file.name} states no metersPerUnit; its lengths are taken for centimetres, as USD does",
            subject=file.name,
        )
        for file, camera in zip(files, cameras, strict=True)
        if not camera.states_unit
    ]


def plan_planted_shot(
    file: Path,
    camera: ShotCamera,
    levels: Mapping[str, PlantedLevel],
    may_be_full: NDArray[np.bool_],
    request: ShotRequest,
) -> PlannedShot:
    """The levels of a shot: in each the plants that are ever drawn so, and which of them are hidden when.

    Args:
        file: Of the shot.
        camera: Its camera.
        levels: Of the forest, by name; all have the same plants (N).
        may_be_full: (N,), plants that have more than a crown.
        request: How.

    Raises:
        CaptureError: The forest has no plants, the camera never sees one, or the forest has no such level.
    """
    near, far = choose_levels(request, levels)
    names = {ShotForm.FULL: FULL, ShotForm.NEAR: near, ShotForm.FAR: far}
    any_level = levels[near]
    if not len(any_level.ids):
        raise CaptureError(
            f"the forest has no plants, which the shot {file} could have", ("leave out ", Argument(name="camera"))
        )
    center_m, reach_m = _spheres_around([levels[name] for name in dict.fromkeys(names.values()) if name in levels])
    plan = plan_shot(center_m, reach_m, any_level.jitter, may_be_full, camera.path, request.settings)
    if not plan.seen.any():
        first, last = plan.frames
        raise CaptureError(
            f"the camera {camera.prim} of {file} sees no plant between the frames {first:g} and {last:g}",
            "give the camera in the forest's frame: Y up, metres from its middle, north to -Z",
        )
    drawn: dict[str, list[ShotForm]] = {}
    for form, name in names.items():
        drawn.setdefault(name, []).append(form)
    made = [_only(levels[name], plan, forms) for name, forms in drawn.items() if name in levels]
    planted = PlantedShot(
        name=shot_name(file),
        levels=[level for level in made if len(level.ids)],
        frames=plan.frames,
        time_codes_per_second=camera.time_codes_per_second,
        frames_per_second=camera.frames_per_second,
    )
    return PlannedShot(planted=planted, plan=plan, camera=camera)


def shot_rows(shots: Sequence[PlannedShot], plants: int) -> tuple[Row, ...]:
    """The figures of shots, for report and terminal."""
    rows = []
    for shot in shots:
        first, last = shot.plan.frames
        seen = int(shot.plan.seen.sum())
        largest = max((len(each.plant) for each in shot.plan.switches), default=0)
        rows.append(
            Row(
                name=shot.planted.name,
                value=f"{seen:,} of {plants:,} plants",
                remark=f"frames {first:g} to {last:g}; {shot.plan.count:,} changes, {largest:,} a frame at most",
            )
        )
    return tuple(rows)


def choose_levels(request: ShotRequest, levels: Collection[str]) -> tuple[str, str]:
    """The levels of near and of far plants.

    Args:
        request: Which the user names.
        levels: Those that the forest has.

    Raises:
        CaptureError: The forest does not have one.
    """
    return _level(request.near, NEAR_LEVELS, levels), _level(request.far, FAR_LEVELS, levels)


def auto_plants(
    request: ShotRequest, levels: Collection[str], lod_distance_m: tuple[float, float]
) -> AutoPlants | None:
    """What a renderer that knows UsdLod chooses from without a shot: the levels of near and far plants.

    Returns:
        None where both are drawn in one level.
    """
    near, far = choose_levels(request, levels)
    return None if near == far else AutoPlants(near=near, far=far, lod_distance_m=lod_distance_m)


def _spheres_around(levels: Sequence[PlantedLevel]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles (N, 3) and radii (N,) of spheres that hold each plant in all levels, however it is turned and leans."""
    centers_m, reaches_m = [], []
    for level in levels:
        boxes_m = np.array([each.extent_m for each in level.prototypes]).reshape(-1, 2, 3)[level.prototype]
        middle_m = boxes_m.mean(axis=1) * level.scale
        centers_m.append(level.position_m + [0.0, 1.0, 0.0] * middle_m)
        half_m = np.linalg.norm((boxes_m[:, 1] - boxes_m[:, 0]) / 2 * level.scale, axis=1)
        # Turned, a middle beside the foot is anywhere around it; leaning, one above the foot is a little aside.
        reaches_m.append(half_m + np.linalg.norm(middle_m[:, [0, 2]], axis=1) + LEAN * np.abs(middle_m[:, 1]))
    center_m = centers_m[0]
    apart_m = [np.linalg.norm(other - center_m, axis=1) for other in centers_m]
    return center_m, np.max([reach + apart for reach, apart in zip(reaches_m, apart_m, strict=True)], axis=0)


def _level(named: str | None, best: Sequence[str], levels: Collection[str]) -> str:
    if named is None:
        return next(name for name in best if name in levels)
    if named not in levels:
        raise CaptureError(
            f"no plant of the forest has the level {named}", f"choose one of {', '.join(sorted(set(levels) - {FULL}))}"
        )
    return named


def _only(level: PlantedLevel, plan: ShotPlan, forms: Sequence[ShotForm]) -> PlantedLevel:
    """The plants of a level that ever have one of these forms, each hidden while it has another."""
    members = np.isin(plan.first, forms) & plan.seen
    for switch in plan.switches:
        members[switch.plant[np.isin(switch.form, forms)]] = True
    own = np.flatnonzero(members)
    drawn_now = np.isin(plan.first, forms)
    hidden = [HiddenPlants(frame=plan.frames[0], ids=level.ids[own[~drawn_now[own]]])]
    for switch in plan.switches:
        before = drawn_now[switch.plant]
        drawn_now[switch.plant] = np.isin(switch.form, forms)
        if (members[switch.plant] & (before != drawn_now[switch.plant])).any():
            hidden.append(HiddenPlants(frame=switch.frame, ids=level.ids[own[~drawn_now[own]]]))
    return replace(level, hidden=tuple(hidden)).take(own)
