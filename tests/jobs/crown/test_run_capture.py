"""From a capture folder to a crown's asset."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pxr import Usd
from usdfoliage.__main__ import main
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.pinhole import Pinhole
from usdfoliage.jobs.crown.capture_input import PlantPoints, move_camera, read_crown_capture
from usdfoliage.jobs.plant_cloud import PlantCloudRequest

from tests.support.captured_crowns import CENTER_M, photograph, ring, sphere, surface_points

ALONE = ("--size", "32", "--mesh-size", "17", "--no-preview")
SMALL = (*ALONE, "--report-views", "2")


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A ball on a stem, green, in a world with Z up: photographs, masks, cameras and cloud."""
    folder = tmp_path_factory.mktemp("my capture") / "ball"
    for name in ("images", "masks", "cameras"):
        (folder / name).mkdir(parents=True)
    z_up_from_y_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    images = []
    for number, camera in enumerate(ring(8)):
        srgb, mask, _ = photograph(camera, sphere)
        cv2.imwrite(str(folder / "images" / f"{number}.png"), srgb[..., ::-1])
        cv2.imwrite(str(folder / "masks" / f"{number}.png"), mask.astype(np.uint8) * 255)
        rotation = camera.cam_from_world[:, :3] @ z_up_from_y_up.T
        w, x, y, z = _quaternion(rotation)
        tx, ty, tz = camera.cam_from_world[:, 3]
        images.append(f"{number + 1} {w} {x} {y} {z} {tx} {ty} {tz} 1 {number}.png\n\n")
    (folder / "cameras" / "cameras.txt").write_text(
        f"1 PINHOLE {camera.width_px} {camera.height_px} {camera.focal_px[0]} {camera.focal_px[1]} "
        f"{camera.center_px[0]} {camera.center_px[1]}\n"
    )
    (folder / "cameras" / "images.txt").write_text("".join(images))
    (folder / "cameras" / "points3D.txt").write_text("")
    (folder / "capture.toml").write_text('up_axis = "Z"\nmetres_per_unit = 1.0\n')
    points_m = np.concatenate([surface_points(sphere, 6000), _stem()]) @ z_up_from_y_up.T
    rows = "\n".join(f"{x:.5f} {y:.5f} {z:.5f} 60 120 40" for x, y, z in points_m)
    header = "ply\nformat ascii 1.0\nelement vertex {}\n{}\nend_header\n".format(
        len(points_m),
        "\n".join(
            f"property {kind}" for kind in ("float x", "float y", "float z", "uchar red", "uchar green", "uchar blue")
        ),
    )
    (folder / "cloud.ply").write_text(header + rows + "\n")
    return folder


def _stem():
    rng = np.random.default_rng(4)
    angle = rng.uniform(0, 2 * np.pi, 1500)
    return np.column_stack(
        [CENTER_M[0] + 0.07 * np.cos(angle), rng.uniform(0, 1.0, 1500), CENTER_M[2] + 0.07 * np.sin(angle)]
    )


def _quaternion(rotation):
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return w, x, y, z


def refused(capsys, *arguments):
    assert main(["crown", *map(str, arguments)]) == 2
    return capsys.readouterr().err.strip().splitlines()[-1]


def test_a_capture_becomes_an_asset_with_report(capture, tmp_path, capsys):
    out = tmp_path / "ball"

    assert main(["crown", str(capture), "-o", str(out), *SMALL]) == 0

    printed = capsys.readouterr().out
    assert "silhouette IoU with the masks: 0.9" in printed
    radius_m = read_cubemap(out / "maps" / "ball_crown_radius.exr").pixels[..., 0]
    assert np.median(radius_m) == pytest.approx(1.0, abs=0.03)
    stage = Usd.Stage.Open(str(out / "ball.usda"))
    center = stage.GetPrimAtPath("/ball/geo/proxy/Crown").GetAttribute("foliage:crown:center").Get()
    assert center[1] == pytest.approx(CENTER_M[1], abs=0.15)
    moved = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()).T
    in_capture = moved[:3, :3].T @ (np.array(center) - moved[:3, 3])
    assert in_capture == pytest.approx([CENTER_M[0], -CENTER_M[2], CENTER_M[1]], abs=0.1)
    page = (out / "report" / "index.html").read_text()
    for picture in ("view_0.jpg", "view_1.jpg", "color_faces.jpg", "radius_faces.png"):
        assert f'src="{picture}"' in page
        assert cv2.imread(str(out / "report" / picture)) is not None
    assert main(["validate", str(out)]) == 0


