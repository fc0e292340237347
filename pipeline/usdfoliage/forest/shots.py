"""Which plant a camera sees in which form, for the whole path of a shot.

A plant changes its form where the camera comes within a distance of its own, and back again a little farther away: no
two neighbours change together, and none changes forth and back where the camera lingers. What no frame sees is not
drawn at all. The plants that the camera comes nearest to are full in all frames, since such a change would be seen.

Source:
    The thesis on semi-procedural landscapes, section 6.3; switches per shot instead of per frame drawn: ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class ShotForm(IntEnum):
    """How a plant is drawn, from near to far."""

    FULL = 0
    NEAR = 1
    FAR = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPath:
    """Where a camera stands in each of F frames, and what it sees: Y up, metres."""

    frame: NDArray[np.float64]  # (F,), time codes that rise
    eye_m: NDArray[np.float64]  # (F, 3)
    axes: NDArray[np.float64]  # (F, 3, 3), rows: to the right, up, and backwards
    window: NDArray[np.float64]  # (F, 4), left, right, bottom and top of what is seen, at a distance of 1

    def __post_init__(self) -> None:
        count = len(self.frame)
        if not count or self.eye_m.shape != (count, 3) or self.axes.shape != (count, 3, 3):
            raise ValueError("a camera's path needs a frame, and a place and axes for each")
        if self.window.shape != (count, 4) or not (np.diff(self.frame) > 0).all():
            raise ValueError("a camera's path needs a window for each frame, and frames that rise")
        if not all(np.isfinite(each).all() for each in (self.frame, self.eye_m, self.axes, self.window)):
            raise ValueError("a camera's path must be finite")


@dataclass(frozen=True, kw_only=True)
class ShotSettings:
    """When plants change their form, and which are drawn."""

    lod_distance_m: tuple[float, float] = (100.0, 200.0)  # between which each changes from its near to its far form
    hysteresis: float = 0.05  # of its distance, by which a plant must be nearer or farther to change
    margin: float = 0.1  # of the picture's width and height, beyond its edges, where plants are kept
    max_full: int = 20  # the nearest, which are full plants in the whole shot
    full_share: float = 0.5  # of the nearer distance, within which the camera must come to them

    def __post_init__(self) -> None:
        near_m, far_m = self.lod_distance_m
        if not 0 <= near_m <= far_m < np.inf:
            raise ValueError(
                f"lod_distance must be two distances from 0 on, the nearer first, not {near_m:g} {far_m:g}"
            )
        if self.max_full < 0:
            raise ValueError(f"max-full-plants must be 0 or more, not {self.max_full}")
        if not (0 <= self.hysteresis < 1 and 0 <= self.margin < np.inf and self.full_share >= 0):
            raise ValueError("hysteresis must be from 0 to below 1; margin and full_share not below 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class Switch:
    """What changes from one frame to the next."""

    frame: float  # from which on
    plant: NDArray[np.int64]  # (K,)
    form: NDArray[np.int8]  # (K,), what each becomes


@dataclass(frozen=True, kw_only=True, eq=False)
class ShotPlan:
    """How N plants are drawn in a shot."""

    seen: NDArray[np.bool_]  # (N,), in any frame
    first: NDArray[np.int8]  # (N,), the ShotForm of each in the first frame
    switches: Sequence[Switch]  # of plants that are seen, by rising frame
    frames: tuple[float, float]  # the first and the last

    @property
    def count(self) -> int:
        """How often a plant changes its form."""
        return sum(len(each.plant) for each in self.switches)

    def forms_at(self, frame: float) -> NDArray[np.int8]:
        """(N,) the form of each plant at a frame."""
        forms = self.first.copy()
        for switch in self.switches:
            if switch.frame > frame:
                break
            forms[switch.plant] = switch.form
        return forms


def plan_shot(
    center_m: NDArray[np.float64],
    reach_m: NDArray[np.float64],
    jitter: NDArray[np.float64],
    may_be_full: NDArray[np.bool_],
    path: CameraPath,
    settings: ShotSettings = ShotSettings(),
) -> ShotPlan:
    """Decide for each plant whether it is drawn, and when it changes its form.

    Args:
        center_m: (N, 3), middles of the plants, in the camera's frame of reference.
        reach_m: (N,), radii of the spheres around them.
        jitter: (N,), from 0 to 1, where between the distances each changes.
        may_be_full: (N,), plants that have a form FULL.
        path: Of the camera.
        settings: When.
    """
    seen = np.zeros(len(center_m), bool)
    nearest_m = np.full(len(center_m), np.inf)
    for number in range(len(path.frame)):
        inside = is_in_view(center_m, reach_m, path, number, settings.margin)
        seen |= inside
        away_m = np.linalg.norm(center_m[inside] - path.eye_m[number], axis=1)
        nearest_m[inside] = np.minimum(nearest_m[inside], away_m)
    near_m, far_m = settings.lod_distance_m
    limit_m = near_m + jitter * (far_m - near_m)
    full_m = settings.full_share * near_m * (0.5 + 0.5 * jitter)
    candidates = np.flatnonzero(seen & may_be_full & (nearest_m < full_m))
    promoted = candidates[np.argsort(nearest_m[candidates], kind="stable")[: settings.max_full]]
    changes = seen.copy()
    changes[promoted] = False
    switches = []
    near = first_near = np.zeros(0, bool)
    for number in range(len(path.frame)):
        away_m = np.linalg.norm(center_m - path.eye_m[number], axis=1)
        if number == 0:
            near = first_near = away_m < limit_m
            continue
        # Farther than its distance a near plant stays near for a little, and a far one far within it.
        kept = np.where(near, 1 + settings.hysteresis, 1 - settings.hysteresis)
        now = np.where(near, away_m <= limit_m * kept, away_m < limit_m * kept)
        plants = np.flatnonzero((now != near) & changes)
        near = now
        if len(plants):
            forms = np.where(near[plants], ShotForm.NEAR, ShotForm.FAR).astype(np.int8)
            switches.append(Switch(frame=float(path.frame[number]), plant=plants, form=forms))
    first = np.where(first_near, ShotForm.NEAR, ShotForm.FAR).astype(np.int8)
    first[promoted] = ShotForm.FULL
    return ShotPlan(seen=seen, first=first, switches=switches, frames=(float(path.frame[0]), float(path.frame[-1])))


def is_in_view(
    center_m: NDArray[np.float64], reach_m: NDArray[np.float64], path: CameraPath, number: int, margin: float
) -> NDArray[np.bool_]:
    """(N,) spheres that reach into what the camera sees in a frame.

    Args:
        center_m: (N, 3), their middles, in the camera's frame of reference.
        reach_m: (N,), their radii.
        path: Of the camera.
        number: Of the frame, from 0.
        margin: Of the picture's width and height, beyond its edges.
    """
    x, y, z = ((center_m - path.eye_m[number]) @ path.axes[number].T).T
    left, right, bottom, top = path.window[number]
    aside, above = margin * (right - left), margin * (top - bottom)
    inside = np.asarray(-z > -reach_m)
    # Distances to the planes through the eye, positive outside: z is negative in front of the camera.
    for across, edge in ((x, right + aside), (-x, aside - left), (y, top + above), (-y, above - bottom)):
        inside &= (across + edge * z) / np.hypot(1.0, edge) < reach_m
    return inside
