"""Which branches of a cloud stand free: a stem below leaves does, what was traced over leaves does not."""

import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.tracing.free_axes import FreeAxisSettings, keep_free_branches, points_of_branches, stands_free

from tests.support.branch_clouds import cone
from tests.support.branch_shapes import plant_of


def polyline(start_m, end_m, count=21):
    return np.linspace(start_m, end_m, count)


def herb() -> tuple[np.ndarray, Skeleton]:
    """A stem 1 m high with a free side branch, a round leaf around its top, and a branch traced over that leaf."""
    rng = np.random.default_rng(0)
    leaf = rng.uniform([-0.3, 0.996, -0.3], [0.3, 1.004, 0.3], (40_000, 3))
    points_m = np.concatenate(
        [cone([0, 0, 0], [0, 1.0, 0], 0.01, 6000), cone([0, 0.4, 0], [0.25, 0.6, 0], 0.006, 2000), leaf]
    )
    stem, side, over = (
        polyline([0, 0, 0], [0, 1.0, 0]),
        polyline([0, 0.4, 0], [0.25, 0.6, 0]),
        polyline([0, 1.0, 0], [0.25, 1.0, 0.1]),
    )
    skeleton = plant_of((stem, 0.01, None, 0), (side, 0.006, 0, 8), (over, 0.01, 0, 20))
    return points_m, skeleton


def test_a_stem_stands_free_below_leaves_and_not_among_them():
    points_m, skeleton = herb()
    free = stands_free(points_m, skeleton)
    assert free[1:7].all()
    assert free[11:18].all()  # above the fork
    assert free[25:41].all()  # the side branch, away from the stem
    assert not free[44:60].any()  # over the leaf


def test_what_was_traced_over_leaves_is_left_out():
    points_m, skeleton = herb()
    kept = keep_free_branches(points_m, skeleton)
    assert kept is not None
    assert len(kept) == 2
    assert kept.parent_curve.tolist() == [-1, 0]
    assert kept.points_m[: kept.counts[0], 1].max() > 0.85
    np.testing.assert_allclose(kept.points_m[kept.first[1]], [0, 0.4, 0], atol=1e-12)


def test_a_stem_ends_where_it_last_stands_free():
    points_m, _ = herb()
    bent = np.concatenate([polyline([0, 0, 0], [0, 1.0, 0]), polyline([0.02, 1.0, 0], [0.28, 1.0, 0])])
    stem = plant_of((bent, 0.01, None, 0))
    kept = keep_free_branches(points_m, stem)
    assert kept is not None
    assert kept.points_m[:, 0].max() < 0.15  # nothing beyond the leaf's middle
    np.testing.assert_array_equal(kept.points_m, stem.points_m[: len(kept.points_m)])


def test_nothing_of_a_hedge_stands_free():
    rng = np.random.default_rng(1)
    hedge = rng.uniform([-1, 0, -0.3], [1, 1.0, 0.3], (100_000, 3))
    assert keep_free_branches(hedge, plant_of((polyline([0.1, 0, 0], [0.2, 1.0, 0.1]), 0.01, None, 0))) is None


def test_a_line_that_winds_or_lies_is_no_stem():
    points_m, _ = herb()
    away = np.linspace(0, 4 * np.pi, 81)
    coil = 0.5 * np.column_stack([np.cos(away), 0.16 * away, np.sin(away)])
    assert keep_free_branches(coil, plant_of((coil, 0.01, None, 0))) is None
    lying = polyline([0, 0, 0], [1, 0.1, 0])
    assert keep_free_branches(np.concatenate([lying, points_m + 5]), plant_of((lying, 0.01, None, 0))) is None


def test_points_of_branches_are_those_within_their_radius():
    points_m, skeleton = herb()
    stem = skeleton.up_to_order(0)
    near = points_of_branches(points_m, stem, 0.002)
    away_m = np.hypot(points_m[:, 0], points_m[:, 2])
    assert near[(away_m < 0.011) & (points_m[:, 1] < 0.99)].all()
    assert not near[away_m > 0.0125].any()


def test_a_cloud_without_height_has_nothing_free():
    stem = plant_of((polyline([0, 0, 0], [1, 0, 0]), 0.01, None, 0))
    assert not stands_free(np.zeros((60, 3)), stem).any()


@pytest.mark.parametrize(
    "change", [{"reach": 0.0}, {"beside": (3.0, 1.5)}, {"free": 0.5}, {"max_hidden": 1.0}, {"straight": 2.0}]
)
def test_settings_that_mean_nothing_are_refused(change):
    with pytest.raises(ValueError, match="must be in"):
        FreeAxisSettings(**change)
