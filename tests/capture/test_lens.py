import numpy as np
import pytest
from usdfoliage.capture.lens import LENS_MODELS, Lens, scale_lens, undistort

WIDTH, HEIGHT = 64, 48
COEFFICIENTS = (-0.11, 0.05, 0.013, -0.007, 0.02, 0.03, -0.015, 0.01)


def lens_of(model: str, coefficients: tuple[float, ...] = COEFFICIENTS) -> Lens:
    described = LENS_MODELS[model]
    focal = (80.0, 82.0)[: described.focal_lengths]
    parameters = (*focal, 33.0, 23.0, *coefficients[: described.distortion])
    return Lens(model=model, width_px=WIDTH, height_px=HEIGHT, parameters=parameters)


def distort(lens: Lens, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """COLMAP's ImgFromCam, from its documentation, written out for each model."""
    k = (*lens.distortion, *([0.0] * 8))
    square = x * x + y * y
    if LENS_MODELS[lens.model].fisheye:
        radius = np.sqrt(square)
        angle = np.arctan(radius)
        bent = angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8)
        factor = np.where(radius > 0, bent / np.where(radius > 0, radius, 1), 1)
        return factor * x, factor * y
    if LENS_MODELS[lens.model].distortion <= 2:
        factor = 1 + k[0] * square + k[1] * square**2
        return factor * x, factor * y
    k1, k2, p1, p2, k3, k4, k5, k6 = k[:8]
    factor = (1 + k1 * square + k2 * square**2 + k3 * square**3) / (1 + k4 * square + k5 * square**2 + k6 * square**3)
    return (
        factor * x + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        factor * y + 2 * p2 * x * y + p1 * (square + 2 * y * y),
    )


@pytest.mark.parametrize("model", LENS_MODELS)
def test_each_pixel_comes_from_where_the_model_puts_it(model):
    lens = lens_of(model)
    undistortion = undistort(lens)
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    (fx, fy), (cx, cy) = lens.focal_px, lens.center_px
    x, y = distort(lens, (columns - cx) / fx, (rows - cy) / fy)
    np.testing.assert_allclose(undistortion.x, x * fx + cx - 0.5, atol=1e-4)
    np.testing.assert_allclose(undistortion.y, y * fy + cy - 0.5, atol=1e-4)


def test_without_distortion_nothing_moves():
    lens = lens_of("OPENCV", (0.0,) * 4)
    assert lens.is_pinhole
    undistortion = undistort(lens)
    picture = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    np.testing.assert_array_equal(undistortion.smooth(picture), picture)
    np.testing.assert_array_equal(undistortion.nearest(picture[..., 0].astype(np.float32)), picture[..., 0])
    assert undistortion.inside.all()


def test_a_fisheye_is_never_a_pinhole():
    assert not lens_of("SIMPLE_RADIAL_FISHEYE", (0.0,)).is_pinhole


def test_depth_is_not_mixed_over_an_edge():
    depth_m = np.zeros((HEIGHT, WIDTH), np.float32)
    depth_m[:, : WIDTH // 2] = 3
    depth_m[10:20] = 1.5
    assert set(np.unique(undistort(lens_of("SIMPLE_RADIAL")).nearest(depth_m))) <= {0.0, 1.5, 3.0}


def test_what_the_photograph_does_not_show_is_black_and_has_no_depth():
    undistortion = undistort(lens_of("SIMPLE_RADIAL", (0.5,)))  # the corners come from outside
    assert not undistortion.inside[0, 0]
    assert undistortion.inside[HEIGHT // 2, WIDTH // 2]
    assert (undistortion.smooth(np.full((HEIGHT, WIDTH, 3), 200, np.uint8))[~undistortion.inside] == 0).all()
    assert undistortion.nearest(np.ones((HEIGHT, WIDTH), np.float32))[0, 0] == 0


def test_a_polynomial_that_turns_back_shows_nothing_twice():
    lens = Lens(model="SIMPLE_RADIAL", width_px=64, height_px=48, parameters=(30.0, 32.0, 24.0, -0.9))
    undistortion = undistort(lens)  # r (1 - 0.9 r²) is largest at r = 0.61
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    radius = np.hypot(columns - 32, rows - 24) / 30
    assert not undistortion.inside[(radius > 0.68) & (radius < 1.0)].any()
    assert undistortion.inside[radius < 0.55].all()


@pytest.mark.parametrize("coefficients", [(1e9, -1e9, 1e9, 1e9), (-1e8, 1.0, 0.0, 0.0)])
@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"])
def test_absurd_coefficients_break_nothing(model, coefficients):
    undistortion = undistort(lens_of(model, coefficients * 2))
    assert np.isfinite(undistortion.x).all()
    assert undistortion.smooth(np.zeros((HEIGHT, WIDTH, 3), np.uint8)).shape == (HEIGHT, WIDTH, 3)
    assert undistortion.nearest(np.zeros((HEIGHT, WIDTH), np.float32)).shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize("model", LENS_MODELS)
def test_scaling_keeps_directions(model):
    lens = lens_of(model)
    scaled = scale_lens(lens, 160, 120)
    for x, y in ((0.0, 0.0), (20.0, 40.0)):
        ours = [
            (place - middle) / focal for place, middle, focal in zip((x, y), lens.center_px, lens.focal_px, strict=True)
        ]
        theirs = [
            (2.5 * place - middle) / focal
            for place, middle, focal in zip((x, y), scaled.center_px, scaled.focal_px, strict=True)
        ]
        np.testing.assert_allclose(theirs, ours, rtol=1e-12)
    assert scaled.distortion == lens.distortion


def test_scaling_allows_for_whole_pixels_and_no_more():
    lens = Lens(model="PINHOLE", width_px=4032, height_px=3024, parameters=(3000.0, 3000.0, 2016.0, 1512.0))
    assert scale_lens(lens, 1000, 750).center_px == (500, 375)
    assert scale_lens(lens, 333, 250).width_px == 333  # 249.75
    with pytest.raises(ValueError, match="4000×2000 has other proportions than 4032×3024"):
        scale_lens(lens, 4000, 2000)
    with pytest.raises(ValueError, match="other proportions"):
        scale_lens(lens, 3024, 4032)
