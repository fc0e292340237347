#!/usr/bin/env python3
"""A capture folder of smaller photographs with depth, from photographs and their cameras.

usage: tools/reduced_capture.py CAPTURE -o NEWCAPTURE [--cameras FOLDER] [--points PLY] [--width PX] …

CAPTURE holds images/ and a COLMAP model. NEWCAPTURE gets the photographs without lens distortion, no wider than
--width, their cameras, masks where CAPTURE has some (or --green-mask), and the depth/ that
`usdfoliage leaves` would compute: for trying its settings many times.
"""

import argparse
import logging
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.capture.folder.read import Capture, read_capture, read_view, read_views
from usdfoliage.capture.mvs.rounds import MvsSettings
from usdfoliage.capture.mvs.view_depths import PhotographDepthSettings, estimate_view_depths
from usdfoliage.capture.view import View
from usdfoliage.errors import FoliageError
from usdfoliage.geometry.pinhole import Pinhole

from tools.synthetic.files import write_depth, write_picture

_PLY_TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4", "short": "<i2"}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    defaults = MvsSettings()
    parser.add_argument("capture", type=Path)
    parser.add_argument("-o", dest="out", type=Path, required=True, metavar="NEWCAPTURE", help="must not exist")
    parser.add_argument("--cameras", default="cameras", help="folder of the COLMAP model in CAPTURE")
    parser.add_argument("--points", type=Path, help="sparse points (binary PLY) where the model has no points3D")
    parser.add_argument("--metres-per-unit", type=float, help="of the cameras; else that of CAPTURE")
    parser.add_argument("--width", type=int, help="reduce wider photographs to this")
    parser.add_argument("--views", help="which photographs, as usdfoliage leaves takes them")
    parser.add_argument("--green-mask", action="store_true", help="depth only where a photograph is green")
    parser.add_argument("--crop", action="store_true", help="cut photographs to what is around their masks")
    parser.add_argument("--max-side", type=int, default=defaults.max_side_px, help="size to match at")
    parser.add_argument("--sources", type=int, default=defaults.sources, help="photographs matched with each")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")

    settings = PhotographDepthSettings(depth=MvsSettings(max_side_px=arguments.max_side, sources=arguments.sources))
    started = time.perf_counter()
    try:
        source = read_capture(arguments.capture, views=arguments.views, cameras=arguments.cameras)
        points = source.points_m / source.settings.metres_per_unit
        if arguments.points:
            points = read_ply_points(arguments.points)
        unit = arguments.metres_per_unit or source.settings.metres_per_unit
        arguments.out.mkdir(parents=True)
        write_reduced(
            source,
            arguments.out,
            arguments.width,
            unit,
            points,
            green_mask=arguments.green_mask,
            crop=arguments.crop,
        )

        capture = read_capture(arguments.out)
        views = estimate_view_depths(
            read_views(capture).views, capture.up, capture.points_m, settings, progress=_report_progress
        ).views
        (arguments.out / "depth").mkdir()
        for view in views:
            write_depth(arguments.out / "depth" / f"{Path(view.name).stem}.exr", view.depth_m)
    except FoliageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    known = np.mean([np.mean(view.depth_m > 0) for view in views])
    print(f"{arguments.out}: {len(views)} views, depth at {known:.0%} of pixels, {time.perf_counter() - started:.0f} s")
    return 0


def write_reduced(
    source: Capture,
    out: Path,
    width_px: int | None,
    metres_per_unit: float,
    points: NDArray[np.float64],
    *,
    green_mask: bool,
    crop: bool,
) -> None:
    """Write photographs, masks, capture.toml and cameras, in the unit of the source's cameras."""
    unit = source.settings.metres_per_unit
    cameras: dict[str, int] = {}
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then an empty line"]
    for index, chosen in enumerate(source.views):
        view = read_view(source, index)
        reduced = reduce_view(view, width_px)
        if green_mask:
            reduced = replace(reduced, mask=_green(reduced.srgb))
        if crop:
            reduced = crop_view(reduced)
        path = out / "images" / view.name
        path.parent.mkdir(parents=True, exist_ok=True)
        if reduced.srgb is view.srgb and chosen.lens.is_pinhole:
            shutil.copyfile(chosen.photo, path)
        else:
            write_picture(path, reduced.srgb)
        if reduced.mask is not None:
            mask_path = out / "masks" / f"{view.name}.png"
            mask_path.parent.mkdir(parents=True, exist_ok=True)
            write_picture(mask_path, np.where(reduced.mask, 255, 0).astype(np.uint8))

        camera = reduced.camera
        numbers = " ".join(f"{number:.15g}" for number in (*camera.focal_px, *camera.center_px))
        line = f"PINHOLE {camera.width_px} {camera.height_px} {numbers}"
        camera_id = cameras.setdefault(line, len(cameras) + 1)
        x, y, z, w = Rotation.from_matrix(camera.cam_from_world[:, :3]).as_quat(canonical=True).tolist()
        pose = " ".join(f"{number:.15g}" for number in (w, x, y, z, *(camera.cam_from_world[:, 3] / unit).tolist()))
        lines += [f"{index + 1} {pose} {camera_id} {view.name}", ""]

    folder = out / "cameras"
    folder.mkdir()
    (folder / "cameras.txt").write_text("".join(f"{number} {line}\n" for line, number in cameras.items()))
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text(
        "".join(f"{k} {x:.8g} {y:.8g} {z:.8g} 128 128 128 0\n" for k, (x, y, z) in enumerate(points.tolist(), 1))
    )
    (out / "capture.toml").write_text(
        f'name = "{source.name}"\nup_axis = "{source.settings.up_axis}"\nmetres_per_unit = {metres_per_unit!r}\n'
        f'note = "depth by tools/reduced_capture.py"\n'
    )


