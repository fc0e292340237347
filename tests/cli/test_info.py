"""What `usdfoliage info` prints of assets and looks."""

import shutil
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from pxr import Usd
from usdfoliage import __version__
from usdfoliage.asset.locate import find_leaves
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.geometry.color import encode_srgb

from tests.support.commands.json_output import read_output
from tests.support.crown_shapes import disc_mask, foliage
from tests.support.leaves.assets import random_leaves, write_spray
from tests.support.leaves.commands import printed, refused, run


@pytest.fixture(scope="module")
def spray(tmp_path_factory):
    out = tmp_path_factory.mktemp("my assets") / "spray"
    assert run("scatter", "-n", 25, "-o", out, "--length", 0.1, "--variation", 0, "--seed", 3) == 0
    return out


def describe(capsys, asset) -> dict:
    return read_output("info", "\n".join(printed(capsys, "info", asset, "--json")))


def test_the_numbers_are_those_of_the_leaves(spray, capsys):
    facts = describe(capsys, spray)
    stage = open_asset(spray)
    (prim,) = find_leaves(stage)
    leaves = read_leaves(prim).leaves
    assert facts["name"] == "spray"
    assert facts["generator"] == f"usdfoliage {__version__}"
    assert facts["seed"] == 3
    assert (facts["up_axis"], facts["meters_per_unit"]) == ("Y", 1.0)
    assert facts["variants"]["representation"] == ["bezier", "nurbs", "subdiv", "mesh"]
    assert facts["selections"]["representation"] == "bezier"
    assert facts["schemas"] == {"/spray": ["FoliagePlantAPI"], "/spray/geo/render/Leaves": ["FoliageLeafAPI"]}
    of_leaves = facts["leaves"]
    assert of_leaves["count"] == 25
    assert of_leaves["length_m"] == {
        "minimum": leaves.length_m.min(),
        "median": np.median(leaves.length_m),
        "maximum": leaves.length_m.max(),
    }
    assert [row["name"] for row in of_leaves["parameters"]][:3] == ["axis1", "axis2", "silhouette1"]
    np.testing.assert_allclose(of_leaves["parameters"][3]["mean"], leaves.parameters[0, 3], rtol=1e-6)
    assert of_leaves["edits"] == {}
    sizes = {file["path"]: file["size_bytes"] for file in facts["layers"]}
    assert next(iter(sizes)) == "spray.usda"
    for name in ("leaves", "leaves_nurbs", "leaves_subdiv", "leaves_mesh"):
        path = f"payload/{name}.usdc"
        assert sizes[path] == (spray / path).stat().st_size
    assert facts["missing"] == []
    assert facts["crown"] is None
    low, high = np.array(facts["extent"])
    assert (low < leaves.base_m.min(axis=0)).all()
    assert (high > leaves.base_m.max(axis=0)).all()


def test_leaves_are_counted_by_their_origin(spray, tmp_path, capsys):
    assert describe(capsys, spray)["leaves"]["origins"] == {}
    assert not any(line.startswith("by origin") for line in printed(capsys, "info", spray))
    origin = np.array([0, 0, 0, 1, 2, 2, 2, 2], np.int32)
    write_spray(tmp_path / "spray", replace(random_leaves(8), origin=origin), representations=("bezier",))
    facts = describe(capsys, tmp_path / "spray")
    assert facts["leaves"]["origins"] == {"found": 3, "completed": 1, "filled_in": 4, "of_species": 0}
    (line,) = (line for line in printed(capsys, "info", tmp_path / "spray") if line.startswith("by origin"))
    assert line.split(None, 2)[2] == "3 found, 1 completed, 4 filled in"


def test_the_area_is_that_of_the_surface(spray, capsys):
    """All leaves are the same: the area is that of the mesh's polygons, by the formula of Newell."""
    stage = Usd.Stage.Open(str(spray / "spray.usda"))
    stage.GetDefaultPrim().GetVariantSets().SetSelection("representation", "mesh")
    mesh = stage.GetPrimAtPath("/spray/geo/render/Leaves")
    points = np.array(mesh.GetAttribute("points").Get(), np.float64)
    total, start = 0.0, 0
    vertices = np.array(mesh.GetAttribute("faceVertexIndices").Get())
    for count in mesh.GetAttribute("faceVertexCounts").Get():
        ring = points[vertices[start : start + count]]
        total += np.linalg.norm(np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)) / 2
        start += count
    assert describe(capsys, spray)["leaves"]["area_m2"] == pytest.approx(total, rel=0.01)


def test_a_look_is_described_with_its_edits(spray, tmp_path, capsys):
    look = tmp_path / "wide look.usda"
    assert run("edit", spray, "--width", 2, "--bend", -0.5, "-o", look) == 0
    plain, wide = describe(capsys, spray), describe(capsys, look)
    assert wide["look"] == str(look)
    assert wide["leaves"]["edits"] == {"width": 2.0, "axis1": [0.0, 0.0, -0.5], "axis2": [0.0, 0.0, -0.5]}
    assert wide["leaves"]["area_m2"] > 1.5 * plain["leaves"]["area_m2"]
    assert wide["leaves"]["parameters"] == plain["leaves"]["parameters"]  # as they are stored
    text = printed(capsys, "info", look)
    assert f"look            {look}".split() == next(line for line in text if line.startswith("look")).split()
    assert any("width 2; axis1 0 0 -0.5" in line for line in text)


