"""A tree of a photograph whose leaves have the form of one that was given."""

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade
from usdfoliage.__main__ import main
from usdfoliage.asset.parts.leaf_part import LeafAppearance
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.leaf.shape.measures import leaf_width

from tests.support.commands.json_output import read_output
from tests.support.leaves.assets import write_spray
from tests.support.leaves.drawn import drawn_leaf, write_leaf
from tests.support.photographs.drawn_trees import draw_bare, draw_leafy, write_photograph

SMALL = ["--no-preview", "--most-leaves", "400", "--reproducible"]


@pytest.fixture
def photo(tmp_path):
    return write_photograph(tmp_path, draw_leafy(150, 200), "oak")[0]


def leaves_of(out):
    stage = Usd.Stage.Open(str(next(out.glob("*.usda"))))
    prim = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer))
    return stage, read_leaves(prim).leaves


def textures_of(stage):
    """The files of textures of leaves on twigs, from the stage's folder."""
    folder = stage.GetRootLayer().realPath.rpartition("/")[0]
    inputs = (UsdShade.Shader(prim).GetInput("file") for prim in stage.TraverseAll() if prim.IsA(UsdShade.Shader))
    files = {each.Get().resolvedPath for each in inputs if each and each.Get()}
    return {file.removeprefix(folder + "/") for file in files if file.endswith("tree_leaf.png")}


@pytest.mark.parametrize("width", [0.12, 0.6])
def test_a_picture_gives_form_and_texture_in_the_colours_of_the_photograph(photo, tmp_path, width):
    leaf = write_leaf(tmp_path / "leaf.png", drawn_leaf(round(100 * width), 100))
    out = tmp_path / "tree"
    assert main(["sketch", str(photo), "-o", str(out), "--leaf", str(leaf), *SMALL]) == 0
    stage, leaves = leaves_of(out)
    assert np.median(leaf_width(leaves.parameters)) == pytest.approx(width, rel=0.2)
    assert textures_of(stage) == {"maps/tree_leaf.png"}
    texels = cv2.imread(str(out / "maps" / "tree_leaf.png"), cv2.IMREAD_UNCHANGED)
    assert texels.shape[2] == 4
    base, apex = texels[-len(texels) // 6, texels.shape[1] // 2], texels[len(texels) // 6, texels.shape[1] // 2]
    assert base[2] > 1.3 * apex[2]  # red at its base, as the picture
    assert apex[1] > 1.3 * base[1]
    assert leaves.color is not None
    green = leaves.color[:, 1] > leaves.color[:, [0, 2]].max(axis=1)
    assert green.mean() > 0.9  # as the leaves of the photograph
    assert (out / "maps" / "tree_crown_leaf.png").is_file()
    assert main(["validate", str(out)]) == 0


def test_an_asset_of_leaves_gives_its_average_leaf(photo, tmp_path):
    texture = write_leaf(tmp_path / "texture.png", np.ones((32, 32, 4), np.float32) * [0.1, 0.4, 0.1, 1])
    spray = write_spray(tmp_path / "spray", appearance=LeafAppearance(texture=texture))
    given = leaves_of(spray.parent)[1]
    out = tmp_path / "tree"
    assert main(["sketch", str(photo), "-o", str(out), "--leaf", str(spray.parent), "--no-crown", *SMALL]) == 0
    stage, leaves = leaves_of(out)
    expected = np.median(leaf_width(given.parameters))
    assert np.median(leaf_width(leaves.parameters)) == pytest.approx(expected, rel=0.2)
    assert textures_of(stage) == {"maps/tree_leaf.png"}
    assert main(["validate", str(out)]) == 0


def test_the_leaf_is_written_down_and_gives_the_same_bytes_again(photo, tmp_path):
    leaf = write_leaf(tmp_path / "leaf.png", drawn_leaf())
    for name in ("one", "two"):
        words = ["-o", str(tmp_path / name / "tree"), "--leaf", str(leaf), "--no-crown", *SMALL]
        assert main(["sketch", str(photo), *words]) == 0
    for file in ("payload/leaves.usdc", "maps/tree_leaf.png", "tree.usda"):
        assert (tmp_path / "one" / "tree" / file).read_bytes() == (tmp_path / "two" / "tree" / file).read_bytes()
    assert "leaf.png" in (tmp_path / "one" / "tree" / "tree.usda").read_text()


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"no picture", "leaf.png"), (None, "leaf.png"), (drawn_leaf() * [1, 1, 1, 0], "leaf.png")],
)
def test_what_is_no_leaf_is_refused_before_anything_is_written(photo, tmp_path, capsys, content, words):
    path = tmp_path / "leaf.png"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        write_leaf(path, content)
    assert main(["sketch", str(photo), "-o", str(tmp_path / "tree"), "--leaf", str(path), *SMALL]) == 2
    complained = capsys.readouterr().err
    assert words in complained
    assert complained.count("error: ") == 1
    assert not (tmp_path / "tree").exists()


def codes_of(capsys, photo, *words):
    assert main(["sketch", str(photo), "--json", "--no-crown", *SMALL, *map(str, words)]) == 0
    return {each["code"]: each for each in read_output("sketch", capsys.readouterr().out)["remarks"]}


def test_broad_leaves_are_named_where_no_species_and_no_leaf_is(photo, tmp_path, capsys):
    about = codes_of(capsys, photo, "-o", tmp_path / "one")["leaves-broad"]
    assert about["remedy"][1] == {"setting": "plant.species", "value": ""}
    assert "leaves-broad" not in codes_of(capsys, photo, "-o", tmp_path / "two", "--species", "oak")
    leaf = write_leaf(tmp_path / "leaf.png", drawn_leaf())
    assert "leaves-broad" not in codes_of(capsys, photo, "-o", tmp_path / "three", "--leaf", leaf)
    bare, _ = write_photograph(tmp_path, draw_bare(), "ash")
    assert "leaves-broad" not in codes_of(capsys, bare, "-o", tmp_path / "four")
    assert main(["sketch", str(photo), "-o", str(tmp_path / "five"), "--no-crown", *SMALL]) == 0
    assert "--species" in (line := next(each for each in capsys.readouterr().out.splitlines() if "broad" in each))
    assert "--leaf" in line


def test_a_surface_of_few_faces_is_named_with_the_option_that_gives_more(tmp_path, capsys):
    photo, _ = write_photograph(tmp_path, draw_leafy(), "oak")
    words = ["--no-crown", "--leaves", "off", "--no-preview", "--most-faces", "2000"]
    assert main(["sketch", str(photo), "-o", str(tmp_path / "tree"), *words]) == 0
    assert "give --most-faces" in capsys.readouterr().out
    assert main(["sketch", str(photo), "-o", str(tmp_path / "none"), "--most-faces", "10"]) == 2
    assert "--most-faces must be at least 1,000, not 10" in capsys.readouterr().err
