"""How similar trees are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from usdfoliage.branch.similarity import compare_trees, measure_traits
from usdfoliage.jobs.branches.likeness import likeness_rows

from tests.support.branch_clouds import small_tree
from tests.support.branch_shapes import fork, plant_of


def test_a_tree_is_as_its_turned_copy():
    plant = small_tree()
    turned = replace(plant, points_m=Rotation.from_rotvec([0, 1.1, 0]).apply(plant.points_m))
    assert compare_trees(measure_traits(plant), measure_traits(plant)).total == 1
    assert compare_trees(measure_traits(plant), measure_traits(turned)).total == pytest.approx(
        1, abs=0.005
    )  # horizontal branches lie between two layers


def test_traits_are_those_of_the_tree():
    traits = measure_traits(fork())  # a trunk of 2 m along y, a branch of 1 m along x from (0, 1, 0), a twig
    assert traits.height_m == pytest.approx(2)
    assert traits.numbers[:2].tolist() == [1, 1]
    assert traits.angles_deg[1] == pytest.approx(90)
    assert traits.slopes_deg[:2] == pytest.approx([90, 0])
    assert traits.lengths[0] == pytest.approx(1)
    assert traits.wood.sum() == pytest.approx(1)


def y_tree(angle_deg, length_m, count):
    trunk_m = np.linspace([0, 0, 0], [0, 4, 0], 41)
    parts = [(trunk_m, 0.1, None, -1)]
    for number in range(count):
        vertex = 20 + number
        away = Rotation.from_rotvec([0, 2.4 * number, 0]).apply([np.sin(np.radians(angle_deg)), 0, 0])
        away = away + np.array([0, np.cos(np.radians(angle_deg)), 0])
        parts.append((np.linspace(trunk_m[vertex], trunk_m[vertex] + length_m * away, 11), 0.02, 0, vertex))
    return plant_of(*parts)


def test_each_difference_is_in_its_term():
    own = measure_traits(y_tree(60, 1, 8))
    steeper = compare_trees(own, measure_traits(y_tree(30, 1, 8)))
    assert own.fork_deg == pytest.approx(60)
    assert steeper.geometry == pytest.approx(np.mean([1, 1, 1 - 30 / 90, 1, 1 - 30 / 90]))
    assert steeper.structure == 1
    fewer = compare_trees(own, measure_traits(y_tree(60, 1, 4)))
    assert fewer.geometry == pytest.approx(1)
    assert fewer.structure == pytest.approx(np.mean([1, 0.5, 1 - (8 / 12 - 4 / 8)]))
    shorter = compare_trees(own, measure_traits(y_tree(60, 0.5, 8)))
    assert shorter.shape < 0.9
    assert shorter.geometry < 1


def test_trees_without_common_orders_are_not_similar():
    """A trunk alone, and one that carries most of its wood: geometry has the trunk in common, and nothing else."""
    bare = plant_of((np.linspace([0, 0, 0], [0, 4, 0], 41), 0.1, None, -1))
    found = compare_trees(measure_traits(bare), measure_traits(y_tree(60, 1, 8)))
    assert found.geometry == pytest.approx(np.mean([1, 0, 0, 1, 0]))  # lengths, angles and slopes of two orders
    assert found.structure == pytest.approx(np.mean([1, 0, 1 / 3]))


def test_a_twig_is_neither_a_crown_nor_an_order():
    """Short ones are not counted; one that is just long enough to count decides nothing."""
    trunk_m = np.linspace([0, 0, 0], [0, 4, 0], 41)
    bare = measure_traits(plant_of((trunk_m, 0.1, None, -1)))
    for length_m in (0.07, 0.082):
        twig = (np.linspace(trunk_m[10], np.add(trunk_m[10], [length_m, 0, 0]), 2), 0.01, 0, 10)
        found = compare_trees(bare, measure_traits(plant_of((trunk_m, 0.1, None, -1), twig)))
        assert found.geometry == 1
        assert min(found.shape, found.structure) > 0.98
    short = [(np.linspace(at_m, np.add(at_m, [0.07, 0, 0]), 2), 0.01, 0, at) for at, at_m in enumerate(trunk_m) if at]
    thorny = measure_traits(plant_of((trunk_m, 0.1, None, -1), *short))
    assert thorny.crown_m == 0
    assert not thorny.layers.any()


def test_likeness_is_reported_in_figures():
    assert likeness_rows(fork(), [], []) == []
    rows = likeness_rows(y_tree(60, 1, 8), [y_tree(60, 1, 8), y_tree(30, 1, 8)], [1.0, 0.97])
    assert rows[0].value.endswith("to the plant, 0.86 to each other")
    assert rows[0].value.startswith("0.86 to 1.00")
    values = [row.value for row in rows]
    assert values[1] == "4.00 m, coefficient of variation 0.0 %"
    assert values[3] == "30 to 60°, coefficient of variation 33.3 %"
    assert values[4] == "97.0 to 100.0 %"
    assert rows[1].remark == "4.00 m of the plant"


def test_a_plant_that_hangs_or_lies_has_traits_too():
    for end_m in ([0, -2, 0], [2, 0, 0]):
        stem = plant_of((np.linspace([0, 0, 0], end_m, 21), 0.05, None, -1))
        traits = measure_traits(stem)
        assert 0 < traits.height_m <= 2
        assert compare_trees(traits, traits).total == 1


def test_no_fork_angle_is_reported_where_there_is_no_fork():
    stem = plant_of((np.linspace([0, 0, 0], [0, 2, 0], 21), 0.05, None, -1))
    names = [row.name for row in likeness_rows(stem, [stem, stem], [1.0, 1.0])]
    assert "height of variations" in names
    assert "mean fork angle of variations" not in names
    rows = likeness_rows(fork(), [fork(), stem], [1.0, 1.0])
    assert "nan" not in "".join(f"{row.value}{row.remark}" for row in rows)
    assert "mean fork angle of variations" in [row.name for row in rows]
