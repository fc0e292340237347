from pathlib import Path

import numpy as np
import pytest
from usdfoliage.capture.folder.images import read_photo
from usdfoliage.capture.folder.masks import clean_mask, read_mask
from usdfoliage.crown.radius import front_outline
from usdfoliage.geometry.cubemap import FACES, face_directions, share_borders
from usdfoliage.jobs.crown.photograph import STEPS, CrownSettings, reconstruct_crown

from tests.support.crown_shapes import disc_mask, foliage

DATA = Path(__file__).parents[4] / "shared" / "data"


@pytest.fixture(scope="module")
def disc():
    mask = disc_mask(110, center_px=(140.0, 160.0))
    steps: list[tuple[str, float]] = []
    made = reconstruct_crown(
        foliage((300, 300)), mask, CrownSettings(size=64, relief=0.0, height_m=3.0), progress=lambda *s: steps.append(s)
    )
    return mask, steps, made


def test_a_disc_without_relief_is_a_ball_of_the_asked_height(disc):
    _, _, (model, _) = disc

    assert model.radius_m == pytest.approx(np.full((6, 64, 64), 1.5), rel=0.03)
    height = np.ptp(face_directions(64)[..., 1] * model.radius_m)
    assert height == pytest.approx(3.0, rel=1e-6)


def test_the_crown_stands_on_the_ground_and_lies_over_its_photograph(disc):
    _, _, (model, measures) = disc

    lowest = (face_directions(64)[..., 1] * model.radius_m).min() + model.center_m[1]
    assert lowest == pytest.approx(0, abs=1e-6)
    center_px = [*measures.silhouette.center_px, 0, 1]
    assert model.asset_from_photo @ center_px == pytest.approx([*model.center_m, 1], abs=1e-9)
    one_px_right, one_px_down = model.asset_from_photo[:3, 0], model.asset_from_photo[:3, 1]
    assert one_px_right == pytest.approx([3.0 / 220, 0, 0], rel=0.02)
    assert one_px_down == pytest.approx([0, -3.0 / 220, 0], rel=0.02)


def test_front_silhouette_against_the_mask(disc):
    _, _, (_, measures) = disc

    assert measures.iou > 0.98
    assert measures.iou_aligned > 0.98
    assert measures.star_bound > 0.99


def test_maps_are_whole(disc):
    _, _, (model, _) = disc

    assert model.color.shape == (6, 64, 64, 3)
    assert np.isfinite(model.color).all()
    assert model.color.min() >= 0
    assert np.array_equal(share_borders(model.color), model.color)
    assert np.array_equal(share_borders(model.radius_m), model.radius_m)


def test_colours_have_the_photographs_mean_and_contrast(disc):
    mask, _, (model, _) = disc
    texels, pixels = model.color.reshape(-1, 3), foliage((300, 300))[mask]

    assert texels.mean(axis=0) == pytest.approx(pixels.mean(axis=0), rel=0.03)
    assert texels.std(axis=0) == pytest.approx(pixels.std(axis=0), rel=0.10)


def test_each_step_is_reported_and_timed(disc):
    _, steps, (_, measures) = disc

    assert [name for name, share in steps if share == 1.0 and name not in ("texture",)] == [
        name for name in STEPS if name != "texture"
    ]
    assert set(measures.seconds) == set(STEPS)


def test_same_seed_same_crown_and_any_number_of_threads():
    color, mask = foliage((120, 120)), disc_mask(50, size_px=120)
    first, second = (reconstruct_crown(color, mask, CrownSettings(size=32, threads=n))[0] for n in (1, 3))
    other = reconstruct_crown(color, mask, CrownSettings(size=32, seed=1))[0]

    assert np.array_equal(first.color, second.color)
    assert np.array_equal(first.radius_m, second.radius_m)
    assert not np.array_equal(first.color, other.color)


def test_relief_moves_the_surface_and_not_the_outline():
    color, mask = foliage((200, 200)), disc_mask(80, size_px=200)
    smooth, rough = (reconstruct_crown(color, mask, CrownSettings(size=48, relief=w))[0] for w in (0.0, 0.4))

    assert (rough.radius_m / smooth.radius_m).std() > 0.03
    assert front_outline(rough.radius_m) == pytest.approx(front_outline(smooth.radius_m), rel=0.03)
    assert rough.radius_m[FACES.index("-Z")].std() > 2 * smooth.radius_m[FACES.index("-Z")].std()


@pytest.mark.parametrize("wrong", [{"size": 0}, {"height_m": 0.0}, {"height_m": np.nan}, {"relief": 2.0}, {"seed": -1}])
def test_settings_are_checked(wrong):
    with pytest.raises(ValueError, match="must be"):
        CrownSettings(**wrong)


def test_photograph_and_mask_must_agree():
    with pytest.raises(ValueError, match="differ in size"):
        reconstruct_crown(foliage((50, 60)), disc_mask(20, size_px=50))


@pytest.mark.parametrize("name", ["Acer_rubrum_13", "Acer_saccharum_07"])
def test_a_real_crown_keeps_silhouette_colours_and_seams(name):
    folder = DATA / "tree-photos-wikimedia"
    if not folder.exists():
        pytest.skip("../shared/data/tree-photos-wikimedia is absent")
    photo = read_photo(folder / f"{name}.jpg")
    mask = clean_mask(read_mask(folder / "masks" / f"{name}.png", photo.linear.shape, photo.orientation)).mask

    model, measures = reconstruct_crown(photo.linear, mask, CrownSettings(size=128))

    assert measures.iou > 0.96 * measures.star_bound
    assert measures.iou_aligned > 0.95 * measures.star_bound
    texels, pixels = model.color.reshape(-1, 3), photo.linear[mask]
    assert texels.mean(axis=0) == pytest.approx(pixels.mean(axis=0), rel=0.03)
    assert texels.std(axis=0) == pytest.approx(pixels.std(axis=0), rel=0.10)


def test_sky_in_gaps_is_no_colour_of_the_crown():
    rng = np.random.default_rng(3)
    crown = disc_mask(110)
    gaps = np.zeros_like(crown)
    for row, column in rng.integers(60, 240, (150, 2)):
        gaps[row : row + 4, column : column + 4] = True
    leaves = crown & ~gaps
    photo = foliage((300, 300))
    photo[~leaves] = [0.6, 0.7, 1.0]  # sky

    model, _ = reconstruct_crown(photo, crown, CrownSettings(size=96), foliage=leaves)

    texels, pixels = model.color.reshape(-1, 3), photo[leaves]
    assert texels.mean(axis=0) == pytest.approx(pixels.mean(axis=0), rel=0.03)
    assert texels.std(axis=0) == pytest.approx(pixels.std(axis=0), rel=0.10)
    assert np.mean(texels[:, 2] > 0.5) < 0.002
