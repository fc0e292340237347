"""From a cloud on disk to an asset of branches, as the command does it."""

import json
import re

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.branches import warnings
from usdfoliage.jobs.branches.regrowth import RegrowthRequest
from usdfoliage.jobs.branches.run import BranchesRequest, make_branches_asset, variation_seed
from usdfoliage.jobs.models import read_models
from usdfoliage.jobs.plant_cloud import PlantCloudRequest, read_roots, read_unit, read_up

from tests.support.cloud_files import write_ply
from tests.support.commands.json_output import read_output

HEIGHT_M, RADIUS_M, ARM_M = 2.0, 0.04, 0.02


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def y_tree(rng, ground=False):
    """(N, 3) points, Z up, on a tapering trunk of 2 m that leans nowhere, with an arm from its middle at 50 degrees."""
    parts = []
    for start, direction, length, radius, count in (
        ((0, 0, 0), (0, 0, 1), HEIGHT_M, RADIUS_M, 6000),
        ((0, 0, 1.0), (np.sin(0.87), 0, np.cos(0.87)), 0.9, ARM_M, 1500),
    ):
        along, turn = rng.uniform(0, length, count), rng.uniform(0, 2 * np.pi, count)
        axis = np.array(direction, float)
        side = np.cross(axis, [0, 1, 0])
        other = np.cross(axis, side)
        ring = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
        here_m = radius * (1 - 0.6 * along / length)
        parts.append(np.array(start) + along[:, None] * axis + here_m[:, None] * ring)
    tree = np.concatenate(parts)
    outside = np.hypot(tree[:, 0], tree[:, 1]) > 0.99 * RADIUS_M * (1 - 0.6 * tree[:, 2] / HEIGHT_M)
    tree = tree[outside]
    if ground:
        flat = np.column_stack([rng.uniform(-1.5, 1.5, (4000, 2)), rng.normal(0, 0.004, 4000)])
        tree = np.concatenate([tree, flat])
    return tree + rng.normal(0, 0.001, tree.shape)


def write_xyz(path, points):
    path.write_text("\n".join(" ".join(f"{c:.6f}" for c in point) for point in points), encoding="utf-8")
    return path


def test_a_tree_in_a_text_file_becomes_an_asset_that_lies_over_it(tmp_path, rng):
    offset = np.array([120_000.0, 480_000.0, 7.0])
    cloud = write_xyz(tmp_path / "tree y.xyz", y_tree(rng, ground=True) + offset)
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview"]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/out/geo/guide/Skeleton"))
    points = np.array(curves.GetPointsAttr().Get(), float)
    assert points[0] == pytest.approx([0, 0, 0], abs=0.05)
    orders = np.array(curves.GetPrim().GetAttribute("foliage:order").Get())
    assert orders[0] == 0
    assert 1 in orders
    counts = np.array(curves.GetCurveVertexCountsAttr().Get())
    trunk, along = np.array(curves.GetWidthsAttr().Get())[: counts[0]], points[: counts[0], 1]
    low = along < 0.4 * HEIGHT_M
    assert trunk[low] == pytest.approx(2 * RADIUS_M * (1 - 0.6 * along[low] / HEIGHT_M), rel=0.15)
    matrix = np.array(stage.GetDefaultPrim().GetAttribute("foliage:captureToAsset").Get())
    top = np.append(offset + np.array([0, 0, HEIGHT_M]), 1) @ matrix
    assert np.linalg.norm(points - top[:3], axis=1).min() < 0.06
    assert (tmp_path / "out" / "report" / "index.html").is_file()


def test_the_same_cloud_makes_the_same_bytes(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng))
    for name, words in (("one", ()), ("two", ("--json",))):
        capsys.readouterr()
        assert main(["branches", str(cloud), "-o", str(tmp_path / name), "--name", "tree", "--no-preview", *words]) == 0
    assert read_output("branches", capsys.readouterr().out)["asset"] == str(tmp_path / "two" / "tree.usda")
    for layer in ("skeleton.usdc", "branches.usdc"):
        first, second = (tmp_path / name / "payload" / layer for name in ("one", "two"))
        assert first.read_bytes() == second.read_bytes()


