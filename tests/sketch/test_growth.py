"""Trees that grow into a crown that is drawn: depth, turning, subtrees, growth and thickness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from usdfoliage.branch.foliage.species import load_species
from usdfoliage.errors import FitError
from usdfoliage.sketch.axes import Axis, sample_axis, skeleton_of
from usdfoliage.sketch.bounds import bound_crown
from usdfoliage.sketch.growth import SketchGrowthSettings, grow_axes, thin_out
from usdfoliage.sketch.into_space import turn_into_space
from usdfoliage.sketch.leaf_choice import fit_leaves
from usdfoliage.sketch.subtrees import MAX_SUBTREES, build_library, place_subtree, predefined_subtrees
from usdfoliage.sketch.thickness import OF_PARENT, find_radii
from usdfoliage.sketch.tracing import TracedBranch, TracedTree

GENERIC = load_species("generic")
FAST = SketchGrowthSettings(iterations=30, image_shoots=0.03, max_shoots=600)


def disc(height=240, width=200, radius=80):
    rows, columns = np.mgrid[:height, :width] + 0.5
    return (columns - width / 2) ** 2 + (rows - 100) ** 2 < radius**2


@pytest.fixture(scope="module")
def bounds():
    return bound_crown(disc())


def trunk(half=4.0):
    points = np.array([[100.0, -235, 0], [100, -180, 0], [100, -120, 0], [100, -60, 0]])
    return Axis(points=points, half=np.full(4, half), parent=-1, parent_point=-1, order=0, inferred=False)


def test_a_disc_is_as_deep_as_wide(bounds):
    assert bounds.half_depth[100, 100] == pytest.approx(80, rel=0.05)
    assert bounds.half_depth[100, 155] == pytest.approx(np.sqrt(80**2 - 55**2), rel=0.12)
    assert not bounds.half_depth[~bounds.inside].any()
    assert bounds.contains(np.array([[100.0, -100, 70], [100, -100, 90], [5, -100, 0]])).tolist() == [
        True,
        False,
        False,
    ]


def test_twice_the_depth_is_twice_as_deep(bounds):
    twice = bound_crown(disc(), 2.0)
    assert twice.half_depth[100, 100] == pytest.approx(2 * bounds.half_depth[100, 100], rel=1e-3)


def test_no_leaves_are_one_error():
    with pytest.raises(FitError, match="no leaves"):
        bound_crown(np.zeros((50, 50), bool))


def traced(*lines):
    branches = [
        TracedBranch(
            points_px=np.array(line, float),
            half_px=np.full(len(line), 2.0),
            parent=-1 if k == 0 else 0,
            parent_point=-1 if k == 0 else 1,
            drawn=k == 0,
        )
        for k, line in enumerate(lines)
    ]
    return TracedTree(branches=tuple(branches), likely=np.zeros((240, 200), np.float32))


def test_branches_that_lie_over_each_other_are_turned_apart(bounds):
    tree = traced([[100, 235], [100, 150], [100, 60]], [[100, 150], [150, 110]], [[100, 150], [152, 112]])
    axes = turn_into_space(tree, bounds)
    np.testing.assert_allclose(axes[0].points[:, 2], 0)
    ends = [axis.points[-1] for axis in axes[1:]]
    assert np.linalg.norm(ends[0] - ends[1]) > 40
    for axis, branch in zip(axes, tree.branches, strict=True):  # seen from the front they stay
        np.testing.assert_allclose(axis.points[:, :2], branch.points_px * [1, -1])
        np.testing.assert_array_equal(axis.points[0], axes[0].points[1] if axis.parent == 0 else axis.points[0])


@given(seed=st.integers(0, 1000), rotations=st.integers(1, 12))
@settings(max_examples=25, deadline=None)
def test_a_subtree_is_turned_and_scaled_with_its_branch(seed, rotations):
    rng = np.random.default_rng(seed)
    support = rng.normal(size=(2, 3)) * 10
    size = np.linalg.norm(support[1] - support[0])
    for subtree in predefined_subtrees(GENERIC):
        placed = place_subtree(subtree, support, rotations)
        assert placed.shape == (rotations, len(subtree.at), *subtree.children.shape[1:])
        base = support[0] + subtree.at[:, None] * (support[1] - support[0])
        np.testing.assert_allclose(placed[:, :, 0], np.broadcast_to(base, (rotations, *base.shape)), atol=1e-9)
        lengths = np.linalg.norm(np.diff(placed, axis=2), axis=3)
        own = size * np.linalg.norm(np.diff(subtree.children, axis=1), axis=2)
        np.testing.assert_allclose(lengths, np.broadcast_to(own, lengths.shape), rtol=1e-9)


def test_the_library_has_what_was_traced_first(bounds):
    tree = traced([[100, 235], [100, 150], [100, 60]], [[100, 150], [150, 110]])
    axes = turn_into_space(tree, bounds)
    side = axes[1]
    more = [
        Axis(
            points=side.points[-1] + np.array([[0.0, 0, 0], end]),
            half=np.ones(2),
            parent=1,
            parent_point=1,
            order=2,
            inferred=False,
        )
        for end in ([10.0, 10, 0], [12, -4, 3])
    ]
    library = build_library([*axes, *more], GENERIC)
    assert len(library) == len(predefined_subtrees(GENERIC)) + 1 <= MAX_SUBTREES
    placed = place_subtree(library[0], side.points, 1)[0]
    for line, axis in zip(placed, more, strict=True):  # unturned, it is what was traced
        assert np.linalg.norm(line[-1] - line[0]) == pytest.approx(np.linalg.norm(axis.points[-1] - axis.points[0]))


@pytest.fixture(scope="module")
def grown(bounds):
    axes = [trunk()]
    return grow_axes(axes, build_library(axes, GENERIC), bounds, np.random.default_rng(0), FAST)


def test_a_tree_fills_its_crown_and_stays_in_it(grown, bounds):
    tips = np.array([axis.points[-1] for axis in grown.axes[1:]])
    row, column, within = bounds.rows_and_columns(tips)
    assert within.all()
    assert bounds.inside[row, column].all()
    assert (np.abs(tips[:, 2]) <= bounds.half_depth[row, column] + 1e-6).all()
    spread = tips.std(axis=0)
    assert spread[2] / spread[0] == pytest.approx(1, abs=0.2)
    assert grown.cost_px[-1] < 0.5 * grown.cost_px[0]
    assert (np.diff(grown.cost_px) <= 1e-9).all()


def test_the_same_seed_grows_the_same_tree(grown, bounds):
    axes = [trunk()]
    again = grow_axes(axes, build_library(axes, GENERIC), bounds, np.random.default_rng(0), FAST)
    assert len(again.axes) == len(grown.axes)
    for one, two in zip(grown.axes, again.axes, strict=True):
        np.testing.assert_array_equal(one.points, two.points)


def test_its_skeleton_is_one_and_thins_out(grown):
    radii = find_radii(grown.axes, GENERIC.exponent, 0.3, 3.0)
    skeleton = skeleton_of(grown.axes, radii, 0.02, grown.axes[0].points[0])
    np.testing.assert_allclose(skeleton.points_m[0], 0)
    child = np.flatnonzero(skeleton.parent_curve >= 0)
    assert (skeleton.radius_m[skeleton.first[child]] <= skeleton.radius_m[skeleton.parent_vertex[child]] + 1e-12).all()
    assert skeleton.inferred[1:].all()
    assert not skeleton.inferred[0]


def test_without_a_species_a_branch_has_three_quarters_of_its_parent():
    line = np.array([[100.0, -180, 0], [140, -150, 0]])
    child = Axis(points=line, half=np.full(2, np.nan), parent=0, parent_point=1, order=1, inferred=True)
    radii = find_radii([trunk(), child], None, 0.1, 3.0)
    assert radii[0][0] == pytest.approx(4.0)
    assert radii[1][0] == pytest.approx(OF_PARENT * radii[0][1])


@given(seed=st.integers(0, 100), spacing=st.floats(2, 30))
@settings(max_examples=30, deadline=None)
def test_thinned_places_keep_apart_and_leave_no_hole(seed, spacing):
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 100, (800, 2))
    chosen = thin_out(places, spacing, rng)
    away = np.linalg.norm(chosen[:, None] - chosen, axis=2) + 1e9 * np.eye(len(chosen))
    assert away.min() >= 0.6 * spacing
    assert np.linalg.norm(places[:, None] - chosen, axis=2).min(axis=1).max() <= 3 * spacing


def test_an_axis_is_sampled_to_its_end():
    points = sample_axis(np.array([[0.0, 0, 0], [10, 0, 0], [10, 5, 0]]), 3.0)
    assert len(points) == 4 + 2
    np.testing.assert_array_equal(points[-1], [10, 5, 0])


def test_leaves_have_the_colours_of_leaves_and_never_of_the_sky(bounds):
    rng = np.random.default_rng(0)
    mask = disc() & (rng.random((240, 200)) < 0.7)
    linear = np.where(mask[..., None], [0.1, 0.3, 0.05], [0.2, 0.4, 0.9]).astype(np.float32)
    base = np.column_stack([rng.uniform(40, 160, 500), -rng.uniform(40, 160, 500), rng.uniform(-60, 60, 500)])
    along = np.tile([0.0, 1.0, 0.0], (500, 1))
    fitting = fit_leaves(base, along, np.full(500, 8.0), bounds, linear, mask, mask, rng)
    np.testing.assert_allclose(
        fitting.color[fitting.kept], np.tile([0.1, 0.3, 0.05], (fitting.kept.sum(), 1)), rtol=1e-6
    )
    tips = base + 8 * along
    away = np.hypot(tips[:, 0] - 100, -tips[:, 1] - 100)
    assert not fitting.kept[away > 83].any()
    assert fitting.kept[(away < 70) & (np.hypot(base[:, 0] - 100, -base[:, 1] - 100) < 70)].all()


def test_gravity_lets_new_branches_hang_or_rise(bounds):
    def rise(gravity: float) -> float:
        """Mean share of its length, by which the last part of a new branch rises."""
        grown = grow_axes(
            [trunk()],
            predefined_subtrees(GENERIC),
            bounds,
            np.random.default_rng(0),
            SketchGrowthSettings(iterations=30, max_shoots=300, gravity=gravity),
        )
        ends = [axis.points[-1] - axis.points[-2] for axis in grown.axes[grown.traced :]]
        return float(np.mean([end[1] / np.linalg.norm(end) for end in ends]))

    hanging, even, rising = rise(1.0), rise(0.0), rise(-1.0)
    assert hanging < even - 0.2
    assert rising > even + 0.05


def test_who_watches_sees_each_axis_once_it_grew(bounds):
    seen = []
    watched = grow_axes(
        [trunk()],
        predefined_subtrees(GENERIC),
        bounds,
        np.random.default_rng(0),
        FAST,
        watch=lambda axes: seen.append(len(axes)),
    )
    assert seen == list(watched.stages[1:])
