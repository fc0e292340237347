"""Thinning while reading: bounded, repeatable, one mean a cell."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree
from usdfoliage.capture.cloud_files import ply
from usdfoliage.capture.cloud_files.read import CloudInputSettings, read_cloud_input
from usdfoliage.capture.cloud_files.thinning import PointThinner

from tests.support.cloud_files import write_ply


def thin(points, max_points, part=1000, colors=None):
    thinner = PointThinner(max_points)
    for start in range(0, len(points), part):
        some = slice(start, start + part)
        thinner.add(points[some], None if colors is None else colors[some])
    return thinner.finish()


def sheet(count, seed=0):
    return np.random.default_rng(seed).uniform(0, 1, (count, 3)) * [5.0, 4.0, 0.0] + [1e5, -2e6, 7.0]


def test_few_points_stay_as_they_are():
    points = sheet(1000)
    result = thin(points, 1000, 64)
    np.testing.assert_array_equal(result.points, points)
    assert (result.cell, result.duplicates, result.colors) == (0, 0, None)


@pytest.mark.parametrize("part", [100, 3000, 20_000])
def test_many_points_become_one_a_cell(part):
    points = sheet(20_000)
    result = thin(points, 2000, part)
    assert 800 <= len(result.points) <= 2000
    assert result.cell > 0
    # Every point has one near, no farther than across a cell and a bit.
    away = cKDTree(result.points).query(points)[0]
    assert away.max() < 2 * result.cell
    np.testing.assert_allclose(result.points.mean(axis=0), points.mean(axis=0), atol=0.1)
    np.testing.assert_array_equal(result.points, thin(points, 2000, part).points)


def test_cells_have_the_mean_of_places_and_colours():
    corners = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]])
    near = np.random.default_rng(1).uniform(-1e-4, 1e-4, (4, 500, 3))
    points = (corners[:, None] + near + 0.5).reshape(-1, 3)
    colors = np.repeat(np.arange(4.0) * 60, 500)[:, None] * [1.0, 0.5, 0.25]
    result = thin(points, 4, 300, colors.astype(np.float32))
    assert len(result.points) == 4
    order = np.argsort(result.colors[:, 0])
    np.testing.assert_allclose(result.points[order], points.reshape(4, 500, 3).mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(result.colors[order][:, 0], [0, 60, 120, 180], atol=1e-3)


def test_outliers_and_many_points_at_one_place_do_no_harm():
    points = np.concatenate([sheet(5000), [[1e11, -1e11, 1e11], [-1e11, 0, 0]]])
    assert 400 <= len(thin(points, 1000).points) <= 1000
    assert len(thin(np.ones((5000, 3)), 1000).points) == 1
    assert len(thin(np.ones((5000, 3)), 5000).points) == 1
    assert len(thin(np.zeros((0, 3)), 10).points) == 0


def test_a_thinned_file_is_noted(tmp_path, monkeypatch):
    monkeypatch.setattr(ply, "PART_POINTS", 1 << 12)
    path = write_ply(tmp_path / "a.ply", sheet(20_000), np.full((20_000, 3), 77))
    cloud = read_cloud_input(path, CloudInputSettings(metres_per_unit=1.0, max_points=2000))
    assert cloud.remarks[0].text.startswith(f"20,000 points thinned to {len(cloud.points_m):,}, one a ")
    assert (cloud.colors == 77).all()
    assert cloud.total == 20_000
    assert np.abs(cloud.points_m).max() < 4


def test_memory_does_not_grow_with_the_points():
    peaks = []
    for parts in (10, 40):
        rng = np.random.default_rng(2)
        thinner = PointThinner(50_000)
        tracemalloc.start()
        for _ in range(parts):
            thinner.add(rng.uniform(0, 1, (50_000, 3)), None)
        thinner.finish()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