def test_a_dry_run_writes_nothing(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng, ground=True))
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert "roots: 1" in printed
    assert "give --up if that is wrong" in printed
    assert "are ground and left out" in printed
    assert not (tmp_path / "out").exists()


def test_a_dry_run_refuses_what_a_run_refuses(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng))
    output = tmp_path / "notes"
    output.mkdir()
    (output / "notes.txt").write_text("mine")
    for words in (["--dry-run"], []):
        assert main(["branches", str(cloud), "-o", str(output), *words]) == 2
        assert "a folder with other things than one asset" in capsys.readouterr().err


def test_an_upside_down_tree_is_turned_by_the_option_up(tmp_path, rng):
    points = y_tree(rng) * [1, -1, -1]
    cloud = write_xyz(tmp_path / "tree.xyz", points)
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--up=-Z", "--no-preview"]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/out/geo/guide/Skeleton"))
    assert np.array(curves.GetPointsAttr().Get())[:, 1].max() == pytest.approx(HEIGHT_M, abs=0.06)


def test_a_cloud_in_millimetres_is_read_with_the_option_unit(tmp_path, rng):
    cloud = write_xyz(tmp_path / "tree.xyz", 1000 * y_tree(rng))
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--unit", "mm", "--up", "Z", "--no-preview"]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/out/geo/guide/Skeleton"))
    assert np.array(curves.GetPointsAttr().Get())[:, 1].max() == pytest.approx(HEIGHT_M, abs=0.06)


@pytest.mark.parametrize("dry", [True, False])
def test_a_height_that_no_plant_has_is_a_warning_that_names_the_unit(tmp_path, rng, capsys, dry):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[::4])
    words = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--unit", "mm", "--up", "Z", "--no-preview"]
    assert main([*words, *(["--dry-run"] if dry else [])]) == 0
    printed = capsys.readouterr().out
    assert "warning: the plant is 2 mm high" in printed
    assert "--unit m (2 m high)" in printed
    if not dry:
        assert "the plant is 2 mm high" in (tmp_path / "out" / "report" / "index.html").read_text(encoding="utf-8")


def test_a_unit_that_makes_all_of_a_cloud_ground_is_named(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng, ground=True))
    words = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--unit", "mm", "--up", "Z"]
    assert main(words) == 2
    assert "--unit m (2" in capsys.readouterr().err


def skeleton_points(asset):
    stage = Usd.Stage.Open(str(asset))
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath(f"/{asset.stem}/geo/guide/Skeleton"))
    return np.array(curves.GetPointsAttr().Get(), float)


def test_branches_and_similar_plants_can_be_grown(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng))
    options = [
        "--method",
        "grow",
        "--variations",
        "2",
        "--variation-spread",
        "0",
        "--seed",
        "4",
        "--no-preview",
        "--up",
        "Z",
        "--internode",
        "0.05",
    ]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options]) == 0
    printed = capsys.readouterr().out
    assert "grown from the roots" in printed
    assert "exponent of the allometry, as traced: " in printed  # circles are those of the branches that were traced
    report = (tmp_path / "out" / "report" / "index.html").read_text(encoding="utf-8")
    assert "circles believed along the branches that were traced" in report
    assets = [tmp_path / "out" / "out.usda"]
    assets += [tmp_path / "out" / "variations" / name / f"{name}.usda" for name in ("out_01", "out_02")]
    tips_m = np.array([[0, HEIGHT_M, 0], [0.9 * np.sin(0.87), 1 + 0.9 * np.cos(0.87), 0]])
    shapes = set()
    for asset in assets:
        points = skeleton_points(asset)
        turned = np.column_stack([np.hypot(points[:, 0], points[:, 2]), points[:, 1], 0 * points[:, 0]])
        for tip_m in tips_m:
            assert (
                np.linalg.norm(turned - tip_m, axis=1).min() < 3 * 0.05
            )  # internodes, within which points are reached
        shapes.add(points.tobytes())
    assert len(shapes) == 3
    assert main(["validate", str(assets[1])]) == 0
    stages = [Usd.Stage.Open(str(asset)) for asset in assets]
    named = {stage.GetDefaultPrim().GetAssetInfo()["name"] for stage in stages}
    assert named == {"out", "out_01", "out_02"}


