"""What is a warning of an asset of branches, and what is not."""

from usdfoliage.cli.remarks import render_for
from usdfoliage.jobs.branches.warnings import check_faces, check_growth, check_stems, check_surface
from usdfoliage.remarks import as_plan_setting

RENDER = render_for("branches")


def test_branches_of_which_many_are_not_joined_are_a_warning():
    assert check_surface(100, 20, 10) == []
    assert check_surface(2, 1, 0) == []  # a stem with one spur
    (warning,) = check_surface(100, 20, 11)
    assert warning.text.startswith("31 % of the branches are not joined")
    assert "--cloud-leaves on" in warning.sentence(RENDER)
    assert "--method grow" in warning.sentence(RENDER)
    assert 'branches.method = "grow"' in warning.sentence(as_plan_setting)


def test_branches_that_grow_are_not_advised_to_grow():
    (joined,) = check_surface(100, 20, 11, grows=True)
    (stems,) = check_stems(0.01, 0.0, 0.01, grows=True)
    for warning in (joined, stems):
        assert "--method" not in warning.sentence(RENDER)
    assert stems.sentence(RENDER).endswith("give --roots where stems are")


def test_branches_beyond_the_number_of_faces_are_a_warning():
    assert check_faces(100, 30) == check_faces(6, 5) == []
    (warning,) = check_faces(100, 58)
    assert warning.text.startswith("58 % of the branches are left out")
    assert "--most-faces" in warning.sentence(RENDER)


def test_growth_through_a_part_of_the_cloud_is_a_warning():
    assert check_growth(0.95, 0.01) == []
    (warning,) = check_growth(0.27, 0.0075)
    assert "27 % of the points" in warning.text
    assert "--internode 0.03" in warning.sentence(RENDER)


def test_a_cloud_without_stems_is_a_warning():
    assert check_stems(0.01, 1.0, 0.01) == check_stems(0.01, 0.25, 0.01) == check_stems(0.2, 0.0, 0.01) == []
    (warning,) = check_stems(0.01, 1 / 12, 0.01)  # one in a hedge may look like one
    assert check_stems(0.01, 0.0, 0.01) == [warning]
    assert "no stem is seen at a root" in warning.text
    assert "--method grow with --internode 0.04 or so" in warning.sentence(RENDER)
    assert 'branches.method = "grow" with branches.internode_m = 0.04 or so' in warning.sentence(as_plan_setting)
    (warning,) = check_stems(0.0, 1.0, 0.01)
    assert "no stem or branch of the cloud is round" in warning.text
