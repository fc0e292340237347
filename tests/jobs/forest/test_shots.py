"""Shots of a forest: each plant stands in one level at every frame, in the form that its distance asks for."""

import json

import numpy as np
import pytest
import rasterio
from pxr import Usd, UsdGeom
from usdfoliage.__main__ import main
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.jobs.forest.shots import shot_name

from tests.support.forests.shots import FRAMES, PATH_M, drawn_at, forest_words, write_shot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a shot")
    write_shot(folder / "shot010.usda", [(0, 40, z) for z in PATH_M])
    return folder


@pytest.fixture(scope="module")
def words(folder):
    return forest_words(folder)


@pytest.fixture(scope="module")
def forest(folder, words):
    out = folder / "one" / "valley"
    shot = ["--camera", str(folder / "shot010.usda"), "--lod-distance", "30", "70"]
    assert main([*words, "-o", str(out), *shot]) == 0
    return out


def test_a_plant_stands_in_one_level_at_every_frame(forest):
    stage = Usd.Stage.Open(str(forest / "valley.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1001, 1000 + FRAMES)
    root = stage.GetDefaultPrim()
    crowns = UsdGeom.PointInstancer(stage.GetPrimAtPath("/valley/plants/crown"))
    position = dict(zip(crowns.GetIdsAttr().Get(), np.array(crowns.GetPositionsAttr().Get()), strict=True))
    jitter = dict(
        zip(crowns.GetIdsAttr().Get(), crowns.GetPrim().GetAttribute("foliage:forest:lodJitter").Get(), strict=True)
    )
    root.GetVariantSet("level").SetVariantSelection("shot010")
    levels = {
        name: UsdGeom.PointInstancer(stage.GetPrimAtPath(f"/valley/plants/{name}")) for name in ("leaves", "relief")
    }
    changed = 0
    everything = set().union(*(set(each.GetIdsAttr().Get()) for each in levels.values()))
    before: set[int] = set()
    for number, z in enumerate(PATH_M):
        near, far = (drawn_at(levels[name], 1001 + number) for name in ("leaves", "relief"))
        assert not near & far
        assert near | far == everything
        for plant in everything:
            away_m = np.linalg.norm(position[plant] - [0, 40, z])
            limit_m = 30 + 40 * jitter[plant]
            if away_m < 0.9 * limit_m - 8:  # the middle of a plant is above its foot
                assert plant in near
            elif away_m > 1.1 * limit_m + 8:
                assert plant in far
        changed += len(near ^ before) if number else 0
        before = near
    assert 0.1 * len(position) < len(everything) < len(position)
    assert changed > 20
    for each in levels.values():  # ids are those of the other levels
        np.testing.assert_array_equal(
            np.array(each.GetPositionsAttr().Get()), [position[plant] for plant in each.GetIdsAttr().Get()]
        )


def test_the_asset_of_a_shot_is_valid_and_counted_once(forest, capsys):
    findings = validate_asset(forest, read_profile(default_profile())).findings
    assert not [each for each in findings if each.severity == "error"]
    assert main(["info", str(forest), "--json"]) == 0
    assert "shot010" in json.dumps(json.loads(capsys.readouterr().out))


def test_the_same_shot_gives_the_same_bytes(forest, folder, words):
    again = folder / "other" / "valley"
    shot = ["--camera", str(folder / "shot010.usda"), "--lod-distance", "30", "70"]
    assert main([*words, "-o", str(again), *shot]) == 0
    for file in ("plants_shot010.usdc", "payload.usda"):
        assert (forest / "payload" / file).read_bytes() == (again / "payload" / file).read_bytes()


def test_every_renderer_draws_a_shot_of_meshes(folder, words):
    out = folder / "meshes"
    shot = ["--camera", str(folder / "shot010.usda"), "--near-level", "crown", "--far-level", "crown"]
    assert main([*words, "-o", str(out), *shot]) == 0
    stage = Usd.Stage.Open(str(out / "meshes.usda"))
    level = stage.GetDefaultPrim().GetVariantSet("level")
    assert "auto" not in level.GetVariantNames()  # which would have one form to choose
    level.SetVariantSelection("shot010")
    (only,) = stage.GetPrimAtPath("/meshes/plants").GetChildren()
    assert only.GetName() == "crown"
    assert not UsdGeom.PointInstancer(only).GetInvisibleIdsAttr().GetTimeSamples()


@pytest.mark.parametrize(
    ("name", "arguments", "about"),
    [
        ("away", {"eyes_m": [(0, 40, 0)], "towards": (0.0, 1.0, 0.1)}, "sees no plant"),
        ("none", {}, "none.usda"),
    ],
)
def test_a_camera_that_sees_nothing_is_an_error_and_nothing_is_written(folder, words, capsys, name, arguments, about):
    file = folder / f"{name}.usda"
    if arguments:
        write_shot(file, **arguments)
    out = folder / f"forest of {name}"
    assert main([*words, "-o", str(out), "--camera", str(file)]) == 2
    assert about in capsys.readouterr().err
    assert not out.exists()


def test_shots_of_two_rates_or_one_name_are_refused(folder, words, capsys):
    other = write_shot(folder / "shot020.usda", [(0, 40, 0)], rate=25.0)
    both = ["--camera", str(folder / "shot010.usda"), "--camera", str(other)]
    assert main([*words, "-o", str(folder / "two"), *both]) == 2
    assert "24 and 25 frames per second" in capsys.readouterr().err
    twice = ["--camera", str(folder / "shot010.usda")] * 2
    assert main([*words, "-o", str(folder / "two"), *twice]) == 2
    assert "would both be shot010" in capsys.readouterr().err
    assert not (folder / "two").exists()


def test_what_a_run_refuses_a_dry_run_refuses(folder, words, capsys):
    shot = ["--camera", str(folder / "shot010.usda")]
    for wrong, about in (
        (["--tile", "0.001", *shot], "are allowed"),
        (["--camera-prim", "/cam"], "give --camera"),
        (["--max-full-plants", "-1", *shot], "max-full-plants must be 0 or more"),
        (["--lod-distance", "5", "3", *shot], "the nearer first"),
    ):
        assert main([*words, "-o", str(folder / "dry"), "--dry-run", *wrong]) == 2
        assert about in capsys.readouterr().err


def test_a_forest_without_plants_is_not_blamed_on_the_camera(folder, words, capsys):
    with rasterio.open(folder / "canopy.tif") as file:
        profile, heights = file.profile, file.read(1)
    with rasterio.open(folder / "bare.tif", "w", **profile) as file:
        file.write(np.zeros_like(heights), 1)
    bare = [f"--canopy={folder / 'bare.tif'}" if word.startswith("--canopy") else word for word in words]
    bare = [word for word in bare if not word.startswith(("--trunks", "--vegetation"))]
    assert main([*bare, "-o", str(folder / "none"), "--camera", str(folder / "shot010.usda")]) == 2
    assert "has no plants" in capsys.readouterr().err


def test_a_dry_run_names_the_frames(folder, words, capsys):
    assert main([*words, "-o", str(folder / "dry"), "--dry-run", "--camera", str(folder / "shot010.usda")]) == 0
    assert f"/cam, frames 1001 to {1000 + FRAMES}" in capsys.readouterr().out


def test_names_of_shots_are_variants(tmp_path):
    assert shot_name(tmp_path / "shot010.usda") == "shot010"
    assert shot_name(tmp_path / "ab 010.usd") == "shot_ab_010"
