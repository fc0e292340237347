"""The plants of a forest as the camera of a shot sees them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usdfoliage.asset.packages.forest_package import PlantedShot
from usdfoliage.asset.parts.planted import HiddenPlants, PlantedLevel
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.shot_camera import ShotCamera, read_shot_camera
from usdfoliage.errors import AssetError, CaptureError
from usdfoliage.forest.shots import ShotForm, ShotPlan, ShotSettings, plan_shot
from usdfoliage.jobs.forest.levels import CROWN, FULL, LEAVES, RELIEF
from usdfoliage.jobs.report.table import Row

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
        names = [shot_name(file) for file in self.files]
        if len(set(names)) < len(names):
            raise ValueError("two shots would have one name: rename one of the files")


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedShot:
    """A shot of a forest, and how it was planned."""

    planted: PlantedShot
    plan: ShotPlan
    camera: ShotCamera


def shot_name(file: Path) -> str:
    """The variant of a shot: shot_ and the name of its file, which may begin so itself."""
    name = asset_name(file.stem)
    return name if name.lower().startswith("shot") else f"shot_{name}"


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
    rates = sorted({camera.frames_per_second for camera in cameras})
    if len(rates) > 1:
        raise CaptureError(
            f"the shots have {' and '.join(f'{rate:g}' for rate in rates)} frames per second",
            "plant one forest for the shots of each rate",
        )
    return tuple(cameras)


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
        CaptureError: The camera never sees a plant, or the forest has no such level.
    """
    names = {ShotForm.FULL: FULL, ShotForm.NEAR: _level(request.near, NEAR_LEVELS, levels)}
    names[ShotForm.FAR] = _level(request.far, FAR_LEVELS, levels)
    any_level = levels[names[ShotForm.NEAR]]
    boxes_m = np.array([each.extent_m for each in any_level.prototypes]).reshape(-1, 2, 3)[any_level.prototype]
    # Around the plant upright: what leans reaches no farther than the sphere around it.
    middle_m = boxes_m.mean(axis=1) * any_level.scale
    center_m = any_level.position_m + [0.0, 1.0, 0.0] * middle_m
    reach_m = np.linalg.norm((boxes_m[:, 1] - boxes_m[:, 0]) / 2 * any_level.scale, axis=1)
    reach_m += np.linalg.norm(middle_m[:, [0, 2]], axis=1)
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


def _level(named: str | None, best: Sequence[str], levels: Mapping[str, PlantedLevel]) -> str:
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
