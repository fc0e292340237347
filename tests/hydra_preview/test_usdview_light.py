"""Leaves and crown as usdview draws them: under a light at the eye, and selected."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from usdfoliage.__main__ import main
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.plant_assets import write_whole_plant
from tests.support.usdview.pictures import draw_as_usdview

LEAVES = "/spray/geo/render/Leaves"


@pytest.fixture(scope="module")
def python() -> Path:
    try:
        return find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")


@pytest.fixture(scope="module")
def spray(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("usdview") / "spray"
    assert main(["scatter", "-n", "40", "--seed", "1", "-o", str(folder)]) == 0
    return folder / "spray.usda"


@pytest.fixture(scope="module")
def plain(python, spray, tmp_path_factory) -> np.ndarray:
    return draw_as_usdview(python, spray, tmp_path_factory.mktemp("plain") / "a.npy")


def covered(picture: np.ndarray) -> np.ndarray:
    """Which pixels differ from the background."""
    return np.abs(picture.astype(int) - picture[0, 0].astype(int)).max(axis=-1) > 12


def yellow(picture: np.ndarray) -> np.ndarray:
    """Which pixels are as bright in red as in green, and brighter than in blue: the colour of what is selected."""
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return covered(picture) & (red > 0.85 * green) & (red > blue + 40)


@pytest.mark.preview
def test_leaves_under_a_light_at_the_eye_are_green(plain):
    leaves = plain[covered(plain)].astype(int)
    assert len(leaves) > 1500
    assert (leaves.max(axis=1) < 12).mean() < 0.002  # black, as where a number is none
    assert np.median(leaves, axis=0)[1] > 60
    assert (leaves[:, 1] > leaves[:, 2]).mean() > 0.95


@pytest.mark.preview
@pytest.mark.parametrize("representation", ["mesh", "subdiv", "nurbs"])
def test_other_representations_are_green_too(python, spray, tmp_path, representation):
    scene = tmp_path / "scene.usda"
    scene.write_text(
        f'#usda 1.0\n(\n    defaultPrim = "spray"\n    upAxis = "Y"\n    metersPerUnit = 1\n)\ndef "spray" (\n'
        f'    references = @{spray}@\n    variants = {{ string representation = "{representation}" }}\n)\n{{\n}}\n'
    )
    picture = draw_as_usdview(python, scene, tmp_path / "a.npy")
    leaves = picture[covered(picture)].astype(int)
    assert len(leaves) > 1500
    assert (leaves.max(axis=1) < 12).mean() < 0.002
    assert (leaves[:, 1] > leaves[:, 2]).mean() > 0.95


@pytest.mark.preview
def test_selected_leaves_are_yellow(python, spray, plain, tmp_path):
    assert not yellow(plain).any()
    every = draw_as_usdview(python, spray, tmp_path / "all.npy", selected=("/spray", None))
    assert yellow(every).sum() > 0.8 * covered(plain).sum()  # edges are mixed with the background
    one = draw_as_usdview(python, spray, tmp_path / "one.npy", selected=(LEAVES, 3))
    assert 10 < yellow(one).sum() < 0.15 * covered(plain).sum()
    changed = np.abs(one.astype(int) - plain.astype(int)).max(axis=-1) > 20
    assert changed.sum() < 2 * yellow(one).sum()  # all other leaves look as before


@pytest.mark.preview
def test_a_shader_that_ignores_the_selection_is_noticed(python, spray, plain, tmp_path):
    copy = tmp_path / "spray"
    shutil.copytree(spray.parent, copy)
    shader = copy / "shaders" / "usdFoliageLeaf.glslfx"
    shader.write_text(
        "".join(line for line in shader.read_text().splitlines(True) if "= ApplyColorOverrides(" not in line)
    )
    every = draw_as_usdview(python, copy / "spray.usda", tmp_path / "all.npy", selected=("/spray", None))
    assert not yellow(every).any()


@pytest.mark.preview
def test_a_crown_under_a_light_at_the_eye_and_selected(python, tmp_path):
    plant = write_whole_plant(tmp_path / "plant")
    scene = tmp_path / "scene.usda"
    scene.write_text(
        '#usda 1.0\n(\n    defaultPrim = "plant"\n    upAxis = "Y"\n    metersPerUnit = 1\n)\ndef "plant" (\n'
        f'    references = @{plant}@\n    variants = {{ string lod = "crown" }}\n)\n{{\n}}\n'
    )
    plain = draw_as_usdview(python, scene, tmp_path / "plain.npy")
    crown = plain[covered(plain)].astype(int)
    assert len(crown) > 1500
    assert (crown.max(axis=1) < 8).mean() < 0.002
    chosen = draw_as_usdview(python, scene, tmp_path / "chosen.npy", selected=("/plant", None))
    changed = np.abs(chosen.astype(int) - plain.astype(int)).max(axis=-1) > 20
    assert changed[covered(plain)].mean() > 0.8


@pytest.mark.preview
def test_a_skeleton_is_seen_where_the_wood_was(python, tmp_path):
    asset = write_whole_plant(tmp_path / "oak")
    plain = draw_as_usdview(python, asset, tmp_path / "plain.npy")
    skeleton = draw_as_usdview(python, asset, tmp_path / "skeleton.npy", guides=("Skeleton",))

    def blue_or_orange(picture):
        red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
        return (abs(red - blue) > 40) & (np.maximum(red, blue) > green + 20)

    assert not blue_or_orange(plain).any()
    assert blue_or_orange(skeleton).sum() > 60
