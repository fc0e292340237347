"""What is doubted in an asset of branches, and what is not."""

import pytest
from usdfoliage.jobs.branches.warnings import doubt_growth, doubt_height, doubt_stems, doubt_surface


@pytest.mark.parametrize(("height_m", "metres_per_unit"), [(0.05, 1.0), (0.3, 0.001), (130.0, 1.0), (4.0, 0.01)])
def test_heights_of_plants_are_not_doubted(height_m, metres_per_unit):
    assert doubt_height(height_m, metres_per_unit) == []


@pytest.mark.parametrize(
    ("height_m", "metres_per_unit", "told", "units"),
    [
        (0.0049, 0.001, "4.9 mm high", {"m": "4.9 m high", "ft": "1.49 m high"}),
        (4940.0, 1.0, "4,940 m high", {"cm": "49.4 m high", "mm": "4.94 m high"}),
        (0.02, 1.0, "20 mm high", {}),
    ],
)
def test_another_height_is_told_with_the_units_that_a_plant_has(height_m, metres_per_unit, told, units):
    (doubt,) = doubt_height(height_m, metres_per_unit)
    assert told in doubt
    assert doubt.count("--unit") == len(units)
    for name, height in units.items():
        assert f"--unit {name} ({height})" in doubt


def test_branches_of_which_many_are_not_joined_are_doubted():
    assert doubt_surface(100, 20, 10) == []
    assert doubt_surface(2, 1, 0) == []  # a stem with one spur
    (doubt,) = doubt_surface(100, 20, 11)
    assert doubt.startswith("31 % of the branches are not joined")
    assert "--method grow" in doubt


def test_growth_through_a_part_of_the_cloud_is_doubted():
    assert doubt_growth(0.7, 0.01) == []
    (doubt,) = doubt_growth(0.27, 0.0075)
    assert "27 % of the points" in doubt
    assert "--internode 0.03" in doubt


def test_a_cloud_without_stems_is_doubted():
    assert doubt_stems(0.01, 1.0, 0.01) == doubt_stems(0.01, 0.25, 0.01) == doubt_stems(0.2, 0.0, 0.01) == []
    (doubt,) = doubt_stems(0.01, 1 / 12, 0.01)  # one in a hedge may look like one
    assert doubt_stems(0.01, 0.0, 0.01) == [doubt]
    assert "no stem is seen at a root" in doubt
    assert "--internode 0.04" in doubt
    (doubt,) = doubt_stems(0.0, 1.0, 0.01)
    assert "no stem or branch of the cloud is round" in doubt
