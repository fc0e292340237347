"""The colour cubemap: unfolding, the merges, the photograph in front."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.crown import color_map
from usdfoliage.crown.color_map import (
    ColorMapSettings,
    build_color_map,
    cut_strip,
)
from usdfoliage.crown.tone import ColorStatistics, measure_color_statistics
from usdfoliage.errors import FoliageError
from usdfoliage.geometry.color import decode_srgb, encode_srgb
from usdfoliage.geometry.cubemap import FACES, face_directions, sample_cubemap, share_borders, texel_identity

FRONT = FACES.index("+Z")
SIZE = 32
BAND = 4


def field(directions):
    """A smooth colour in every direction, different on every face and corner, in 0.2..0.8."""
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(
        [0.5 + 0.3 * np.sin(2 * x + y), 0.5 + 0.3 * np.sin(2 * y + z), 0.5 + 0.3 * np.sin(2 * z + x)], axis=-1
    )


def field_on_cube(size=SIZE):
    return field(face_directions(size)).astype(np.float32)


def foliage(shape, seed=0, blob_px=2.0):
    """Blobs of leaf-like colours, linear, with structure of a few pixels."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(*shape, 3)), (blob_px, blob_px, 0))
    noise = noise / noise.std() + gaussian_filter(noise, (0, 0, 1)) / noise.std()
    return decode_srgb(np.clip([0.3, 0.45, 0.2] + 0.13 * noise, 0.01, 0.99).astype(np.float32))


def photo_of_sphere(photo, size):
    """A square photograph of a sphere that fills it: what each texel sees, and how squarely."""
    directions = face_directions(size)
    rows, columns = photo.shape[:2]
    row = np.clip(np.rint((1 - directions[..., 1]) / 2 * (rows - 1)), 0, rows - 1).astype(int)
    column = np.clip(np.rint((1 + directions[..., 0]) / 2 * (columns - 1)), 0, columns - 1).astype(int)
    return photo[row, column], np.maximum(directions[..., 2], 0)


def seam_ratio(cubemap):
    """Mean step over two texels across the cube's edges, of that inside faces."""
    size = cubemap.shape[1]
    edge = size - 1
    identity = texel_identity(size)
    inner = {}  # identity of a border texel -> the texels next to it inside the faces that share it
    for face in range(6):
        for along in range(1, edge):
            for border, near in (
                ((face, 0, along), (face, 1, along)),
                ((face, edge, along), (face, edge - 1, along)),
                ((face, along, 0), (face, along, 1)),
                ((face, along, edge), (face, along, edge - 1)),
            ):
                inner.setdefault(identity[border], []).append(cubemap[near])
    across = np.abs([first - second for first, second in inner.values()]).mean()
    rows, columns = cubemap[:, 2:] - cubemap[:, :-2], cubemap[:, :, 2:] - cubemap[:, :, :-2]
    return across / ((np.abs(rows).mean() + np.abs(columns).mean()) / 2)


# ---- unfolding


def test_the_strip_is_continuous_in_every_direction():
    """Neighbours in the strip are neighbours on the cube, over all twelve edges, but for the corners."""
    size, band = 33, 8
    strip = cut_strip(face_directions(size), band)
    assert strip.shape == (size + 2 * band, 4 * (size - 1), 3)
    step = 2.01 / (size - 1)
    right = np.linalg.norm(strip - np.roll(strip, -1, axis=1), axis=-1)
    down = np.linalg.norm(strip[1:] - strip[:-1], axis=-1)
    assert down.max() < step
    lateral = right[band : band + size]
    assert lateral.max() < step
    folded = np.ones(strip.shape[1], bool)
    folded[size - 2 :: size - 1] = False  # from one side's band to the next one's
    assert right[:, folded].max() < step
    assert right[:band, ~folded].max() > step


def test_a_strip_shows_the_front_as_the_camera_mirrored():
    strip = cut_strip(face_directions(9), 2)
    front = strip[2 + 4, 8 + 4]
    np.testing.assert_allclose(front, [0, 0, 1], atol=1e-12)
    assert strip[2 + 4, 8 + 5, 0] < 0  # x runs to the left
    assert strip[2 + 3, 8 + 4, 1] > 0  # y runs up
    np.testing.assert_allclose(strip[0, 8 + 4], face_directions(9)[FACES.index("+Y"), 2, 4])
    np.testing.assert_allclose(strip[-1, 8 + 4], face_directions(9)[FACES.index("-Y"), 9 - 3, 4])