def test_a_dry_run_writes_nothing(capture, tmp_path, capsys):
    assert main(["crown", str(capture), "-o", str(tmp_path / "out"), "--dry-run"]) == 0

    printed = capsys.readouterr().out
    assert "8 photographs with cameras, 8 with masks, 0 with depth" in printed
    assert list(tmp_path.iterdir()) == []


def test_options_of_photographs_and_captures_are_refused_for_the_other(capture, tmp_path, capsys):
    out = tmp_path / "out"

    complaint = refused(capsys, capture, "-o", out, "--height", "3", "--laplacian")
    assert "--height, --laplacian have no meaning there" in complaint
    complaint = refused(capsys, capture / "images" / "0.png", "-o", out, "--up", "Z")
    assert "--up has no meaning there" in complaint
    assert not out.exists()


def test_a_folder_without_a_cloud_is_refused(capture, tmp_path, capsys):
    (tmp_path / "bare").mkdir()
    for name in ("images", "cameras"):
        (tmp_path / "bare" / name).symlink_to(capture / name)

    assert "has no cloud" in refused(capsys, tmp_path / "bare", "-o", tmp_path / "out")


def test_a_given_frame_and_given_points_are_kept(capture):
    request = PlantCloudRequest(path=capture, roots=RootSettings())
    own = read_crown_capture(request)
    shift = np.eye(4)
    shift[:3, 3] = 5.0, 1.0, -2.0
    frame = shift @ own.plant.asset_from_capture

    moved = read_crown_capture(request, asset_from_capture=frame)
    given = read_crown_capture(request, PlantPoints(points_m=np.ones((5, 3)), foliage=None, asset_from_capture=frame))

    assert moved.plant.points_m == pytest.approx(own.plant.points_m + shift[:3, 3], abs=1e-9)
    assert len(given.plant.points_m) == 5
    place, depth_m = own.views[0].camera.project(own.plant.points_m[:50])
    for other in (moved, given):
        again, as_deep = other.views[0].camera.project(own.plant.points_m[:50] + shift[:3, 3])
        assert again == pytest.approx(place, abs=1e-6)
        assert as_deep == pytest.approx(depth_m, abs=1e-9)


def test_a_camera_in_a_larger_frame_sees_the_same():
    camera = ring(3)[1]
    frame = np.diag([2.5, 2.5, 2.5, 1.0])
    frame[:3, 3] = 1, 2, 3
    points_m = surface_points(sphere, 20)

    moved = move_camera(camera, frame)

    assert isinstance(moved, Pinhole)
    place, depth_m = camera.project(points_m)
    again, deeper_m = moved.project(2.5 * points_m + frame[:3, 3])
    assert again == pytest.approx(place, abs=1e-9)
    assert deeper_m == pytest.approx(2.5 * depth_m)
    assert replace(moved, cam_from_world=camera.cam_from_world).position_m == pytest.approx(camera.position_m)


