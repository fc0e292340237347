"""Assets that are packed as usdz."""

import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Sdf, UsdUtils
from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.looks.look import open_asset
from usdfoliage.asset.packages.contents import list_files
from usdfoliage.asset.packages.other_parts import read_other_parts
from usdfoliage.asset.packed_files import file_of, size_bytes, unpacked
from usdfoliage.asset.validation.studio_profile import StudioRules
from usdfoliage.asset.validation.studio_rules import check_files
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError
from usdfoliage.jobs.info import describe_asset

from tests.support.leaves.commands import printed, refused, run
from tests.support.plant_assets import write_whole_plant


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """The package of a whole plant, and the asset that it is of."""
    asset = write_whole_plant(tmp_path_factory.mktemp("plant") / "oak")
    package = tmp_path_factory.mktemp("packages") / "oak.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(asset)), str(package))
    return package, asset


def test_a_package_holds_the_files_of_its_asset(packed):
    package, asset = packed
    layers, others, missing = list_files(package)
    expected_layers, expected_others, _ = list_files(asset)
    assert not missing
    assert [file.path for file in layers] == [file.path for file in expected_layers]
    assert {file.path for file in expected_others} == {file.path for file in others}
    with zipfile.ZipFile(package) as archive:
        sizes = {each.filename: each.file_size for each in archive.infolist()}
    assert {file.path: file.size_bytes for file in (*layers, *others)} == sizes


def test_a_package_is_described_as_its_folder_is(packed):
    info, expected = (describe_asset(path) for path in packed)
    assert info.crown == expected.crown  # its cubemaps were read out of the package
    assert info.branches == expected.branches
    assert info.leaves == expected.leaves


def test_a_package_is_validated(packed):
    report = validate_asset(packed[0])
    assert {finding.error for finding in report.findings if finding.severity == "error"} == {
        "UnsupportedFileExtensionInPackage"  # of Storm's shaders
    }
    assert len(report.selections) == len(validate_asset(packed[1]).selections)


def test_rules_of_files_hold_in_a_package(packed):
    rules = StudioRules(texture_side_px=4, texture_formats=("png",))
    assert {str(finding) for finding in check_files(packed[0], rules)} == {
        str(finding) for finding in check_files(packed[1], rules)
    }
    assert [finding for finding in check_files(packed[0], rules) if finding.error == "TextureSize"]


def test_a_file_is_unpacked_for_so_long(packed):
    package, asset = packed
    name = "maps/oak_crown_radius.exr"
    with unpacked(file_of(package, name)) as file:
        assert file.read_bytes() == (asset.parent / name).read_bytes()
    assert not file.exists()
    with unpacked(file_of(asset, name)) as file:
        assert file == asset.parent / name
    with pytest.raises(AssetError, match=r"none.exr.* cannot be read"):
        size_bytes(Path(f"{package}[maps/none.exr]"))


def test_parts_are_taken_from_folders_alone(packed):
    with pytest.raises(AssetError, match=r"oak.usdz is a package; unpack it"):
        read_other_parts(packed[0])


def test_leaves_with_a_jitter_map_in_a_package(tmp_path, capsys):
    wave = tmp_path / "wave.png"
    cv2.imwrite(str(wave), np.linspace(0, 255, 32).astype(np.uint8)[None])
    assert run("scatter", "-n", 2, "-o", tmp_path / "spray", "--representation", "bezier", "--jitter-map", wave) == 0
    package = tmp_path / "spray.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "spray" / "spray.usda")), str(package))
    assert any(line.split() == ["jitter", "map", "spray_leaf_jitter.png"] for line in printed(capsys, "info", package))
    assert run("edit", package, "--jitter", 0.02, 5, "-o", tmp_path / "look.usda") == 0
    line = refused(capsys, "bake", package, "-o", tmp_path / "baked")
    assert "spray_leaf_jitter.png] lies in a package; unpack that" in line


def test_the_folder_of_a_package_is_the_users(packed, tmp_path, capsys):
    package = Path(shutil.copy(packed[0], tmp_path))
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    assert not is_asset_folder(tmp_path)
    assert "other things than one asset" in refused(capsys, "scatter", "-n", 1, "-o", tmp_path)
    assert package.is_file()
    assert notes.is_file()
    look = tmp_path / "wide.usda"
    assert run("edit", package, "--width", 2, "-o", look) == 0  # beside the package, as anywhere else
    assert open_asset(look).GetPrimAtPath("/oak/geo/render/Leaves").GetAttribute("primvars:leaf:edit:width").Get() == 2
    for asset in (package, look):
        assert "is a package; unpack it" in refused(capsys, "bake", asset, "-o", tmp_path / "baked")