def test_variations_of_a_stand_differ_in_height_and_are_whole(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[::3])
    options = ["--variations", "2", "--seed", "4", "--no-preview", "--up", "Z", "--internode", "0.05"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options]) == 0
    assert "reach of variations: " in capsys.readouterr().out
    assets = [tmp_path / "out" / "variations" / name / f"{name}.usda" for name in ("out_01", "out_02")]
    points = [skeleton_points(asset) for asset in assets]
    heights_m = [float(each[:, 1].max()) for each in points]
    assert abs(heights_m[0] - heights_m[1]) > 0.02 * HEIGHT_M
    assert all(0.6 * HEIGHT_M < height_m < 1.5 * HEIGHT_M for height_m in heights_m)
    assert all(np.linalg.norm(each, axis=1).min() < 0.1 for each in points)  # the root stays
    assert main(["validate", str(assets[0])]) == 0


def test_of_two_trees_that_at_the_given_root_is_traced(tmp_path, rng, capsys):
    one = y_tree(rng)[::3]
    cloud = write_xyz(tmp_path / "two.xyz", np.concatenate([one, np.add(one, [5, 0, 0])]))
    options = ["--no-preview", "--up", "Z", "--roots", "5,0,0"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options]) == 0
    assert "of other trees" in capsys.readouterr().out
    assert np.ptp(skeleton_points(tmp_path / "out" / "out.usda")[:, [0, 2]], axis=0).max() < 1.5


def closed_crown(rng):
    """(N, 3) points, Z up, on a trunk of 0.9 m and on a ball of a crown around 1.3 m, half a metre to each side."""
    trunk = rng.normal(size=(1500, 3))
    trunk = trunk / np.linalg.norm(trunk[:, :2], axis=1, keepdims=True) * [0.05, 0.05, 0]
    trunk[:, 2] = rng.uniform(0, 0.9, len(trunk))
    crown = rng.normal(size=(2500, 3))
    return np.concatenate([trunk, crown / np.linalg.norm(crown, axis=1, keepdims=True) * 0.5 + [0, 0, 1.3]])


def test_similar_plants_fill_what_the_crown_hides_as_well(tmp_path, rng):
    cloud = write_xyz(tmp_path / "tree.xyz", closed_crown(rng))
    inside = []
    for name, filled in (("shell", []), ("full", ["--fill-hidden"])):
        options = [
            "--variations",
            "1",
            "--variation-spread",
            "0",
            "--no-preview",
            "--up",
            "Z",
            "--internode",
            "0.06",
            *filled,
        ]
        assert main(["branches", str(cloud), "-o", str(tmp_path / name), *options]) == 0
        points = skeleton_points(tmp_path / name / "variations" / f"{name}_01" / f"{name}_01.usda")
        inside.append(int((np.linalg.norm(points - [0, 1.3, 0], axis=1) < 0.3).sum()))
    assert inside[1] > inside[0] + 20


def test_limbs_grow_on_where_they_are_asked_to(tmp_path, rng):
    """A tree, and beside its top a cluster that no branch was traced to, as across a gap."""
    cluster = rng.normal([0.9, 0, 1.6], 0.08, (300, 3))
    cloud = write_xyz(tmp_path / "tree.xyz", np.concatenate([y_tree(rng)[::4], cluster]))
    marked = {}
    for name, options in (("traced", []), ("filled", ["--fill"])):
        asked = ["--no-preview", "--up", "Z", "--roots", "0,0,0", "--cloud-leaves", "off", *options]
        assert main(["branches", str(cloud), "-o", str(tmp_path / name), *asked]) == 0
        marked[name] = read_models(tmp_path / name).skeleton.inferred
    assert not marked["traced"].any()
    assert 0 < marked["filled"].sum() < len(marked["filled"])


