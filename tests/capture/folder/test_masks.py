import logging

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.capture.folder.masks import CleanMaskSettings, clean_mask, read_mask
from usdfoliage.errors import CaptureError

HEIGHT, WIDTH = 90, 120


def disc(row: float, column: float, radius: float, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> np.ndarray:
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]]
    return (rows - row) ** 2 + (columns - column) ** 2 <= radius**2


@pytest.fixture
def plant() -> np.ndarray:
    mask = disc(40, 50, 30)
    mask[10:20, 100:110] = True  # no symmetry
    return mask


def write_grey(path, values: np.ndarray, **attributes):
    values = values if values.ndim == 3 else values[..., None]
    spec = oiio.ImageSpec(
        values.shape[1], values.shape[0], values.shape[2], str(values.dtype).replace("float32", "float")
    )
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(values)), output.geterror()
    output.close()
    return path


# read_mask


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 1.0)])
@pytest.mark.parametrize("channels", [1, 3])
def test_types(tmp_path, plant, dtype, white, channels):
    values = np.repeat((plant * white).astype(dtype)[..., None], channels, axis=2)
    path = write_grey(tmp_path / "mask.tif", values)
    np.testing.assert_array_equal(read_mask(path, plant.shape), plant)


def test_threshold_is_half(tmp_path):
    values = np.repeat(np.arange(256, dtype=np.uint8)[None, :], 20, axis=0)
    path = write_grey(tmp_path / "mask.png", values)
    np.testing.assert_array_equal(read_mask(path, values.shape), values >= 128)


def test_one_bit(tmp_path, plant):
    cv2.imwrite(str(tmp_path / "mask.png"), plant.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png", plant.shape), plant)
    write_grey(tmp_path / "mask.tif", plant.astype(np.uint8) * 255, oiio__BitsPerSample=1)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.tif", plant.shape), plant)


@pytest.mark.parametrize("paint", [0, 90, 255], ids=["black", "grey", "white"])
def test_alpha_alone(tmp_path, plant, paint):
    values = np.full((*plant.shape, 4), paint, np.uint8)
    values[..., 3] = plant * 255
    cv2.imwrite(str(tmp_path / "mask.png"), values)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png", plant.shape), plant)


def test_cut_out_photograph(tmp_path, plant):
    values = np.random.default_rng(0).integers(0, 256, (*plant.shape, 4), dtype=np.uint8)
    values[..., 3] = plant * 255
    cv2.imwrite(str(tmp_path / "mask.png"), values)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png", plant.shape), plant)


def test_black_and_white_with_alpha(tmp_path, plant):
    values = np.repeat((plant * np.uint8(255))[..., None], 4, axis=2)
    values[..., 3] = 255
    values[:5, :5, 3] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), values)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png", plant.shape), plant)


def test_opaque_alpha_is_ignored(tmp_path, plant):
    values = np.repeat((plant * np.uint8(255))[..., None], 4, axis=2)
    values[..., 3] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), values)
    np.testing.assert_array_equal(read_mask(tmp_path / "mask.png", plant.shape), plant)


def test_jpeg(tmp_path, plant):
    cv2.imwrite(str(tmp_path / "mask.jpg"), plant.astype(np.uint8) * 255)
    assert np.count_nonzero(read_mask(tmp_path / "mask.jpg", plant.shape) != plant) <= 2


def test_mask_of_the_stored_photograph_is_turned_with_it(tmp_path, plant, caplog):
    path = write_grey(tmp_path / "mask.png", plant.astype(np.uint8) * 255)
    with caplog.at_level(logging.INFO):
        turned = read_mask(path, (WIDTH, HEIGHT, 3), photo_orientation=6)
    np.testing.assert_array_equal(turned, np.rot90(plant, -1))
    assert "orientation 6" in caplog.text


def test_mask_of_the_upright_photograph_is_not_turned(tmp_path, plant):
    path = write_grey(tmp_path / "mask.png", plant.astype(np.uint8) * 255)
    np.testing.assert_array_equal(read_mask(path, plant.shape, photo_orientation=6), plant)


def test_the_mask_s_own_orientation(tmp_path, plant):
    path = write_grey(tmp_path / "mask.tif", plant.astype(np.uint8) * 255, Orientation=8)
    np.testing.assert_array_equal(read_mask(path, (WIDTH, HEIGHT)), np.rot90(plant))


def test_another_size(tmp_path, plant):
    path = write_grey(tmp_path / "mask.png", plant.astype(np.uint8) * 255)
    with pytest.raises(CaptureError, match=r"mask.png is 120×90 pixels, its photograph 640×480"):
        read_mask(path, (480, 640, 3))
    with pytest.raises(CaptureError, match="its photograph 90×120"):
        read_mask(path, (WIDTH, HEIGHT, 3))  # turned, but the photograph was not


