"""Blender as the artist's application, beside Storm: a crown asset of the product opens and is drawn the same."""

import json
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.asset.packages.leaf_package import AssetSettings, write_crown_asset
from usdfoliage.asset.provenance import Provenance
from usdfoliage.crown.model import CrownModel
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.crown_cage import build_crown_cage
from usdfoliage.geometry.cubemap import face_directions
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views

from tests.support.machines.blender import blender_interpreter

TOOL = Path(__file__).resolve().parents[2] / "tools" / "blender_import.py"
SEMI_AXES_M = np.array([1.5, 2.0, 1.0])
CENTER_M = np.array([0.2, 3.0, -0.1])
MESH_SIZE = 17
SIDE_PX = 128

pytestmark = pytest.mark.preview


def color_of(directions):
    """Red to the right, green upwards, blue towards the viewer; linear."""
    return 0.35 + 0.3 * directions


def egg_radius():
    return (1 / np.linalg.norm(face_directions(33) / SEMI_AXES_M, axis=-1)).astype(np.float32)


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    crown = CrownModel(
        radius_m=egg_radius(),
        color=color_of(face_directions(33)).astype(np.float32),
        center_m=CENTER_M,
        relief_weight=0.0,
        asset_from_photo=np.eye(4),
    )
    provenance = Provenance(capture="egg.png", generator="test", seed=0, input_sha256="00" * 32)
    folder = tmp_path_factory.mktemp("an egg") / "egg"
    folder.mkdir()
    return write_crown_asset(folder, "egg", crown, provenance, AssetSettings(crown_mesh_size=MESH_SIZE))


@pytest.fixture(scope="module")
def blender(asset, tmp_path_factory):
    """Blender's description of the asset, and its picture (H, W, 4) of the front, linear."""
    python = blender_interpreter()
    output = tmp_path_factory.mktemp("blender") / "front.png"
    words = [python, TOOL, asset, "--render", output, "--size", str(SIDE_PX), str(SIDE_PX), "--samples", "8"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    picture = cv2.cvtColor(cv2.imread(str(output), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA) / 255.0
    linear = np.concatenate([decode_srgb(picture[..., :3]), picture[..., 3:]], axis=2)
    return json.loads(done.stdout.splitlines()[-1]), linear


@pytest.fixture(scope="module")
def storm(asset):
    """The same orthographic front in Storm, straight colours."""
    half_m = 1.1 * SEMI_AXES_M[1]
    x, y, _ = CENTER_M
    window = (x - half_m, x + half_m, y - half_m, y + half_m)
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=window)
    return draw_views(asset, [view], PreviewSettings(width_px=SIDE_PX, height_px=SIDE_PX))[0]


def test_blender_finds_one_mesh_with_its_material_and_texture(blender):
    found, _ = blender
    assert found["meshes"] == 1
    (mesh,) = (thing for thing in found["objects"] if thing["type"] == "MESH")
    assert mesh["name"] == "Crown"
    assert mesh["faces"] == 6 * (MESH_SIZE - 1) ** 2
    assert mesh["vertices"] == mesh["faces"] + 2  # closed: Euler
    assert mesh["subdivided"]
    assert mesh["uv_maps"] == ["st"]
    assert mesh["materials"] == found["materials"] == ["Crown"]
    (image,) = found["images"]
    assert image["found"]
    assert image["size"] == [33, 6 * 33]
    assert Path(image["file"]).name == "egg_crown_color.exr"


def test_bounds_in_blender_are_the_crowns_stood_upright(blender):
    found, _ = blender
    cage_m = build_crown_cage(egg_radius(), CENTER_M, MESH_SIZE).points_m  # Blender's own mesh, before it is subdivided
    low, high = cage_m.min(axis=0), cage_m.max(axis=0)
    np.testing.assert_allclose(found["bound_asset"], [low, high], atol=1e-5)
    np.testing.assert_allclose(
        found["bound_blender"], [[low[0], -high[2], low[1]], [high[0], -low[2], high[1]]], atol=1e-5
    )


def expected_front(height_m=2 * SEMI_AXES_M[1]):
    """Silhouette and colours of the egg's front where its picture spans 1.1 of this height."""
    across = (np.arange(SIDE_PX) + 0.5 - SIDE_PX / 2) * 1.1 * height_m / SIDE_PX
    x, y = np.meshgrid(across, -across)
    inside = 1 - (x / SEMI_AXES_M[0]) ** 2 - (y / SEMI_AXES_M[1]) ** 2
    z = SEMI_AXES_M[2] * np.sqrt(np.maximum(inside, 0))
    directions = np.stack([x, y, z], axis=-1) / np.maximum(np.linalg.norm(np.stack([x, y, z]), axis=0), 1e-9)[..., None]
    return inside > 0, color_of(directions)


def test_cycles_draws_the_egg_where_and_in_the_colours_it_should(blender):
    found, picture = blender
    low, high = found["bound_asset"]  # of the cage
    inside, color = expected_front(high[1] - low[1])
    drawn = picture[..., 3] > 0.5
    assert np.sum(drawn & inside) / np.sum(drawn | inside) > 0.97
    # Under an even white sky a matte surface shows its colour, but for a thin gloss and what the samples scatter.
    middle = inside & (np.abs(np.arange(SIDE_PX) - SIDE_PX / 2) < SIDE_PX / 4)[:, None]
    np.testing.assert_allclose(picture[middle][:, :3].mean(axis=0), color[middle].mean(axis=0), atol=0.08)
    for channel in range(3):
        assert np.corrcoef(picture[middle][:, channel], color[middle][:, channel])[0, 1] > 0.8


def test_storm_draws_the_same_silhouette_and_the_same_order_of_colours(storm):
    inside, color = expected_front()
    drawn = storm[..., 3] > 0.5
    assert np.sum(drawn & inside) / np.sum(drawn | inside) > 0.97
    for row, column in ((24, 44), (64, 90), (104, 84)):
        np.testing.assert_array_equal(np.argsort(storm[row, column, :3]), np.argsort(color[row, column]))
