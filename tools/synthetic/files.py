"""A synthetic capture as a folder: what the product reads, and truth/ beside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.capture.view import View

JPEG_QUALITY = 92
PLACES_A_VIEW = 150  # tried, to become points of points3D.txt
SAME_DEPTH = 0.01  # of the depth: a point nearer than this to what another view sees is seen by it


def write_depth(path: Path, depth_m: NDArray[np.float32]) -> None:
    """An EXR with one float channel Z."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": np.ascontiguousarray(depth_m, np.float32)}) as file:
        file.write(str(path))


def write_picture(path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """A picture of grey values, or of red, green, blue, in the format of its suffix.

    Raises:
        OSError: It cannot be written.
    """
    ordered = pixels[..., ::-1] if pixels.ndim == 3 else pixels
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else []
    if not cv2.imwrite(str(path), np.ascontiguousarray(ordered), quality):
        raise OSError(f"{path} cannot be written")


def write_cameras(folder: Path, views: Sequence[View], rng: np.random.Generator) -> None:
    """A COLMAP text model of the views: cameras.txt, images.txt, and points3D.txt with some that several views see."""
    folder.mkdir(parents=True)
    cameras = sorted({_camera_line(view) for view in views})
    (folder / "cameras.txt").write_text(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
        + "".join(f"{number} {line}\n" for number, line in enumerate(cameras, 1))
    )
    tracks = _find_tracks(views, rng)
    observed: list[list[str]] = [[] for _ in views]
    lines = []
    for number, (point, color, seen) in enumerate(tracks, 1):
        track = []
        for view, (x, y) in seen.items():
            track.append(f"{view + 1} {len(observed[view])}")
            observed[view].append(f"{x:.2f} {y:.2f} {number}")
        x, y, z = point.tolist()
        red, green, blue = color.tolist()
        lines.append(f"{number} {x:.8g} {y:.8g} {z:.8g} {red} {green} {blue} 0 {' '.join(track)}\n")
    (folder / "points3D.txt").write_text("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n" + "".join(lines))
    text = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n"
    for number, view in enumerate(views, 1):
        pose = view.camera.cam_from_world
        qx, qy, qz, qw = Rotation.from_matrix(pose[:, :3]).as_quat(canonical=True).tolist()
        numbers = " ".join(f"{value:.15g}" for value in (qw, qx, qy, qz, *pose[:, 3].tolist()))
        camera = cameras.index(_camera_line(view)) + 1
        text += f"{number} {numbers} {camera} {view.name}\n{' '.join(observed[number - 1])}\n"
    (folder / "images.txt").write_text(text)


def write_truth(
    folder: Path,
    arrays: Mapping[str, NDArray[np.generic]],
    leaf_ids: Mapping[str, NDArray[np.uint16]],
    labels: Mapping[str, NDArray[np.uint8]],
    readme: str,
) -> None:
    """leaves.npz, and the leaf and the kind of thing that every pixel of a view, by its name, shows."""
    folder.mkdir(parents=True)
    np.savez_compressed(folder / "leaves.npz", **dict(arrays))
    for name, ids in leaf_ids.items():
        write_picture(folder / f"{Path(name).stem}_leafid.png", ids)
    for name, label in labels.items():
        write_picture(folder / f"{Path(name).stem}_label.png", label)
    (folder / "README.md").write_text(readme)


def _camera_line(view: View) -> str:
    camera = view.camera
    parameters = " ".join(f"{number:.15g}" for number in (*camera.focal_px, *camera.center_px))
    return f"PINHOLE {camera.width_px} {camera.height_px} {parameters}"


_Track = tuple[NDArray[np.float64], NDArray[np.uint8], dict[int, tuple[float, float]]]


def _find_tracks(views: Sequence[View], rng: np.random.Generator) -> list[_Track]:
    """Points of depth maps that two views or more see: where they are, their colour, and where each view has them."""
    tracks: list[_Track] = []
    for own, view in enumerate(views):
        height, width = view.depth_m.shape
        rows, columns = rng.integers(0, height, PLACES_A_VIEW), rng.integers(0, width, PLACES_A_VIEW)
        known = view.depth_m[rows, columns] > 0
        rows, columns = rows[known], columns[known]
        points = view.camera.unproject(np.column_stack([columns, rows]) + 0.5, view.depth_m[rows, columns])
        seen: list[dict[int, tuple[float, float]]] = [
            {own: (column + 0.5, row + 0.5)} for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
        ]
        for other, other_view in enumerate(views):
            if other == own:
                continue
            places, depth = other_view.camera.project(points)
            inside = (depth > 0) & (np.nan_to_num(places, nan=-1) >= 0).all(axis=1)
            inside &= (np.nan_to_num(places, nan=-1) < (width, height)).all(axis=1)
            for k in np.flatnonzero(inside).tolist():
                x, y = places[k].tolist()
                if abs(float(other_view.depth_m[int(y), int(x)]) - depth[k]) < SAME_DEPTH * depth[k]:
                    seen[k][other] = x, y
        colors = view.srgb[rows, columns]
        tracks += [(points[k], colors[k], where) for k, where in enumerate(seen) if len(where) > 1]
    return tracks
