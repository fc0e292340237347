"""How long a unit of poses is, by depth maps in metres: where points of the poses' model are, and where maps meet."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usdfoliage.geometry.pinhole import Pinhole

_MAX_VIEWS = 8  # evenly chosen
_SAMPLES = 400  # of each
_RANGE = 100.0  # factor around what the depth itself suggests
_STEPS = 460  # in that range, to begin with: 2 % each
_FINER = ((0.03, 0.02), (0.01, 0.005))  # logarithm around the best, and the tolerance of a depth
_FINE_STEPS = 41
_AGREES = 0.02  # of a depth: at the right unit the maps agree as far
_MIN_SHARE = 0.3  # of the samples that another map shows, that must agree
_RIVAL = 0.7  # of that share, that another unit may have which is off by more than 20 %
_FAR = 0.2  # logarithm of how far off
_MIN_POINTS = 20  # that maps show
_MIN_SEEN = 100
_AS_GOOD = 0.9  # of the best agreement, with which the unit as it is stays


def find_depth_unit(
    cameras: Sequence[Pinhole], maps: Sequence[NDArray[np.floating]], points: NDArray[np.floating], distance: float
) -> tuple[float, float] | None:
    """Metres of a unit of the cameras' poses, and its relative error; None where depth maps do not show it.

    Points of the model are as far away as the maps measure there, but for those that something hides. Without points,
    a place that one map measures lies, in the right unit, where another map measures it too. Where a unit of 1 m is
    within the error, it is 1. Our own.

    Args:
        cameras: (N), their poses in the unit that is looked for.
        maps: (N) of (H, W), planar depth in metres, 0 for none.
        points: (P, 3), of the model, in that unit; may be none.
        distance: About how far the cameras are from what they see, in that unit.
    """
    found = _by_points(cameras, maps, points)
    if found is None:
        found = _by_agreement(cameras, maps, distance)
    if found is not None and abs(math.log(found[0])) < 2 * max(found[1], _AGREES):
        return 1.0, max(found[1], _AGREES)
    return found


def _by_points(
    cameras: Sequence[Pinhole], maps: Sequence[NDArray[np.floating]], points: NDArray[np.floating]
) -> tuple[float, float] | None:
    """The ratio of measured depth to that of points that most samples are near, and its error.

    Hidden points have smaller ratios of all sizes, so that it is no median: it is the middle of the shortest range that
    has a quarter of the samples.
    """
    ratios = []
    for camera, depth_m in zip(cameras, maps, strict=True):
        if not len(points):
            break
        places, away = camera.project(points)
        with np.errstate(invalid="ignore"):  # NaN behind the camera
            inside = np.all((places >= 0) & (places < (camera.width_px, camera.height_px)), axis=1) & (away > 0)
        column, row = places[inside].astype(int).T
        measured = depth_m[row, column].astype(np.float64)
        ratios.append(measured[measured > 0] / away[inside][measured > 0])
    ratio = np.concatenate([np.zeros(0), *ratios])
    if len(ratio) < _MIN_POINTS:
        return None
    sorted_log = np.sort(np.log(ratio))
    quarter = max(len(ratio) // 4, 2)
    spans = sorted_log[quarter - 1 :] - sorted_log[: len(ratio) - quarter + 1]
    start = int(spans.argmin())
    middle = float(np.median(sorted_log[start : start + quarter]))
    return math.exp(middle), max(float(spans[start]), 0.001)


def _by_agreement(
    cameras: Sequence[Pinhole], maps: Sequence[NDArray[np.floating]], distance: float
) -> tuple[float, float] | None:
    """The unit in which most places of the maps lie where other maps have them."""
    chosen = np.unique(np.linspace(0, len(cameras) - 1, min(len(cameras), _MAX_VIEWS)).round().astype(int))
    if len(chosen) < 2:
        return None
    cameras, maps = [cameras[k] for k in chosen], [maps[k] for k in chosen]
    points = [_sample(camera, depth_m) for camera, depth_m in zip(cameras, maps, strict=True)]
    guess = float(np.median(np.concatenate([own[:, 2] for own in points]))) / max(distance, 1e-300)
    candidates = guess * np.geomspace(1 / _RANGE, _RANGE, _STEPS)
    scores = np.array([_agreement(cameras, maps, points, scale, _AGREES) for scale in candidates])
    best = float(candidates[int(scores.argmax())])
    if float(scores[np.abs(np.log(candidates / best)) > _FAR].max()) > _RIVAL * float(scores.max()):
        return None  # maps that hardly overlap meet anywhere
    for width, tolerance in _FINER:
        candidates = best * np.exp(np.linspace(-width, width, _FINE_STEPS))
        scores = np.array([_agreement(cameras, maps, points, scale, tolerance) for scale in candidates])
        top = scores >= scores.max() * (1 - 1e-9)
        best = float(np.exp(np.log(candidates[top]).mean()))
    share = _agreement(cameras, maps, points, best, _AGREES)
    if share < _MIN_SHARE:
        return None
    beside = max(_agreement(cameras, maps, points, best * (1 + off), _AGREES) for off in (-_AGREES, _AGREES))
    # As far as agreement hardly falls, the unit is unknown.
    return best, _AGREES / 4 if beside < _AS_GOOD * share else _AGREES


def _sample(camera: Pinhole, depth_m: NDArray[np.floating]) -> NDArray[np.float64]:
    """(S, 3), measured places in the camera's own axes, in metres."""
    rows, columns = np.nonzero(depth_m > 0)
    some = np.linspace(0, len(rows) - 1, min(len(rows), _SAMPLES)).astype(int)
    rows, columns = rows[some], columns[some]
    z = depth_m[rows, columns].astype(np.float64)
    x = (columns + 0.5 - camera.center_px[0]) / camera.focal_px[0] * z
    y = (rows + 0.5 - camera.center_px[1]) / camera.focal_px[1] * z
    return np.column_stack([x, y, z])


def _agreement(
    cameras: Sequence[Pinhole],
    maps: Sequence[NDArray[np.floating]],
    points: Sequence[NDArray[np.float64]],
    scale: float,
    tolerance: float,
) -> float:
    """Share of the places of all maps, among those that others have depth at, which lie there."""
    agree = seen = 0
    for first, camera in enumerate(cameras):
        turn, move = camera.cam_from_world[:, :3], camera.cam_from_world[:, 3] * scale
        world_m = (points[first] - move) @ turn
        for second, other in enumerate(cameras):
            if first == second:
                continue
            own = world_m @ other.cam_from_world[:, :3].T + other.cam_from_world[:, 3] * scale
            good = own[:, 2] > 0
            z = np.where(good, own[:, 2], 1.0)
            column = np.floor(own[:, 0] / z * other.focal_px[0] + other.center_px[0])
            row = np.floor(own[:, 1] / z * other.focal_px[1] + other.center_px[1])
            good &= (column >= 0) & (column < other.width_px) & (row >= 0) & (row < other.height_px)
            measured = maps[second][row[good].astype(int), column[good].astype(int)]
            z = z[good][measured > 0]
            measured = measured[measured > 0]
            seen += len(z)
            agree += int(np.count_nonzero(np.abs(z - measured) < tolerance * measured))
    return agree / seen if seen >= _MIN_SEEN else 0.0
