import numpy as np
import pytest
from usdfoliage.branch.model import Skeleton

from tests.support.branch_shapes import fork


def test_a_branch_is_found_by_its_number():
    plant = fork()
    assert plant.points_m[plant.branch(1)].tolist()[0] == plant.points_m[1].tolist()
    assert plant.curve.tolist() == [0, 0, 0, 1, 1, 2, 2]
    assert plant.first.tolist() == [0, 3, 5]


def test_lengths_are_those_of_the_branches_alone():
    assert fork().lengths_m == pytest.approx([2.0, 1.0, np.sqrt(0.5)])


def test_up_to_an_order_keeps_what_carries_it():
    plant = fork().up_to_order(1)
    assert plant.counts.tolist() == [3, 2]
    assert plant.parent_curve.tolist() == [-1, 0]
    assert plant.parent_vertex.tolist() == [-1, 1]


@pytest.mark.parametrize(
    ("change", "about"),
    [
        ({"parent_curve": np.array([-1, 2, 1], np.int32)}, "after its parent"),
        ({"parent_vertex": np.array([-1, 5, 4], np.int32)}, "vertex of its parent"),
        ({"parent_vertex": np.array([-1, 2, 4], np.int32)}, "repeat the vertex"),
        ({"counts": np.array([5, 1, 1], np.int32)}, "2 or more"),
        ({"radius_m": np.zeros(7)}, "above 0"),
        ({"order": np.zeros(2, np.int32)}, r"order must be \(3,\)"),
    ],
)
def test_what_is_no_skeleton_is_refused(change, about):
    plant = fork()
    fields = {name: getattr(plant, name) for name in Skeleton.__dataclass_fields__}
    with pytest.raises(ValueError, match=about):
        Skeleton(**{**fields, **change})
