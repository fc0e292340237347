"""Mean and contrast of a cubemap."""

import numpy as np
import pytest
from usdfoliage.crown.tone import ColorStatistics, ToneSettings, blend_tone, match_statistics, measure_color_statistics
from usdfoliage.geometry.color import decode_srgb
from usdfoliage.geometry.cubemap import face_directions, share_borders

SIZE = 48


def texels(seed=0, spread=0.1):
    noise = np.random.default_rng(seed).normal(size=(6, SIZE, SIZE, 3))
    return share_borders(np.clip([0.4, 0.5, 0.3] + spread * noise, 0, 1).astype(np.float32))


def unseen():
    return (1 - np.maximum(face_directions(SIZE)[..., 2], 0)).astype(np.float32)


def test_statistics_of_a_few_pixels():
    pixels = np.array([[[0.0, 0.5, 1.0], [1.0, 0.5, 3.0]]])
    statistics = measure_color_statistics(pixels)
    np.testing.assert_allclose(statistics.mean, [0.5, 0.5, 2.0])
    np.testing.assert_allclose(statistics.std, [0.5, 0.0, 1.0])
    one = measure_color_statistics(pixels, np.array([[True, False]]))
    np.testing.assert_allclose(one.mean, [0.0, 0.5, 1.0])


def test_statistics_of_nothing_or_of_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="no pixel"):
        measure_color_statistics(np.ones((2, 2, 3)), np.zeros((2, 2), bool))
    with pytest.raises(ValueError, match=r"\(\.\.\., 3\)"):
        measure_color_statistics(np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"\(3, 3\)"):
        measure_color_statistics(np.ones((2, 2, 3)), np.zeros((3, 3), bool))


@pytest.mark.parametrize(("mean", "std"), [(1.0, 1.0), (1.1, 1.5), (0.9, 1.3), (1.0, 2.0), (1.05, 0.6)])
def test_mean_is_reached_and_contrast_within_its_ratio(mean, std):
    encoded = texels()
    before = measure_color_statistics(decode_srgb(encoded))
    target = ColorStatistics(mean=before.mean * mean, std=before.std * std)
    result = match_statistics(encoded, unseen(), target, 1.0)
    after = measure_color_statistics(result)
    np.testing.assert_allclose(after.mean, target.mean, rtol=2e-3)
    assert np.all(after.std >= 0.94 * target.std)
    assert np.all(after.std <= 1.06 * target.std)
    assert result.min() >= 0
    assert result.max() <= 1


def test_what_has_the_right_statistics_stays():
    encoded = np.clip(texels(), 0.01, 0.99)
    linear = decode_srgb(encoded)
    result = match_statistics(encoded, unseen(), measure_color_statistics(linear), 1.0)
    np.testing.assert_allclose(result, linear, rtol=2e-3)


def test_the_mean_is_corrected_where_the_photograph_does_not_see():
    encoded = np.clip(texels(), 0.01, 0.99)
    before = decode_srgb(encoded)
    target = measure_color_statistics(before)
    target = ColorStatistics(mean=target.mean * 1.04, std=target.std)
    blind = np.zeros((6, SIZE, SIZE), np.float32)
    blind[5] = 1
    result = match_statistics(encoded, blind, target, 1.0)
    np.testing.assert_allclose(result[:5], before[:5], rtol=0.1)
    assert result[:5].mean() == pytest.approx(before[:5].mean(), rel=5e-3)
    assert result[5].mean() > 1.1 * before[5].mean()


def test_peak_scales_the_result():
    encoded = texels()
    one = measure_color_statistics(decode_srgb(encoded))
    four = ColorStatistics(mean=4 * one.mean, std=4 * one.std)
    np.testing.assert_allclose(
        match_statistics(encoded, unseen(), four, 4.0), 4 * match_statistics(encoded, unseen(), one, 1.0), rtol=1e-4
    )


def test_no_seam_appears_at_the_edges_of_the_cube():
    """Detail is what differs from a neighbourhood that reaches over the edges.

    A smooth field has next to no detail, so the gain is the largest there is; a neighbourhood that ended at the edge
    would show as 0.03.
    """
    directions = face_directions(SIZE)
    smooth = (0.5 + 0.2 * directions).astype(np.float32)
    statistics = measure_color_statistics(decode_srgb(smooth))
    more = ColorStatistics(mean=statistics.mean, std=1.2 * statistics.std)
    result = match_statistics(smooth, unseen(), more, 1.0)
    np.testing.assert_allclose(share_borders(result), result, atol=0.01)


def test_tone_beside_the_photograph_becomes_its_own_and_far_from_it_stays():
    noise = 0.02 * np.random.default_rng(1).normal(size=(6, SIZE, SIZE, 3))
    photo = face_directions(SIZE)[..., 2] > 0.6
    encoded = np.where(photo[..., None], 0.6, 0.4) + noise
    encoded = np.asarray(share_borders(encoded), np.float32)
    settings = ToneSettings(blend=1 / 12)
    result = blend_tone(encoded, photo, settings)
    np.testing.assert_array_equal(result[photo], encoded[photo])
    z = face_directions(SIZE)[..., 2]
    beside, far = ~photo & (z > 0.58), z < -0.2
    assert result[beside].mean() == pytest.approx(0.6, abs=0.04)
    assert result[far].mean() == pytest.approx(encoded[far].mean(), abs=1e-3)
    assert result[far].std() == pytest.approx(encoded[far].std(), rel=0.05)
    # From the one to the other without a step.
    rings = [result[(z > low) & (z <= low + 0.1)].mean() for low in np.arange(-0.4, 0.6, 0.1)]
    assert np.all(np.diff(rings) > -2e-3)
    assert np.max(np.diff(rings)) < 0.1


@pytest.mark.parametrize("everywhere", [True, False])
def test_tone_stays_where_there_is_no_border(everywhere):
    encoded = texels()
    np.testing.assert_array_equal(blend_tone(encoded, np.full(encoded.shape[:3], everywhere)), encoded)


@pytest.mark.parametrize(
    "wrong", [{"blend": 0.0}, {"blend": 0.3}, {"std_ratio": 0.0}, {"std_ratio": 1.1}, {"detail_texels": 0.0}]
)
def test_settings_refuse_what_makes_no_sense(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ToneSettings(**wrong)
