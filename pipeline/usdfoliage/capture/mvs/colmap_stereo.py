"""Planes of photographs by COLMAP's own PatchMatch, which needs CUDA, in the place of ours.

Source: COLMAP's documentation, "Output format" (dense reconstruction); J. L. Schönberger et al., Pixelwise view
selection for unstructured multi-view stereo, 2016. What it finds is believed by the same rules as ours.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usdfoliage.capture.mvs.patch_match import MatchedPlanes
from usdfoliage.capture.mvs.rounds import DepthPlan
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError
from usdfoliage.files.reading import read_regular
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.remarks import Setting

_HEADER_BYTES = 64


def check_cuda() -> None:
    """Raises CaptureError where COLMAP's PatchMatch cannot run."""
    if not pycolmap.has_cuda:
        raise CaptureError(
            f"pycolmap {pycolmap.__version__} here is built without CUDA, which COLMAP's PatchMatch needs",
            ("install a build with it, or set ", Setting(name="capture.dense", value='"own"')),
        )


def write_stereo_workspace(folder: Path, plan: DepthPlan, read_view: Callable[[int], View]) -> None:
    """Write photographs without distortion, their cameras, and with what each is matched, as COLMAP asks for them.

    Args:
        folder: It is made.
        plan: Of all views.
        read_view: Gives a view, by its number.

    Raises:
        OSError: A file cannot be written.
    """
    for below in ("images", "sparse", "stereo/depth_maps", "stereo/normal_maps", "stereo/consistency_graphs"):
        (folder / below).mkdir(parents=True, exist_ok=True)
    cameras, images, sources = [], [], []
    for index, chosen in enumerate(plan.sources):
        view = read_view(index)
        good, encoded = cv2.imencode(".png", np.ascontiguousarray(view.srgb[..., ::-1]))
        if not good:
            raise ValueError(f"{view.name} cannot be encoded")
        (folder / "images" / _name(index)).write_bytes(encoded.tobytes())
        camera = view.camera
        numbers = " ".join(repr(float(value)) for value in (*camera.focal_px, *camera.center_px))
        cameras.append(f"{index + 1} PINHOLE {camera.width_px} {camera.height_px} {numbers}")
        x, y, z, w = Rotation.from_matrix(camera.cam_from_world[:, :3]).as_quat(canonical=True)
        pose = " ".join(repr(float(value)) for value in (w, x, y, z, *camera.cam_from_world[:, 3]))
        images += [f"{index + 1} {pose} {index + 1} {_name(index)}", ""]
        if chosen:
            sources += [_name(index), ", ".join(map(_name, chosen))]
    for name, lines in (
        ("sparse/cameras.txt", cameras),
        ("sparse/images.txt", images),
        ("sparse/points3D.txt", []),
        ("stereo/patch-match.cfg", sources),
        ("stereo/fusion.cfg", [_name(index) for index in range(len(plan.sources))]),
    ):
        (folder / name).write_text("\n".join(lines) + "\n", encoding="ascii")


def run_stereo(folder: Path, plan: DepthPlan) -> None:
    """Let COLMAP match a workspace; what it has done already it does not do again.

    Raises:
        CaptureError: There is no CUDA, or COLMAP fails.
    """
    check_cuda()
    options = pycolmap.PatchMatchOptions()
    options.geom_consistency = True
    options.filter = False  # what is believed is decided afterwards
    options.depth_min = float(np.nanmin(np.array(plan.ranges_m)))
    options.depth_max = float(np.nanmax(plan.farthest_m))
    try:
        pycolmap.patch_match_stereo(str(folder), options=options)
    except RuntimeError as error:
        raise CaptureError(f"COLMAP's PatchMatch failed in {folder}: {error}") from error


def read_stereo_planes(folder: Path, index: int, camera: Pinhole) -> MatchedPlanes:
    """What COLMAP found for one view.

    Args:
        folder: The workspace.
        index: Of the view.
        camera: Of the view as it was written.

    Raises:
        CaptureError: Depth or normals are missing or damaged, or are not as large as the view.
    """
    size = camera.height_px, camera.width_px
    depth_m = _read_matrix(folder / "stereo" / "depth_maps" / f"{_name(index)}.geometric.bin", (*size, 1))[..., 0]
    normals = _read_matrix(folder / "stereo" / "normal_maps" / f"{_name(index)}.geometric.bin", (*size, 3))
    towards = np.sum(normals * camera.rays().astype(np.float32), axis=2)  # of the plane's distance, as depth is 1
    found = np.isfinite(depth_m) & (depth_m > 0) & np.isfinite(normals).all(axis=2) & (towards < 0)
    scale = np.divide(1, depth_m * towards, out=np.zeros_like(depth_m), where=found)
    planes = np.zeros((*size, 3), np.float32)  # inverse depth is normal · ray over the plane's distance
    planes[..., 0] = np.divide(1, depth_m, out=np.zeros_like(depth_m), where=found)
    planes[..., 1] = normals[..., 0] / camera.focal_px[0] * scale
    planes[..., 2] = normals[..., 1] / camera.focal_px[1] * scale
    return MatchedPlanes(camera=camera, planes=planes, cost=np.where(found, np.float32(0), np.float32(2)))


def _read_matrix(path: Path, shape: tuple[int, int, int]) -> NDArray[np.float32]:
    """A matrix (H, W, C) as COLMAP stores it: width, height and channels as text, then channel after channel."""
    try:
        data = read_regular(path)
    except OSError as error:
        raise CaptureError(f"{path} cannot be read: {error.strerror}; COLMAP did not write it") from error
    head = data[:_HEADER_BYTES].split(b"&", 3)
    try:
        width, height, channels = (int(field) for field in head[:3])
    except ValueError as error:
        raise CaptureError(f"{path} is no matrix of COLMAP") from error
    start = sum(len(field) + 1 for field in head[:3])
    if (height, width, channels) != shape or len(data) - start != 4 * width * height * channels:
        raise CaptureError(
            f"{path} holds {width}×{height}×{channels} numbers in {len(data) - start} bytes, not "
            f"{shape[1]}×{shape[0]}×{shape[2]}"
        )
    values = np.frombuffer(data, "<f4", offset=start).reshape(channels, height, width)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _name(index: int) -> str:
    """Of a photograph in the workspace: names with commas or spaces would part in COLMAP's lists."""
    return f"{index:06d}.png"
