"""What capture.toml states of up and unit: read, and written into a copy."""

import numpy as np
import pytest
from usdfoliage.capture.folder.settings import CaptureSettings, read_capture_settings, read_stated_unit, state_frame


def read(folder, text):
    (folder / "capture.toml").write_text(text, encoding="utf-8")
    return read_capture_settings(folder)[0]


@pytest.mark.parametrize(
    ("text", "axis", "up"),
    [
        ("", "auto", (0, 1, 0)),
        ('up_axis = "AUTO"', "auto", (0, 1, 0)),
        ('up_axis = "-y"', "-Y", (0, -1, 0)),
        ('up_axis = "+z"', "Z", (0, 0, 1)),
        ('up_axis = "X"', "X", (1, 0, 0)),
        ('up_axis = "X"\nup_vector = [0, 3, -4]', "X", (0, 0.6, -0.8)),
    ],
)
def test_up_is_an_axis_or_a_direction(text, axis, up, tmp_path):
    settings = read(tmp_path, text)
    assert settings.up_axis == axis
    np.testing.assert_allclose(settings.up, up)
    assert settings.knows_up == (axis != "auto")


def test_only_a_unit_that_is_there_is_stated(tmp_path):
    assert read_stated_unit(tmp_path) is None
    read(tmp_path, "metres_per_unit = 0.01")
    assert read_stated_unit(tmp_path) == 0.01


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\ufeff# ours\r\nname = 'x'\r\n",
        'up_axis = "auto" # find it\nname = "x"\nmetres_per_unit = 3\n[scale_bar]\na = 1\n',
    ],
)
@pytest.mark.parametrize(
    "settings",
    [CaptureSettings(up_axis="-Z", metres_per_unit=0.5), CaptureSettings(up_vector=(0.1, 0.2, 0.3), metres_per_unit=2)],
)
def test_a_copy_states_what_was_found(text, settings, tmp_path):
    stated = state_frame(text, settings)
    found = read(tmp_path, stated)
    assert (found.up_vector, found.metres_per_unit) == (settings.up_vector, settings.metres_per_unit)
    np.testing.assert_array_equal(found.up, settings.up)
    assert found.name == ("x" if "name" in text else "")
    assert state_frame(stated, settings) == stated
