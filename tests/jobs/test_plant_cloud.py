"""The cloud that branches are traced through: as close as twigs need, with colours, without what lies beside it."""

import numpy as np
import pytest
from usdfoliage.branch.tracing.roots import RootSettings
from usdfoliage.cli.remarks import render_for
from usdfoliage.jobs.plant_cloud import PlantCloud, PlantCloudRequest, check_height, read_plant_cloud

from tests.support.cloud_files import write_ply

HEIGHT_M = 2.0
CLOSEST_M = 0.3 * 0.005 * HEIGHT_M
BROWN, GREEN = (120, 90, 60), (60, 150, 40)


def pole(count: int) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) points of a pole of 2 m, Z up, brown below and green above its middle; and their colours."""
    rng = np.random.default_rng(7)
    turn, height_m = rng.uniform(0, 2 * np.pi, count), np.linspace(0, HEIGHT_M, count)
    points = np.column_stack([0.02 * np.cos(turn), 0.02 * np.sin(turn), height_m])
    return points, np.where(height_m[:, None] < 1, BROWN, GREEN).astype(np.uint8)


def read(path, points, colors=None, **asked) -> PlantCloud:
    write_ply(path, points, colors)
    return read_plant_cloud(PlantCloudRequest(path=path, roots=RootSettings(), up="Z", unit="m", **asked))


def test_points_far_closer_than_twigs_need_become_fewer_and_keep_their_colours(tmp_path):
    plant = read(tmp_path / "pole.ply", *pole(80_000))
    assert len(plant.points_m) < 40_000
    assert any("branches are traced through" in each.text for each in plant.remarks)
    middle = np.abs(plant.points_m[:, 1] - 1) < 2 * CLOSEST_M
    assert (np.abs(plant.colors[~middle & (plant.points_m[:, 1] < 1)] - BROWN) < 1e-6).all()
    assert (np.abs(plant.colors[~middle & (plant.points_m[:, 1] > 1)] - GREEN) < 1e-6).all()


def test_of_a_cloud_that_is_no_closer_than_that_every_point_stays(tmp_path):
    plant = read(tmp_path / "pole.ply", *pole(5000))
    assert len(plant.points_m) == 5000
    assert not any(each.code == "cloud-thinned" for each in plant.remarks)


def test_a_shorter_internode_asks_for_more_points(tmp_path):
    points, colors = pole(80_000)
    counts = [
        len(read(tmp_path / "pole.ply", points, colors, internode_m=each).points_m) for each in (0.02, 0.01, 0.0001)
    ]
    assert counts[0] < counts[1] < counts[2] == 80_000


@pytest.mark.parametrize("max_points", [1000, 20_000])
def test_no_more_points_come_than_are_asked_for(tmp_path, max_points):
    plant = read(tmp_path / "pole.ply", *pole(80_000), max_points=max_points)
    assert len(plant.points_m) == len(plant.colors) <= max_points


def test_points_strewn_all_over_the_box_are_left_out_before_up_is_looked_for(tmp_path):
    rng = np.random.default_rng(5)
    pole_m, _ = pole(8000)
    crown_m = rng.normal(size=(8000, 3))
    crown_m = 0.7 * crown_m / np.linalg.norm(crown_m, axis=1)[:, None] + [0, 0, HEIGHT_M]
    plant_m = np.concatenate([pole_m, crown_m])
    noise_m = rng.uniform(plant_m.min(axis=0), plant_m.max(axis=0), (8000, 3))
    write_ply(tmp_path / "noisy.ply", np.concatenate([plant_m, noise_m]), None)
    plant = read_plant_cloud(PlantCloudRequest(path=tmp_path / "noisy.ply", roots=RootSettings(), unit="m"))
    texts = {each.code: each.text for each in plant.remarks}
    assert "left out as noise" in texts["noise-left-out"]
    assert "a trunk" in texts["cloud-up"]
    assert 14_000 < len(plant.source.points_m) < 17_500


@pytest.mark.parametrize(("turn", "code"), [(0, "cloud-up"), (1, "cloud-up-unusual")])
def test_a_plant_along_an_axis_that_files_rarely_have_up_is_warned_of(tmp_path, turn, code):
    rng = np.random.default_rng(5)
    pole_m, _ = pole(8000)
    crown_m = rng.normal(size=(8000, 3))
    crown_m = 0.7 * crown_m / np.linalg.norm(crown_m, axis=1)[:, None] + [0, 0, HEIGHT_M]
    write_ply(tmp_path / "plant.ply", np.roll(np.concatenate([pole_m, crown_m]), turn, axis=1), None)
    plant = read_plant_cloud(PlantCloudRequest(path=tmp_path / "plant.ply", roots=RootSettings(), unit="m"))
    assert [each.code for each in plant.remarks if each.code.startswith("cloud-up")] == [code]
    assert np.ptp(plant.points_m[:, 1]) == pytest.approx(2.7, rel=0.05)


def test_outliers_are_left_out_with_a_remark(tmp_path):
    points, colors = pole(5000)
    outliers = np.array([[3.0, 0, 0.4]]) + np.random.default_rng(1).normal(0, 0.02, (60, 3))
    plant = read(tmp_path / "pole.ply", np.concatenate([points, outliers]), np.concatenate([colors, colors[:60]]))
    assert len(plant.points_m) == len(plant.colors) == 5000
    assert "60 points are far beside the plant and left out" in [each.text for each in plant.remarks]


def test_a_cloud_without_colours_has_none(tmp_path):
    assert read(tmp_path / "pole.ply", pole(5000)[0]).colors is None


def test_of_a_plant_whose_ground_was_left_out_what_lies_low_stays(tmp_path):
    stem, _ = pole(4000)
    rosette = np.random.default_rng(8).uniform([-0.6, -0.6, 0], [0.6, 0.6, 0.015], (8000, 3))
    points = np.concatenate([stem, rosette])
    assert len(read(tmp_path / "plant.ply", points).points_m) < 5000
    kept = read(tmp_path / "plant.ply", points, has_ground=False)
    assert len(kept.points_m) == len(points)
    assert kept.ground == 0


@pytest.mark.parametrize("max_points", [500, 400_000])
def test_black_points_have_no_colour_and_darken_none(tmp_path, max_points):
    points, colors = pole(40_000)
    colors = np.tile([60, 120, 40], (len(points), 1))
    colors[np.random.default_rng(3).random(len(points)) < 0.7] = 0

    cloud = read(tmp_path / "a.ply", points, colors, max_points=max_points)

    assert len(cloud.points_m) < len(points)
    assert cloud.colors is not None
    black = ~cloud.colors.any(axis=1)
    np.testing.assert_allclose(cloud.colors[~black], np.tile([60, 120, 40], ((~black).sum(), 1)), atol=1e-3)
    assert black.mean() < 0.7


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
    sentence = warning.sentence(render_for("branches"))
    assert warning.code == "plant-height-improbable"
    assert text in sentence
    assert sentence.count("--unit") == len(units)
    for name, height in units.items():
        assert f"--unit {name} ({height})" in sentence