def test_growth_that_comes_to_few_points_is_a_warning(tmp_path, rng, capsys):
    beside = rng.uniform([2.7, -0.3, 1], [3.3, 0.3, 2], (5000, 3))
    cloud = write_xyz(tmp_path / "tree.xyz", np.concatenate([y_tree(rng)[::4], beside]))
    options = ["--method", "grow", "--no-preview", "--up", "Z", "--internode", "0.05", "--roots", "0,0,0"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options, "--cloud-leaves", "off"]) == 0
    assert re.search(r"warning: .*% of the points alone", capsys.readouterr().out)
    report = (tmp_path / "out" / "report" / "index.html").read_text(encoding="utf-8")
    assert "% of the points alone" in report


def crown_on_trunk(rng, trunk_m):
    """(N, 3) points, Z up, along a trunk at these heights and in a ball of a crown half a metre wide around 2 m."""
    crown = rng.normal(size=(3000, 3))
    crown *= 0.5 * (rng.random(3000) ** (1 / 3) / np.linalg.norm(crown, axis=1))[:, None]
    trunk = np.column_stack([0 * trunk_m, 0 * trunk_m, trunk_m])
    return np.concatenate([trunk, np.add(crown, [0, 0, 2.0])])


@pytest.mark.parametrize(
    "trunk_m", [np.arange(0, 1.5, 0.3), np.append(np.arange(0, 0.5, 0.01), np.arange(1.2, 1.5, 0.01))]
)
def test_growth_reaches_a_crown_over_points_far_apart_and_over_a_gap(tmp_path, rng, capsys, trunk_m):
    cloud = write_xyz(tmp_path / "tree.xyz", crown_on_trunk(rng, trunk_m))
    options = ["--method", "grow", "--no-preview", "--up", "Z", "--roots", "0,0,0", "--cloud-leaves", "off"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options]) == 0
    share = re.search(r"growth came to (\d+) % of the points", capsys.readouterr().out)
    assert int(share.group(1)) >= 95
    points = skeleton_points(tmp_path / "out" / "out.usda")
    assert points[:, 1].max() > 2.3
    assert points[0] == pytest.approx([0, 0, 0], abs=0.05)


