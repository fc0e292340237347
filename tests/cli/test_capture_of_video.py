"""A capture from a video on the command line: its frames, their cameras, depth and cloud."""

import re

import cv2
import numpy as np
from usdfoliage.capture.cloud_files.ply import read_cloud
from usdfoliage.capture.folder.read import read_capture

from tests.support.leaves.commands import run
from tests.support.textured_scene import LENS, arc, render
from tests.support.videos import write_video

FRAMES, RATE_HZ = 60, 10


def similarity(source_m, target_m):
    """Scale, rotation and shift that take points (N, 3) to others best; Umeyama, 1991."""
    from_m, to_m = source_m - source_m.mean(axis=0), target_m - target_m.mean(axis=0)
    left, sizes, right = np.linalg.svd(to_m.T @ from_m)
    turned = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    rotation = left * turned @ right
    scale = (sizes * turned).sum() / np.square(from_m).sum()
    return scale, rotation, target_m.mean(axis=0) - scale * rotation @ source_m.mean(axis=0)


def test_a_video_gives_cameras_and_a_cloud(tmp_path):
    """Frames are named by their time, so that the true camera of each is known."""
    true = list(arc(FRAMES).values())
    pictures = (cv2.cvtColor(render(pose), cv2.COLOR_GRAY2BGR) for pose in true)
    video = write_video(tmp_path / "a walk.mp4", pictures, RATE_HZ)
    made = tmp_path / "walk"
    assert run("capture", video, "-o", made, "--quality", "draft", "--no-report") == 0

    capture = read_capture(made)
    assert len(capture.views) >= 5
    seconds = [float(re.fullmatch(r"frame_00m([\d.]+)s\.png", view.name)[1]) for view in capture.views]
    true_m = np.array([LENS.pinhole(true[round(each * RATE_HZ)]).position_m for each in seconds])
    found_m = np.array([view.lens.pinhole(view.cam_from_world).position_m for view in capture.views])
    scale, rotation, shift_m = similarity(found_m, true_m)
    assert np.linalg.norm(found_m @ rotation.T * scale + shift_m - true_m, axis=1).max() < 0.02

    cloud = read_cloud(made / "cloud.ply")
    points_m = cloud.points_m @ rotation.T * scale + shift_m
    off_m = np.abs(points_m).min(axis=1)  # from the nearest of the three planes
    assert len(points_m) > 10_000
    assert np.median(off_m) < 0.01
