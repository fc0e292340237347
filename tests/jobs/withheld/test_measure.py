"""An asset over photographs that it was not made of: what is drawn, and what the figures state."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.asset.parts.branches import SurfaceMesh
from usdfoliage.capture.folder.read import read_capture
from usdfoliage.capture.lens import Lens
from usdfoliage.errors import CaptureError
from usdfoliage.geometry.picture_agreement import NOTHING, measure_agreement
from usdfoliage.jobs.withheld.measure import draw_asset, list_figures, measure_by_withheld, refine_once

from tests.support.captures import look_at, write_text_model
from tests.support.leaves.assets import two_leaves, write_spray
from tests.support.leaves.pictures import front_camera, place_leaves
from tests.support.leaves.shapes import flat_leaf

CAMERA = front_camera(width_px=200, height_px=160, focal_px=200.0)  # 1 m before the plane z = 0: a pixel is 5 mm
LENS = Lens(model="PINHOLE", width_px=200, height_px=160, parameters=(200.0, 200.0, 100.0, 80.0))


def quad(left_m, right_m, low_m, high_m, z_m=0.0):
    return np.array([[[[left_m, low_m, z_m], [right_m, low_m, z_m]], [[left_m, high_m, z_m], [right_m, high_m, z_m]]]])


SQUARE = quad(-0.101, 0.101, -0.101, 0.101)  # of 40.4 pixels a side


def test_a_square_is_drawn_half_a_pixel_larger_on_every_side():
    expected = np.full((160, 200), NOTHING)
    expected[60:100, 80:120] = 0
    # Beyond each side lies a row of pixels whose centres are 0.3 pixels away; those at the corners are farther.
    expected[59:101, 80:120] = expected[60:100, 79:121] = 0
    np.testing.assert_array_equal(draw_asset(None, SQUARE, CAMERA), expected)


def test_a_twig_thinner_than_a_pixel_stays_whole():
    thin = draw_asset(None, quad(-0.101, -0.1, -0.2, 0.2), CAMERA)
    assert (thin != NOTHING).any(axis=1)[41:119].all()


def test_leaves_hide_branches_behind_them_and_are_hidden_by_those_before():
    leaf = place_leaves(flat_leaf(), [(0.0, -0.1, 0.0)], length_m=0.2)
    behind, before = quad(-0.3, 0.3, -0.3, 0.3, -0.1), quad(-0.3, 0.3, -0.3, 0.3, 0.1)
    assert draw_asset(leaf, behind, CAMERA)[80, 100] == 1
    assert draw_asset(leaf, before, CAMERA)[80, 100] == 0


def test_a_square_agrees_with_its_own_picture_and_moved_as_is_known():
    drawn = draw_asset(None, SQUARE, CAMERA)
    moved = draw_asset(None, quad(-0.051, 0.151, -0.101, 0.101), CAMERA)  # by 10 pixels
    picture = np.where((drawn == 0)[..., None], (40, 160, 50), 140).astype(np.uint8)
    assert measure_agreement(drawn, picture, drawn != NOTHING).iou == 1
    found = measure_agreement(moved, picture, drawn != NOTHING)
    # 40 rows of 42 pixels and two of 40; of those 32 and 30 are covered twice.
    area, both = 40 * 42 + 2 * 40, 40 * 32 + 2 * 30
    assert found.iou == pytest.approx(both / (2 * area - both), abs=1e-12)
    assert found.precision == pytest.approx(both / area, abs=1e-12)


def test_a_cube_is_refined_once():
    corners = np.array([[x, y, z] for z in (-1.0, 1) for y in (-1, 1) for x in (-1, 1)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    surface = SurfaceMesh(
        points_m=corners, face_counts=np.full(6, 4, np.int32), face_vertices=np.array(faces, np.int32).ravel()
    )
    quads = refine_once(surface)
    assert quads.shape == (24, 2, 2, 3)
    # Face points stay in the middle of faces, edge points come to 3/4, corners to 5/9 (Catmull and Clark, 1978).
    places = {tuple(sorted(np.round(np.abs(point), 6))) for point in quads.reshape(-1, 3)}
    assert places == {(0.0, 0.0, 1.0), (0.0, 0.75, 0.75), (0.555556, 0.555556, 0.555556)}
    # Neighbours in a grid are neighbours on the face: no edge is a diagonal.
    edges = np.concatenate([quads[:, :, 1] - quads[:, :, 0], quads[:, 1] - quads[:, 0]]).reshape(-1, 3)
    assert np.linalg.norm(edges, axis=1).max() < 0.9


# Whole assets


@pytest.fixture
def written(tmp_path):
    """An asset of two leaves, one found and one of the species, and photographs of the first alone."""
    leaves = replace(two_leaves(), origin=np.array([0, 3], np.int32))
    asset = write_spray(tmp_path / "spray", leaves)
    return asset, write_photographs(tmp_path / "capture", leaves.take([0]))


def write_photographs(folder, leaves, settings="", unit=1.0):
    """Three photographs of leaves of 1 m, green before grey, in units of so many metres."""
    poses = {}
    for number, x in enumerate((-1.0, 0.0, 1.0)):
        pose = look_at((x, 0.5, 3.0), (0, 0.5, 0))
        camera = LENS.pinhole(pose)
        drawn = draw_asset(leaves, np.zeros((0, 2, 2, 3)), camera)
        picture = np.where((drawn != NOTHING)[..., None], (40, 160, 50), 140).astype(np.uint8)
        (folder / "images").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / "images" / f"{number}.png"), picture[..., ::-1])
        poses[f"{number}.png"] = np.column_stack([pose[:, :3], pose[:, 3] / unit])
    write_text_model(folder / "cameras", poses, [LENS])
    if settings:
        (folder / "capture.toml").write_text(settings)
    return folder


def test_only_leaves_that_photographs_show_are_measured(written, tmp_path):
    asset, capture = written
    made = measure_by_withheld(asset, read_capture(capture), tmp_path, 3, lost=["9.png"])
    assert made.leaves == 1
    assert not made.has_branches
    assert [view.name for view in made.views] == ["0.png", "1.png", "2.png"]
    for view in made.views:
        assert view.mask == "vegetation"
        assert view.agreement.iou > 0.95
        assert view.agreement.edge_recall > 0.95
        height, width = cv2.imread(str(tmp_path / view.picture)).shape[:2]
        assert (height, width) == (80, 200)  # half the photograph, twice
    assert [(each.code, each.subject) for each in made.remarks] == [("withheld-not-compared", "9.png")]
    stored = json.loads((tmp_path / "withheld.json").read_text())
    assert stored == json.loads(json.dumps(made.as_json()))
    assert stored["hold_back"] == 3
    assert stored["mean"]["iou"] == pytest.approx(np.mean([view["iou"] for view in stored["views"]]))
    rows = list_figures(stored)
    assert [row.name for row in rows] == ["withheld photographs", "0.png", "1.png", "2.png"]
    assert rows[0].value.startswith(f"IoU {stored['mean']['iou']:.3f}, precision ")


def test_a_mask_goes_before_colours(written, tmp_path):
    asset, capture = written
    (capture / "masks").mkdir()
    mask = np.zeros((160, 200), np.uint8)
    mask[:, 100:] = 255
    cv2.imwrite(str(capture / "masks" / "1.png"), mask)
    made = measure_by_withheld(asset, read_capture(capture), tmp_path, 3)
    assert [view.mask for view in made.views] == ["vegetation", "given", "vegetation"]
    assert made.views[1].agreement.mask_share == 0.5
    assert made.views[1].agreement.precision == pytest.approx(0.5, abs=0.02)  # the leaf is upright in the middle


def test_a_plant_on_a_lawn_is_drawn_but_not_measured_without_a_mask(written, tmp_path):
    asset, capture = written
    for number in (0, 1):
        photo = cv2.imread(str(capture / "images" / f"{number}.png"))
        photo[80:][photo[80:, :, 0] == 140] = (60, 140, 70)  # a lawn up to the horizon: half of the border
        cv2.imwrite(str(capture / "images" / f"{number}.png"), photo)
    (capture / "masks").mkdir()
    mask = np.zeros((160, 200), np.uint8)
    mask[40:120, 80:120] = 255
    cv2.imwrite(str(capture / "masks" / "1.png"), mask)
    made = measure_by_withheld(asset, read_capture(capture), tmp_path, 3)
    assert [view.mask for view in made.views] == ["unknown", "given", "vegetation"]
    assert made.views[0].agreement is None
    assert [(each.code, each.subject) for each in made.remarks] == [("withheld-surroundings-green", "0.png")]
    stored = json.loads((tmp_path / "withheld.json").read_text())
    assert stored["views"][0] == {"name": "0.png", "mask": "unknown"}
    assert stored["mean"]["iou"] == pytest.approx(np.mean([view["iou"] for view in stored["views"][1:]]))
    assert [row.value for row in list_figures(stored)][1] == "not measured"
    assert "IoU" not in made.pictures()[0].caption
    # Of lawns alone there is no mean.
    alone = replace(read_capture(capture), views=read_capture(capture).views[:1])
    bare = measure_by_withheld(asset, alone, tmp_path, 3)
    assert bare.as_json()["mean"] is None
    assert [row.name for row in bare.rows()] == ["0.png"]


def test_the_unit_of_the_capture_is_followed(tmp_path):
    leaves = two_leaves().take([0])
    asset = write_spray(tmp_path / "spray", leaves)
    capture = write_photographs(tmp_path / "capture", leaves, "metres_per_unit = 0.01\n", unit=0.01)
    # captureToAsset of this asset is the identity, so the capture's coordinates must be in metres to meet it.
    with_unit = measure_by_withheld(asset, read_capture(capture), tmp_path, 2)
    assert with_unit.views[0].agreement.iou == 0  # centimetres are taken for metres: the cameras are far away
    plain = write_photographs(tmp_path / "plain", leaves)
    assert measure_by_withheld(asset, read_capture(plain), tmp_path, 2).views[0].agreement.iou > 0.95


def test_photographs_that_cannot_be_read_are_left_out_until_none_is_left(written, tmp_path):
    asset, capture = written
    (capture / "images" / "0.png").write_bytes(b"no picture")
    made = measure_by_withheld(asset, read_capture(capture), tmp_path, 3)
    assert [view.name for view in made.views] == ["1.png", "2.png"]
    assert [each.subject for each in made.remarks] == ["0.png"]
    both = measure_by_withheld(asset, read_capture(capture), tmp_path, 3, lost=["8.png", "9.png"]).remarks
    assert [each.subject for each in both] == ["8.png, 9.png", "0.png"]
    assert both[0].text == "8.png, 9.png: withheld, but not compared: no camera was found"
    assert both[1].text == made.remarks[0].text  # the reason is that of this photograph
    assert "0.png" in both[1].text.partition("not compared: ")[2]
    for name in ("1.png", "2.png"):
        (capture / "images" / name).write_bytes(b"no picture")
    with pytest.raises(CaptureError, match="no photograph that was withheld can be read"):
        measure_by_withheld(asset, read_capture(capture), tmp_path, 3)
