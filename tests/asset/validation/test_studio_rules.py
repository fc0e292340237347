"""The rules of a studio: each passes what it allows and finds what it does not."""

import shutil
from dataclasses import fields

import cv2
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from usdfoliage.asset.validation.studio_profile import StudioRules, default_profile, read_profile
from usdfoliage.asset.validation.studio_rules import check_composition, check_files, count_drawn
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.cli import validate
from usdfoliage.errors import AssetError

from tests.support import plant_stages as stages
from tests.support.plant_assets import write_whole_plant


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return write_whole_plant(tmp_path_factory.mktemp("plant") / "oak", count=5)


def found(asset, text, tmp_path, **selections):
    """Names and places of what a profile with this text finds of an asset."""
    profile = tmp_path / "studio.toml"
    profile.write_text(text)
    rules = read_profile(profile).rules
    session = Sdf.Layer.CreateAnonymous(".usda")
    spec = Sdf.CreatePrimInLayer(session, "/oak")
    for name, variant in selections.items():
        spec.variantSelections[name] = variant
    stage = Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(asset)), session)
    return [(finding.error, finding.path) for finding in (*check_composition(stage, rules), *check_files(asset, rules))]


# In the lod leaves, the representation mesh, the branches of order 1 at most.
@pytest.mark.parametrize(
    ("good", "bad", "finding"),
    [
        ("[naming]\nasset = 'oak|ash'", "[naming]\nasset = 'oa'", ("AssetName", "/")),
        ("[naming]\nprim = '\\w+'", "[naming]\nprim = '(?!Bark$)\\w+'", ("PrimName", "/oak/mtl/Bark")),
        ("[kinds]\nallowed = ['component']", "[kinds]\nallowed = ['assembly']", ("Kind", "/oak")),
        (
            "[textures]\nformats = ['exr', 'png']",
            "[textures]\nformats = ['exr']",
            ("TextureFormat", "maps/fork_bark.png"),
        ),
        (
            "[textures]\nlargest_side_px = 128",  # the leaf of the crown
            "[textures]\nlargest_side_px = 127",
            ("TextureSize", "maps/oak_crown_leaf.png"),
        ),
        ("[limits]\nprims = 1000", "[limits]\nprims = 5", ("PrimCount", "/oak")),
        ("[limits]\npoints = 100000", "[limits]\npoints = 20", ("PointCount", "/oak")),
        ("[limits]\nfaces = 100000", "[limits]\nfaces = 20", ("FaceCount", "/oak")),
        ("[limits]\ninterface_bytes = 10000", "[limits]\ninterface_bytes = 100", ("InterfaceSize", "/")),
        ("[limits]\nasset_bytes = 1000000", "[limits]\nasset_bytes = 10000", ("AssetSize", "/")),
        ("[limits]\nlayers = 14", "[limits]\nlayers = 13", ("LayerCount", "/")),
        ("[metadata]\nmeters_per_unit = [0.01, 1]", "[metadata]\nmeters_per_unit = [0.01]", ("MetersPerUnit", "/")),
        ("[metadata]\nup_axis = ['Z', 'Y']", "[metadata]\nup_axis = ['Z']", ("UpAxis", "/")),
        ("[variants]\nrequired = ['lod']", "[variants]\nrequired = ['season']", ("VariantSet", "/oak")),
    ],
)
def test_each_rule_passes_and_fails(asset, tmp_path, good, bad, finding):
    chosen = {"lod": "leaves", "representation": "mesh", "branches": "order1"}
    assert found(asset, good, tmp_path, **chosen) == []
    assert finding in found(asset, bad, tmp_path, **chosen)
    assert {rule for rule, _ in found(asset, bad, tmp_path, **chosen)} == {finding[0]}


def test_instances_count_as_often_as_they_are_drawn(asset):
    stage = Usd.Stage.Open(str(asset))
    leaves = stage.GetPrimAtPath("/oak/geo/render/Leaves")
    (prototype,) = UsdGeom.PointInstancer(leaves).GetPrototypesRel().GetTargets()
    mesh = next(prim for prim in Usd.PrimRange(stage.GetPrimAtPath(prototype)) if prim.IsA(UsdGeom.Mesh))
    points, faces = (len(mesh.GetAttribute(name).Get()) for name in ("points", "faceVertexCounts"))
    assert count_drawn(leaves) == (5 * points, 5 * faces)


def test_all_rules_have_a_key_and_the_shipped_profile_sets_them(asset):
    rules = read_profile(default_profile()).rules
    unset = {each.name for each in fields(StudioRules) if getattr(rules, each.name) in (None, ())}
    assert unset == {"variant_sets"}
    assert [each for each in validate_asset(asset, read_profile(default_profile())).findings if not each.accepted] == []


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[naming]\nassets = 'x'", r"\[naming\] assets is not known; it may hold asset, prim"),
        ("[limit]\nprims = 3", r"limit is not known.*\[limits\]"),
        ("prims = 3", "prims is not known"),
        ("[limits]\nprims = 0", "whole number above 0, not 0"),
        ("[limits]\nprims = true", "whole number"),
        ("[naming]\nasset = '('", "regular expression"),
        ("[kinds]\nallowed = 'component'", "list of texts"),
        ("[metadata]\nmeters_per_unit = ['m']", "list of numbers"),
        ("[rules]\nseverity = 'fatal'", "one of error, warning"),
    ],
)
def test_what_is_not_known_is_refused_with_the_file(tmp_path, text, complaint):
    path = tmp_path / "studio.toml"
    path.write_text(text)
    with pytest.raises(AssetError, match=complaint) as caught:
        read_profile(path)
    assert str(path) in str(caught.value)


def test_a_broken_rule_is_an_error_of_the_command_and_a_warning_can_be_accepted(tmp_path, capsys):
    folder = stages.write_asset(tmp_path / "oak").parent
    profile = tmp_path / "studio.toml"
    options = validate.argparse.ArgumentParser()
    options.add_argument("-v", "--verbose", action="store_true")
    validate.add_arguments(options)
    strict = "[naming]\nasset = 'ash'\n"
    profile.write_text(strict)
    assert validate.run(options.parse_args([str(folder), "--profile", str(profile)])) == 3
    assert "error: studio.AssetName /: its name oak is no ash" in capsys.readouterr().out
    accepted = (
        "[rules]\nseverity = 'warning'\n[[accepted]]\nvalidator = 'studio'\nerror = 'AssetName'\nreason = 'old'\n"
    )
    profile.write_text(strict + accepted)
    assert validate.run(options.parse_args([str(folder), "--profile", str(profile)])) == 0
    assert "studio.AssetName" not in capsys.readouterr().out


def test_pictures_that_cannot_be_read_have_no_size(asset, tmp_path):
    copy = tmp_path / "oak"
    shutil.copytree(asset.parent, copy)
    (copy / "maps" / "fork_bark.png").write_bytes(b"no picture")
    assert list(check_files(copy / "oak.usda", StudioRules(texture_side_px=128))) == []
    cv2.imwrite(str(copy / "maps" / "fork_bark.png"), np.zeros((2, 150, 3), np.uint8))
    assert [f.path for f in check_files(copy / "oak.usda", StudioRules(texture_side_px=149))] == ["maps/fork_bark.png"]