def test_a_cloud_alone_becomes_a_crown_in_its_own_colours(capture, tmp_path, capsys):
    cloud = tmp_path / "my scan.ply"
    cloud.write_bytes((capture / "cloud.ply").read_bytes())
    frame = ("--up", "Z", "--unit", "m")
    assert main(["crown", str(cloud), "-o", str(tmp_path / "plan"), *ALONE, *frame, "--dry-run"]) == 0
    plan = capsys.readouterr().out
    assert "a cloud alone" in plan
    assert "photographs" not in plan
    assert not (tmp_path / "plan").exists()

    assert main(["crown", str(cloud), "-o", str(tmp_path / "ball"), *ALONE, *frame]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("colours of its points" in line for line in lines)
    radius = read_cubemap(tmp_path / "ball" / "maps" / "ball_crown_radius.exr").pixels
    assert np.median(radius) == pytest.approx(1.0, abs=0.05)
    color = np.median(read_cubemap(tmp_path / "ball" / "maps" / "ball_crown_color.exr").pixels.reshape(-1, 3), axis=0)
    np.testing.assert_allclose(color, decode_srgb(np.array([60, 120, 40]) / 255), rtol=0.02)
    assert "my scan" in (tmp_path / "ball" / "report" / "index.html").read_text()

    assert main(["crown", str(cloud), "-o", str(tmp_path / "no"), "--height", "3"]) == 2
    assert "is a cloud, not one photograph" in capsys.readouterr().err


def test_the_report_of_a_cloud_does_not_mention_photographs(capture, tmp_path, capsys):
    cloud = tmp_path / "scan.ply"
    cloud.write_bytes((capture / "cloud.ply").read_bytes())
    assert main(["crown", str(cloud), "-o", str(tmp_path / "ball"), *ALONE, "--up", "Z", "--unit", "m"]) == 0
    page = (tmp_path / "ball" / "report" / "index.html").read_text()

    for word in ("photograph", "carved", "texels seen", "IoU with the mask", "capture"):
        assert word not in page
    assert "100 %</td><td>of the texels have a point&#39;s colour or shade" in page
    assert "a crown from the cloud scan" in page
    assert "directions carved" not in capsys.readouterr().out

    complaint = refused(capsys, cloud, "-o", tmp_path / "no", "--report-views", "2")
    assert "is a cloud alone, without photographs; --report-views has no meaning there" in complaint
    assert not (tmp_path / "no").exists()


def test_the_report_of_a_capture_has_the_measures_of_its_photographs(capture, tmp_path):
    assert main(["crown", str(capture), "-o", str(tmp_path / "ball"), *SMALL]) == 0
    page = (tmp_path / "ball" / "report" / "index.html").read_text()

    for words in ("directions carved", "in some photograph", "texels seen", "IoU with the mask", "from the capture"):
        assert words in page


def test_an_unreadable_cloud_is_refused_as_by_other_commands(tmp_path, capsys):
    (tmp_path / "scan.e57").write_bytes(b"ASTM-E57" + bytes(40))
    (tmp_path / "renamed.jpg").write_bytes(b"ASTM-E57" + bytes(40))
    (tmp_path / "empty.laz").touch()
    for name, expected in {
        "missing.laz": "missing.laz does not exist; give a cloud (.ply",
        "missing.e57": "missing.e57 does not exist; give a cloud (.ply",
        "scan.e57": "scan.e57 is E57 of version 0 with pages of 0 bytes; export it again",
        "renamed.jpg": "renamed.jpg is E57 of version 0 with pages of 0 bytes; export it again",
        "empty.laz": "empty.laz is empty (0 bytes); copy it again",
    }.items():
        assert expected in refused(capsys, tmp_path / name, "-o", tmp_path / "out")
        assert main(["build", str(tmp_path / name), "-o", str(tmp_path / "out"), "--work", str(tmp_path / "work")]) == 2
        assert expected in capsys.readouterr().err
    assert "missing.jpg does not exist" in refused(capsys, tmp_path / "missing.jpg", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_plane_of_points_is_refused_by_its_name(tmp_path, capsys):
    rng = np.random.default_rng(5)
    path = tmp_path / "wall.xyz"
    np.savetxt(path, np.column_stack([rng.uniform(0, 2, 2000), np.zeros(2000), rng.uniform(0, 3, 2000)]))

    complaint = refused(capsys, path, "-o", tmp_path / "out", "--up", "Z", "--unit", "m")

    assert "points of the crown lie in a plane" in complaint
    assert str(path) in complaint


@pytest.mark.parametrize("by", ["height", "intensity"])
def test_a_ramp_makes_no_holes_and_no_rainbow(capture, tmp_path, capsys, by):
    text = (capture / "cloud.ply").read_text().split("end_header\n")
    points = np.array([line.split()[:3] for line in text[1].splitlines()], float)
    value = points[:, 2] if by == "height" else np.random.default_rng(6).random(len(points))
    value = np.rint(255 * (value - value.min()) / np.ptp(value)).astype(np.uint8)
    colors = cv2.applyColorMap(value[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    rows = [" ".join(f"{c:.5f}" for c in p) + " " + " ".join(map(str, c)) for p, c in zip(points, colors, strict=True)]
    path = tmp_path / "ramp.ply"
    path.write_text(text[0] + "end_header\n" + "\n".join(rows) + "\n")

    assert main(["crown", str(path), "-o", str(tmp_path / "ball"), *ALONE, "--up", "Z", "--unit", "m"]) == 0

    lines = capsys.readouterr().out.splitlines()
    assert "warning: the cloud's colours are a ramp" in lines[0]
    assert any("the points have no colours that show leaves" in line for line in lines)
    radius = read_cubemap(tmp_path / "ball" / "maps" / "ball_crown_radius.exr").pixels
    assert np.median(radius) == pytest.approx(1.0, abs=0.05)
    color = read_cubemap(tmp_path / "ball" / "maps" / "ball_crown_color.exr").pixels.reshape(-1, 3)
    assert (color[:, 1] > color[:, 0]).all()
    assert (color[:, 1] > color[:, 2]).all()
    assert "colours are a ramp" in (tmp_path / "ball" / "report" / "index.html").read_text()
