"""The command lobed: from a scan to an asset that validates."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.asset.validation.validate import validate_asset

from tests.support.leaves.lobed import lobed_mask


def write_scan(folder: Path, mask: np.ndarray, *, alpha: bool = False) -> tuple[Path, Path]:
    """A scan and its mask."""
    shade = (40 * np.sin(np.arange(mask.shape[1]) / 9)[None] * np.ones(mask.shape)).astype(int)
    leaf = np.dstack([30 + shade * 0, 120 + shade, 60 + shade // 2])  # blue, green, red
    picture = np.where(mask[..., None], leaf, 235).clip(0, 255).astype(np.uint8)
    if alpha:
        picture = np.dstack([picture, mask.astype(np.uint8) * 255])
    cv2.imwrite(str(folder / "scan.png"), picture)
    cv2.imwrite(str(folder / "mask.png"), mask.astype(np.uint8) * 255)
    return folder / "scan.png", folder / "mask.png"


def run(*words: object) -> int:
    return main(["lobed", *map(str, words)])


def test_an_asset_validates_and_lies_over_its_scan(tmp_path, capsys):
    scan, mask = write_scan(tmp_path, lobed_mask())
    out = tmp_path / "ivy"
    assert run(scan, "--mask", mask, "-o", out, "--width", "0.08", "--no-preview", "--species", "Hedera helix") == 0
    printed = capsys.readouterr().out
    assert "lobes: 5" in printed
    assert "size: 80.0 x" in printed
    found = [each for each in validate_asset(out).findings if each.severity == "error" and not each.accepted]
    assert found == []
    stage = Usd.Stage.Open(str(out / "ivy.usda"))
    root = stage.GetDefaultPrim()
    (target,) = root.GetRelationship("foliage:leaves").GetTargets()
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(target))
    points = np.array(mesh.GetPointsAttr().Get(), np.float64)
    st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get(), np.float64)
    matrix = np.array(root.GetAttribute("foliage:captureToAsset").Get())
    pixels = np.column_stack([st[:, 0] * 240, (1 - st[:, 1]) * 240, np.zeros(len(st)), np.ones(len(st))])
    assert (pixels @ matrix)[:, :3] == pytest.approx(points, abs=1e-6)
    texture = cv2.imread(str(out / "maps" / "ivy_leaf.png"), cv2.IMREAD_UNCHANGED)
    assert texture.shape == (240, 240, 4)
    assert np.array_equal(texture[..., 3] > 127, lobed_mask())


def test_equal_runs_give_equal_bytes(tmp_path):
    scan, mask = write_scan(tmp_path, lobed_mask((30, 150)))
    for out in ("a", "b"):
        assert run(scan, "--mask", mask, "-o", tmp_path / out, "--name", "leaf", "--no-preview", "--reproducible") == 0
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert files
    assert [
        str(file) for file in files if (tmp_path / "a" / file).read_bytes() != (tmp_path / "b" / file).read_bytes()
    ] == []


def test_several_leaves_are_several_assets(tmp_path, capsys):
    mask = np.hstack([lobed_mask((90,)), lobed_mask((30, 150))])
    scan, _ = write_scan(tmp_path, mask, alpha=True)
    assert run(scan, "-o", tmp_path / "out", "--dpi", "300", "--no-preview", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert [Path(leaf["asset"]).relative_to(tmp_path).as_posix() for leaf in made["leaves"]] == [
        "out/leaf_01/out_01.usda",
        "out/leaf_02/out_02.usda",
    ]
    assert [leaf["facts"][0]["value"] for leaf in made["leaves"]] == ["1", "2"]
    assert {each["code"] for each in made["leaves"][0]["remarks"]} == {"lobed-mask-of-alpha"}
    assert (tmp_path / "out" / "leaf_02" / "report" / "ties.png").is_file()


def test_a_dry_run_writes_nothing(tmp_path, capsys):
    scan, mask = write_scan(tmp_path, lobed_mask())
    assert run(scan, "--mask", mask, "-o", tmp_path / "out", "--dry-run") == 0
    assert "1 leaf" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_a_scan_without_mask_and_scale_is_remarked_on(tmp_path, capsys):
    scan, _ = write_scan(tmp_path, lobed_mask((90,)))
    assert run(scan, "-o", tmp_path / "out", "--no-preview", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert {each["code"] for each in made["remarks"]} == {"lobed-mask-of-colours", "lobed-size-assumed"}


def test_a_hole_stays_a_hole_of_the_texture(tmp_path, capsys):
    mask = lobed_mask((90,))
    mask[112:128, 112:128] = False
    scan, given = write_scan(tmp_path, mask)
    assert run(scan, "--mask", given, "-o", tmp_path / "out", "--dpi", "300", "--no-preview", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert [each["code"] for each in made["remarks"]] == ["lobed-holes"]
    texture = cv2.imread(str(tmp_path / "out" / "maps" / "out_leaf.png"), cv2.IMREAD_UNCHANGED)
    assert texture[120, 120, 3] == 0


@pytest.mark.parametrize(
    ("change", "words", "reason"),
    [
        ("empty", (), "is empty"),
        ("full", (), "is full"),
        ("small", (), "they must have the same size"),
        ("dot", (), "is 1×1 pixels"),
        ("speck", (), "and a leaf needs 400"),
        ("", ("--dpi", "0"), "dpi must be above 0"),
        ("", ("--width", "nan"), "width must be above 0"),
        ("", ("--width", "0.1", "--height", "0.1"), "not by several"),
        ("", ("--seed", "-1"), "the seed must be"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(tmp_path, capsys, change, words, reason):
    scan, mask = write_scan(tmp_path, lobed_mask((90,)))
    pixels = cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE)
    changed = {
        "empty": pixels * 0,
        "full": pixels * 0 + 255,
        "small": pixels[::2, ::2],
        "dot": pixels[:1, :1],
        "speck": np.where(np.indices(pixels.shape).max(axis=0) < 8, 255, 0),
    }
    if change:
        cv2.imwrite(str(mask), changed[change].astype(np.uint8))
    assert run(scan, "--mask", mask, "-o", tmp_path / "out", "--no-preview", *words) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_another_asset_is_not_replaced(tmp_path, capsys):
    scan, mask = write_scan(tmp_path, lobed_mask((90,)))
    other = tmp_path / "other.png"
    other.write_bytes(scan.read_bytes())
    words = ("--mask", mask, "-o", tmp_path / "out", "--no-preview")
    assert run(scan, *words) == 0
    assert run(other, *words) == 2
    assert "and not by" in capsys.readouterr().err
    assert run(other, *words, "--force") == 0
