"""A model without some of its photographs is the same in all else."""

import numpy as np
import pytest
from usdfoliage.capture.colmap.model import read_camera_model, read_model_points
from usdfoliage.capture.poses.model_without import write_model_without

from tests.support.captures import LENS, ring, write_binary_model, write_text_model

POINTS = np.array([[0.0, 0.5, 0.25], [1, -2, 3]])


@pytest.mark.parametrize("write", [write_text_model, write_binary_model])
def test_what_is_left_is_what_it_was(write, tmp_path):
    poses = ring(4)
    write(tmp_path / "given", poses, points=POINTS)
    write_model_without(tmp_path / "given", tmp_path / "some", {"001.png", "003.png"})
    model = read_camera_model(tmp_path / "some")
    assert [image.name for image in model.images] == ["000.png", "002.png"]
    for image in model.images:
        np.testing.assert_allclose(image.cam_from_world, poses[image.name], atol=1e-12)
        assert model.lenses[image.camera_id] == LENS
    np.testing.assert_array_equal(read_model_points(tmp_path / "some"), POINTS)