@settings(max_examples=15, deadline=None)
@given(size=st.integers(8, 24), data=st.data())
def test_every_texel_of_a_strip_is_one_of_the_cube(size, data):
    band = data.draw(st.integers(1, size - 1))
    strip = cut_strip(texel_identity(size), band)
    np.testing.assert_array_equal(np.unique(strip[band:-band]), np.unique(texel_identity(size)[[0, 1, 4, 5]]))
    if band == size - 1:  # then the fold shows all of the top
        assert len(np.unique(strip)) == 6 * (size - 1) ** 2 + 2


# ---- the merges, with a synthesis whose result is known


def strip_of(cubemap, band):
    """What the synthesis of the strip would be if it made this cubemap: the front in the middle, the start repeated."""
    strip = np.roll(cut_strip(cubemap, band), cubemap.shape[1] // 2, axis=1)
    return np.concatenate([strip, strip[:, :band]], axis=1)


@pytest.fixture
def synthesis_of(monkeypatch):
    """Replace the texture synthesis by one that returns given cubemaps; tone is left as it is."""

    def install(strip_cube, cap_cube):
        images = [
            strip_of(strip_cube, BAND),
            np.rot90(cap_cube[FACES.index("+Y")], 2),
            np.rot90(cap_cube[FACES.index("-Y")], 2),
        ]
        asked = []

        def synthesize(exemplar, shape, rng, *, exemplar_mask, known, known_mask, settings, progress):
            image = images[len(asked)]
            assert image.shape == (*shape, 3)
            asked.append((exemplar, exemplar_mask, known, known_mask))
            return np.where(known_mask[..., None], known, image).astype(np.float32)

        monkeypatch.setattr(color_map, "synthesize_texture", synthesize)
        monkeypatch.setattr(color_map, "blend_tone", lambda encoded, *_: encoded)
        monkeypatch.setattr(color_map, "match_statistics", lambda encoded, *_: decode_srgb(encoded))
        return asked

    return install


def build(photo, weight, exemplar=None, target=None):
    exemplar = foliage((SIZE, SIZE)) if exemplar is None else exemplar
    return build_color_map(
        exemplar,
        np.ones(exemplar.shape[:2], bool),
        photo,
        weight,
        measure_color_statistics(exemplar) if target is None else target,
        np.random.default_rng(0),
    )


def test_what_is_synthesised_of_one_field_comes_back_as_that_field(synthesis_of):
    """All three images cut from one field: strip, faces and merges put every texel where it was."""
    encoded = field_on_cube()
    synthesis_of(encoded, encoded)
    result = build(np.zeros((6, SIZE, SIZE, 3), np.float32), np.zeros((6, SIZE, SIZE), np.float32))
    np.testing.assert_allclose(encode_srgb(result), encoded, atol=1e-5)


def test_caps_take_the_border_of_the_strip_and_keep_their_inside(synthesis_of):
    strip_cube, cap_cube = field_on_cube(), 1 - field_on_cube()
    synthesis_of(strip_cube, cap_cube)
    result = encode_srgb(build(np.zeros((6, SIZE, SIZE, 3), np.float32), np.zeros((6, SIZE, SIZE), np.float32)))
    for face in (FACES.index("+Y"), FACES.index("-Y")):
        inside = slice(BAND, SIZE - BAND)
        np.testing.assert_allclose(result[face, inside, inside], cap_cube[face, inside, inside], atol=1e-5)
        for border in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
            np.testing.assert_allclose(result[face][border], strip_cube[face][border], atol=1e-5)
        either = np.isclose(result[face], strip_cube[face], atol=1e-5) | np.isclose(
            result[face], cap_cube[face], atol=1e-5
        )
        assert either.all()


def test_the_photograph_is_kept_in_front_and_the_synthesis_beside_it(synthesis_of):
    synthesised = field_on_cube()
    asked = synthesis_of(synthesised, synthesised)
    photo = decode_srgb(1 - field_on_cube())
    weight = np.maximum(face_directions(SIZE)[..., 2], 0).astype(np.float32)
    result = build(photo, weight)
    kept = weight >= ColorMapSettings().keep_weight
    kept[FRONT] = True
    np.testing.assert_allclose(result[kept], photo[kept], atol=1e-5)
    beyond = weight < ColorMapSettings().reach_weight
    np.testing.assert_allclose(encode_srgb(result[beyond]), synthesised[beyond], atol=1e-5)
    # Each synthesis got the known pixels to grow from: nearly all of the front in the strip, less of top and bottom.
    shares = [known_mask.mean() for _, _, _, known_mask in asked]
    assert 0.15 < shares[0] < 0.25
    assert shares[1] == pytest.approx(shares[2])
    assert 0 < shares[1] < 0.2


def test_the_border_of_the_photograph_does_not_follow_the_edge_of_the_cube(synthesis_of):
    """Some way beyond the front is seen squarely enough, and the images agree best away from the edge."""
    synthesised = field_on_cube()
    photo = 1 - field_on_cube()
    z = face_directions(SIZE)[..., 2]
    reach, keep = ColorMapSettings().reach_weight, ColorMapSettings().keep_weight
    border = reach + 0.6 * (keep - reach)
    agree = (z > reach) & (z < border)
    photo[agree] = synthesised[agree]
    synthesis_of(synthesised, synthesised)
    result = encode_srgb(build(decode_srgb(photo), np.maximum(z, 0)))
    for face in (FACES.index("+X"), FACES.index("-X")):
        taken = np.all(np.isclose(result[face], photo[face], atol=1e-5), axis=-1)
        assert taken[z[face] > border].mean() > 0.95


def test_what_the_front_shows_at_a_grazing_angle_may_be_synthesised(synthesis_of):
    synthesised = field_on_cube()
    synthesis_of(synthesised, synthesised)
    weight = np.where(face_directions(SIZE)[..., 2] > 0.8, 0.9, 0.0)
    weight[FRONT] = np.where(weight[FRONT] > 0, 0.9, 0.1)
    photo = decode_srgb(1 - field_on_cube())
    result = build(photo, weight)
    np.testing.assert_allclose(result[weight > 0.5], photo[weight > 0.5], atol=1e-5)
    np.testing.assert_allclose(encode_srgb(result[weight == 0]), synthesised[weight == 0], atol=1e-5)


def test_the_exemplar_is_mirrored_with_the_faces(synthesis_of):
    asked = synthesis_of(field_on_cube(), field_on_cube())
    exemplar = foliage((20, 30))
    build(np.zeros((6, SIZE, SIZE, 3), np.float32), np.zeros((6, SIZE, SIZE), np.float32), exemplar)
    for given_exemplar, given_mask, _, _ in asked:
        np.testing.assert_allclose(decode_srgb(given_exemplar), exemplar[:, ::-1], atol=1e-6)
        assert given_mask.shape == (20, 30)


def test_a_photograph_brighter_than_white_comes_back(synthesis_of):
    synthesis_of(field_on_cube(), field_on_cube())
    exemplar = foliage((SIZE, SIZE)) * 4
    exemplar[0, 0] = 5.0
    photo = np.full((6, SIZE, SIZE, 3), 4.5, np.float32)
    weight = np.maximum(face_directions(SIZE)[..., 2], 0).astype(np.float32)
    result = build(photo, weight, exemplar)
    # The replaced tone returns encoded values decoded, without their peak.
    np.testing.assert_allclose(result[FRONT] * 5.0, 4.5, rtol=1e-4)


# ---- all of it, with the real synthesis


@pytest.fixture(scope="module")
def crown():
    """A sphere photographed at four pixels a texel, built once."""
    size = 64
    photo = foliage((4 * size, 4 * size), blob_px=3.0)
    exemplar = photo.reshape(size, 4, size, 4, 3).mean(axis=(1, 3))
    on_cube, weight = photo_of_sphere(exemplar, size)
    calls = []
    result = build_color_map(
        exemplar,
        np.ones((size, size), bool),
        on_cube,
        weight,
        measure_color_statistics(photo),
        np.random.default_rng(5),
        progress=lambda done, total: calls.append((done, total)),
    )
    return photo, exemplar, on_cube, weight, result, calls


def test_the_whole_is_a_proper_cubemap(crown):
    *_, result, calls = crown
    assert result.shape == (6, 64, 64, 3)
    assert result.dtype == np.float32
    assert np.isfinite(result).all()
    assert result.min() >= 0
    np.testing.assert_array_equal(share_borders(result), result)
    done = [d for d, _ in calls]
    assert done == sorted(done)
    assert len({t for _, t in calls}) == 1
    assert done[-1] == calls[-1][1]


def test_mean_and_contrast_are_those_of_the_photograph(crown):
    photo, *_, result, _ = crown
    target, got = measure_color_statistics(photo), measure_color_statistics(result)
    np.testing.assert_allclose(got.mean / target.mean, 1, atol=0.01)
    np.testing.assert_allclose(got.std / target.std, 1, atol=0.06)


def test_steps_across_the_edges_are_like_those_inside(crown):
    *_, result, _ = crown
    assert 0.7 < seam_ratio(result) < 1.25


def test_the_front_is_the_photograph_up_to_contrast(crown):
    _, _, on_cube, _, result, _ = crown
    for channel in range(3):
        # Monotone up to the neighbourhood, so the pictures correlate strongly but need not be equal.
        seen, found = encode_srgb(on_cube[FRONT, ..., channel]), encode_srgb(result[FRONT, ..., channel])
        assert np.corrcoef(seen.ravel(), found.ravel())[0, 1] > 0.97
        assert result[FRONT, ..., channel].mean() == pytest.approx(on_cube[FRONT, ..., channel].mean(), rel=0.06)


def test_the_seam_measure_knows_a_smooth_field_a_step_and_a_blurred_band():
    noise = share_borders(np.random.default_rng(0).random((6, 64, 64, 3)))
    assert seam_ratio(noise) == pytest.approx(1, abs=0.05)
    stepped = noise + np.arange(6)[:, None, None, None]
    assert seam_ratio(stepped) > 3
    blurred = noise.copy()
    blurred[:, [1, -2]] = 0.5
    blurred[:, :, [1, -2]] = 0.5
    assert seam_ratio(blurred) < 0.1


def test_same_seed_same_result(crown):
    photo, exemplar, on_cube, weight, result, _ = crown
    mask = np.ones(exemplar.shape[:2], bool)
    target = measure_color_statistics(photo)
    again = build_color_map(exemplar, mask, on_cube, weight, target, np.random.default_rng(5))
    np.testing.assert_array_equal(again, result)


def test_without_a_photograph_in_sight_all_is_synthesised():
    exemplar = foliage((48, 48))
    result = build(np.zeros((6, SIZE, SIZE, 3), np.float32), np.zeros((6, SIZE, SIZE), np.float32), exemplar)
    target, got = measure_color_statistics(exemplar), measure_color_statistics(result)
    np.testing.assert_allclose(got.mean / target.mean, 1, atol=0.01)
    assert sample_cubemap(result, np.array([0.0, 0.0, 1.0])).max() > 0


def test_a_photograph_of_one_colour_stays_that_colour():
    color = np.array([0.1, 0.3, 0.05], np.float32)
    exemplar = np.broadcast_to(color, (40, 40, 3)).copy()
    photo = np.broadcast_to(color, (6, SIZE, SIZE, 3)).copy()
    weight = np.maximum(face_directions(SIZE)[..., 2], 0).astype(np.float32)
    np.testing.assert_allclose(build(photo, weight, exemplar), np.broadcast_to(color, photo.shape), rtol=2e-3)


# ---- what is refused


def test_shapes_that_do_not_fit_are_refused():
    exemplar = foliage((40, 40))
    cube, weight = np.zeros((6, SIZE, SIZE, 3), np.float32), np.zeros((6, SIZE, SIZE), np.float32)
    with pytest.raises(ValueError, match="photo_on_cube and photo_weight"):
        build(cube, weight[:, 1:], exemplar)
    with pytest.raises(ValueError, match="N at least 8"):
        build(cube[:, :4, :4], weight[:, :4, :4], exemplar)
    with pytest.raises(ValueError, match="exemplar must be"):
        build_color_map(
            exemplar,
            np.ones((40, 41), bool),
            cube,
            weight,
            measure_color_statistics(exemplar),
            np.random.default_rng(0),
        )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"band": 0.0}, "band"),
        ({"band": 0.3}, "band"),
        ({"keep_weight": 0.4}, "reach_weight <= keep_weight"),
        ({"front_weight": 0.7}, "front_weight <= keep_weight"),
        ({"reach_weight": 0.0}, "reach_weight"),
        ({"keep_weight": 1.5}, "keep_weight <= 1"),
    ],
)
def test_settings_refuse_what_makes_no_sense(wrong, message):
    with pytest.raises(ValueError, match=message):
        ColorMapSettings(**wrong)


def test_an_exemplar_without_a_pixel_is_an_error_with_a_reason():
    exemplar = foliage((40, 40))
    with pytest.raises((FoliageError, ValueError)):
        build_color_map(
            exemplar,
            np.zeros((40, 40), bool),
            np.zeros((6, SIZE, SIZE, 3), np.float32),
            np.zeros((6, SIZE, SIZE), np.float32),
            ColorStatistics(mean=np.full(3, 0.1), std=np.full(3, 0.1)),
            np.random.default_rng(0),
        )