def reduce_view(view: View, width_px: int | None) -> View:
    """The view no wider than width_px; the view itself where it is not."""
    camera = view.camera
    if width_px is None or camera.width_px <= width_px:
        return view
    scale = width_px / camera.width_px
    height_px = round(camera.height_px * scale)
    across, down = scale, height_px / camera.height_px
    reduced = Pinhole(
        width_px=width_px,
        height_px=height_px,
        focal_px=(camera.focal_px[0] * across, camera.focal_px[1] * down),
        center_px=(camera.center_px[0] * across, camera.center_px[1] * down),
        cam_from_world=camera.cam_from_world,
    )
    size = width_px, height_px
    mask = view.mask
    if mask is not None:
        mask = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.5
    return replace(
        view,
        camera=reduced,
        srgb=cv2.resize(view.srgb, size, interpolation=cv2.INTER_AREA),
        depth_m=np.zeros((height_px, width_px), np.float32),
        mask=mask,
    )


def crop_view(view: View) -> View:
    """The part of a view around its mask, a twentieth of its size more on each side; the view where it has no mask."""
    if view.mask is None or not view.mask.any():
        return view
    sides = []
    for axis in (1, 0):
        inside = np.flatnonzero(view.mask.any(axis=axis))
        margin = (inside[-1] - inside[0]) // 20 + 1
        sides.append(slice(max(0, int(inside[0] - margin)), int(inside[-1] + margin + 1)))
    rows, columns = sides
    camera = view.camera
    srgb, depth_m, mask = (np.ascontiguousarray(a[rows, columns]) for a in (view.srgb, view.depth_m, view.mask))
    part = replace(
        camera,
        width_px=srgb.shape[1],
        height_px=srgb.shape[0],
        center_px=(camera.center_px[0] - columns.start, camera.center_px[1] - rows.start),
    )
    return View(name=view.name, camera=part, srgb=srgb, depth_m=depth_m, mask=mask)


def read_ply_points(path: Path) -> NDArray[np.float64]:
    """(N, 3), the vertices of a binary little-endian PLY whose first element they are."""
    content = path.read_bytes()
    head, mark, body = content.partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    if not mark or ["format", "binary_little_endian", "1.0"] not in lines:
        raise FoliageError(f"{path} is no binary little-endian PLY; convert it")
    start = next((k for k, line in enumerate(lines) if line[:2] == ["element", "vertex"]), None)
    if start is None:
        raise FoliageError(f"{path} has no vertices")
    properties = []
    for line in lines[start + 1 :]:
        if line[0] != "property":
            break
        properties.append((line[2], _PLY_TYPES[line[1]]))
    vertices = np.frombuffer(body, np.dtype(properties), int(lines[start][2]))
    return np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)


def _green(srgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(H, W), where green or its share stand out, beyond Otsu's threshold; without specks, with its highlights."""
    values = cv2.GaussianBlur(srgb, (5, 5), 0).astype(np.float32)
    light = values.sum(axis=2)
    excess = 2 * values[..., 1] - values[..., 0] - values[..., 2]
    mask = np.zeros(light.shape, np.uint8)
    for measure in (excess, 255 * excess / (light + 30)):  # the one finds bright leaves, the other those in shade
        _, found = cv2.threshold(np.clip(measure, 0, 255).astype(np.uint8), 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        mask |= found
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    large = stats[:, cv2.CC_STAT_AREA] >= 1e-3 * np.count_nonzero(mask)
    large[0] = False  # all that is not green
    green = large[labels]
    typical = float(np.median(light[green])) if green.any() else 0.0
    count, labels, stats, _ = cv2.connectedComponentsWithStats(np.where(green, 0, 1).astype(np.uint8), connectivity=4)
    for hole in range(1, count):
        left, top, width, height, area = stats[hole]
        box = np.s_[top : top + height, left : left + width]
        inside = labels[box] == hole
        if area < 0.01 * np.count_nonzero(green) and np.median(light[box][inside]) > 0.9 * typical:
            green[box] |= inside  # as bright as a highlight; a gap between leaves is dark
    return np.asarray(green)


def _report_progress(done: int, total: int) -> None:
    print(f"matching: {done} of {total}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
