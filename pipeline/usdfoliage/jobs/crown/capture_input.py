"""A capture folder, or a cloud, as a crown is made of it: points of the plant and photographs, in the asset's frame."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from usdfoliage.capture.clear_sky import elevations_deg, find_clear_sky
from usdfoliage.capture.cloud_files.read import is_cloud_input
from usdfoliage.capture.folder.read import Capture, read_capture, read_view
from usdfoliage.capture.view import View
from usdfoliage.crown.leaf_colors import find_green_points, have_color
from usdfoliage.crown.views import CrownPicture, CrownView
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_plant_cloud
from usdfoliage.jobs.report.pictures import shrink_to
from usdfoliage.progress import StepProgress
from usdfoliage.remarks import Remark, remark

_SKY_PX = 700  # longer side of the picture that sky is looked for in


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantPoints:
    """The points of a plant, and the frame that they are in."""

    points_m: NDArray[np.float64]  # (N, 3), in the asset's frame, without ground
    foliage: NDArray[np.bool_] | None  # (N,), which are leaves; None where that is not known
    colors: NDArray[np.float64] | None = None  # (N, 3), red, green and blue, 0 to 255; black where one has none
    asset_from_capture: NDArray[np.float64]  # (4, 4), column vectors, from the coordinates in the capture's files


@dataclass(frozen=True, kw_only=True, eq=False)
class CrownCapture:
    """All that a crown is made of."""

    name: str
    capture: Capture | None  # None of a cloud alone
    plant: PlantPoints
    views: tuple[CrownView, ...]
    remarks: tuple[Remark, ...]


def read_crown_capture(
    request: PlantCloudRequest,
    plant: PlantPoints | None = None,
    asset_from_capture: NDArray[np.float64] | None = None,
    progress: StepProgress | None = None,
) -> CrownCapture:
    """Read a capture with its cloud, or a cloud alone; photographs are read later, when their turn comes.

    Args:
        request: The capture's folder, or a cloud, and what the user knows of it.
        plant: Points that were read already; their frame decides.
        asset_from_capture: (4, 4), the frame to use instead of the one that the cloud's root gives.
        progress: Called as the cloud is read.

    Raises:
        CaptureError: The folder, its cameras or its cloud cannot be used.
        FitError: The cloud shows no plant.
    """
    capture = None if is_cloud_input(request.path) else read_capture(request.path)
    remarks = [] if capture is None else list(capture.remarks)
    if plant is None:
        plant, of_points = _read_points(request, asset_from_capture, progress)
        remarks.extend(of_points)
    if capture is None:
        return CrownCapture(name=request.path.stem, capture=None, plant=plant, views=(), remarks=tuple(remarks))
    views = tuple(_make_view(capture, number, plant.asset_from_capture) for number in range(len(capture.views)))
    return CrownCapture(name=capture.name, capture=capture, plant=plant, views=views, remarks=tuple(remarks))


def _read_points(
    request: PlantCloudRequest, frame: NDArray[np.float64] | None, progress: StepProgress | None
) -> tuple[PlantPoints, list[Remark]]:
    """The points, and remarks on them."""
    cloud = read_plant_cloud(request, progress)
    remarks = list(cloud.remarks)
    foliage = None if cloud.colors is None else find_green_points(cloud.points_m, cloud.colors)
    if foliage is None:
        text = "leaves are not recognised by their colour; what of the cloud is wide is taken for the crown"
        remarks.append(remark("crown-by-width", text))
    else:
        text = f"the crown is made of the {100 * foliage.mean():.0f} % of the plant's points that are green"
        remarks.append(remark("crown-by-color", text))
        black = 0.0 if cloud.colors is None else 1 - float(have_color(cloud.colors).mean())
        if black > 0:
            text = (
                f"{black:.1%} of the plant's points are black, which is taken for no colour; they are leaves where "
                "most of the coloured points nearest to them are"
            )
            remarks.append(remark("points-without-color", text))
    points_m = cloud.points_m
    if frame is not None:
        moved = frame @ np.linalg.inv(cloud.asset_from_cloud)
        points_m = points_m @ moved[:3, :3].T + moved[:3, 3]
    return (
        PlantPoints(
            points_m=points_m,
            foliage=foliage,
            colors=cloud.colors,
            asset_from_capture=cloud.asset_from_cloud if frame is None else np.asarray(frame, np.float64),
        ),
        remarks,
    )


def _make_view(capture: Capture, number: int, asset_from_capture: NDArray[np.float64]) -> CrownView:
    captured = capture.views[number]
    unit = capture.settings.metres_per_unit
    asset_from_world = asset_from_capture @ np.diag([1 / unit, 1 / unit, 1 / unit, 1.0])
    scale = float(np.cbrt(np.linalg.det(asset_from_world[:3, :3])))
    camera = move_camera(captured.lens.pinhole(captured.cam_from_world), asset_from_world)
    return CrownView(name=captured.name, camera=camera, read=_reader(capture, number, scale))


def move_camera(camera: Pinhole, asset_from_world: NDArray[np.float64]) -> Pinhole:
    """The camera in another frame (4, 4), which may be larger or smaller than its world."""
    scale = np.cbrt(np.linalg.det(asset_from_world[:3, :3]))
    cam_from_asset = camera.cam_from_world[:, :3] @ (asset_from_world[:3, :3] / scale).T
    moved = scale * camera.cam_from_world[:, 3] - cam_from_asset @ asset_from_world[:3, 3]
    return replace(camera, cam_from_world=np.column_stack([cam_from_asset, moved]))


def _reader(capture: Capture, number: int, scale: float) -> Callable[[], CrownPicture]:
    def read() -> CrownPicture:
        view = read_view(capture, number)
        size = view.camera.height_px, view.camera.width_px
        lens = capture.views[number].lens
        if size != (lens.height_px, lens.width_px):  # a camera for pictures of another size
            view = _fit_size(view, (lens.width_px, lens.height_px))
        return CrownPicture(
            srgb=view.srgb,
            mask=view.mask,
            sky=_find_sky(view, capture.up),  # beside a mask too: outlines of leaves are not drawn to the pixel
            depth_m=np.asarray(view.depth_m * np.float32(scale)) if view.has_depth else None,
        )

    return read


def _fit_size(view: View, size: tuple[int, int]) -> View:
    mask = None
    if view.mask is not None:
        mask = cv2.resize(view.mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    return View(
        name=view.name,
        camera=view.camera.resized(*size),
        srgb=np.asarray(cv2.resize(view.srgb, size, interpolation=cv2.INTER_AREA), np.uint8),
        depth_m=np.asarray(cv2.resize(view.depth_m, size, interpolation=cv2.INTER_NEAREST), np.float32),
        mask=mask,
    )


def _find_sky(view: View, up: NDArray[np.float64]) -> NDArray[np.bool_] | None:
    small = shrink_to(view.srgb, _SKY_PX)
    camera = view.camera.resized(small.shape[1], small.shape[0])
    sky = find_clear_sky(small, elevation_deg=elevations_deg(camera, up))
    if sky is None:
        return None
    whole = cv2.resize(sky.astype(np.uint8), view.srgb.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(whole > 0)
