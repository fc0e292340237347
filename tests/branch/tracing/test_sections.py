"""Slices along the paths to the root: rings of a cylinder, and parents that are always nearer to the root."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree
from usdfoliage.branch.rooted_tree import RootedTree, step_lengths
from usdfoliage.branch.tracing.cloud_graph import CloudGraphSettings, link_points
from usdfoliage.branch.tracing.sections import cut_sections, find_paths

from tests.support.branch_clouds import line, rings


def graph_of(points_m: np.ndarray, links) -> csr_array:
    start, end = np.array(links).T
    length_m = np.linalg.norm(points_m[start] - points_m[end], axis=1)
    half = coo_array((length_m, (start, end)), shape=(len(points_m),) * 2).tocsr()
    return csr_array(half.maximum(half.T))


def cylinder(radius_m: float = 0.1, step_m: float = 0.05, count: int = 12) -> tuple[np.ndarray, csr_array]:
    """Rings of 24 points, the lowest half a step above the ground; each point linked with those around it."""
    points_m = rings(radius_m, step_m * (np.arange(count) + 0.5))
    return points_m, graph_of(points_m, cKDTree(points_m).query_pairs(1.01 * step_m, output_type="ndarray"))


def hairpin() -> tuple[np.ndarray, csr_array]:
    """Three sides of a square of 1 m in steps of 0.1, and the fourth in one link."""
    corners = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]], float)
    points_m = np.concatenate([line(corners[k], corners[k + 1], 11)[int(k > 0) :] for k in range(3)])
    return points_m, graph_of(points_m, [*((k, k + 1) for k in range(30)), (0, 30)])


def paths_from(lengths_m: csr_array, *roots: int, power: float = 1.0, straight=None):
    return find_paths(lengths_m, np.array(roots), np.arange(len(roots)), power, straight)


def test_sections_of_a_cylinder_are_its_rings_in_order():
    points_m, lengths_m = cylinder()
    paths = find_paths(lengths_m, np.arange(24), np.zeros(24, int))
    sections = cut_sections(points_m, lengths_m, paths, 0.0499)
    order = np.argsort(sections.center_m[:, 1])
    heights_m = 0.05 * (np.arange(12) + 0.5)
    np.testing.assert_allclose(sections.center_m[order], heights_m[:, None] * [0, 1, 0], atol=1e-12)
    assert sections.points.tolist() == [24] * 12
    assert sections.parent[order].tolist() == [-1, *order[:-1].tolist()]
    assert sections.section.tolist() == np.repeat(order, 24).tolist()


def test_all_that_ends_at_one_root_is_one_section():
    points_m = line([0, 0, 0], [9, 0, 0], 10)
    lengths_m = graph_of(points_m, [(k, k + 1) for k in range(9)])
    sections = cut_sections(points_m, lengths_m, find_paths(lengths_m, np.array([0, 9]), np.array([0, 0])), 0.9)
    assert sections.section[0] == sections.section[9]
    assert sections.points[sections.section[0]] == 2
    assert (sections.parent < 0).sum() == 1


def test_a_slice_of_two_branches_is_two_sections():
    points_m = np.concatenate([line([0, 0, 0], [0, 1, 0], 11), line([0.1, 1.1, 0], [1, 2, 0], 10)])
    points_m = np.concatenate([points_m, points_m[11:] * [-1, 1, 1]])
    links = [(k, k + 1) for k in range(20)] + [(10, 21)] + [(k, k + 1) for k in range(21, 30)]
    lengths_m = graph_of(points_m, links)
    sections = cut_sections(points_m, lengths_m, paths_from(lengths_m, 0), 0.3)
    forks = RootedTree(sections.parent).child_counts()
    assert (forks == 2).sum() == 1
    assert forks.max() == 2
    assert np.abs(sections.center_m[:, 0]).min(initial=1, where=sections.center_m[:, 1] > 1.25) > 0.1


def test_thick_slices_where_they_are_asked_for():
    points_m = line([0, 0, 0], [0, 4, 0], 401)
    lengths_m = graph_of(points_m, [(k, k + 1) for k in range(400)])
    thickness_m = np.where(points_m[:, 1] < 2, 0.2, 0.05)
    sections = cut_sections(points_m, lengths_m, paths_from(lengths_m, 0), thickness_m)
    assert len(sections) == pytest.approx(2 / 0.2 + 2 / 0.05, abs=2)


def test_with_power_2_paths_keep_to_the_dense_line_where_with_1_they_leap():
    _, lengths_m = hairpin()
    leaping, keeping = (paths_from(lengths_m, 0, power=power).before for power in (1.0, 2.0))
    assert leaping[30] == 0
    assert keeping[30] == 29  # 30 links of 0.1 cost less than one of 1
    assert keeping[1:].tolist() == list(range(30))


def test_on_a_stem_paths_are_straight_whatever_the_power():
    _, lengths_m = hairpin()
    assert paths_from(lengths_m, 0, power=2.0, straight=np.ones(31, bool)).before[30] == 0


@given(power=st.floats(1, 4), scale=st.floats(0.01, 100))
def test_paths_do_not_depend_on_the_unit(power, scale):
    _, lengths_m = hairpin()
    first, second = (paths_from(unit * lengths_m, 3, power=power) for unit in (1, scale))
    along = np.arange(6, 28)  # far from where two paths are as long as each other
    assert (first.before[along] == second.before[along]).mean() > 0.9


@examples(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 300), roots=st.integers(1, 3))
def test_parents_are_always_nearer_to_the_root(seed, count, roots):
    rng = np.random.default_rng(seed)
    points_m = rng.normal(size=(count, 3)) * rng.uniform(0.1, 3, 3)
    lengths_m = link_points(points_m, CloudGraphSettings(neighbors=int(rng.integers(1, 8)))).lengths_m
    chosen = rng.choice(count, min(roots, count), replace=False)
    paths = paths_from(lengths_m, *chosen, power=float(rng.uniform(1, 3)))
    thickness_m = float(rng.uniform(0.05, 2))
    sections = cut_sections(points_m, lengths_m, paths, thickness_m)

    path_m = RootedTree(paths.before).sum_below(step_lengths(points_m, paths.before) / thickness_m)
    slice_of = np.full(len(sections), -1)
    slice_of[sections.section] = np.floor(path_m)
    assert (slice_of[sections.section] == np.floor(path_m)).all()  # a section is of one slice
    has = sections.parent >= 0
    assert (slice_of[sections.parent[has]] < slice_of[has]).all()
    assert (~has).sum() == len(chosen)
    assert sections.points.sum() == count
    root_of = np.full(len(sections), -1)
    root_of[sections.section] = paths.root
    assert (root_of[sections.section] == paths.root).all()  # and of one root
    assert (root_of[sections.parent[has]] == root_of[has]).all()
    for number in range(len(sections)):
        np.testing.assert_allclose(sections.center_m[number], points_m[sections.section == number].mean(axis=0))


def test_every_point_goes_to_the_root_it_is_nearest_to():
    points_m = line([0, 0, 0], [9, 0, 0], 10)
    lengths_m = graph_of(points_m, [(k, k + 1) for k in range(9)])
    paths = paths_from(lengths_m, 8, 1)
    assert paths.root.tolist() == [1] * 5 + [0] * 5
    assert paths.before.tolist() == [1, -1, 1, 2, 3, 6, 7, 8, -1, 8]


def test_points_that_are_all_roots_are_sections_of_their_own():
    points_m = line([0, 0, 0], [3, 0, 0], 4)
    lengths_m = graph_of(points_m, [(k, k + 1) for k in range(3)])
    sections = cut_sections(points_m, lengths_m, paths_from(lengths_m, 0, 1, 2, 3), 1.0)
    assert sections.parent.tolist() == [-1] * 4


def test_what_is_thicker_than_the_plant_is_one_section():
    points_m, lengths_m = cylinder()
    sections = cut_sections(points_m, lengths_m, paths_from(lengths_m, 0), 10.0)
    assert sections.parent.tolist() == [-1]
    assert sections.points.tolist() == [len(points_m)]


@pytest.mark.parametrize(("power", "crosses"), [(2.0, True), (3.0, False)])
def test_a_higher_power_keeps_paths_on_their_branch_where_another_comes_near(power, crosses):
    # From one foot two branches lead to ends that are 0.6 apart; one has ten links of 0.1 to there, the other four.
    links = coo_array(
        ([0.1] * 14 + [0.2], ([0, 1, 2, 3, 0, *range(5, 14), 4], [1, 2, 3, 4, 5, *range(6, 15), 14])), shape=(15, 15)
    ).tocsr()
    before = paths_from(csr_array(links.maximum(links.T)), 0, power=power).before
    assert before[14] == (4 if crosses else 13)
