from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from usdfoliage.crown.texture import TextureSettings, synthesize_sources, synthesize_texture
from usdfoliage.errors import FitError

EXEMPLARS = Path(__file__).parents[3] / "shared/data/texture-exemplars"


def blobs(height=72, width=64, seed=0):
    """A random texture of soft coloured blobs with noise on them."""
    rng = np.random.default_rng(seed)
    soft = gaussian_filter(rng.normal(size=(height, width, 3)), (3, 3, 0), mode="wrap")
    return np.clip(0.5 + soft + rng.normal(scale=0.05, size=soft.shape), 0, 1).astype(np.float32)


def make(exemplar, shape, seed=0, **arguments):
    return synthesize_texture(exemplar, shape, np.random.default_rng(seed), **arguments)


def test_every_pixel_is_one_of_the_exemplar():
    exemplar = blobs()
    image = make(exemplar, (50, 91))
    assert image.shape == (50, 91, 3)
    assert image.dtype == np.float32
    colors = {tuple(color) for color in exemplar.reshape(-1, 3).tolist()}
    assert {tuple(color) for color in image.reshape(-1, 3).tolist()} <= colors


def test_seed_decides_and_threads_do_not():
    exemplar = blobs()
    image = make(exemplar, (60, 61))
    np.testing.assert_array_equal(image, make(exemplar, (60, 61), settings=TextureSettings(threads=1)))
    np.testing.assert_array_equal(image, make(exemplar, (60, 61), settings=TextureSettings(threads=3)))
    assert (image != make(exemplar, (60, 61), seed=1)).any()


def test_statistics_are_the_exemplars():
    exemplar = blobs(128, 128)
    image = make(exemplar, (160, 200))
    np.testing.assert_allclose(image.mean(axis=(0, 1)), exemplar.mean(axis=(0, 1)), atol=0.02)
    np.testing.assert_allclose(image.std(axis=(0, 1)), exemplar.std(axis=(0, 1)), rtol=0.1)
    for axis in (0, 1):  # neither blurred nor noisy
        steps = [np.abs(np.diff(x, axis=axis)).mean() for x in (image, exemplar)]
        assert steps[0] == pytest.approx(steps[1], rel=0.15)


def test_all_of_the_exemplar_is_used_and_no_large_piece_at_once():
    exemplar = blobs(128, 128)
    source = synthesize_sources(exemplar, (256, 256), np.random.default_rng(0))
    times = np.zeros((128, 128))
    np.add.at(times, (source[..., 0], source[..., 1]), 1)
    cells = times.reshape(8, 16, 8, 16).mean(axis=(1, 3))
    assert cells.min() > 0.5  # 4 would be even
    assert cells.max() < 9
    shift = source - np.stack(np.indices((256, 256)), axis=-1)
    _, area = np.unique(shift.reshape(-1, 2), axis=0, return_counts=True)
    assert area.max() < 3 * (128 * TextureSettings().patch_share) ** 2
    # Pieces are whole: hardly a pixel does not continue the one on its left.
    assert (np.diff(shift, axis=1) == 0).all(axis=-1).mean() > 0.9


def test_the_mask_bounds_what_is_copied():
    exemplar = blobs(90, 100)
    y, x = np.mgrid[:90, :100]
    mask = np.hypot(y - 45, x - 50) < 40
    exemplar[~mask] = np.nan
    source = synthesize_sources(exemplar, (64, 80), np.random.default_rng(0), exemplar_mask=mask)
    assert mask[source[..., 0], source[..., 1]].all()
    assert np.isfinite(make(exemplar, (64, 80), exemplar_mask=mask)).all()


def test_what_is_known_stays_and_is_continued():
    # Stripes whose phase is known in the middle: the synthesis has to carry on with it.
    stripes = np.repeat((np.sin(np.arange(96) * np.pi / 6) / 2 + 0.5)[:, None], 96, axis=1)
    exemplar = np.repeat(stripes[..., None], 3, axis=-1).astype(np.float32)
    exemplar += np.random.default_rng(0).uniform(0, 0.05, exemplar.shape).astype(np.float32)
    exemplar /= exemplar.max()
    known = np.zeros((72, 140, 3), np.float32)
    known[:, 50:90] = exemplar[5:77, 20:60]
    known_mask = np.zeros((72, 140), bool)
    known_mask[:, 50:90] = True
    image = make(exemplar, (72, 140), known=known, known_mask=known_mask)
    np.testing.assert_array_equal(image[known_mask], known[known_mask])
    profile = known[:, 60].mean(axis=-1)
    for side in (image[:, 30:50], image[:, 90:110]):
        # Patches are laid to two pixels: half of that is 30° of a stripe.
        assert np.corrcoef(side.mean(axis=(1, 2)), profile)[0, 1] > 0.99 * np.cos(np.radians(30))