def test_growth_that_comes_to_few_points_without_an_internode_ends_with_what_is_missing(tmp_path, rng, capsys):
    beside = rng.uniform([2.7, -0.3, 1], [3.3, 0.3, 2], (5000, 3))
    cloud = write_xyz(tmp_path / "tree.xyz", np.concatenate([y_tree(rng)[::4], beside]))
    options = ["--method", "grow", "--no-preview", "--up", "Z", "--roots", "0,0,0", "--cloud-leaves", "off"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert re.search(r"growth came to \d+ % of the points of .*tree\.xyz, 95 % needed", error)
    assert "and it crosses gaps of 1.00 m" in error
    assert "--roots" in error
    assert "--internode" in error
    assert not (tmp_path / "out").exists()


def test_branches_that_are_not_joined_are_a_warning(tmp_path, rng, capsys, monkeypatch):
    monkeypatch.setattr(warnings, "_UNJOINED", 0.01)  # a lump of points without stems has a few
    cloud = write_xyz(tmp_path / "lump.xyz", rng.uniform(-0.5, 0.5, (1500, 3)))
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview", "--up", "Z"]) == 0
    assert re.search(r"warning: .* of the branches are not joined to the surface", capsys.readouterr().out)


def test_a_crown_that_hides_its_inside_is_filled_and_an_open_one_is_not(tmp_path, rng, capsys):
    for name, points, about in (
        ("closed", closed_crown(rng), "branches are grown inside the crown"),
        ("open", y_tree(rng), "hides nothing of the crown"),
    ):
        cloud = write_xyz(tmp_path / f"{name}.xyz", points)
        options = ["--fill-hidden", "--no-preview", "--up", "Z", "--internode", "0.06"]
        assert main(["branches", str(cloud), "-o", str(tmp_path / name), *options]) == 0
        assert about in capsys.readouterr().out


@pytest.mark.parametrize(
    "wrong",
    [
        ["--variations", "-1"],
        ["--variations", "1000"],
        ["--variation-spread", "3"],
        ["--seed", "-1"],
        ["--internode", "50"],
        ["--internode", "1.9"],
    ],
)
def test_growth_that_cannot_be_is_named(tmp_path, rng, capsys, wrong):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[:300])
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *wrong]) == 2
    assert wrong[0] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "about"),
    [
        ("", "empty"),
        ("1 2 3\n" * 200, "points"),
        ("\n".join(f"{n % 40} {n // 40} 0" for n in range(1600)), "give a cloud of a plant"),
        ("nan nan nan\n" * 200, "points"),
        ("hello world\n", "tree.xyz"),
    ],
)
def test_a_cloud_that_cannot_be_used_is_named_and_nothing_is_written(tmp_path, capsys, content, about):
    cloud = tmp_path / "tree.xyz"
    cloud.write_text(content, encoding="utf-8")
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview"]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("error: ")
    assert about in complaint
    assert "tree.xyz" in complaint
    assert not (tmp_path / "out").exists()


def test_roots_are_a_word_a_number_or_places():
    assert read_roots("auto") == (read_roots("auto")[0], ())
    assert read_roots("3")[0].count == 3
    assert read_roots("1,2,3;4,5,6")[1] == ((1, 2, 3), (4, 5, 6))
    for bad in ("0", "one", "1,2", "1,2,nan", ""):
        with pytest.raises(FoliageError):
            read_roots(bad)


def test_a_root_that_is_nowhere_near_is_refused(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng))
    command = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--up", "Z", "--dry-run", "--roots"]
    assert main([*command, "0,0,-1"]) == 0  # as far as the stem may be hidden
    assert main([*command, "500000.25,0,0"]) == 2
    error = capsys.readouterr().err
    assert "500000.25,0,0" in error
    assert "--roots" in error


def test_units_and_axes_that_are_not_known_are_refused():
    assert read_unit("auto") is None
    assert read_unit("cm") == "cm"
    assert read_up("-z") == "-Z"
    with pytest.raises(FoliageError, match="unit must be"):
        read_unit("yard")
    with pytest.raises(FoliageError, match="up must be"):
        read_up("W")


def test_the_record_has_the_settings(tmp_path, rng):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng))
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview", "--internode", "0.02"]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    record = stage.GetRootLayer().customLayerData["usdfoliage"]
    assert json.loads(json.dumps(record["settings"]["internode"])) == "0.02"
    skeleton = stage.GetPrimAtPath("/out/geo/guide/Skeleton")
    assert skeleton.GetAttribute("foliage:growth:internodeLength").Get() == pytest.approx(0.02)
    assert 0.3 <= skeleton.GetAttribute("foliage:growth:allometryExponent").Get() <= 0.7  # those thought possible


