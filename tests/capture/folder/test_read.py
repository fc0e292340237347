import logging
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from usdfoliage.capture.folder.depth_scale import check_depth_scale
from usdfoliage.capture.folder.images import Photo, read_photo
from usdfoliage.capture.folder.listing import named, parse_views
from usdfoliage.capture.folder.read import read_capture, read_view, read_views
from usdfoliage.capture.lens import Lens, scale_lens
from usdfoliage.errors import CaptureError
from usdfoliage.remarks import as_plan_setting, remark

from tests.support import captures
from tests.support.captures import LENS, SIZE, look_at, ring, write_capture, write_depth, write_photo, write_text_model

DATA = Path(__file__).parents[4] / "shared" / "data"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A capture of four views of a sphere."""
    write_capture(tmp_path / "plant")
    return tmp_path / "plant"


def sentences_of(folder: Path, **options: str) -> str:
    capture = read_capture(folder, **options)
    remarks = (*capture.remarks, *read_views(capture).remarks)
    return "\n".join(each.sentence(as_plan_setting) for each in remarks)


# What is there.


def test_views_have_the_values_of_the_files(folder):
    capture = read_capture(folder)
    read = read_views(capture)
    assert capture.remarks == read.remarks == ()
    assert capture.name == "plant"
    assert [view.name for view in read.views] == ["000.png", "001.png", "002.png", "003.png"]
    for seed, (view, (name, pose)) in enumerate(zip(read.views, ring(4).items(), strict=True)):
        np.testing.assert_array_equal(view.srgb, write_photo(folder / "images" / name, seed=seed))
        np.testing.assert_allclose(view.camera.cam_from_world, pose, atol=1e-12)
        assert (view.camera.focal_px, view.camera.center_px) == (LENS.focal_px, LENS.center_px)
        points = view.points()
        assert view.mask is None
        np.testing.assert_allclose(np.linalg.norm(points[np.isfinite(points[..., 0])], axis=1), 0.5, rtol=1e-5)


def test_one_view_is_the_same_as_among_all(folder):
    capture = read_capture(folder)
    alone, among = read_view(capture, 2), read_views(capture).views[2]
    np.testing.assert_array_equal(alone.srgb, among.srgb)
    np.testing.assert_array_equal(alone.depth_m, among.depth_m)


def test_progress_counts_views(folder):
    seen = []
    read_views(read_capture(folder), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(done, 4) for done in range(5)]


def test_all_levels_of_srgb_come_back(folder):
    levels = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    levels.reshape(-1)[:256] = np.arange(256)
    assert cv2.imwrite(str(folder / "images" / "000.png"), levels)
    np.testing.assert_array_equal(read_view(read_capture(folder), 0).srgb, levels[..., ::-1])


def test_a_binary_model_in_sparse_0(folder):
    shutil.rmtree(folder / "cameras")
    captures.write_binary_model(folder / "cameras" / "sparse" / "0", ring(4))
    assert len(read_capture(folder).views) == 4


def test_photographs_in_folders_with_spaces(tmp_path):
    poses = {"day 1/leaf 1.png": look_at((0, 0, 2), (0, 0, 0)), "day 2/leaf 1.png": look_at((1, 0, 2), (0, 0, 0))}
    write_capture(tmp_path, poses=poses)
    capture = read_capture(tmp_path)
    assert [view.name for view in capture.views] == list(poses)
    assert capture.remarks == ()
    assert capture.views[0].depth == tmp_path / "depth" / "day 1" / "leaf 1.exr"


@pytest.mark.parametrize("name", ["images", "depth", "masks"])
def test_a_link_to_nothing_is_an_error_that_names_it(folder, name):
    (folder / name).mkdir(exist_ok=True)
    (folder / name / ".#lock").symlink_to("somebody@somewhere")  # of an editor: hidden, and nobody's business
    read_capture(folder)
    (folder / name / "lost.png").symlink_to("../published/lost.png")
    with pytest.raises(CaptureError, match=rf"{name}/lost\.png is a link to \.\./published/lost\.png, which is not"):
        read_capture(folder)


def test_names_of_depth_and_masks_may_keep_the_suffix_of_the_photograph(folder):
    (folder / "depth" / "000.exr").rename(folder / "depth" / "000.png.exr")
    (folder / "masks").mkdir()
    mask = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    mask[10:20, 30:50] = 255
    cv2.imwrite(str(folder / "masks" / "000.png.png"), mask)
    cv2.imwrite(str(folder / "masks" / "001.png"), mask)
    capture = read_capture(folder)
    views = read_views(capture).views
    assert views[0].has_depth
    for view in views[:2]:
        np.testing.assert_array_equal(view.mask, mask > 0)
    assert views[2].mask is None
    assert [each.text for each in capture.remarks] == ["2 of 4 views without a mask: 002.png, 003.png"]


def test_millimetres_of_a_depth_camera(folder):
    depth_m = read_view(read_capture(folder), 0).depth_m
    (folder / "depth" / "000.exr").unlink()
    cv2.imwrite(str(folder / "depth" / "000.png"), np.round(depth_m * 1000).astype(np.uint16))
    np.testing.assert_allclose(read_view(read_capture(folder), 0).depth_m, depth_m, atol=0.00051)


# capture.toml


def test_settings(folder):
    (folder / "capture.toml").write_text('name = "fern"\nup_axis = "z"\nmetres_per_unit = 0.001\nnote = "x"\n')
    capture = read_capture(folder)
    assert (capture.name, capture.settings.up_axis, capture.settings.metres_per_unit) == ("fern", "Z", 0.001)
    assert capture.remarks == ()


def test_poses_are_in_units_and_depth_in_metres(folder):
    poses = {name: np.column_stack([pose[:, :3], pose[:, 3] * 1000]) for name, pose in ring(4).items()}
    write_text_model(folder / "cameras", poses, points=np.array([[0, 0, 500.0]]))
    (folder / "capture.toml").write_text("metres_per_unit = 0.001")
    capture = read_capture(folder)
    for view, pose in zip(read_views(capture).views, ring(4).values(), strict=True):
        np.testing.assert_allclose(view.camera.cam_from_world, pose, atol=1e-12)
        points = view.points()
        np.testing.assert_allclose(np.linalg.norm(points[np.isfinite(points[..., 0])], axis=1), 0.5, rtol=1e-5)
    np.testing.assert_allclose(capture.points_m, [[0, 0, 0.5]])


@pytest.mark.parametrize(("axis", "expected"), [("Y", (1, 2, 3)), ("Z", (1, 3, -2))])
def test_the_asset_is_y_up_in_metres(folder, axis, expected):
    (folder / "capture.toml").write_text(f'up_axis = "{axis}"\nmetres_per_unit = 0.5')
    capture = read_capture(folder)
    np.testing.assert_allclose(capture.asset_from_world @ (1, 2, 3, 1), (*expected, 1))
    np.testing.assert_allclose(capture.asset_from_capture @ (2, 4, 6, 1), (*expected, 1))
    assert np.linalg.det(capture.asset_from_world[:3, :3]) == pytest.approx(1)


def test_unknown_keys_are_reported(folder):
    (folder / "capture.toml").write_text('uo_axis = "Z"\nscale = 2')
    assert [each.text for each in read_capture(folder).remarks] == [
        "capture.toml: scale, uo_axis not known, and not used"
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("up_axis = ", r"capture\.toml is no TOML: .*Invalid value"),
        ('up_axis = "W"', r"capture\.toml: up_axis must be one of auto, X, -X, Y, -Y, Z, -Z, not 'W'"),
        ("up_vector = 2", r"capture\.toml: up_vector must be three numbers, not 2"),
        ("up_vector = [0, true, 1]", r"capture\.toml: up_vector must be three numbers"),
        ("up_vector = [0, 0, 0]", r"capture\.toml: up_vector must be three finite numbers and not 0"),
        ("up_axis = 2", r"capture\.toml: up_axis must be text, not 2"),
        ('metres_per_unit = "mm"', r"capture\.toml: metres_per_unit must be a number, not 'mm'"),
        ("metres_per_unit = true", "must be a number"),
        ("metres_per_unit = 0", "metres_per_unit must be in 1e-9 to 1e9, not 0"),
        ("metres_per_unit = nan", "metres_per_unit must be in"),
        ("metres_per_unit = inf", "metres_per_unit must be in"),
    ],
)
def test_bad_settings(folder, text, message):
    (folder / "capture.toml").write_text(text)
    with pytest.raises(CaptureError, match=message):
        read_capture(folder)


def test_the_color_space_is_the_photographs(folder):
    plain = read_view(read_capture(folder), 0).srgb
    (folder / "capture.toml").write_text('color_space = "linear"')
    assert read_view(read_capture(folder), 0).srgb.mean() > plain.mean() + 20


# Which views, which depth


@pytest.mark.parametrize(
    ("views", "expected"),
    [
        ("0,3,5", (0, 3, 5)),
        ("0:10:2", (0, 2, 4)),
        ("::-2", (5, 3, 1)),
        (":2", (0, 1)),
        ("a.jpg", (0,)),
        ("a", (0,)),
        ("-1", (5,)),
        ("c, 4.jpg.jpg", (2, 4)),
        ("leaf, 12.jpg", (5,)),
        ("3,a.jpg,0", (3, 0)),
        ([0, "b.jpg"], (0, 1)),
        ([2, "1:3"], (2, 1)),
    ],
)
def test_views_can_be_chosen(views, expected):
    assert parse_views(views, ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "4.jpg.jpg", "leaf, 12.jpg"]) == expected


@pytest.mark.parametrize("views", ["6", "-7", "g.jpg", "", "1:2:3:4", "x:y", "::0", "5:2", "0,,1", []])
def test_views_that_are_not_there(views):
    with pytest.raises(CaptureError, match=r"no view .* and 1 more"):
        parse_views(views, [f"{letter}.jpg" for letter in "abcdef"])


@given(views=st.text(st.sampled_from("0123456789:,-ab. "), max_size=12))
def test_whatever_is_chosen_is_there_or_refused(views):
    try:
        chosen = parse_views(views, ["a.jpg", "b.jpg", "1.jpg"])
    except CaptureError:
        return
    assert 0 < len(set(chosen)) == len(chosen)
    assert set(chosen) <= {0, 1, 2}


def test_only_chosen_views_are_read(folder):
    capture = read_capture(folder, views="3,1")
    assert [view.name for view in read_views(capture).views] == ["003.png", "001.png"]
    assert capture.remarks == ()


def test_another_depth_folder(folder):
    for path in (folder / "depth").iterdir():
        write_depth(folder / "depth_noisy" / path.name, np.full((SIZE[1], SIZE[0]), 1.75))
    assert (read_view(read_capture(folder, depth="depth_noisy"), 0).depth_m == 1.75).all()
    with pytest.raises(CaptureError, match="depth_nosy has no depth maps; there are depth, depth_noisy"):
        read_capture(folder, depth="depth_nosy")
    (folder / "renders").mkdir()
    (folder / "renders" / "001.jpg").touch()
    with pytest.raises(CaptureError, match="renders has no depth maps"):
        read_capture(folder, depth="renders")


@pytest.mark.parametrize("name", ["truth", "./truth", "truth/depth", "..", "../plant/depth", "/tmp", ""])
def test_nothing_outside_and_no_truth_is_read(folder, name):
    with pytest.raises(CaptureError, match="not the name of a folder"):
        read_capture(folder, depth=name)


# What is missing or damaged


def test_depth_missing_for_some(folder):
    for name in ("000.exr", "002.exr"):
        (folder / "depth" / name).unlink()
    capture = read_capture(folder)
    assert [each.text for each in capture.remarks] == ["2 of 4 views without a depth map: 000.png, 002.png"]
    assert [view.has_depth for view in read_views(capture).views] == [False, True, False, True]


def test_no_depth_at_all(folder):
    shutil.rmtree(folder / "depth")
    capture = read_capture(folder)
    assert [each.text for each in capture.remarks] == [
        "4 of 4 views without a depth map: 000.png, 001.png, 002.png, 003.png"
    ]
    assert not any(view.has_depth for view in read_views(capture).views)


def test_depth_of_no_photograph(folder):
    shutil.copy(folder / "depth" / "000.exr", folder / "depth" / "frame_17.exr")
    assert [each.text for each in read_capture(folder).remarks] == ["1 depth map without a photograph: frame_17.exr"]


def test_depth_of_another_size(folder):
    write_depth(folder / "depth" / "001.exr", np.ones((24, 32)))
    read = read_views(read_capture(folder))
    assert [view.has_depth for view in read.views] == [True, False, True, True]
    (one_remark,) = read.remarks
    assert one_remark.code == "depth-map-ignored"
    assert one_remark.text.startswith("001.png: the depth map is ignored; ")
    assert "001.exr is 32×24 pixels, its photograph 64×48" in one_remark.text


def test_no_depth_of_the_right_size(folder):
    for path in (folder / "depth").iterdir():
        write_depth(path, np.ones((24, 32)))
    with pytest.raises(CaptureError, match=r"none of 4 depth maps can be used; .*000\.exr is 32×24 pixels"):
        read_views(read_capture(folder))


def test_damaged_depth(folder):
    path = folder / "depth" / "001.exr"
    path.write_bytes(path.read_bytes()[:-100])
    read = read_views(read_capture(folder))
    assert not read.views[1].has_depth
    assert "001.exr is truncated or damaged" in read.remarks[0].text


def test_depth_of_zeros(folder):
    for path in list((folder / "depth").iterdir())[:4]:
        write_depth(path, np.zeros((SIZE[1], SIZE[0])))
    read = read_views(read_capture(folder))
    assert [each.text for each in read.remarks] == [
        "000.png, 001.png, 002.png, 003.png: the depth map has no depth at all"
    ]


def test_depths_that_are_no_distance_are_counted(folder):
    for index, value in enumerate((np.nan, np.inf, -2.0, 1e10)):
        path = folder / "depth" / f"00{index}.exr"
        depth_m = read_view(read_capture(folder), index).depth_m
        depth_m[:2, :50] = value
        write_depth(path, depth_m)
    read = read_views(read_capture(folder))
    assert [each.text for each in read.remarks] == [
        "000.png, 001.png: 200 depths are not finite and taken as none",
        "002.png: 100 depths are negative and taken as none",
        "003.png: 100 depths are too far for any photograph and taken as none",
    ]
    assert all(np.isfinite(view.depth_m).all() and (view.depth_m[:2, :50] == 0).all() for view in read.views)


def test_a_channel_of_another_name_is_reported(folder):
    write_depth(folder / "depth" / "000.exr", np.full((SIZE[1], SIZE[0]), 1.5), "Y")
    assert "000.png: the channel Y is taken for the depth, whose name is Z" in sentences_of(folder)


def test_photographs_without_cameras_and_the_reverse(folder):
    (folder / "images" / "000.png").rename(folder / "images" / "extra 1.png")
    write_photo(folder / "images" / "extra 2.png")
    (folder / "images" / "Thumbs.db").write_bytes(b"x")
    (folder / "images" / ".hidden.png").write_bytes(b"x")
    capture = read_capture(folder)
    assert len(capture.views) == 3
    assert [each.text for each in capture.remarks] == [
        "1 camera without a photograph: 000.png",
        "2 photographs without a camera: extra 1.png, extra 2.png",
        "1 depth map without a photograph: 000.exr",
    ]


def test_names_that_are_no_unicode_can_be_printed(folder):
    shutil.copy(folder / "images" / "000.png", folder / "images" / "\udcff.png")
    (one_remark,) = read_capture(folder).remarks
    assert one_remark.text == "1 photograph without a camera: \\udcff.png"


def test_no_photograph_has_a_camera(folder):
    for path in (folder / "images").iterdir():
        path.rename(path.with_name("IMG_" + path.name))
    with pytest.raises(
        CaptureError, match=r"none of the 4 images .* know 000\.png.* there are IMG_000\.png.* the same"
    ):
        read_capture(folder)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("cameras", r"cameras does not exist; the poses .* put a COLMAP model there"),
        ("images", r"images has no photographs; put them there"),
        ("", r"is no folder; give a capture folder"),
    ],
)
def test_missing_folders(folder, missing, message):
    shutil.rmtree(folder / missing)
    with pytest.raises(CaptureError, match=message):
        read_capture(folder)


def test_names_do_not_escape(folder):
    text = (folder / "cameras" / "images.txt").read_text().replace("001.png", "../../secret.png")
    (folder / "cameras" / "images.txt").write_text(text)
    with pytest.raises(CaptureError, match=r"images\.txt:4: .*stay inside"):
        read_capture(folder)


def test_damaged_photographs_are_left_out(folder):
    path = folder / "images" / "001.png"
    path.write_bytes(path.read_bytes()[:500])
    (folder / "images" / "003.png").write_bytes(b"")
    read = read_views(read_capture(folder))
    assert [view.name for view in read.views] == ["000.png", "002.png"]
    (one_remark,) = read.remarks
    assert (one_remark.code, one_remark.subject) == ("photographs-unusable", "001.png, 003.png")
    assert "truncated" in one_remark.text


def test_all_photographs_damaged(folder):
    for path in (folder / "images").iterdir():
        path.write_bytes(b"no picture")
    with pytest.raises(CaptureError, match=r"none of 4 views can be read; the first: .*000\.png"):
        read_views(read_capture(folder))


def test_damaged_points_are_no_reason_to_stop(folder):
    (folder / "cameras" / "points3D.txt").write_text("1 0 0\n")
    (one_remark,) = read_capture(folder).remarks
    assert one_remark.code == "model-points-not-used"
    assert "points3D.txt:1" in one_remark.text


def test_an_unusable_mask_is_ignored(folder):
    (folder / "masks").mkdir()
    for name in ring(4):
        cv2.imwrite(str(folder / "masks" / name), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    read = read_views(read_capture(folder))
    assert all(view.mask is None for view in read.views)
    assert "the mask is ignored; the mask" in read.remarks[0].text
    assert "is empty" in read.remarks[0].text


def test_what_is_remarked_of_photographs_is_one_remark_with_their_names(folder, monkeypatch):
    def read_strange(path: Path, color_space: str | None) -> Photo:
        unknown = remark("color-profile-unknown", "the colour profile 'x' is not known", subject=path.name)
        return replace(read_photo(path, color_space), remarks=(unknown,))

    monkeypatch.setattr("usdfoliage.capture.folder.read.read_photo", read_strange)
    (unknown,) = read_views(read_capture(folder)).remarks
    assert unknown.code == "color-profile-unknown"
    assert unknown.text == f"{named(sorted(ring(4)))}: the colour profile 'x' is not known"


# Size, orientation, distortion


def test_resized_photographs_scale_their_camera(folder):
    wide = scale_lens(LENS, 160, 120)
    for seed, name in enumerate(ring(4)):
        write_photo(folder / "images" / name, (160, 120), seed)
        depth_m = captures.sphere_depth(wide.pinhole(ring(4)[name]), 0.5)
        write_depth((folder / "depth" / name).with_suffix(".exr"), depth_m)
    read = read_views(read_capture(folder))
    (one_remark,) = read.remarks
    assert "for pictures of 64×48 pixels and is scaled to the photograph's 160×120" in one_remark.text
    for view in read.views:
        assert view.camera.focal_px == (200, 205)
        points = view.points()
        np.testing.assert_allclose(np.linalg.norm(points[np.isfinite(points[..., 0])], axis=1), 0.5, rtol=1e-5)


def test_cropped_photographs_are_refused(folder):
    write_photo(folder / "images" / "000.png", (64, 40))
    with pytest.raises(CaptureError, match=r"000\.png is 64×40 pixels, its camera for 64×48; give the pictures"):
        read_view(read_capture(folder), 0)
    assert "000.png is left out: " in sentences_of(folder)


def write_oriented(path: Path, pixels: np.ndarray, orientation: int) -> None:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "uint8")
    spec.attribute("Orientation", orientation)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(pixels))
    output.close()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_cameras_are_for_pixels_as_stored(tmp_path, orientation):
    """COLMAP ignores EXIF orientation, so that one camera fits pictures taken upright and on the side."""
    write_capture(tmp_path, poses={"a.tif": look_at((0, 0, 2), (0, 0, 0))})
    pixels = np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    write_oriented(tmp_path / "images" / "a.tif", pixels, orientation)
    read = read_views(read_capture(tmp_path))
    np.testing.assert_array_equal(read.views[0].srgb, pixels)
    ignored = [f"a.tif: EXIF orientation {orientation} is ignored, as the cameras do"]
    assert [each.text for each in read.remarks] == (ignored if orientation != 1 else [])


def test_cameras_for_upright_photographs(tmp_path):
    """Other programs turn photographs first; where the proportions show that, they are turned."""
    upright = Lens(model="PINHOLE", width_px=48, height_px=64, parameters=(80.0, 80.0, 24.0, 32.0))
    write_capture(tmp_path, poses={"a.tif": look_at((0, 0, 2), (0, 0, 0))}, lens=upright)
    pixels = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    write_oriented(tmp_path / "images" / "a.tif", pixels, 6)
    read = read_views(read_capture(tmp_path))
    np.testing.assert_array_equal(read.views[0].srgb, np.rot90(pixels, -1))
    assert read.remarks == ()


@pytest.mark.parametrize("model", ["SIMPLE_RADIAL", "OPENCV_FISHEYE"])
def test_views_are_pinholes(tmp_path, model):
    """A point seen through a lens is, in the undistorted view, where the pinhole sees it, at its depth."""
    tail = (-0.12,) if model == "SIMPLE_RADIAL" else (0.02, -0.01, 0.003, 0.001)
    focal = (300.0,) if model == "SIMPLE_RADIAL" else (300.0, 310.0)
    lens = Lens(model=model, width_px=240, height_px=180, parameters=(*focal, 118.0, 92.0, *tail))
    pose = look_at((0, 0.6, 2), (0, 0, 0))
    write_capture(tmp_path, poses={"a.png": pose}, lens=lens)
    pinhole = lens.pinhole(pose)
    depth_m, photo = np.zeros((180, 240), np.float32), np.zeros((180, 240, 3), np.uint8)
    points, distances = [], np.linspace(1, 2, 20)
    rng = np.random.default_rng(1)
    for distance in distances:
        x, y = rng.uniform(-0.3, 0.3), rng.uniform(-0.22, 0.22)
        square = x * x + y * y
        if model == "SIMPLE_RADIAL":
            factor = 1 + tail[0] * square
        else:
            angle = np.arctan(np.sqrt(square))
            factor = angle * (1 + sum(k * angle ** (2 * i + 2) for i, k in enumerate(tail))) / np.sqrt(square)
        column = int(lens.focal_px[0] * factor * x + lens.center_px[0])
        row = int(lens.focal_px[1] * factor * y + lens.center_px[1])
        depth_m[row - 1 : row + 2, column - 1 : column + 2] = distance
        photo[row - 1 : row + 2, column - 1 : column + 2] = 255
        points.append((distance * x, distance * y, distance))
    write_depth(tmp_path / "depth" / "a.exr", depth_m)
    cv2.imwrite(str(tmp_path / "images" / "a.png"), photo)
    view = read_view(read_capture(tmp_path), 0)
    in_world = (np.array(points) - pose[:, 3]) @ pose[:, :3]
    places, seen_m = pinhole.project(in_world)
    columns, rows = places.astype(int).T
    np.testing.assert_allclose(seen_m, distances, rtol=1e-9)
    np.testing.assert_allclose(view.depth_m[rows, columns], distances, rtol=1e-6)
    assert (view.srgb[rows, columns] > 150).all()


# Scale


def with_points(folder: Path, scale: float = 1.0) -> None:
    """Poses and points of the model in another unit; the depth stays."""
    directions = np.random.default_rng(0).standard_normal((400, 3))
    points = 0.5 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    points = points[points @ (0, 0.3, 1) > 0.4]  # towards the cameras
    poses = {name: np.column_stack([pose[:, :3], pose[:, 3] * scale]) for name, pose in ring(4).items()}
    write_text_model(folder / "cameras", poses, points=points * scale)


def test_a_right_scale_needs_no_remark(folder):
    with_points(folder)
    assert sentences_of(folder) == ""


@pytest.mark.parametrize("points", [True, False])
def test_depth_in_millimetres_is_reported(tmp_path, points):
    write_capture(tmp_path, depth_scale=1000)
    if points:
        with_points(tmp_path)
    assert "the depth is probably in millimetres" in sentences_of(tmp_path)


@pytest.mark.parametrize("points", [True, False])
def test_poses_in_millimetres_are_reported(folder, points):
    with_points(folder, 1000)
    if not points:
        (folder / "cameras" / "points3D.txt").unlink()
    assert "set metres_per_unit = 0.001 in capture.toml" in sentences_of(folder)
    (folder / "capture.toml").write_text("metres_per_unit = 0.001")
    assert sentences_of(folder) == ""


def test_the_remark_on_a_model_without_scale_gives_its_scale(folder):
    with_points(folder, 7.5)
    (sentence,) = sentences_of(folder).splitlines()
    metres_per_unit = float(sentence.split("metres_per_unit = ")[1].split()[0])
    assert metres_per_unit == pytest.approx(1 / 7.5, rel=0.02)
    (folder / "capture.toml").write_text(f"metres_per_unit = {metres_per_unit}")
    assert sentences_of(folder) == ""


def test_cameras_that_look_in_one_direction_are_compared_by_their_spread(tmp_path):
    poses = {f"{k}.png": look_at((0.3 * k, 0, 2), (0.3 * k, 0, 0)) for k in range(4)}
    write_capture(tmp_path / "metres", poses=poses)
    write_capture(tmp_path / "millimetres", poses=poses, depth_scale=1000)
    assert sentences_of(tmp_path / "metres") == ""
    assert "distance of the cameras from each other; the depth is probably in milli" in sentences_of(
        tmp_path / "millimetres"
    )


def test_one_camera_alone_knows_no_scale(tmp_path):
    write_capture(tmp_path, count=1, depth_scale=1000)
    assert sentences_of(tmp_path) == ""


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(factor=st.floats(0.01, 100))
def test_the_note_does_not_depend_on_the_scene_s_size(folder, factor):
    capture = read_capture(folder)
    views = [
        replace(
            view,
            depth_m=view.depth_m * np.float32(factor),
            camera=replace(
                view.camera,
                cam_from_world=np.column_stack(
                    [view.camera.cam_from_world[:, :3], view.camera.cam_from_world[:, 3] * factor]
                ),
            ),
        )
        for view in read_views(capture).views
    ]
    assert check_depth_scale(views, np.zeros((0, 3)), 1.0) == ()
    far = [replace(view, depth_m=view.depth_m * np.float32(1000)) for view in views]
    assert "millimetres" in check_depth_scale(far, np.zeros((0, 3)), 1.0)[0].text


def test_remarks_are_logged_where_one_view_is_read(folder, caplog):
    write_depth(folder / "depth" / "000.exr", np.ones((24, 32)))
    with caplog.at_level(logging.WARNING):
        read_view(read_capture(folder), 0)
    assert "000.png: the depth map is ignored" in caplog.text


# Benchmark captures


def data(name: str) -> Path:
    if not (DATA / name).is_dir():
        pytest.skip(f"../shared/data/{name} is absent")
    return DATA / name


@pytest.mark.parametrize("depth", ["depth", "depth_noisy"])
def test_dense_foliage(depth):
    capture = read_capture(data("synthetic/dense_foliage"), depth=depth, views="::3")
    read = read_views(capture)
    assert capture.name == "dense_foliage_dev"
    assert capture.remarks == read.remarks == ()
    assert capture.settings.up_axis == "Z"
    for view in read.views:  # the model's points lie on the depth
        places, distance_m = view.camera.project(capture.points_m)
        inside = ((places >= 0) & (places < (view.camera.width_px, view.camera.height_px))).all(axis=1)
        columns, rows = places[inside].astype(int).T
        off_m = np.abs(view.depth_m[rows, columns] - distance_m[inside])
        assert np.median(off_m) < 0.01


def test_depth_for_every_fourth_view():
    capture = read_capture(data("synthetic/tree_leaf_on"))
    assert len(capture.views) == 24
    assert capture.remarks[0].text.startswith("18 of 24 views without a depth map: 001.jpg, 002.jpg")
    assert [index for index, view in enumerate(capture.views) if view.depth is not None] == [0, 4, 8, 12, 16, 20]


def test_cameras_for_smaller_photographs(tmp_path):
    basil = data("mv-basil-bush")
    (tmp_path / "images").symlink_to(basil / "images")
    (tmp_path / "cameras").symlink_to(basil / "colmap_reference")
    capture = read_capture(tmp_path, views="0:2")
    read = read_views(capture)
    view = read.views[0]
    assert (view.camera.width_px, view.camera.height_px) == (2000, 1125)
    assert view.camera.focal_px[0] == pytest.approx(1206.3441308733882 * 1.25)
    assert view.srgb.shape == (1125, 2000, 3)
    (one_remark,) = read.remarks
    assert "for pictures of 1600×900 pixels and is scaled to the photograph's 2000×1125" in one_remark.text
