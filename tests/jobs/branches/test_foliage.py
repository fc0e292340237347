"""Leaves on the branches of a small cloud, as the command makes them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import build_parser, main
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.branch.foliage.species import load_species
from usdfoliage.branch.tracing.settings import BranchSettings
from usdfoliage.cli.options.branches import read_branches_request
from usdfoliage.cli.remarks import render_for
from usdfoliage.jobs.branches.foliage import FoliageRequest, grow_leaves
from usdfoliage.jobs.fitted_leaves import read_fitted_leaves
from usdfoliage.leaf.shape.edits import LeafEdits, apply_edits
from usdfoliage.leaf.shape.measures import leaf_width

from tests.support.branch_clouds import cloud_of, small_tree
from tests.support.leaves.assets import random_leaves, write_spray

MAPLE = load_species("maple")
STOUT = replace(MAPLE, twig_radius_m=0.02)  # for a small tree whose twigs are thick


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    path = tmp_path_factory.mktemp("clouds") / "tree.xyz"
    np.savetxt(path, cloud_of(small_tree(), per_m2=6000, seed=1, noise_m=0.001), fmt="%.5f")
    return path


@pytest.fixture(scope="module")
def leafy(cloud, tmp_path_factory):
    """An asset of a maple; its folder."""
    out = tmp_path_factory.mktemp("assets") / "tree"
    stout = out.with_name("stout.toml")
    stout.write_text("[Maple]\ntwig_radius_m = 0.02\n", encoding="utf-8")
    species = ("--species-file", str(stout), "--species", "MAPLE")
    words = ("--foliage", "template", "--most-leaves", "20", "--representation", "bezier")
    assert main(["branches", str(cloud), "-o", str(out), "--up", "Y", "--no-preview", *species, *words]) == 0
    return out


def leaves_of(folder):
    stage = Usd.Stage.Open(str(folder / f"{folder.name}.usda"))
    return stage, read_leaves(stage.GetPrimAtPath(f"/{folder.name}/geo/render/Leaves")).leaves


def run(*words):
    return main([str(word) for word in words])


def test_a_cloud_becomes_branches_with_leaves_on_them(leafy):
    stage, leaves = leaves_of(leafy)
    plant = stage.GetDefaultPrim()
    assert plant.GetAttribute("foliage:species").Get() == "maple"
    assert len(leaves) == 20
    axes = np.array(UsdGeom.BasisCurves(stage.GetPrimAtPath("/tree/geo/guide/Skeleton")).GetPointsAttr().Get())
    between = np.concatenate([axes[:-1] + share * np.diff(axes, axis=0) for share in np.linspace(0, 1, 50)])
    away_m = np.linalg.norm(leaves.base_m[:, None] - between, axis=2).min(axis=1)
    assert away_m.max() < 0.025  # on the bark
    assert leaves.base_m[:, 1].min() > 0.5  # none on the trunk's foot
    assert 0.6 * MAPLE.leaf_length_m < leaves.length_m.mean() < 1.1 * MAPLE.leaf_length_m
    assert leaf_width(leaves.parameters).mean() == pytest.approx(MAPLE.leaf_width, rel=0.1)
    assert leaves.color is not None
    assert leaves.color.mean(axis=0) == pytest.approx(MAPLE.color, rel=0.3)
    settings = json.loads(json.dumps(stage.GetRootLayer().customLayerData["usdfoliage"]["settings"]))
    assert (settings["species"], settings["foliage"], settings["most-leaves"]) == ("maple", "template", "20")
    page = (leafy / "report" / "index.html").read_text(encoding="utf-8")
    assert "mean leaf" in page
    assert "--most-leaves keeps more" in page


def test_the_leaves_can_be_described_edited_baked_and_validated(leafy, tmp_path, capsys):
    look, baked = tmp_path / "look.usda", tmp_path / "baked"
    assert run("edit", leafy, "--width", 0.5, "-o", look) == 0
    assert run("bake", look, "-o", baked) == 0
    capsys.readouterr()
    assert run("validate", baked) == 0
    assert "0 errors, 0 warnings" in capsys.readouterr().out
    stage, narrow = leaves_of(baked)
    _, leaves = leaves_of(leafy)
    expected = apply_edits(leaves.parameters, LeafEdits(width=0.5))
    np.testing.assert_array_equal(narrow.parameters, expected.astype(np.float32))
    assert stage.GetPrimAtPath("/baked/geo/render/Branches").IsA(UsdGeom.Mesh)
    assert run("info", baked, "--json") == 0
    assert json.loads(capsys.readouterr().out)["leaves"]["count"] == len(leaves)


def test_a_species_alone_adds_no_leaves_but_its_exponent(tmp_path):
    words = ["branches", "cloud.ply", "-o", str(tmp_path)]
    plain = read_branches_request(build_parser().parse_args(words))
    peach = read_branches_request(build_parser().parse_args([*words, "--species", "Peach"]))
    assert (peach.species, peach.settings.radii.allometry.exponent) == ("peach", 0.5)
    assert peach.settings.internode_m is None  # the table's is that of leaves
    assert peach.foliage.kind == "none"
    assert grow_leaves(small_tree(), peach.foliage, None, seed=0) is None
    assert (plain.species, plain.settings) == ("", BranchSettings())


def test_fitted_leaves_are_drawn_with_their_shape_colour_and_length(tmp_path):
    leaves = random_leaves(5, facts=True)
    leaves.parameters[3, 2, 1] = -0.1  # is none
    trusted = np.array([0.0, 1.0, 1.0, 1.0, 0.0])
    colors = np.linspace(0.1, 0.5, 15).reshape(5, 3)
    known = replace(leaves, confidence=trusted, color=colors)
    source = write_spray(tmp_path / "fitted", known, LeafAppearance(), representations=("bezier",))
    request = FoliageRequest(kind="fitted", source=source.parent, species=STOUT)
    fitted = read_fitted_leaves(source.parent, tmp_path / "out")
    grown = grow_leaves(small_tree(), request, fitted, seed=1)
    assert grown is not None
    made = grown.foliage.leaves
    of = [np.flatnonzero((leaf == fitted.leaves.parameters).all(axis=(1, 2))) for leaf in made.parameters]
    assert all(len(each) == 1 for each in of)
    drawn = np.concatenate(of)
    assert set(drawn) == {1, 2}
    assert made.color == pytest.approx(colors[drawn], rel=0.5)
    assert len(np.unique(made.color, axis=0)) == len(made)
    grown_share = made.length_m / leaves.length_m[drawn]
    assert 0.79 < grown_share.min() <= grown_share.max() <= 1 + 1e-6
    as_long = FoliageRequest(kind="fitted", source=source.parent, species=STOUT, length_m=2.0)
    longer = grow_leaves(small_tree(), as_long, fitted, seed=1)
    assert longer is not None
    ratio = longer.foliage.leaves.length_m / made.length_m
    assert ratio == pytest.approx(2.0 / np.median(leaves.length_m))


def test_fitted_leaves_of_another_size_are_spoken_of(tmp_path):
    source = write_spray(tmp_path / "fitted", representations=("bezier",))  # leaves of 1 m and 0.5 m
    request = FoliageRequest(kind="fitted", source=source.parent, species=STOUT)
    grown = grow_leaves(small_tree(), request, read_fitted_leaves(source.parent, tmp_path / "out"), seed=1)
    assert grown is not None
    assert any(
        "75 cm long, those of maple 9 cm: give --leaf-length" in each.sentence(render_for("branches"))
        for each in grown.remarks
    )


def test_a_plant_too_thick_for_leaves_gets_a_remark():
    plant = small_tree()
    thick = type(plant)(
        **{**{n: getattr(plant, n) for n in plant.__dataclass_fields__}, "radius_m": plant.radius_m + 1}
    )
    grown = grow_leaves(thick, FoliageRequest(kind="template", species=MAPLE), None, seed=0)
    assert grown is not None
    assert "no twig is thin enough to carry leaves" in [each.text for each in grown.remarks]
    assert len(grown.foliage.leaves) == 0


@pytest.mark.parametrize(
    ("words", "about"),
    [
        (("--species", "mapel"), "there is no species 'mapel'; the library has alder"),
        (("--species-file", "mine.toml"), "name with --species which one"),
        (("--foliage", "fitted"), "name it with --leaves"),
        (("--foliage", "template", "--leaves", "spray"), "--leaves is for --foliage fitted, not template"),
        (("--leaves", "nowhere"), "nowhere does not exist"),
        (("--leaf-length", "0"), "--leaf-length must be"),
        (("--most-leaves", "0"), "--most-leaves must be 1 to"),
        (("--representation", "quads"), "there is no representation 'quads'"),
    ],
)
def test_what_cannot_be_asked_for_is_refused_before_anything_is_read(tmp_path, capsys, words, about):
    assert run("branches", tmp_path / "no cloud.ply", "-o", tmp_path / "out", *words) == 2
    complaint = capsys.readouterr().err
    assert about in complaint
    assert not (tmp_path / "out").exists()


def test_the_leaves_asset_is_not_replaced(tmp_path, capsys):
    write_spray(tmp_path / "spray")
    before = sorted(path.name for path in (tmp_path / "spray").iterdir())
    words = ("--leaves", tmp_path / "spray")
    assert run("branches", tmp_path / "no cloud.ply", "-o", tmp_path / "spray", *words) == 2
    assert "spray, which would be replaced" in capsys.readouterr().err
    assert sorted(path.name for path in (tmp_path / "spray").iterdir()) == before