def test_empty(tmp_path, plant):
    path = write_grey(tmp_path / "mask.png", np.zeros(plant.shape, np.uint8))
    with pytest.raises(CaptureError, match=r"mask.png is empty.* 0.0% of white"):
        read_mask(path, plant.shape)


def test_labels_instead_of_white(tmp_path, plant):
    path = write_grey(tmp_path / "mask.png", plant.astype(np.uint8))
    with pytest.raises(CaptureError, match=r"empty: its brightest pixel is 0.4% of white"):
        read_mask(path, plant.shape)


def test_full(tmp_path, plant):
    path = write_grey(tmp_path / "mask.png", np.full(plant.shape, 255, np.uint8))
    with pytest.raises(CaptureError, match=r"mask.png is full"):
        read_mask(path, plant.shape)


def test_bad_files_are_refused(tmp_path):
    with pytest.raises(CaptureError, match="does not exist"):
        read_mask(tmp_path / "none.png", (90, 120))


# clean_mask


def test_disc_with_hole_and_second_component():
    mask = disc(45, 45, 30) & ~disc(45, 50, 6)
    other = disc(20, 105, 8)
    result = clean_mask(mask | other)
    np.testing.assert_array_equal(result.mask, disc(45, 45, 30))
    share = mask.sum() / (mask.sum() + other.sum())
    assert result.remarks[0].text == f"2 components; the largest, {share:.1%} of the area, was taken"
    assert result.remarks[1].text.startswith("1 hole filled, ")
    assert len(result.remarks) == 2


def test_a_clean_mask_stays_and_has_no_remarks():
    result = clean_mask(disc(45, 45, 30))
    np.testing.assert_array_equal(result.mask, disc(45, 45, 30))
    assert result.remarks == ()


def test_large_holes_can_be_kept():
    mask = disc(45, 50, 40) & ~disc(45, 40, 15) & ~disc(45, 70, 3)
    result = clean_mask(mask, CleanMaskSettings(fill_holes_up_to=0.05))
    np.testing.assert_array_equal(result.mask, disc(45, 50, 40) & ~disc(45, 40, 15))
    assert [each.text.split(",")[0] for each in result.remarks] == ["1 hole filled", "1 hole kept"]
    untouched = clean_mask(mask, CleanMaskSettings(fill_holes_up_to=0))
    np.testing.assert_array_equal(untouched.mask, mask)


def test_diagonal_neighbors_are_one_component():
    mask = np.zeros((80, 80), np.bool_)
    mask[5:35, 5:35] = True
    mask[35:65, 35:65] = True
    assert clean_mask(mask).mask.sum() == 1800


def test_a_gap_that_reaches_the_border_is_not_a_hole():
    mask = np.zeros((80, 80), np.bool_)
    mask[:60, 10:70] = True
    mask[:30, 35:45] = False
    result = clean_mask(mask)
    np.testing.assert_array_equal(result.mask, mask)
    assert [each.text for each in result.remarks] == ["the mask touches the image border (top): the crown is cut there"]


def test_every_border_is_named():
    mask = np.zeros((80, 80), np.bool_)
    mask[:, 20:60] = True
    mask[20:60, :] = True
    assert "(left, right, top, bottom)" in clean_mask(mask).remarks[0].text


def test_too_small_a_crown():
    with pytest.raises(CaptureError, match="21×21 pixels; at least 24"):
        clean_mask(disc(45, 45, 10))
    thin = np.zeros((80, 80), np.bool_)
    thin[10:70, 30:40] = True
    with pytest.raises(CaptureError, match="10×60 pixels"):
        clean_mask(thin)


def test_no_plant():
    with pytest.raises(CaptureError, match="empty"):
        clean_mask(np.zeros((80, 80), np.bool_))


def test_wrong_arguments():
    with pytest.raises(ValueError, match="of bool"):
        clean_mask(np.zeros((80, 80), np.uint8))
    with pytest.raises(ValueError, match="fill_holes_up_to"):
        CleanMaskSettings(fill_holes_up_to=1.5)
    with pytest.raises(ValueError, match="min_width_px"):
        CleanMaskSettings(min_width_px=0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), share=st.floats(0.3, 0.8))
def test_cleaning_is_idempotent_and_only_fills(seed, share):
    noise = cv2.GaussianBlur(np.random.default_rng(seed).random((80, 100)), (0, 0), 6)
    mask = noise > np.quantile(noise, 1 - share)
    try:
        once = clean_mask(mask).mask
    except CaptureError:
        return
    twice = clean_mask(once)
    np.testing.assert_array_equal(twice.mask, once)
    components, _labels = cv2.connectedComponents(once.astype(np.uint8), connectivity=8)
    assert components == 2
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    edge = once & ~cv2.erode(once.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1).astype(bool)
    assert grown[edge].all()  # no new silhouette
