"""Storm draws branches that a rig moves as USD bakes them, and growth up to the plant."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.branches.motion import BranchMotion
from usdfoliage.jobs.preview.pictures import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.preview.recorder import find_interpreter

from tests.support.branch_clouds import small_tree
from tests.support.branch_motions import leaves_on, write_moving

pytestmark = pytest.mark.preview

MOTION = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4, swing_rad=0.4), growth_frames=8)


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    return write_moving(tmp_path_factory.mktemp("a tree") / "tree", "tree", small_tree(), MOTION)


@pytest.fixture(scope="module")
def leafy(asset, tmp_path_factory):
    """Nothing but leaves to see: with branches they would hide behind them."""
    grown = leaves_on(small_tree(), "bezier", "mesh")
    made = write_moving(tmp_path_factory.mktemp("leafy") / "tree", "tree", small_tree(), MOTION, grown)
    scene = made.with_name("leaves.usda")
    stage = Usd.Stage.CreateNew(str(scene))
    tree = stage.DefinePrim("/tree")
    tree.GetReferences().AddReference("./tree.usda")
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.Imageable(stage.OverridePrim("/tree/geo/render/Branches")).MakeInvisible()
    stage.Save()
    return scene


def covered(file, **settings):
    """Which pixels a tree covers."""
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=(-1.6, 1.6, -0.2, 4.6))
    wanted = PreviewSettings(width_px=320, height_px=480, complexity="medium", samples=1, **settings)
    (picture,) = draw_views(file, [view], wanted)
    return picture[..., 3] > 0.5


@pytest.fixture(scope="module")
def still(asset):
    return covered(asset)


@pytest.fixture(scope="module")
def still_leaves(leafy):
    return covered(leafy)


def overlap(one, other):
    return (one & other).sum() / (one | other).sum()


def test_storm_moves_branches_as_usd_bakes_them(asset, still, tmp_path):
    stage = Usd.Stage.Open(str(asset))
    stage.SetEditTarget(stage.GetSessionLayer())
    stage.GetDefaultPrim().GetVariantSet("rig").SetVariantSelection("skel")
    assert UsdSkel.BakeSkinning(stage.Traverse())
    baked = tmp_path / "baked.usda"
    stage.Flatten().Export(str(baked))
    moved = covered(asset, variants=(("rig", "skel"),), frame=3.0)
    assert overlap(moved, covered(baked, frame=3.0)) > 0.99
    assert overlap(moved, still) < 0.8


def test_growth_ends_with_the_plant(asset, still):
    assert np.array_equal(covered(asset, variants=(("growth", "growing"),), frame=8.0), still)


def test_an_instancer_of_leaves_sways_as_their_mesh_is_skinned(leafy, still_leaves):
    chosen = (("rig", "skel"), ("representation", "bezier")), (("rig", "skel"), ("representation", "mesh"))
    bezier, mesh = (covered(leafy, variants=each, frame=3.0) for each in chosen)
    assert bezier.sum() > 500
    assert overlap(bezier, mesh) > 0.9
    assert overlap(bezier, still_leaves) < 0.5


def test_leaves_grow_to_what_they_are_at_last(leafy, still_leaves):
    growing = (("growth", "growing"),)
    with pytest.raises(PreviewError, match="Storm drew nothing"):
        covered(leafy, variants=growing, frame=1.0)
    assert np.array_equal(covered(leafy, variants=growing, frame=8.0), still_leaves)
