"""Cards lie as applications draw them, show the plant from all six sides, and have its own colours."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd, UsdGeom
from usdfoliage.asset.packages.asset_shape import AssetShape
from usdfoliage.asset.packages.cards import CARD_SIDES, AssetPictures, read_cards
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.jobs.plant.pages.cards import SIDES, cut_to_box, draw_asset_pictures, view_side
from usdfoliage.jobs.plant.pages.pictures import PictureSettings
from usdfoliage.jobs.preview.pictures import PreviewSettings, draw_views

from tests.support.plant_assets import RUN, some_leaves

SETTINGS = PictureSettings(card_px=128, samples=4)


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    """An asset with cards, and its shape."""
    work, shapes = tmp_path_factory.mktemp("cards"), []

    def draw(interface: Path, shape: AssetShape) -> AssetPictures:
        shapes.append(shape)
        return draw_asset_pictures(interface, shape, work, SETTINGS)

    (work / "oak").mkdir()
    foliage = some_leaves(6, "bezier")
    large = replace(foliage, leaves=replace(foliage.leaves, length_m=np.full(6, 2.5)))
    interface = write_plant_asset(
        work / "oak", "oak", provenance=RUN, asset_from_capture=np.eye(4), foliage=large, pictures=draw
    )
    return interface, shapes[0]


@pytest.mark.preview
def test_cards_are_drawn_where_the_plant_is(plant, tmp_path):
    interface, shape = plant
    views = [view_side(side, shape.drawn_m, 128) for side in SIDES.values()]
    whole = draw_views(interface, views, PreviewSettings(samples=4))
    stage = Usd.Stage.Open(str(interface))
    assert UsdGeom.ModelAPI(stage.GetDefaultPrim()).ComputeModelDrawMode() == "default"
    assert not stage.GetDefaultPrim().GetAttribute("model:drawMode").HasAuthoredValue()  # a group's is inherited
    over = Usd.Stage.CreateNew(str(tmp_path / "cards.usda"))
    over.GetRootLayer().subLayerPaths.append(str(interface))
    prim = over.OverridePrim(stage.GetDefaultPrim().GetPath())
    over.SetDefaultPrim(prim)
    UsdGeom.ModelAPI(prim).CreateModelDrawModeAttr("cards")
    over.Save()
    drawn = draw_views(tmp_path / "cards.usda", views, PreviewSettings(samples=4))
    for name, real, card in zip(SIDES, whole, drawn, strict=True):
        own, other = real[..., 3] > 0.5, card[..., 3] > 0.5
        mirrored = other[:, ::-1], other[::-1], other[::-1, ::-1]
        assert iou(own, other) > max(0.6, *(iou(own, wrong) for wrong in mirrored)), name


@pytest.mark.preview
def test_cards_have_the_colours_of_the_plant_without_light(plant):
    interface, _ = plant
    card = cv2.imread(str(interface.parent / "cards" / "oak_ZPos.png"), cv2.IMREAD_UNCHANGED)
    solid = card[card[..., 3] == 255]
    green = solid[(solid[:, 1] > solid[:, 2]) & (solid[:, 1] > solid[:, 0])]
    assert len(green) > 20
    assert len(np.unique(card[card[..., 3] == 0][:, :3], axis=0)) == 1  # no dark border


@pytest.mark.preview
def test_cards_are_read_where_all_are_there(plant, tmp_path):
    interface, _ = plant
    assert set(read_cards(Usd.Stage.Open(str(interface)).GetDefaultPrim(), interface.parent)) == set(CARD_SIDES)
    (interface.parent / "cards" / "oak_XPos.png").rename(tmp_path / "away.png")
    try:
        assert read_cards(Usd.Stage.Open(str(interface)).GetDefaultPrim(), interface.parent) == {}
    finally:
        (tmp_path / "away.png").rename(interface.parent / "cards" / "oak_XPos.png")


def test_a_view_has_the_sides_of_the_box():
    box_m = np.array([[-1.0, 0.0, 2.0], [3.0, 8.0, 4.0]])
    view = view_side(SIDES["XPos"], box_m, 80)
    assert view.size_px == (20, 80)
    np.testing.assert_allclose(view.window, (-4, -2, 0, 8), atol=1e-4)
    assert view_side(SIDES["ZNeg"], box_m, 80).window[0] == pytest.approx(-3, abs=1e-4)


@pytest.mark.parametrize(
    ("size_m", "size_px"),
    [((0.04, 2.0), (2, 100)), ((1.0, 0.01), (100, 1)), ((1.0, 0.0), (100, 1)), ((1, 0.5), (100, 50))],
)
def test_a_card_of_a_thin_plant_is_cut_to_its_box(size_m, size_px):
    """Pictures have 16 pixels a side or more: what is beyond the box is drawn, and cut away."""
    box_m = np.array([[0.3, -0.2, 0.0], [0.3 + size_m[0], -0.2 + size_m[1], 1.0]])
    view = view_side(SIDES["ZPos"], box_m, 100)
    left, right, bottom, top = view.window
    pixels = np.array(view.size_px)
    assert pixels.min() >= 16
    assert (right - left) / (top - bottom) == pytest.approx(pixels[0] / pixels[1])  # square pixels
    x_m = left + (np.arange(pixels[0]) + 0.5) * (right - left) / pixels[0]
    y_m = top - (np.arange(pixels[1]) + 0.5) * (top - bottom) / pixels[1]
    picture = np.zeros((pixels[1], pixels[0], 4), np.uint8)
    picture[..., 0] = 100 * np.clip((x_m - box_m[0, 0]) / max(size_m[0], 1e-9), 0, 1)
    picture[..., 1] = 100 * np.clip((y_m - box_m[0, 1]) / max(size_m[1], 1e-9), 0, 1)[:, None]
    cut = cut_to_box(picture, SIDES["ZPos"], box_m)
    assert cut.shape[1::-1] == size_px
    if size_px[0] > 50:
        assert cut[0, 0, 0] < 2 < 98 <= cut[0, -1, 0]
    if size_px[1] > 50:
        assert cut[-1, 0, 1] < 2 < 98 <= cut[0, 0, 1]


def test_cards_are_all_six_or_none():
    with pytest.raises(ValueError, match="cards must be"):
        AssetPictures(cards={"XPos": Path("x.png")})


@pytest.mark.preview
@pytest.mark.parametrize("asked", [True, False])
def test_a_plant_has_no_cards_where_it_has_no_box_or_none_are_asked_for(plant, tmp_path, asked):
    interface, shape = plant
    drawn = draw_asset_pictures(
        interface, replace(shape, drawn_m=None if asked else shape.drawn_m), tmp_path, replace(SETTINGS, cards=asked)
    )
    assert drawn.cards == {}
    assert [path.name for path in tmp_path.iterdir()] == [drawn.thumbnail.name] == ["thumbnail.png"]


def iou(first, second):
    return (first & second).sum() / max((first | second).sum(), 1)
