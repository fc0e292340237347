"""What is given to COLMAP's PatchMatch, and what is read of it; COLMAP itself needs CUDA and is played here."""

import cv2
import numpy as np
import pycolmap
import pytest
from usdfoliage.capture.colmap.model import read_camera_model
from usdfoliage.capture.mvs import colmap_stereo
from usdfoliage.capture.mvs.colmap_stereo import check_cuda, read_stereo_planes, run_stereo, write_stereo_workspace
from usdfoliage.capture.mvs.rounds import DepthPlan
from usdfoliage.capture.view import View
from usdfoliage.errors import CaptureError

from tests.support.capture_photos import LENS, draw, poses, scene


def write_matrix(path, values):
    """As COLMAP does: channel after channel."""
    height, width, channels = values.shape
    path.write_bytes(b"%d&%d&%d&" % (width, height, channels) + np.moveaxis(values, -1, 0).astype("<f4").tobytes())


@pytest.fixture
def views():
    made = []
    for name, pose in poses().items():
        srgb, _, _ = draw(scene(), LENS.pinhole(pose))
        depth_m = np.zeros(srgb.shape[:2], np.float32)
        made.append(View(name=name, camera=LENS.pinhole(pose), srgb=srgb, depth_m=depth_m))
    return made


@pytest.fixture
def plan():
    sources = ((1, 2), (0, 2), (1, 3), (2, 4), ())
    ranges_m = ((1.0, 75.0), (1.5, 100.0), (1.0, 75.0), (1.0, 75.0), (np.nan, np.nan))
    return DepthPlan(ranges_m=ranges_m, farthest_m=(3.0, 4.0, 3.0, 3.0, np.nan), sources=sources)


def test_the_workspace_has_photographs_cameras_and_sources(tmp_path, views, plan):
    write_stereo_workspace(tmp_path, plan, views.__getitem__)
    model = read_camera_model(tmp_path / "sparse")
    for image, view in zip(model.images, views, strict=True):
        np.testing.assert_allclose(image.cam_from_world, view.camera.cam_from_world, atol=1e-12)
        assert model.lenses[image.camera_id] == LENS
        np.testing.assert_array_equal(cv2.imread(str(tmp_path / "images" / image.name))[..., ::-1], view.srgb)
    lines = (tmp_path / "stereo" / "patch-match.cfg").read_text().splitlines()
    assert lines[:4] == ["000000.png", "000001.png, 000002.png", "000001.png", "000000.png, 000002.png"]
    assert len(lines) == 8
    assert pycolmap.Reconstruction(str(tmp_path / "sparse")).num_images() == 5


def test_planes_are_those_of_depth_and_normals(tmp_path, views, plan):
    write_stereo_workspace(tmp_path, plan, views.__getitem__)
    camera = views[0].camera
    normal = np.array([0.2, -0.1, -0.95])
    normal /= np.linalg.norm(normal)
    depth_m = -2.0 / (camera.rays() @ normal)
    depth_m[:10] = 0
    write_matrix(tmp_path / "stereo/depth_maps/000000.png.geometric.bin", depth_m[..., None])
    write_matrix(tmp_path / "stereo/normal_maps/000000.png.geometric.bin", np.broadcast_to(normal, (*depth_m.shape, 3)))
    matched = read_stereo_planes(tmp_path, 0, camera)
    np.testing.assert_allclose(matched.depth_m, depth_m, rtol=1e-5)
    np.testing.assert_allclose(matched.normals()[10:], np.broadcast_to(normal, (*depth_m.shape, 3))[10:], atol=1e-5)
    inverse = matched.planes[..., 0].astype(np.float64)
    np.testing.assert_allclose(inverse[10:-1] + matched.planes[10:-1, :, 2], inverse[11:], rtol=1e-5)
    np.testing.assert_allclose(inverse[10:, :-1] + matched.planes[10:, :-1, 1], inverse[10:, 1:], rtol=1e-5)
    assert (matched.cost[:10] > 1).all()
    assert not matched.planes[:10].any()


@pytest.mark.parametrize("data", [b"", b"128&96&1&", b"128&96&3&" + bytes(4 * 128 * 96 * 3), b"a&b&c&", bytes(100)])
def test_damaged_matrices_are_refused(tmp_path, views, plan, data):
    write_stereo_workspace(tmp_path, plan, views.__getitem__)
    with pytest.raises(CaptureError, match="did not write it"):
        read_stereo_planes(tmp_path, 0, views[0].camera)
    (tmp_path / "stereo/depth_maps/000000.png.geometric.bin").write_bytes(data)
    with pytest.raises(CaptureError, match=r"000000.png.geometric.bin (is no matrix|holds)"):
        read_stereo_planes(tmp_path, 0, views[0].camera)


def test_without_cuda_it_is_refused(tmp_path, plan, monkeypatch):
    monkeypatch.setattr(pycolmap, "has_cuda", False)
    with pytest.raises(CaptureError, match="without CUDA"):
        check_cuda()
    with pytest.raises(CaptureError, match="without CUDA"):
        run_stereo(tmp_path, plan)


def test_colmap_is_asked_for_the_range_of_all_views(tmp_path, plan, monkeypatch):
    asked = {}
    monkeypatch.setattr(pycolmap, "has_cuda", True)
    monkeypatch.setattr(pycolmap, "patch_match_stereo", lambda folder, options: asked.update(f=folder, o=options))
    run_stereo(tmp_path, plan)
    assert asked["f"] == str(tmp_path)
    assert (asked["o"].depth_min, asked["o"].depth_max) == (1.0, 4.0)
    assert asked["o"].geom_consistency

    def fail(_folder, options):
        raise RuntimeError(f"no device for {options.gpu_index}")

    monkeypatch.setattr(colmap_stereo.pycolmap, "patch_match_stereo", fail)
    with pytest.raises(CaptureError, match="no device"):
        run_stereo(tmp_path, plan)
