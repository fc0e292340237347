"""Leaves of a cloud alone from the command line: what is written, and what is refused."""

import numpy as np
import pytest
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.capture.cloud_files.ply import read_cloud_file
from usdfoliage.leaf.model import LeafOrigin

from tests.support.cloud_files import write_any, write_las, write_ply
from tests.support.leaves.commands import files, printed, read, refused, run
from tests.support.leaves.scans import overlaps, scanned_leaves

ORIGIN = np.array([100.0, 200.0, 50.0])
GREEN = (60, 140, 30)


def labels_of(path):
    """Points (N, 3) and leaves (N,) of a points.ply."""
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    kind = "<f8" if b"property double x" in header else "<f4"
    rows = np.frombuffer(body, [("p", kind, 3), ("leaf", "<i4")])
    assert b"property int leaf" in header
    assert f"element vertex {len(rows)}\n".encode() in header
    return rows["p"].astype(np.float64), rows["leaf"]


@pytest.fixture(scope="module")
def scan():
    """Points in the file's coordinates, Z up, and the true leaves."""
    points_m, leaf = scanned_leaves(27, 80)
    return points_m + ORIGIN, leaf


@pytest.fixture(scope="module")
def made(tmp_path_factory, scan):
    folder = tmp_path_factory.mktemp("scans")
    points, _ = scan
    cloud = write_ply(folder / "scan.ply", points, np.full(points.shape, GREEN))
    assert run("leaves", cloud, "-o", folder / "shrub", "--up", "Z", "--unit", "m", "--no-preview") == 0
    return folder / "shrub"


def test_leaves_of_a_cloud_are_instances(made, scan):
    leaves = read(made).leaves
    assert 25 <= len(leaves) <= 29
    assert set(leaves.origin.tolist()) <= {LeafOrigin.FOUND, LeafOrigin.COMPLETED}
    assert (leaves.origin == LeafOrigin.FOUND).mean() > 0.8
    assert ((leaves.confidence >= 0) & (leaves.confidence <= 1)).all()
    assert np.median(leaves.length_m) == pytest.approx(0.08, rel=0.1)
    linear = np.array([0.0452, 0.2623, 0.0130])
    np.testing.assert_allclose(leaves.color, np.tile(linear, (len(leaves), 1)), atol=2e-3)


def test_the_points_keep_their_order_and_have_their_leaf(made, scan):
    points, true = scan
    written, leaf = labels_of(made / "report/points.ply")
    np.testing.assert_array_equal(written, points)
    assert (overlaps(leaf, true) > 0.8).mean() > 0.9
    assert leaf.max() == len(read(made).leaves) - 1
    assert (read_cloud_file(made / "report/points.ply").cloud.points_m == points).all()