def test_the_bark_has_the_color_that_is_asked_for(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[::4])
    command = ["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview", "--up", "Z", "--bark-color"]
    assert main([*command, "0.5", "0.25", "0.125"]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    branches = stage.GetPrimAtPath("/out/geo/render/Branches")
    assert [tuple(color) for color in branches.GetAttribute("primvars:displayColor").Get()] == [(0.5, 0.25, 0.125)]
    assert stage.GetRootLayer().customLayerData["usdfoliage"]["settings"]["bark-color"] == "0.5 0.25 0.125"
    assert main([*command, "0.5", "2", "0"]) == 2
    assert "--bark-color must be three numbers from 0 to 1" in capsys.readouterr().err


def test_the_bark_has_the_median_color_of_the_clouds_wood(tmp_path, rng):
    points_m = y_tree(rng)[::4]
    colors = np.tile(np.array([[188, 137, 99]], np.uint8), (len(points_m), 1))
    colors[::5] = (255, 0, 255)  # of something behind it
    cloud = write_ply(tmp_path / "tree.ply", points_m, colors)
    request = BranchesRequest(
        cloud=PlantCloudRequest(path=cloud, roots=RootSettings(), up="Z"),
        output=tmp_path / "out",
        name="out",
        settings=BranchSettings(),
        preview=False,
        color_of_cloud=True,
    )
    made = make_branches_asset(request)
    stage = Usd.Stage.Open(str(made.asset))
    (color,) = stage.GetPrimAtPath("/out/geo/render/Branches").GetAttribute("primvars:displayColor").Get()
    np.testing.assert_allclose(color, [0.503, 0.250, 0.125], atol=0.002)


def test_what_moves_is_written_when_it_is_asked_for(tmp_path, rng, capsys):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[::2])
    asked = ["--internode", "0.05", "--rig", "--rig-order", "1", "--sway", "4", "--growth", "3"]
    stout = tmp_path / "stout.toml"
    stout.write_text("[generic]\ntwig_radius_m = 0.1\n", encoding="utf-8")
    asked += ["--foliage", "template", "--species", "generic", "--species-file", str(stout)]
    asked += ["--representation", "bezier"]
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), "--no-preview", *asked]) == 0
    assert "joints" in capsys.readouterr().out
    stage = Usd.Stage.Open(str(tmp_path / "out" / "out.usda"))
    plant = stage.GetDefaultPrim()
    assert {name: plant.GetVariantSet(name).GetVariantSelection() for name in ("rig", "growth")} == {
        "rig": "none",
        "growth": "still",
    }
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 4)
    settings = stage.GetRootLayer().customLayerData["usdfoliage"]["settings"]
    assert (settings["rig-order"], settings["sway"], settings["growth"]) == ("1", "4", "3")
    plant.GetVariantSet("rig").SetVariantSelection("skel")
    joints = stage.GetPrimAtPath("/out/geo/render/Rig/Joints").GetAttribute("joints").Get()
    assert joints[0] == "branch_0"
    assert max(joint.count("/") for joint in joints) == 1
    leaves = stage.GetPrimAtPath("/out/geo/render/Leaves")
    assert len(leaves.GetAttribute("positions").Get())
    assert leaves.GetAttribute("orientationsf").GetTimeSamples() == [1, 2, 3, 4]
    plant.GetVariantSet("growth").SetVariantSelection("growing")
    assert leaves.GetAttribute("scales").GetTimeSamples() == [1, 2, 3]


@pytest.mark.parametrize(
    ("asked", "about"),
    [
        (["--rig-order", "1"], "--rig"),
        (["--rig", "--rig-order", "-1"], "--rig-order"),
        (["--sway", "1"], "--sway"),
        (["--growth", "0"], "--growth"),
    ],
)
def test_motion_that_cannot_be_is_refused(tmp_path, rng, capsys, asked, about):
    cloud = write_xyz(tmp_path / "tree.xyz", y_tree(rng)[:100])
    assert main(["branches", str(cloud), "-o", str(tmp_path / "out"), *asked]) == 2
    assert about in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_no_variation_has_the_seed_of_another_plants():
    seeds = [variation_seed(seed, number) for seed in range(50) for number in range(1, 100)]
    assert len(set(seeds)) == len(seeds)
    assert variation_seed(3, 2) == variation_seed(3, 2) < 2**32


@pytest.mark.parametrize(
    "wrong", [{"variations": -1}, {"variation_spread": float("nan")}, {"method": "x"}, {"fill": "x"}]
)
def test_growth_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        RegrowthRequest(**wrong)
