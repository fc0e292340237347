"""Ramps of height and intensity are no colours; greens and browns with noise, shade and few materials are."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from usdfoliage.capture.cloud_files.false_colors import SampledColors, check_colors
from usdfoliage.capture.cloud_files.read import CloudInputSettings, read_cloud_input
from usdfoliage.remarks import warnings_of

from tests.support.cloud_files import write_las, write_ply

DATA = Path(__file__).parents[4] / "shared" / "data"
METRES = CloudInputSettings(metres_per_unit=1.0)
RAMPS = (
    "VIRIDIS",
    "JET",
    "TURBO",
    "PARULA",
    "RAINBOW",
    "HSV",
    "SUMMER",
    "WINTER",
    "CIVIDIS",
    "PLASMA",
    "HOT",
)
GREEN, BROWN, ORANGE, YELLOW = np.array([[60, 120, 40], [90, 70, 50], [200, 120, 30], [230, 210, 60]], float)


def tree(count=3000, seed=0):
    """A ball of points on a stem, Z up, and which are of the ball."""
    rng = np.random.default_rng(seed)
    toward = rng.normal(size=(count, 3))
    ball = [0, 0, 4] + 1.5 * toward / np.linalg.norm(toward, axis=1, keepdims=True) * rng.uniform(0.7, 1, (count, 1))
    stem = np.column_stack([rng.normal(0, 0.05, (count // 4, 2)), rng.uniform(0, 3, count // 4)])
    return np.concatenate([ball, stem]), np.arange(count + count // 4) < count


def ramp(name, values):
    """Colours (N, 3) of values 0 to 1, in 256 steps."""
    table = getattr(cv2, f"COLORMAP_{name}")
    return cv2.applyColorMap(np.rint(values * 255).astype(np.uint8)[:, None], table)[:, 0, ::-1].astype(float)


def unit(values):
    return (values - values.min()) / np.ptp(values)


@pytest.mark.parametrize("name", RAMPS)
@pytest.mark.parametrize("count", [400, 3000])
def test_ramps_are_no_colours(name, count):
    points, _ = tree(count)
    rng = np.random.default_rng(1)
    for axis in range(3):
        assert f"axis {'XYZ'[axis]}" in check_colors(points, ramp(name, unit(points[:, axis])))
    assert "a ramp" in check_colors(points, ramp(name, rng.normal(0.5, 0.2, len(points)).clip(0, 1)))
    assert "a ramp" in check_colors(points, ramp(name, rng.random(len(points)) ** 2))


@pytest.mark.parametrize("name", ["VIRIDIS", "JET", "TURBO", "HSV"])
def test_shading_over_a_ramp_of_height_hides_nothing(name):
    points, _ = tree()
    shade = np.random.default_rng(1).uniform(0.4, 1, (len(points), 1))

    assert "axis Z" in check_colors(points, np.rint(shade * ramp(name, unit(points[:, 2]))))


def test_ramps_of_many_steps_and_of_another_direction():
    points, _ = tree()
    across = unit(points @ [0.6, 0.48, 0.64])
    nodes = np.array([[0, 0, 255], [0, 255, 0], [255, 255, 0], [255, 0, 0]], float)  # as of CloudCompare
    smooth = np.column_stack([np.interp(across, np.linspace(0, 1, 4), channel) for channel in nodes.T])

    assert "a ramp" in check_colors(points, np.rint(smooth))


@pytest.mark.parametrize("noise", [0, 0.5, 2, 8, 25])
@pytest.mark.parametrize("base", ["one", "two", "mixed", "autumn"])
def test_colours_of_plants_are_colours(noise, base):
    points, of_ball = tree()
    rng = np.random.default_rng(2)
    share = rng.random((len(points), 1))
    plain = {
        "one": np.tile(GREEN, (len(points), 1)),
        "two": np.where(of_ball[:, None], GREEN, BROWN),
        "mixed": share * GREEN + (1 - share) * BROWN,
        "autumn": np.where(of_ball[:, None], share * ORANGE + (1 - share) * YELLOW, BROWN),
    }[base]
    lower_darker = 0.4 + 0.6 * unit(points[:, 2])[:, None]
    for shade in (1.0, rng.uniform(0.3, 1.4, (len(points), 1)), lower_darker):
        colors = np.rint((shade * plain + noise * rng.normal(size=points.shape)).clip(0, 255))
        assert check_colors(points, colors) == ""


def test_grey_and_few_points_get_no_warning():
    points, _ = tree()
    grey = np.rint(unit(points[:, [2, 2, 2]]) * 255)

    assert check_colors(points, grey) == ""
    assert check_colors(points[:20], ramp("JET", unit(points[:20, 2]))) == ""
    assert check_colors(points, np.zeros(points.shape)) == ""


def test_black_points_hide_no_ramp():
    points, _ = tree()
    colors = ramp("TURBO", np.random.default_rng(3).random(len(points)))
    colors[::3] = 0

    assert "a ramp" in check_colors(points, colors)


def test_a_cloud_with_a_ramp_counts_as_uncoloured_with_a_remark(tmp_path):
    points, of_ball = tree()
    cloud = read_cloud_input(write_las(tmp_path / "a.las", points, ramp("VIRIDIS", unit(points[:, 2]))), METRES)
    assert cloud.colors is None
    (false,) = warnings_of(cloud.remarks)
    assert false.code == "cloud-colors-false"
    assert "are a ramp along its axis Z, and none of a plant; they are not used" in false.text

    own = np.where(of_ball[:, None], GREEN, BROWN)
    cloud = read_cloud_input(write_las(tmp_path / "b.las", points, own), METRES)
    np.testing.assert_array_equal(cloud.colors, own)
    assert warnings_of(cloud.remarks) == ()


def test_thinning_hides_no_ramp(tmp_path):
    points, _ = tree()
    colors = ramp("VIRIDIS", np.random.default_rng(4).random(len(points)))
    settings = CloudInputSettings(metres_per_unit=1.0, max_points=500)

    cloud = read_cloud_input(write_las(tmp_path / "a.las", points, colors), settings)

    assert len(cloud.points_m) <= 500
    assert cloud.colors is None
    assert len(warnings_of(cloud.remarks)) == 1


def test_samples_are_evenly_taken_and_few():
    sampled = SampledColors()
    rows = np.arange(400_000.0)
    for part in np.split(rows, [7, 1000, 90_000, 90_001, 250_000]):
        sampled.add(np.tile(part[:, None], 3), np.tile(part[:, None], 3).astype(np.float32))
    points, colors = sampled.finish()

    assert 20_000 < len(points) <= 80_000
    np.testing.assert_array_equal(points, colors)
    assert len(set(np.diff(points[:, 0]))) == 1


@pytest.mark.parametrize(
    "name",
    [
        "mv-basil-bush/colmap_reference/sparse.ply",
        "mv-park-drone/colmap_reference/sparse.ply",
        "mv-park-drone/model.laz",
        "cloud-amsterdam-street-tree/stem_121913_487434.ply",
    ],
)
def test_colours_of_cameras_get_no_warning(name):
    if not (DATA / name).is_file():
        pytest.skip(f"../shared/data/{name} is absent")
    cloud = read_cloud_input(DATA / name, METRES)
    assert warnings_of(cloud.remarks) == ()
    assert cloud.colors is not None


def test_black_points_darken_no_mean(tmp_path):
    points, _ = tree()
    colors = np.tile(GREEN, (len(points), 1))
    colors[::2] = 0

    cloud = read_cloud_input(
        write_ply(tmp_path / "a.ply", points, colors), CloudInputSettings(metres_per_unit=1.0, max_points=300)
    )

    different = {tuple(color) for color in cloud.colors.tolist()}
    assert tuple(GREEN.astype(int).tolist()) in different
    assert different <= {(0, 0, 0), tuple(GREEN.astype(int).tolist())}