def test_a_selection_of_what_does_not_exist(spray, tmp_path, capsys):
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    plant = stage.DefinePrim("/spray")
    plant.GetReferences().AddReference(str(spray / "spray.usda"))
    plant.GetVariantSets().SetSelection("representation", "voxels")
    stage.SetDefaultPrim(plant)
    stage.Save()
    lines = printed(capsys, "info", tmp_path / "shot.usda")
    (line,) = (line for line in lines if line.startswith("representation"))
    assert line.split(None, 1)[1] == "bezier, nurbs, subdiv, mesh; none is selected, voxels is none of them"
    facts = describe(capsys, tmp_path / "shot.usda")
    assert facts["variants"]["representation"] == ["bezier", "nurbs", "subdiv", "mesh"]
    assert facts["selections"]["representation"] == "voxels"


def test_the_text_is_aligned_and_whole(spray, capsys):
    lines = printed(capsys, "info", spray)
    table = lines.index("")
    columns = {len(line) - len(line.split(None, 1)[1]) for line in lines[:table] if not line.startswith("up axis")}
    text = "\n".join(lines)
    for words in ("leaves", "25", "median", "m²", "bezier (selected), nurbs, subdiv, mesh", "payload/leaves_mesh.usdc"):
        assert words in text
    assert len(columns) <= 3  # names of two words end elsewhere
    assert [line.split()[0] for line in lines[table + 2 :]] == [
        *("axis1", "axis2", "silhouette1", "silhouette2", "silhouette3", "inner", "outer")
    ]
    assert len({len(line) for line in lines[table + 2 :]}) == 1


def test_an_asset_that_is_a_crown(tmp_path, capsys):
    photo = np.rint(np.clip(encode_srgb(foliage((120, 120))), 0, 1) * 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "oak.png"), photo[..., ::-1])
    cv2.imwrite(str(tmp_path / "mask.png"), disc_mask(48, size_px=120).astype(np.uint8) * 255)
    words = ("--mask", tmp_path / "mask.png", "--size", 32, "--mesh-size", 17, "--no-preview", "--height", 4)
    assert run("crown", tmp_path / "oak.png", *words, "-o", tmp_path / "oak") == 0
    facts = describe(capsys, tmp_path / "oak")
    assert facts["leaves"] is None
    assert facts["capture"] == "oak.png"
    low, high = facts["crown"]["radius_m"]
    assert 0.5 < low < high < 5
    assert facts["crown"]["radius_map_px"] == facts["crown"]["color_map_px"] == 32
    text = "\n".join(printed(capsys, "info", tmp_path / "oak"))
    assert "6 faces of 32 x 32" in text
    assert "crown (selected)" in text
    # Commands that act on leaves report that there are none.
    for words in (("edit", "--width", 2, "-o", tmp_path / "a.usda"), ("bake", "-o", tmp_path / "a")):
        assert "leaves" in refused(capsys, words[0], tmp_path / "oak", *words[1:])


def test_what_is_not_ours(tmp_path, capsys):
    theirs = tmp_path / "theirs.usda"
    theirs.write_text('#usda 1.0\ndef Xform "World" {}\n')
    broken = tmp_path / "broken.usda"
    broken.write_text("no USD")
    (tmp_path / "empty folder").mkdir()
    picture = tmp_path / "a.png"
    picture.write_bytes(b"")
    for asset in (theirs, broken, tmp_path / "empty folder", picture, tmp_path / "absent"):
        assert asset.name in refused(capsys, "info", asset)


def test_a_missing_layer_is_an_answer_too(spray, tmp_path, capsys):
    shutil.copytree(spray, tmp_path / "oak")
    (tmp_path / "oak" / "payload" / "leaves_mesh.usdc").unlink()
    assert any("leaves_mesh.usdc" in path for path in describe(capsys, tmp_path / "oak")["missing"])
    (tmp_path / "oak" / "payload" / "leaves.usdc").unlink()
    assert "leaves.usdc" in refused(capsys, "info", tmp_path / "oak")


def test_what_is_not_needed_is_not_loaded():
    """The process that waits for a command in a box loads no arrays, and a command that only reads no solvers."""
    program = (
        "import sys\n"
        "import usdfoliage.__main__\n"
        "print(sorted({'numpy', 'scipy'} & set(sys.modules)))\n"
        "import usdfoliage.jobs.info\n"
        "print(sorted({'cv2', 'scipy.interpolate', 'scipy.optimize', 'scipy.spatial'} & set(sys.modules)))\n"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines() == ["[]", "[]"]
