"""What is a warning of an asset of branches, and what is not."""

import pytest
from usdfoliage.cli.remarks import render_for
from usdfoliage.jobs.branches.warnings import check_growth, check_height, check_stems, check_surface

RENDER = render_for("branches")


@pytest.mark.parametrize(("height_m", "metres_per_unit"), [(0.05, 1.0), (0.3, 0.001), (130.0, 1.0), (4.0, 0.01)])
def test_heights_of_plants_are_no_warning(height_m, metres_per_unit):
    assert check_height(height_m, metres_per_unit) == []


@pytest.mark.parametrize(
    ("height_m", "metres_per_unit", "text", "units"),
    [
        (0.0049, 0.001, "4.9 mm high", {"m": "4.9 m high", "ft": "1.49 m high"}),
        (4940.0, 1.0, "4,940 m high", {"cm": "49.4 m high", "mm": "4.94 m high"}),
        (0.02, 1.0, "20 mm high", {}),
    ],
)
def test_another_height_is_a_warning_with_the_units_that_a_plant_has(height_m, metres_per_unit, text, units):
    (warning,) = check_height(height_m, metres_per_unit)
    sentence = warning.sentence(RENDER)
    assert warning.code == "plant-height-improbable"
    assert text in sentence
    assert sentence.count("--unit") == len(units)
    for name, height in units.items():
        assert f"--unit {name} ({height})" in sentence


def test_branches_of_which_many_are_not_joined_are_a_warning():
    assert check_surface(100, 20, 10) == []
    assert check_surface(2, 1, 0) == []  # a stem with one spur
    (warning,) = check_surface(100, 20, 11)
    assert warning.text.startswith("31 % of the branches are not joined")
    assert "--cloud-leaves on" in warning.sentence(RENDER)
    assert "method grow" in warning.sentence(RENDER)


def test_growth_through_a_part_of_the_cloud_is_a_warning():
    assert check_growth(0.7, 0.01) == []
    (warning,) = check_growth(0.27, 0.0075)
    assert "27 % of the points" in warning.text
    assert "--internode 0.03" in warning.sentence(RENDER)


def test_a_cloud_without_stems_is_a_warning():
    assert check_stems(0.01, 1.0, 0.01) == check_stems(0.01, 0.25, 0.01) == check_stems(0.2, 0.0, 0.01) == []
    (warning,) = check_stems(0.01, 1 / 12, 0.01)  # one in a hedge may look like one
    assert check_stems(0.01, 0.0, 0.01) == [warning]
    assert "no stem is seen at a root" in warning.text
    assert "an internode of 0.04 m" in warning.sentence(RENDER)
    (warning,) = check_stems(0.0, 1.0, 0.01)
    assert "no stem or branch of the cloud is round" in warning.text
