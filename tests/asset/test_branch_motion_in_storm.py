"""Storm draws branches that a rig moves as USD bakes them, and growth up to the plant."""

from pathlib import Path

import numpy as np
import pytest
from branch_clouds import small_tree
from branch_motions import write_moving
from pxr import Usd, UsdSkel
from usdfoliage.branch.rig import RigSettings
from usdfoliage.branch.sway import SwaySettings
from usdfoliage.errors import PreviewError
from usdfoliage.jobs.branch_motion import BranchMotion
from usdfoliage.jobs.preview import PreviewSettings, PreviewView, draw_views
from usdfoliage.jobs.recorder import find_interpreter

pytestmark = pytest.mark.preview

MOTION = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4, swing_rad=0.4), growth_frames=8)


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    try:
        find_interpreter()
    except PreviewError as error:
        pytest.skip(f"the preview interpreter is absent: {error}")
    return write_moving(tmp_path_factory.mktemp("a tree") / "tree", "tree", small_tree(), MOTION)


def covered(file, **settings):
    """Which pixels a tree covers."""
    view = PreviewView(output=Path("unused.png"), orthographic=True, window=(-1.6, 1.6, -0.2, 4.6))
    wanted = PreviewSettings(width_px=320, height_px=480, complexity="medium", samples=1, **settings)
    (picture,) = draw_views(file, [view], wanted)
    return picture[..., 3] > 0.5


@pytest.fixture(scope="module")
def still(asset):
    return covered(asset)


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
