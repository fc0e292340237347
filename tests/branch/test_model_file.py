"""The files of branches that stages hand on."""

from dataclasses import fields, replace

import numpy as np
import pytest
from usdfoliage.branch.cage.build import BranchCage, DroppedBranch, build_branch_cage
from usdfoliage.branch.cage.drop_reason import DropReason
from usdfoliage.branch.cage.surfaces import BranchSurfaces
from usdfoliage.branch.model import Skeleton
from usdfoliage.branch.model_file import (
    BranchesModel,
    TracedPlant,
    read_branches_model,
    read_traced_plant,
    write_branches_model,
    write_traced_plant,
)

from tests.support.branch_shapes import fork
from tests.support.model_files import check_model_file


def assert_same_skeleton(found, wanted):
    for field in fields(Skeleton):
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        assert one.dtype == other.dtype
        assert np.array_equal(one, other), field.name


def test_branches_come_back_with_all_their_surfaces(tmp_path):
    skeleton = fork()
    whole = replace(
        build_branch_cage(skeleton), dropped=(DroppedBranch(curve=1, reason=DropReason.NO_ROOM),), loose=(1,)
    )
    coarse = build_branch_cage(skeleton.up_to_order(0))
    model = BranchesModel(
        skeleton=skeleton,
        surfaces=BranchSurfaces(whole=whole, by_order=((1, coarse),)),
        color=(0.1, 1 / 3, 0.2),
        growth={"rootDiameter": 0.1, "internodeLength": 1 / 7},
    )
    found = check_model_file(tmp_path, model, write_branches_model, read_branches_model, "skeleton_points_m")
    assert_same_skeleton(found.skeleton, skeleton)
    assert [order for order, _ in found.surfaces.by_order] == [1]
    for one, other in ((found.surfaces.whole, whole), (found.surfaces.by_order[0][1], coarse)):
        assert one.tries is None  # of use while surfaces are built alone
        for field in (each for each in fields(BranchCage) if each.name != "tries"):
            loaded, wanted = getattr(one, field.name), getattr(other, field.name)
            assert np.array_equal(loaded, wanted) if isinstance(wanted, np.ndarray) else loaded == wanted, field.name
    assert found.surfaces.coarsest is found.surfaces.by_order[0][1]
    assert found.color == (0.1, 1 / 3, 0.2)
    assert found.growth == {"rootDiameter": 0.1, "internodeLength": 1 / 7}


@pytest.mark.parametrize("colored", [False, True])
def test_a_traced_cloud_comes_back(tmp_path, colored):
    rng = np.random.default_rng(0)
    plant = TracedPlant(
        points_m=rng.normal(size=(40, 3)),
        wood=np.arange(40) < 39,
        knows_leaves=True,
        colors=rng.integers(0, 255, (40, 3)).astype(np.float64) if colored else None,
        plant_from_capture=np.diag([2.0, 2, 2, 1]),
        skeleton=fork(),
        of_photographs=colored,
        turned=np.array([2, 5], np.int32),
        unjoined=np.array([7], np.int32),
    )
    found = check_model_file(tmp_path, plant, write_traced_plant, read_traced_plant, "points_m")
    assert_same_skeleton(found.skeleton, fork())
    assert found.is_leafless
    assert not replace(found, knows_leaves=False).is_leafless
    assert found.of_photographs == colored
    for name in ("points_m", "wood", "plant_from_capture", "turned", "unjoined"):
        assert np.array_equal(getattr(found, name), getattr(plant, name)), name
    assert (found.colors is None) != colored
    assert not colored or np.array_equal(found.colors, plant.colors)
