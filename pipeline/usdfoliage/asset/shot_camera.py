"""The path of a shot's camera, read from a USD file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom

from usdfoliage.asset.locate import open_layer
from usdfoliage.errors import AssetError
from usdfoliage.forest.shots import CameraPath
from usdfoliage.remarks import Argument

MAX_FRAMES = 100_000
LAST_FRAME = 1e12  # beyond which time codes are not exact enough to count frames


@dataclass(frozen=True, kw_only=True, eq=False)
class ShotCamera:
    """A camera of a shot, and when the shot is."""

    prim: str  # path of the camera
    path: CameraPath  # Y up, metres
    time_codes_per_second: float
    frames_per_second: float
    states_unit: bool  # whether the file has metersPerUnit; without it USD takes centimetres


def read_shot_camera(file: Path, prim: str | None = None) -> ShotCamera:
    """The path of a camera through a shot, at every whole frame of it.

    The first and the last frame are those of the file, or else of what moves its camera; a file without either has one.

    Args:
        file: A USD file.
        prim: Path of the camera; without it the file has one camera.

    Raises:
        AssetError: The file cannot be read, has a unit or a rate that cannot be, or no such camera, or more than one,
            or one without perspective.
    """
    open_layer(file)
    stage = Usd.Stage.Open(str(file))
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 0 < unit < np.inf:
        raise AssetError(f"{file} has metersPerUnit {unit:g}", "author the unit of its lengths")
    rates = float(stage.GetTimeCodesPerSecond()), float(stage.GetFramesPerSecond())
    if not all(0 < rate < np.inf for rate in rates):
        raise AssetError(
            f"{file} has {rates[0]:g} time codes and {rates[1]:g} frames per second",
            "author timeCodesPerSecond and framesPerSecond",
        )
    camera = _find_camera(stage, file, prim)
    frames = _frames_of(stage, camera, file)
    up = UsdGeom.GetStageUpAxis(stage)
    # (x, y, z) -> (x, z, -y), for row vectors.
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if up == UsdGeom.Tokens.z else np.eye(3)
    eye_m, axes, window = np.empty((len(frames), 3)), np.empty((len(frames), 3, 3)), np.empty((len(frames), 4))
    for number, frame in enumerate(frames.tolist()):
        seen = camera.GetCamera(frame)
        if seen.projection != Gf.Camera.Perspective:
            raise AssetError(f"the camera {camera.GetPath()} of {file} has no perspective", "name another camera")
        matrix = np.array(seen.transform)
        rows = matrix[:3, :3] @ turn
        size = np.linalg.norm(rows, axis=1)
        if not np.isfinite(matrix).all() or not (size > 0).all():
            raise AssetError(f"the camera {camera.GetPath()} of {file} stands nowhere at frame {frame:g}", "move it")
        axes[number] = rows / size[:, None]
        eye_m[number] = unit * matrix[3, :3] @ turn
        window[number] = _window_of(seen)
    if not np.isfinite(window).all():
        raise AssetError(
            f"the camera {camera.GetPath()} of {file} has no picture", "author its aperture and focal length"
        )
    return ShotCamera(
        prim=str(camera.GetPath()),
        path=CameraPath(frame=frames, eye_m=eye_m, axes=axes, window=window),
        time_codes_per_second=rates[0],
        frames_per_second=rates[1],
        states_unit=UsdGeom.StageHasAuthoredMetersPerUnit(stage),
    )


def _find_camera(stage: Usd.Stage, file: Path, prim: str | None) -> UsdGeom.Camera:
    cameras = [each for each in stage.Traverse(Usd.TraverseInstanceProxies()) if each.IsA(UsdGeom.Camera)]
    names = [str(each.GetPath()) for each in cameras]
    if not cameras:
        raise AssetError(f"{file} has no camera", "name the file of a shot")
    if prim is not None and prim not in names:
        raise AssetError(f"{file} has no camera {prim}", f"name one of {', '.join(names[:8])}")
    if prim is None and len(cameras) > 1:
        raise AssetError(
            f"{file} has {len(cameras)} cameras: {', '.join(names[:8])}",
            ("name one of them with ", Argument(name="camera_prim")),
        )
    return UsdGeom.Camera(cameras[names.index(prim) if prim is not None else 0])


def _frames_of(stage: Usd.Stage, camera: UsdGeom.Camera, file: Path) -> NDArray[np.float64]:
    """(F,) whole frames from the first to the last."""
    layer = stage.GetRootLayer()
    times = [time for attribute in camera.GetPrim().GetAttributes() for time in attribute.GetTimeSamples()]
    above = camera.GetPrim()
    while above and above.IsA(UsdGeom.Xformable):
        times += UsdGeom.Xformable(above).GetTimeSamples()
        above = above.GetParent()
    first = stage.GetStartTimeCode() if layer.HasStartTimeCode() else min(times, default=0.0)
    last = stage.GetEndTimeCode() if layer.HasEndTimeCode() else max(times, default=first)
    if not (np.isfinite(first) and np.isfinite(last) and first <= last):
        raise AssetError(f"{file} goes from frame {first:g} to {last:g}", "author startTimeCode and endTimeCode")
    if last - first >= MAX_FRAMES or max(abs(first), abs(last)) > LAST_FRAME:
        raise AssetError(
            f"{file} goes from frame {first:g} to {last:g}, and {MAX_FRAMES:,} frames are allowed",
            "author startTimeCode and endTimeCode of one shot",
        )
    frames = np.arange(np.ceil(first), np.floor(last) + 1)
    return frames if len(frames) else np.array([float(first)])  # between two whole frames


def _window_of(camera: Gf.Camera) -> NDArray[np.float64]:
    """(4,) left, right, bottom and top of the picture at a distance of 1."""
    if not camera.focalLength > 0:
        return np.full(4, np.nan)
    half = np.array([camera.horizontalAperture, camera.verticalAperture]) / 2
    if not (half > 0).all():
        return np.full(4, np.nan)
    offset = np.array([camera.horizontalApertureOffset, camera.verticalApertureOffset])
    (left, bottom), (right, top) = (offset - half) / camera.focalLength, (offset + half) / camera.focalLength
    return np.array([left, right, bottom, top])
