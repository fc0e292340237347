"""Looks made with plain USD: what `info` knows of them, and how `edit --look` gives them their extents."""

from pathlib import Path

import pytest
from pxr import Sdf
from usdfoliage.asset.locate import find_leaves
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.parts.leaves import read_leaves
from usdfoliage.leaf.shape.edits import LeafEdits

from tests.support.commands.json_output import read_output
from tests.support.leaves.commands import printed, refused, run

WIDE = LeafEdits(width=4.0, curl=(0.0, 0.0, 0.5))


@pytest.fixture(scope="module")
def spray(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("plain") / "spray"
    assert run("scatter", "-n", 6, "--representation", "bezier", "-o", out) == 0
    return out


def write_plain(path: Path, prim: str, **edits: float | tuple[float, float, float]) -> Path:
    """A layer with edits at a prim, as somebody without usdfoliage writes it."""
    layer = Sdf.Layer.CreateNew(str(path))
    over = Sdf.CreatePrimInLayer(layer, prim)
    for name, value in edits.items():
        kind = Sdf.ValueTypeNames.Float if isinstance(value, float) else Sdf.ValueTypeNames.Float3
        Sdf.AttributeSpec(over, f"primvars:leaf:edit:{name}", kind).default = value
    layer.Save()
    return path


def edits_of(asset: Path) -> LeafEdits:
    stage = open_asset(asset)
    return read_leaves(find_leaves(stage)[0]).edits


@pytest.mark.parametrize("prim", ["/__class__/spray/geo/render/Leaves", "/spray/geo/render/Leaves"])
def test_one_command_gives_a_plain_look_its_extents(spray, tmp_path, capsys, prim) -> None:
    plain = write_plain(tmp_path / "plain.usda", prim, width=4.0, curl=(0.0, 0.0, 0.5))
    look, ours = tmp_path / "look.usda", tmp_path / "ours.usda"
    assert run("edit", spray, "--look", plain, "-o", look) == 0
    assert edits_of(look) == WIDE
    assert run("edit", spray, "--width", 4, "--curl", 0, 0, 0.5, "-o", ours) == 0
    assert look.read_bytes() == ours.read_bytes()
    assert "extents" not in "\n".join(printed(capsys, "info", look))


def test_other_edits_act_on_top(spray, tmp_path) -> None:
    plain = write_plain(tmp_path / "plain.usda", "/__class__/spray/geo/render/Leaves", width=2.0)
    assert run("edit", spray, "--look", plain, "--width", 1.5, "--bend", 0.25, "-o", tmp_path / "look.usda") == 0
    assert edits_of(tmp_path / "look.usda") == LeafEdits(width=3.0, axis1=(0, 0, 0.25), axis2=(0, 0, 0.25))


def test_a_plain_look_of_one_placement(spray, tmp_path, capsys) -> None:
    plain = write_plain(tmp_path / "plain.usda", "/World/a/geo/render/Leaves", width=2.0)
    assert "--prim" in refused(capsys, "edit", spray, "--look", plain, "-o", tmp_path / "look.usda")
    assert run("edit", spray, "--look", plain, "--prim", "/World/a", "-o", tmp_path / "look.usda") == 0
    assert edits_of(tmp_path / "look.usda").width == 2.0


def test_info_knows_a_plain_look(spray, tmp_path, capsys) -> None:
    plain = write_plain(tmp_path / "plain.usda", "/__class__/spray/geo/render/Leaves", width=2.0)
    text = "\n".join(printed(capsys, "info", plain))
    assert "/__class__/spray/geo/render/Leaves: width 2" in text
    assert "`usdfoliage edit`" in text
    facts = read_output("info", "\n".join(printed(capsys, "info", plain, "--json")))
    assert facts["prims"] == {"/__class__/spray/geo/render/Leaves": {"width": 2.0}}
    assert facts["has_extents"] is False
    other = tmp_path / "other.usda"
    other.write_text('#usda 1.0\nover "spray" (\n    apiSchemas = ["NoSuchAPI"]\n)\n{\n    double x = 3\n}\n')
    assert "no plant" in refused(capsys, "info", other)
    assert "edits no leaves" in refused(capsys, "edit", spray, "--look", other, "-o", tmp_path / "look.usda")


def test_info_reports_extents_that_edits_outgrow(spray, tmp_path, capsys) -> None:
    look = tmp_path / "look.usda"
    assert run("edit", spray, "--width", 1.5, "-o", look) == 0
    facts = read_output("info", "\n".join(printed(capsys, "info", look, "--json")))
    assert facts["leaves"]["extents_hold"] is True
    layer = Sdf.Layer.FindOrOpen(str(look))
    widths: list[Sdf.Path] = []
    layer.Traverse("/", lambda path: widths.append(path) if path.name == "primvars:leaf:edit:width" else None)
    for path in widths:  # with pxr alone
        layer.GetAttributeAtPath(path).default = 40.0
    layer.Save()
    assert "too small for these edits" in "\n".join(printed(capsys, "info", look))
    assert run("edit", spray, "--look", look, "-o", look) == 0  # in its own place
    assert edits_of(look).width == 40
    assert "too small" not in "\n".join(printed(capsys, "info", look))


@pytest.mark.parametrize("value", ["nan", '"x"', "[1, 2]"])
def test_a_damaged_edit_of_a_plain_look_is_one_line(spray, tmp_path, capsys, value) -> None:
    kind = {"nan": "float", '"x"': "string", "[1, 2]": "float[]"}[value]
    plain = tmp_path / "plain.usda"
    plain.write_text(
        f'#usda 1.0\nover "spray"\n{{\n over "geo"\n {{\n  over "render"\n  {{\n   over "Leaves"\n   {{\n'
        f"    {kind} primvars:leaf:edit:width = {value}\n   }}\n  }}\n }}\n}}\n"
    )
    assert run("info", plain) == 0
    refused(capsys, "edit", spray, "--look", plain, "-o", tmp_path / "look.usda")
    assert not (tmp_path / "look.usda").exists()
