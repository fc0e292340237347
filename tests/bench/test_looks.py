"""The bench of looks: Storm by each description of a material, and Blender, show the same colours."""

import subprocess

import numpy as np
import pytest
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.preview.recorder import find_interpreter

from tools.bench.looks import CARD_PX, MAX_DIFFERENCE, SPACING_M, STORM, compare, list_cards, measure_patches

pytestmark = pytest.mark.preview


def test_all_applications_show_the_true_colors(tmp_path):
    try:
        python = find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    has_blender = not subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode
    found = compare(tmp_path, blender=has_blender)
    assert found.keys() == {"true", *STORM, *(["Blender"] if has_blender else [])}
    for name, colors in found.items():
        furthest = np.abs(colors - found["true"]).max(axis=(1, 2, 3))
        far = {card.name: value for card, value in zip(list_cards(), furthest, strict=True) if value > MAX_DIFFERENCE}
        assert far == {}, name


def test_a_patch_is_measured_in_its_middle():
    count = len(list_cards())
    picture = np.zeros((CARD_PX, round(CARD_PX * SPACING_M * count), 3))
    picture[:32, round(CARD_PX * 0.625) : round(CARD_PX * 1.125)] = (1, 2, 3)  # above on the right of the first card
    found = measure_patches(picture)
    np.testing.assert_array_equal(found[0, 0, 1], (1, 2, 3))
    assert found.sum() == 6
