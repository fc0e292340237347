"""Little capture folders whose every number is known."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.capture.lens import LENS_MODELS, Lens
from usdfoliage.geometry.pinhole import Pinhole

SIZE = (64, 48)
LENS = Lens(model="PINHOLE", width_px=SIZE[0], height_px=SIZE[1], parameters=(80.0, 82.0, 33.0, 23.0))


def look_at(position: Sequence[float], target: Sequence[float], up: Sequence[float] = (0, 1, 0)) -> NDArray[np.float64]:
    """(3, 4): a camera at position with target on its axis, y of the picture down."""
    z = np.subtract(target, position)
    z = z / np.linalg.norm(z)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    rotation = np.array([x, np.cross(z, x), z])
    return np.column_stack([rotation, -rotation @ np.asarray(position, np.float64)])


def ring(count: int, radius: float = 2.0) -> dict[str, NDArray[np.float64]]:
    """Poses on an arc around the origin, by the names of their photographs."""
    angles = np.linspace(-0.6, 0.6, count) if count > 1 else [0.0]
    places = [(radius * np.sin(angle), 0.3 * radius, radius * np.cos(angle)) for angle in angles]
    return {f"{index:03d}.png": look_at(place, (0, 0, 0)) for index, place in enumerate(places)}


def quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """w, x, y, z of a rotation (3, 3), w not below 0."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return np.array([w, x, y, z])


def write_text_model(
    folder: Path,
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Sequence[Lens] = (LENS,),
    points: NDArray[np.floating] | None = None,
    observations: str = "",
) -> None:
    """A COLMAP model as text; photographs take turns with the lenses."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Camera list"]
    for number, lens in enumerate(lenses, 1):
        numbers = " ".join(repr(float(value)) for value in lens.parameters)
        lines.append(f"{number} {lens.model} {lens.width_px} {lens.height_px} {numbers}")
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n")
    lines = ["# Image list"]
    for number, (name, pose) in enumerate(poses.items()):
        numbers = " ".join(repr(float(value)) for value in (*quaternion(pose[:, :3]), *pose[:, 3]))
        lines += [f"{number + 1} {numbers} {number % len(lenses) + 1} {name}", observations]
    (folder / "images.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if points is not None:
        lines = [f"{number} {x} {y} {z} 0 0 0 0.1 1 2" for number, (x, y, z) in enumerate(points, 1)]
        (folder / "points3D.txt").write_text("\n".join(lines) + "\n")


def write_binary_model(
    folder: Path,
    poses: Mapping[str, NDArray[np.float64]],
    lenses: Sequence[Lens] = (LENS,),
    points: NDArray[np.floating] = np.zeros((0, 3)),
    observations: int = 0,
) -> None:
    """The same as binary."""
    folder.mkdir(parents=True, exist_ok=True)
    data = struct.pack("<Q", len(lenses))
    for number, lens in enumerate(lenses, 1):
        data += struct.pack("<IiQQ", number, LENS_MODELS[lens.model].number, lens.width_px, lens.height_px)
        data += struct.pack(f"<{len(lens.parameters)}d", *lens.parameters)
    (folder / "cameras.bin").write_bytes(data)
    data = struct.pack("<Q", len(poses))
    for number, (name, pose) in enumerate(poses.items()):
        data += struct.pack("<I7dI", number + 1, *quaternion(pose[:, :3]), *pose[:, 3], number % len(lenses) + 1)
        data += name.encode() + b"\0" + struct.pack("<Q", observations) + struct.pack("<ddQ", 1, 2, 3) * observations
    (folder / "images.bin").write_bytes(data)
    data = struct.pack("<Q", len(points))
    for number, point in enumerate(points, 1):
        data += struct.pack("<Q3d3Bd", number, *point, 1, 2, 3, 0.5)
        data += struct.pack("<Q", 2) + struct.pack("<II", 1, 2) * 2
    (folder / "points3D.bin").write_bytes(data)


def write_depth(path: Path, depth_m: NDArray[np.floating], channel: str = "Z") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {channel: np.ascontiguousarray(depth_m, np.float32)}).write(str(path))
    return path


def write_photo(path: Path, size: tuple[int, int] = SIZE, seed: int = 0) -> NDArray[np.uint8]:
    """A photograph of noise, (H, W, 3) as it must be read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    srgb = np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    assert cv2.imwrite(str(path), srgb[..., ::-1])
    return srgb


def sphere_depth(camera: Pinhole, radius: float) -> NDArray[np.float64]:
    """(H, W), along the optical axis, to a sphere about the origin; 0 beside it."""
    rays = camera.rays()
    center = camera.cam_from_world[:, 3]  # of the sphere, in camera axes
    along = rays @ center
    square = np.sum(rays**2, axis=-1)
    root = along**2 - square * (center @ center - radius**2)
    return np.where(root > 0, (along - np.sqrt(np.maximum(root, 0))) / square, 0.0)


def write_capture(
    folder: Path,
    count: int = 4,
    lens: Lens = LENS,
    poses: Mapping[str, NDArray[np.float64]] | None = None,
    depth_scale: float = 1.0,
    settings: str = "",
) -> dict[str, NDArray[np.float64]]:
    """Photographs of noise around a sphere of 0.5 m about the origin, with its depth; the poses by name."""
    poses = ring(count) if poses is None else dict(poses)
    write_text_model(folder / "cameras", poses, [lens])
    size = lens.width_px, lens.height_px
    for seed, (name, pose) in enumerate(poses.items()):
        write_photo(folder / "images" / name, size, seed)
        depth_m = sphere_depth(lens.pinhole(pose), 0.5) * depth_scale
        write_depth((folder / "depth" / name).with_suffix(".exr"), depth_m)
    if settings:
        (folder / "capture.toml").write_text(settings)
    return dict(poses)
