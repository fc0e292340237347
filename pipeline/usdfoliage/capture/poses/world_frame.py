"""How long a metre is and where up is in a world of cameras that were found by pictures alone."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.folder.listing import named
from usdfoliage.capture.folder.photo_set import PhotoFile
from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.capture.poses.result import Registered
from usdfoliage.capture.poses.up_direction import UpDirection, find_ups
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import Remark, Remedy, Setting, remark

Array = NDArray[np.float64]

UPS = ("auto", "gps", "elevation", "level", "ground", "ring", "trunk", "photographs")
_EARTH_M = 6_371_008.8  # mean radius
_DISAGREE_RAD = math.radians(12)


@dataclass(frozen=True, kw_only=True)
class KnownDistance:
    """The distance between the cameras of two photographs."""

    photographs: tuple[str, str]
    metres: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.metres) and self.metres > 0):
            raise ValueError(f"the distance must be above 0 m, not {self.metres}")
        if self.photographs[0] == self.photographs[1]:
            raise ValueError(f"the distance must be between two photographs, not {self.photographs[0]} and itself")


@dataclass(frozen=True, kw_only=True)
class ScaleBar:
    """Two marks whose distance is known, and where photographs show them: x and y in pixels, as stored."""

    first: tuple[tuple[str, float, float], ...]  # photograph, x, y; two or more
    second: tuple[tuple[str, float, float], ...]
    metres: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.metres) and self.metres > 0):
            raise ValueError(f"the scale bar must be longer than 0 m, not {self.metres}")
        for end, places in (("first", self.first), ("second", self.second)):
            if len({name for name, _, _ in places}) < 2:
                raise ValueError(f"the {end} end of the scale bar must be shown by two photographs, not {len(places)}")
            if not all(math.isfinite(number) for _, *place in places for number in place):
                raise ValueError(f"the {end} end of the scale bar must be at finite places")


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """What the user states of the world, and how far other evidence is used."""

    times: float = 1.0  # The world is made larger by this factor than it is without it. Range: 1e-9 to 1e9.
    # Two cameras stand this distance apart. The file capture.toml is the better place for it. Unit: metres. Range:
    # above 0.
    known_distance: KnownDistance | None = None
    # Two marks that photographs show lie this distance apart. The file capture.toml is the better place for it. Unit:
    # metres. Range: above 0.
    scale_bar: ScaleBar | None = None
    # The up direction comes from this evidence: gps, elevation, level, ground, ring, trunk or photographs; auto takes
    # the surest that is there.
    up: str = "auto"
    # This is the up direction in the world as it is without this setting; it takes precedence over up. Unit: world
    # axes. Range: not zero.
    up_vector: tuple[float, float, float] | None = None
    # The up direction and the scale come from GPS only where at least this many photographs have a position. Range: 3
    # or more.
    min_gps: int = 4
    # GPS positions are used where they spread over at least this many times their own disagreement. Range: above 0.
    gps_spread: float = 5.0

    def __post_init__(self) -> None:
        if not 1e-9 <= self.times <= 1e9:
            raise ValueError(f"the scale must be in 1e-9 to 1e9, not {self.times:g}")
        if self.up not in UPS:
            raise ValueError(f"up must be one of {', '.join(UPS)}, not {self.up!r}")
        if self.up_vector is not None and not (np.isfinite(self.up_vector).all() and np.any(self.up_vector)):
            raise ValueError(f"up_vector must be finite and not 0, not {self.up_vector}")
        if self.min_gps < 3 or not self.gps_spread > 0:
            raise ValueError(f"min_gps must be at least 3 and gps_spread above 0, not {self}")
        if self.known_distance is not None and self.scale_bar is not None:
            raise ValueError("give one of known_distance and scale_bar")


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldFrame:
    """A world in metres, Y up, the ground or the lowest points at 0, the first photograph taken from +Z."""

    world_from_registered: Array  # (4, 4), a similarity for column vectors
    scale_known: bool  # else a unit is the median distance from the cameras to the points they see, and called a metre
    scale_from: str  # "scale", "distance", "scale bar", "gps" or "nothing"
    up_from: str  # "given" or one of UPS
    up_error_rad: float  # estimated
    remarks: tuple[Remark, ...]

    @property
    def metres_per_unit(self) -> float:
        """Metres per unit of the reconstruction."""
        return float(np.cbrt(np.linalg.det(self.world_from_registered[:3, :3])))


class _Gps(NamedTuple):
    scale: float  # metres per unit
    up: Array  # (3,), unit, in the reconstruction
    residual_m: float  # rms
    spread_m: float  # rms
    flat: float  # second largest spread over the largest: 0 on a line, which has no information on up


def read_scale_hints(values: Mapping[str, Any], where: str) -> tuple[KnownDistance | None, ScaleBar | None]:
    """Read the tables known_distance and scale_bar of capture.toml.

        [known_distance]                       [scale_bar]
        photographs = ["a.jpg", "b.jpg"]       metres = 0.5
        metres = 1.25                          first = { "a.jpg" = [120, 840], "b.jpg" = [96.5, 812] }
                                               second = { "a.jpg" = [530, 838], "b.jpg" = [515, 820] }

    Args:
        values: Of the whole file.
        where: The file, for messages.

    Raises:
        CaptureError: A table is not as above.
    """
    try:
        distance = bar = None
        if "known_distance" in values:
            table = values["known_distance"]
            first, second = table["photographs"]
            distance = KnownDistance(photographs=(str(first), str(second)), metres=float(table["metres"]))
        if "scale_bar" in values:
            table = values["scale_bar"]
            ends = [
                tuple((str(name), float(x), float(y)) for name, (x, y) in table[end].items())
                for end in ("first", "second")
            ]
            bar = ScaleBar(first=ends[0], second=ends[1], metres=float(table["metres"]))
    except KeyError as error:
        raise CaptureError(f"{where}: known_distance or scale_bar lacks {error}") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise CaptureError(f"{where}: known_distance or scale_bar is not as it must be: {error}") from error
    return distance, bar


def level_and_scale(
    registered: Registered, photos: Sequence[PhotoFile], settings: WorldSettings = WorldSettings()
) -> WorldFrame:
    """Find a metric world with Y up for registered cameras.

    Every method of finding up that the pictures allow is tried, and the surest taken; there is a remark where others
    disagree. A factor or direction that the user gives is one in the world as it is found without that, since that is
    the one in which anything can be measured or viewed.

    Args:
        registered: Cameras and points, in any world.
        photos: Position and orientation by their files, by name; more than are registered may be there.
        settings: What the user states.

    Raises:
        CaptureError: A photograph that the user names has no camera; a scale bar or distance of no length there; no up
            is found by the method that the user wants.
    """
    by_name = {photo.name: photo for photo in photos}
    files = [by_name.get(photo.name) for photo in registered.photos]
    poses = np.array([photo.cam_from_world for photo in registered.photos])
    centers = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
    distance = _viewing_distance(registered, centers)
    gps, remarks = _fit_gps(centers, files, settings)

    ups = find_ups(registered, poses, centers, files, _gps_up(gps, len(centers)), distance)
    if settings.up_vector is not None:
        found = level_and_scale(registered, photos, replace(settings, up_vector=None)).world_from_registered
        vector = np.linalg.solve(found[:3, :3], np.array(settings.up_vector, np.float64))
        chosen = UpDirection("given", vector / np.linalg.norm(vector), 0.0)
    elif settings.up != "auto":
        of_kind = [up for up in ups if up.method == settings.up]
        if not of_kind:
            methods = ", ".join(up.method for up in ups)
            raise CaptureError(f"up cannot be found by {settings.up} in these photographs; it can by {methods}")
        chosen = of_kind[0]
    else:
        chosen = min(ups, key=lambda up: up.error_rad)
        remarks += list_disagreements(chosen, ups)
        if chosen.error_rad > math.radians(5):
            text = f"up is found by {chosen.method} and may be wrong by {math.degrees(chosen.error_rad):.0f}°"
            method = Setting(name="capture.world.up")
            remarks.append(remark("up-uncertain", text, remedy=("where it is, choose another method with ", method)))

    scale, scale_from = find_scale(registered, centers, gps, distance, settings)
    if settings.times != 1:
        scale, scale_from = settings.times * scale, "scale"
    if scale_from == "nothing":
        text = "the scale is unknown, and the median distance from the cameras to what they see is taken for 1 m"
        remedy = (
            "measure something in the cloud, and give its true length over that one as ",
            Setting(name="capture.world.times"),
            "; or put a known distance between two cameras, or a scale bar, into capture.toml",
        )
        remarks.append(remark("scale-unknown", text, remedy=remedy))
    return WorldFrame(
        world_from_registered=_similarity(registered, poses, centers, chosen.direction, scale),
        scale_known=scale_from != "nothing",
        scale_from=scale_from,
        up_from=chosen.method,
        up_error_rad=chosen.error_rad,
        remarks=tuple(remarks),
    )


def move_registered(registered: Registered, world_from_registered: Array) -> Registered:
    """The same cameras and points in another world.

    Args:
        registered: In its world.
        world_from_registered: (4, 4), a similarity.
    """
    scale = float(np.cbrt(np.linalg.det(world_from_registered[:3, :3])))
    turn, move = world_from_registered[:3, :3] / scale, world_from_registered[:3, 3]
    photos = []
    for photo in registered.photos:
        rotation = photo.cam_from_world[:, :3] @ turn.T
        translation = scale * photo.cam_from_world[:, 3] - rotation @ move
        photos.append(replace(photo, cam_from_world=np.column_stack([rotation, translation])))
    points = registered.points @ world_from_registered[:3, :3].T + move
    return replace(registered, photos=tuple(photos), points=points)


def _viewing_distance(registered: Registered, centers: Array) -> float:
    """Median distance from the cameras to the points that they see, in units of the reconstruction."""
    if not len(registered.track_photos):
        spread = float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max())
        return spread or 1.0
    point_of = np.repeat(np.arange(len(registered.points)), np.diff(registered.track_starts))
    apart = np.linalg.norm(registered.points[point_of] - centers[registered.track_photos], axis=1)
    return float(np.median(apart)) or 1.0


def find_scale(
    registered: Registered, centers: Array, gps: _Gps | None, distance: float, settings: WorldSettings
) -> tuple[float, str]:
    """Metres per unit, and what it is taken from."""
    if settings.known_distance is not None:
        first, second = (
            centers[_number(registered, name, "known_distance")] for name in settings.known_distance.photographs
        )
        apart = float(np.linalg.norm(second - first))
        if apart <= 1e-6 * distance:
            raise CaptureError(f"{' and '.join(settings.known_distance.photographs)} were taken from one place")
        return settings.known_distance.metres / apart, "distance"
    if settings.scale_bar is not None:
        ends = [
            _intersect_rays(registered, centers, places)
            for places in (settings.scale_bar.first, settings.scale_bar.second)
        ]
        apart = float(np.linalg.norm(ends[1] - ends[0]))
        if apart <= 1e-6 * distance:
            raise CaptureError("the ends of the scale bar are one place", "give the places of its two marks")
        return settings.scale_bar.metres / apart, "scale bar"
    if gps is not None:
        return gps.scale, "gps"
    return 1 / distance, "nothing"


def _number(registered: Registered, name: str, what: str) -> int:
    for number, photo in enumerate(registered.photos):
        if photo.name == name:
            return number
    raise CaptureError(
        f"{what} names {name!r}, which has no camera; there are {named([photo.name for photo in registered.photos])}"
    )


def _intersect_rays(registered: Registered, centers: Array, places: Sequence[tuple[str, float, float]]) -> Array:
    """(3,), the point nearest to the rays through places of photographs."""
    matrix, side = np.zeros((3, 3)), np.zeros(3)
    for name, x, y in places:
        number = _number(registered, name, "scale_bar")
        photo = registered.photos[number]
        ray = photo.cam_from_world[:, :3].T @ _ray(photo.lens, x, y)
        across = np.eye(3) - np.outer(ray, ray)
        matrix += across
        side += across @ centers[number]
    if np.linalg.cond(matrix) > 1e6:
        raise CaptureError(
            f"the rays to an end of the scale bar are parallel: {', '.join(name for name, _, _ in places)} were taken "
            f"from one place",
            "mark it in photographs farther apart",
        )
    return np.asarray(np.linalg.solve(matrix, side), np.float64)


def _ray(lens: Lens, x: float, y: float) -> Array:
    """(3,), unit, in camera axes."""
    matrix = np.array([[lens.focal_px[0], 0, lens.center_px[0]], [0, lens.focal_px[1], lens.center_px[1]], [0, 0, 1.0]])
    model = LENS_MODELS[lens.model]
    coefficients = np.zeros(4 if model.distortion <= 4 else 8)
    coefficients[: len(lens.distortion)] = lens.distortion
    undistort = cv2.fisheye.undistortPoints if model.fisheye else cv2.undistortPoints
    place = undistort(np.array([[[x, y]]], np.float64), matrix, coefficients).reshape(2)
    ray = np.array([*place, 1.0])
    return np.asarray(ray / np.linalg.norm(ray))


def _fit_gps(
    centers: Array, files: Sequence[PhotoFile | None], settings: WorldSettings
) -> tuple[_Gps | None, list[Remark]]:
    """Scale and up by positions by satellite, where they lie far enough apart for how exact they are."""
    known = [number for number, file in enumerate(files) if file is not None and file.gps is not None]
    if len(known) < settings.min_gps:
        return None, []
    degrees = np.array([file.gps for file in files if file is not None and file.gps is not None], np.float64)
    east_m = np.radians(degrees[:, 1] - degrees[0, 1]) * _EARTH_M * np.cos(np.radians(degrees[0, 0]))
    north_m = np.radians(degrees[:, 0] - degrees[0, 0]) * _EARTH_M
    altitude_m = np.where(np.isfinite(degrees[:, 2]), degrees[:, 2], 0.0)
    places_m = np.column_stack([east_m, north_m, altitude_m])
    own = centers[known]
    own, places_m = own - own.mean(axis=0), places_m - places_m.mean(axis=0)
    spread_m = float(np.sqrt(np.square(places_m).sum(axis=1).mean()))
    if spread_m == 0 or not np.isfinite(degrees[:, 2]).all():
        text = "positions by satellite are all one, or without altitude, and not used"
        return None, [remark("positions-not-usable", text)]
    # Umeyama 1991: places = scale turn own.
    u, sizes, vt = np.linalg.svd(places_m.T @ own / len(own))
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u @ np.diag(signs) @ vt
    scale = float((sizes * signs).sum() / np.square(own).sum(axis=1).mean())
    residual_m = float(np.sqrt(np.square(scale * own @ turn.T - places_m).sum(axis=1).mean()))
    if spread_m < settings.gps_spread * residual_m or not scale > 0:
        text = (
            f"positions by satellite contradict the pictures by {residual_m:.2g} m over {spread_m:.2g} m, and are not "
            "used"
        )
        return None, [remark("positions-contradict-pictures", text)]
    along = np.linalg.svd(own, compute_uv=False)
    flat = float(along[1] / along[0])
    return _Gps(scale, turn[2], residual_m, spread_m, flat), []


def _gps_up(gps: _Gps | None, positions: int) -> UpDirection | None:
    """Up by positions; none by those that lie on a line."""
    if gps is None or gps.flat <= 0.05:
        return None
    error_rad = math.atan(gps.residual_m / (gps.spread_m * gps.flat * math.sqrt(positions / 2)))
    return UpDirection("gps", gps.up, error_rad)


def list_disagreements(chosen: UpDirection, ups: Sequence[UpDirection], remedy: Remedy = ()) -> list[Remark]:
    """Remarks on methods that find up elsewhere.

    Args:
        chosen: The one that is taken.
        ups: All.
        remedy: What to do; () names the setting of estimated poses.
    """
    remarks = []
    for up in ups:
        angle = math.acos(float(np.clip(chosen.direction @ up.direction, -1, 1)))
        if angle > max(_DISAGREE_RAD, 3 * (chosen.error_rad + up.error_rad)) and up.method != "photographs":
            text = (
                f"up by {chosen.method} and up by {up.method} are {math.degrees(angle):.0f}° apart; "
                f"{chosen.method} is taken"
            )
            other = "set ", Setting(name="capture.world.up", value=f'"{up.method}"'), " for the other"
            remarks.append(remark("up-methods-disagree", text, remedy=remedy or other))
    return remarks


def _similarity(registered: Registered, poses: Array, centers: Array, up: Array, scale: float) -> Array:
    """(4, 4): up becomes +Y, the first camera stands towards +Z, the middle of the points above the origin."""
    middle = np.median(registered.points, axis=0) if len(registered.points) else centers.mean(axis=0)
    behind = centers[0] - middle
    behind = behind - (behind @ up) * up
    if np.linalg.norm(behind) < 1e-6 * max(float(np.linalg.norm(centers[0] - middle)), 1e-300):
        behind = -poses[0, 2, :3] + (poses[0, 2, :3] @ up) * up
        if np.linalg.norm(behind) < 1e-6:
            behind = np.linalg.svd(np.eye(3) - np.outer(up, up))[0][:, 0]
    back = behind / np.linalg.norm(behind)
    turn = np.array([np.cross(up, back), up, back])
    heights = (registered.points if len(registered.points) else centers) @ up
    origin = middle - (middle @ up) * up + float(np.quantile(heights, 0.01)) * up
    matrix = np.eye(4)
    matrix[:3, :3] = scale * turn
    matrix[:3, 3] = -scale * turn @ origin
    return matrix
