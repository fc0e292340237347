#!/usr/bin/env python3
"""How well and how fast the cameras of captures are found.

usage: tools/bench/poses.py CAPTURE... [--work DIR] [--reference NAME] [--set NAME=VALUE ...]

For each capture: photographs registered, mean reprojection error, wall and processor seconds by step, and, where a
COLMAP model of the same photographs lies in cameras/ (or NAME), the error of the cameras' places and turns once the
found ones are laid over them by a similarity. With --work what an earlier run left there is used; else all is done
anew.
"""

import argparse
import resource
import sys
import tempfile
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from usdfoliage.capture.colmap.model import find_camera_model, read_camera_model
from usdfoliage.capture.folder.photo_set import read_photo_set
from usdfoliage.capture.folder.settings import read_capture_settings
from usdfoliage.capture.poses.register import register_photos
from usdfoliage.capture.poses.result import Registered
from usdfoliage.capture.poses.settings import PoseEstimationSettings
from usdfoliage.capture.poses.world_frame import level_and_scale, move_registered
from usdfoliage.errors import FoliageError
from usdfoliage.remarks import as_plan_setting

Array = NDArray[np.float64]


def centers(poses: Array) -> Array:
    """(N, 3), the places of cameras (N, 3, 4)."""
    return np.asarray(-np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3]))


def fit_similarity(found: Array, true: Array) -> tuple[float, Array, Array]:
    """Scale, turn and move that bring places (N, 3) nearest to others: true = scale turn found + move.

    Source: S. Umeyama, Least-squares estimation of transformation parameters between two point patterns, 1991.
    """
    mean_found, mean_true = found.mean(axis=0), true.mean(axis=0)
    u, sizes, vt = np.linalg.svd((true - mean_true).T @ (found - mean_found) / len(found))
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = u @ np.diag(signs) @ vt
    scale = float((sizes * signs).sum() / np.square(found - mean_found).sum(axis=1).mean())
    return scale, turn, mean_true - scale * turn @ mean_found


def pose_errors(registered: Registered, model_folder: Path, up: Array) -> str:
    true = {image.name: image.cam_from_world for image in read_camera_model(find_camera_model(model_folder)).images}
    common = [photo for photo in registered.photos if photo.name in true]
    if len(common) < 3:
        return f"{len(common)} photographs of {model_folder} registered: no error"
    found_poses = np.array([photo.cam_from_world for photo in common])
    true_poses = np.array([true[photo.name] for photo in common])
    scale, turn, move = fit_similarity(centers(found_poses), centers(true_poses))
    apart = np.linalg.norm(scale * centers(found_poses) @ turn.T + move - centers(true_poses), axis=1)
    between = np.einsum("nij,kj,nlk->nil", found_poses[:, :, :3], turn, true_poses[:, :, :3])
    cosine = (np.trace(between, axis1=1, axis2=2) - 1) / 2
    angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    leaning = np.degrees(np.arccos(np.clip(turn[:, 1] @ up, -1, 1)))
    spread = float(np.sqrt(np.square(centers(true_poses) - centers(true_poses).mean(axis=0)).sum(axis=1).mean()))
    return (
        f"places {1000 * np.sqrt(np.mean(apart**2)):.2f} mm rms, {1000 * apart.max():.2f} mm at most "
        f"({np.sqrt(np.mean(apart**2)) / spread:.2%} of their spread); turns {angles.mean():.3f}° mean, "
        f"{angles.max():.3f}° at most; scale {scale:.4f}, up {leaning:.2f}° off"
    )


def measure(capture: Path, work: Path, reference: str, settings: PoseEstimationSettings) -> None:
    wall_s, cpu_s = time.perf_counter(), _processor_s()
    photo_set = read_photo_set(capture / "images")
    steps: dict[str, tuple[float, float]] = {}

    def report_step(step: str, share: float) -> None:
        del share
        now = time.perf_counter()
        steps[step] = (steps.get(step, (now, now))[0], now)

    registered = register_photos(photo_set, work, settings, report_step)
    wall_s, cpu_s = time.perf_counter() - wall_s, _processor_s() - cpu_s
    by_step = ", ".join(f"{step} {end - start:.1f}" for step, (start, end) in steps.items())
    total = len(photo_set.photos)
    seen = np.diff(registered.track_starts)
    error_px = float(np.average(registered.error_px, weights=seen)) if seen.sum() else float("nan")
    print(
        f"{capture.name}: {len(registered.photos)} of {total} ({len(registered.photos) / total:.0%}), "
        f"{len(registered.points)} points, track {len(registered.track_photos) / max(len(registered.points), 1):.2f}, "
        f"reprojection {error_px:.3f} px; {wall_s:.1f} s wall ({by_step}), {cpu_s:.1f} s processor"
    )
    for lens in sorted({(photo.lens.model, photo.lens.parameters) for photo in registered.photos})[:3]:
        print("  ", lens[0], " ".join(f"{number:.5g}" for number in lens[1]))
    for failure in registered.failures:
        print(f"   {failure.name}: {failure.reason}")
    for remark in (*photo_set.remarks, *registered.remarks):
        print(f"   {remark.severity}: {remark.sentence(as_plan_setting)}")
    frame = level_and_scale(registered, photo_set.photos)
    print(f"   scale by {frame.scale_from}, up by {frame.up_from} ± {np.degrees(frame.up_error_rad):.1f}°")
    for remark in frame.remarks:
        print(f"   {remark.severity}: {remark.sentence(as_plan_setting)}")
    if (capture / reference).is_dir():
        moved = move_registered(registered, frame.world_from_registered)
        up_axis = read_capture_settings(capture)[0].up_axis
        print("  ", pose_errors(moved, capture / reference, np.eye(3)["XYZ".index(up_axis)]))


def _processor_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(item.ru_utime + item.ru_stime for item in used)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", nargs="+", type=Path)
    parser.add_argument("--work", type=Path, help="keep features and matches here")
    parser.add_argument("--reference", default="cameras", help="folder of the capture with the true cameras")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings of the pose estimation")
    arguments = parser.parse_args()
    settings = PoseEstimationSettings()
    kinds = {field.name: type(getattr(settings, field.name)) for field in fields(settings)} | {"focal_px": float}
    settings = replace(
        settings, **{name: kinds[name](value) for name, value in (text.split("=") for text in arguments.set)}
    )
    failed = False
    for capture in arguments.captures:
        with tempfile.TemporaryDirectory() as folder:
            try:
                measure(capture, (arguments.work or Path(folder)) / capture.name, arguments.reference, settings)
            except FoliageError as error:
                print(f"{capture.name}: {error}")
                failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