def test_the_leaves_lie_over_the_points_of_the_file(made, scan):
    points, _ = scan
    stage = open_asset(made)
    matrix = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get()).T
    in_asset = points @ matrix[:3, :3].T + matrix[:3, 3]
    _, leaf = labels_of(made / "report/points.ply")
    leaves = read(made).leaves
    for number in range(len(leaves)):
        own = in_asset[leaf == number]
        middle = leaves.base_m[number] + leaves.asset_from_leaf()[number, :, 1] / 2
        assert np.linalg.norm(own.mean(axis=0) - middle) < 0.3 * leaves.length_m[number]
    np.testing.assert_allclose(matrix[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)


def test_points_that_are_not_used_are_of_no_leaf(tmp_path, scan):
    points, _ = scan
    broken = np.concatenate([[[np.nan] * 3], points, points[:3], [[np.inf, 0, 0]]])
    cloud = write_ply(tmp_path / "scan.ply", broken)
    assert run("leaves", cloud, "-o", tmp_path / "out", "--no-preview") == 0
    written, leaf = labels_of(tmp_path / "out/report/points.ply")
    assert len(written) == len(broken)
    np.testing.assert_array_equal(written[1:-1], broken[1:-1])
    assert leaf[0] == leaf[-1] == -1
    np.testing.assert_array_equal(leaf[-4:-1], leaf[1:4])  # duplicates are of the leaf of their place


def test_points_that_the_file_marks_are_rows_of_no_leaf(tmp_path, scan):
    points, _ = scan
    some = np.arange(3, 200, 20)
    classes = np.isin(np.arange(200), some) * 7
    cloud = write_las(tmp_path / "scan.las", points[:200], classification=classes.astype(np.uint8))
    assert run("leaves", cloud, "-o", tmp_path / "out", "--no-preview") == 0
    written, leaf = labels_of(tmp_path / "out/report/points.ply")
    np.testing.assert_allclose(written, points[:200], atol=6e-4)
    assert (leaf[some] == -1).all()


def test_marked_points_move_no_leaf_to_others(tmp_path, scan):
    points, true = scan
    marked = np.zeros(len(points), bool)
    marked[::7] = True
    cloud = write_las(tmp_path / "scan.las", points, withheld=marked)
    assert run("leaves", cloud, "-o", tmp_path / "out", "--up", "Z", "--no-preview") == 0
    _, leaf = labels_of(tmp_path / "out/report/points.ply")
    assert (leaf[marked] == -1).all()
    assert (overlaps(leaf[~marked], true[~marked]) > 0.8).mean() > 0.85


def test_ground_is_no_leaf_and_its_points_are_rows(tmp_path, scan):
    points, true = scan
    rng = np.random.default_rng(3)
    floor = np.column_stack([rng.uniform(-0.5, 0.9, (4000, 2)), -0.06 + rng.normal(0, 0.002, 4000)]) + ORIGIN
    cloud = write_ply(tmp_path / "scan.ply", np.concatenate([floor, points]))
    assert run("leaves", cloud, "-o", tmp_path / "out", "--up", "Z", "--unit", "m", "--no-preview") == 0
    written, leaf = labels_of(tmp_path / "out/report/points.ply")
    assert len(written) == len(floor) + len(points)
    assert (leaf[: len(floor)] == -1).all()
    assert (overlaps(leaf[len(floor) :], true) > 0.8).mean() > 0.85
    assert (read(tmp_path / "out").leaves.base_m[:, 1] > -0.01).all()  # none on the floor


@pytest.mark.parametrize("suffix", [".las", ".xyz"])
def test_other_files_give_the_same_leaves(tmp_path, scan, suffix):
    points, true = scan
    cloud = write_any(tmp_path / f"scan{suffix}", points)
    assert run("leaves", cloud, "-o", tmp_path / "out", "--up", "Z", "--unit", "m", "--no-preview") == 0
    _, leaf = labels_of(tmp_path / "out/report/points.ply")
    assert (overlaps(leaf, true) > 0.8).mean() > 0.85


def test_a_folder_with_a_cloud_and_no_photographs(tmp_path, scan, capsys):
    write_ply(tmp_path / "capture.ply", scan[0])
    lines = printed(capsys, "leaves", tmp_path, "-o", tmp_path / "out", "--dry-run")
    assert lines[0].startswith(f"cloud: {tmp_path / 'capture.ply'}, 2,160 points without colours")
    assert not (tmp_path / "out").exists()


def test_the_same_cloud_gives_the_same_bytes(tmp_path, scan):
    cloud = write_ply(tmp_path / "scan.ply", scan[0][:800])
    for out, threads in (("one", 1), ("two", 2)):
        words = ("leaves", cloud, "-o", tmp_path / out, "--name", "shrub", "--no-preview", "--threads", threads)
        assert run(*words) == 0
    one, two = files(tmp_path / "one"), files(tmp_path / "two")
    assert one.keys() == two.keys()
    differ = {name for name in one if one[name] != two[name]}
    assert differ <= {"report/timings.js"}


def test_noise_gives_an_asset_without_leaves_and_a_warning(tmp_path, capsys):
    cloud = write_ply(tmp_path / "noise.ply", np.random.default_rng(0).random((2000, 3)))
    lines = printed(capsys, "leaves", cloud, "-o", tmp_path / "out", "--no-preview")
    assert any(line.startswith("warning: no leaf was found") for line in lines)
    assert len(read(tmp_path / "out").leaves) == 0


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--depth", "estimated"), "--depth is for photographs"),
        (("--views", "0:3"), "--views is for photographs"),
        (("--method", "paper"), "--method is for photographs"),
        (("--up", "W"), "--up must be auto or one of X, Y, Z"),
        (("--unit", "ell"), "--unit must be auto or one of"),
    ],
)
def test_options_that_cannot_be(tmp_path, scan, capsys, words, named):
    cloud = write_ply(tmp_path / "scan.ply", scan[0][:100])
    assert named in refused(capsys, "leaves", cloud, "-o", tmp_path / "out", *words)


def test_options_of_clouds_are_refused_for_photographs(tmp_path, capsys):
    (tmp_path / "images").mkdir()
    assert "--up is for a cloud alone" in refused(capsys, "leaves", tmp_path, "-o", tmp_path / "out", "--up", "Z")


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("scan.ply", b"", "is empty (0 bytes)"),
        ("scan.e57", b"ASTM-E57", "is no E57 file"),
        ("scan.xyz", b"1 2 3\n" * 60, "all 60 points of"),
        ("scan.xyz", b"nan nan nan\n" * 60, "has no usable point"),
        ("scan.xyz", b"0 0 0\n1 0 0\n", "50 are needed"),
    ],
)
def test_clouds_that_cannot_be_used(tmp_path, capsys, name, content, named):
    (tmp_path / name).write_bytes(content)
    line = refused(capsys, "leaves", tmp_path / name, "-o", tmp_path / "out", "--no-preview")
    assert named in line
    assert name in line
    assert not (tmp_path / "out").exists()


def test_a_cloud_that_is_not_there(tmp_path, capsys):
    line = refused(capsys, "leaves", tmp_path / "none.laz", "-o", tmp_path / "out")
    assert "none.laz does not exist" in line
