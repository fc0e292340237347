"""Cameras that few features support come nearer to the true ones when they are refined."""

import numpy as np
import pytest
from usdfoliage.capture.folder.photo_set import read_photo_set
from usdfoliage.capture.poses import register
from usdfoliage.capture.poses.settings import PoseEstimationSettings

from tests.capture.poses.test_register import worst_place
from tests.support.textured_scene import arc, write_photos

SETTINGS = PoseEstimationSettings(features=250, min_features=0, max_ratio=0.7)
POSES = arc(14)


@pytest.fixture(scope="module")
def photo_set(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    write_photos(folder, POSES)
    return read_photo_set(folder)


def test_refined_cameras_are_nearer_and_see_more(photo_set, tmp_path, monkeypatch):
    refined = register.register_photos(photo_set, tmp_path, SETTINGS)
    monkeypatch.setattr(register, "refine_cameras", lambda matched, model, *rest: model)
    plain = register.register_photos(photo_set, tmp_path, SETTINGS)
    assert len(plain.photos) == len(refined.photos) == len(POSES)
    assert len(refined.points) > len(plain.points)
    assert worst_place(refined, POSES) < worst_place(plain, POSES)


def test_cameras_that_cannot_be_adjusted_stay(photo_set, tmp_path, monkeypatch, caplog):
    """As where COLMAP ends its process: the model is that of before, and the log has a warning."""
    from usdfoliage.capture.poses import refining

    run_items = refining.run_items

    def fail(job, items, work, processes, progress=None):
        if job["task"] == "adjust":
            job = {**job, "cameras": [{**camera, "parameters": [float("nan")] * 9} for camera in job["cameras"]]}
        return run_items(job, items, work, processes, progress)

    monkeypatch.setattr(refining, "run_items", fail)
    kept = register.register_photos(photo_set, tmp_path, SETTINGS)
    monkeypatch.setattr(register, "refine_cameras", lambda matched, model, *rest: model)
    plain = register.register_photos(photo_set, tmp_path, SETTINGS)
    np.testing.assert_array_equal(kept.points, plain.points)
    assert "cameras are not refined" in caplog.text