def test_the_border_of_what_is_known_is_no_step():
    exemplar = blobs(128, 128)
    known = np.zeros((96, 200, 3), np.float32)
    known[10:80, 60:140] = exemplar[30:100, 20:100]
    known_mask = np.zeros((96, 200), bool)
    known_mask[10:80, 60:140] = True
    image = make(exemplar, (96, 200), known=known, known_mask=known_mask)
    mean_step = np.abs(np.diff(exemplar, axis=1)).mean()
    for border in (59, 139):
        assert np.abs(image[10:80, border + 1] - image[10:80, border]).mean() < 1.35 * mean_step


EVERY_PLACE = TextureSettings(max_places=2**24)


def test_a_small_exemplar_is_searched_everywhere():
    exemplar = blobs(96, 96)
    first, second = (
        synthesize_sources(exemplar, (90, 120), np.random.default_rng(0), settings=settings)
        for settings in (TextureSettings(), EVERY_PLACE)
    )
    np.testing.assert_array_equal(first, second)


def test_a_grid_of_places_is_as_good_as_every_place():
    exemplar = blobs(160, 160)
    joins = []
    for settings in (TextureSettings(max_places=200), EVERY_PLACE):
        source = synthesize_sources(exemplar, (192, 256), np.random.default_rng(0), settings=settings)
        image = exemplar[source[..., 0], source[..., 1]]
        # Where a pixel does not continue the one on its left: by how much they differ.
        shift = source - np.stack(np.indices((192, 256)), axis=-1)
        breaks = (np.diff(shift, axis=1) != 0).any(axis=-1)
        joins.append(float(np.abs(np.diff(image, axis=1)).mean(axis=-1)[breaks].sum()))
    assert joins[0] < 1.02 * joins[1]


def test_all_known_is_left_alone():
    exemplar = blobs()
    known = blobs(40, 41, seed=5)
    image = make(exemplar, (40, 41), known=known, known_mask=np.ones((40, 41), bool))
    np.testing.assert_array_equal(image, known)


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (97, 5)])
def test_odd_shapes(shape):
    assert make(blobs(), shape).shape == (*shape, 3)


def test_a_small_exemplar_gets_smaller_patches():
    exemplar = blobs(40, 44)
    assert make(exemplar, (64, 64)).shape == (64, 64, 3)
    mask = np.zeros((40, 44), bool)
    mask[5:15, 3:13] = True  # ten pixels a side
    source = synthesize_sources(exemplar, (30, 30), np.random.default_rng(0), exemplar_mask=mask)
    assert mask[source[..., 0], source[..., 1]].all()


def test_an_exemplar_without_room_is_refused():
    mask = np.zeros((72, 64), bool)
    mask[10:17, 10:50] = True
    with pytest.raises(FitError, match=r"280 pixels of 64×72 .* no square of 8 pixels"):
        make(blobs(), (30, 30), exemplar_mask=mask)
    with pytest.raises(FitError, match="0 pixels"):
        make(blobs(), (30, 30), exemplar_mask=np.zeros((72, 64), bool))


def test_wrong_arguments_are_refused():
    exemplar = blobs()
    with pytest.raises(ValueError, match=r"\(h, w, 3\)"):
        make(exemplar[..., 0], (30, 30))
    with pytest.raises(ValueError, match="positive"):
        make(exemplar, (0, 30))
    with pytest.raises(ValueError, match="known must be"):
        make(exemplar, (30, 30), known=exemplar, known_mask=np.zeros((30, 30), bool))
    with pytest.raises(ValueError, match="belong together"):
        make(exemplar, (30, 30), known=np.zeros((30, 30, 3), np.float32))
    with pytest.raises(ValueError, match="finite"):
        make(exemplar * np.float32(np.nan), (30, 30))


@pytest.mark.parametrize(
    "wrong", [{"levels": 0}, {"patch_px": 7}, {"overlap_share": 0.6}, {"patch_share": 0.0}, {"passes": 0}, {"cuts": 0}]
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        TextureSettings(**wrong)


def test_progress_comes_to_its_end():
    calls = []
    make(blobs(), (40, 40), progress=lambda done, total: calls.append((done, total)))
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
    assert calls[-1][0] == calls[-1][1]


def test_foliage_keeps_its_colours():
    if not EXEMPLARS.is_dir():
        pytest.skip(f"{EXEMPLARS} is absent")
    for path in sorted(EXEMPLARS.glob("*.png"))[:2]:
        exemplar = cv2.imread(str(path))[:192, :192].astype(np.float32) / 255
        image = make(exemplar, (192, 256))
        np.testing.assert_allclose(image.mean(axis=(0, 1)), exemplar.mean(axis=(0, 1)), atol=0.03)
        np.testing.assert_allclose(image.std(axis=(0, 1)), exemplar.std(axis=(0, 1)), rtol=0.1)
