import cv2
import numpy as np
import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.crown.tangent import read_tangent


def test_auto_and_numbers():
    assert read_tangent("auto") is None
    assert read_tangent("2.5") == 2.5


def test_a_formula_in_i_from_the_left_and_j_from_the_top():
    tangent = read_tangent("1 + 2*j + sin(pi*i)/4")

    size = len(tangent)
    share = (np.arange(size) + 0.5) / size
    assert tangent == pytest.approx(1 + 2 * share[:, None] + np.sin(np.pi * share) / 4)


def test_a_constant_formula_is_a_map():
    assert read_tangent("max(1, 2)") == pytest.approx(np.full((256, 256), 2.0))


def test_an_image_stands_for_0_to_4(tmp_path):
    path = tmp_path / "my tangent.png"
    cv2.imwrite(str(path), np.full((20, 30), 51, np.uint8))

    assert read_tangent(str(path)) == pytest.approx(np.full((20, 30), 0.8))


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "i.__class__",
        "(lambda: 1)()",
        "[1][0]",
        "unknown + 1",
        "sin(1, 2, 3)",
        "1 +",
        "True",
        "",
        "'text'",
        "i if j else 1",
        "sin(i, out=j)",
    ],
)
def test_nothing_but_arithmetic_is_understood(text):
    with pytest.raises(FoliageError, match="is no number, file or formula"):
        read_tangent(text)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "1e-9", "50"])
def test_a_number_must_be_positive(text):
    with pytest.raises(FoliageError, match="positive"):
        read_tangent(text)


@pytest.mark.parametrize("text", ["i - 0.5", "1/(i - i)", "sqrt(-1 - i)"])
def test_a_formula_must_be_positive_everywhere(text):
    with pytest.raises(FoliageError, match=r"from 0\.1 to 10 everywhere; at i = 0\.002, j = 0\.002"):
        read_tangent(text)


def test_a_missing_map_is_named():
    with pytest.raises(FoliageError, match=r"there is no such map \(absent\.exr\)"):
        read_tangent("absent.exr")
