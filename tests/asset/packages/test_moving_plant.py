"""A whole plant whose branches sway and grow, and whose leaves follow them in every lod that has any."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdValidation
from usdfoliage.asset.packages.other_parts import read_other_parts
from usdfoliage.asset.packages.plant_package import PlantAssetSettings, write_plant_asset
from usdfoliage.asset.validation import validate as validation
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.branch.motion.rig import RigSettings
from usdfoliage.branch.motion.sway import SwaySettings
from usdfoliage.jobs.branches.motion import BranchMotion

from tests.support.asset_shapes import list_shape, read_shape
from tests.support.branch_motions import leaves_on, write_moving
from tests.support.branch_shapes import fork
from tests.support.plant_assets import RUN, round_crown

MOTION = BranchMotion(rig=RigSettings(), sway=SwaySettings(frames=4, swing_rad=0.3), growth_frames=6)


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    """The asset of branches, and that of the plant."""
    folder = tmp_path_factory.mktemp("moving")
    grown = leaves_on(fork(), "bezier", "mesh")
    branches = write_moving(folder / "fork", "fork", fork(), MOTION, grown)
    (folder / "oak").mkdir()
    plant = write_plant_asset(
        folder / "oak",
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=read_other_parts(branches),
        foliage=grown.foliage,
        crown=round_crown(),
    )
    return branches, plant


def opened(asset, **selections):
    session = Sdf.Layer.CreateAnonymous(".usda")
    layer = Sdf.Layer.FindOrOpen(str(asset))
    spec = Sdf.CreatePrimInLayer(session, f"/{layer.defaultPrim}")
    for name, variant in selections.items():
        spec.variantSelections[name] = variant
    return Usd.Stage.Open(layer, session)


@pytest.mark.parametrize("lod", ["leaves", "both", "auto"])
@pytest.mark.parametrize("chosen", [{"rig": "skel"}, {"growth": "growing"}, {"rig": "skel", "representation": "mesh"}])
def test_it_moves_as_the_branches_did(assets, lod, chosen):
    before, after = opened(assets[0], **chosen), opened(assets[1], lod=lod, **chosen)
    assert (after.GetStartTimeCode(), after.GetEndTimeCode()) == (1, 6)
    moved = 0
    for prim in Usd.PrimRange(before.GetPrimAtPath("/fork/geo/render")):
        other = after.GetPrimAtPath(prim.GetPath().ReplacePrefix("/fork", "/oak"))
        assert other.GetTypeName() == prim.GetTypeName()
        for attribute in prim.GetAuthoredAttributes():
            times = attribute.GetTimeSamples()
            assert other.GetAttribute(attribute.GetName()).GetTimeSamples() == times
            moved += len(times) > 1
            for time in times:
                found, wanted = other.GetAttribute(attribute.GetName()).Get(time), attribute.Get(time)
                if attribute.GetName() == "extent":  # worked out again
                    np.testing.assert_allclose(np.array(found), np.array(wanted), atol=1e-3)
                else:
                    assert found == wanted, attribute
    assert moved


def test_no_layer_of_what_moves_is_opened_for_the_crown(assets):
    stage = opened(assets[1], lod="crown", rig="skel", growth="growing")
    used = {layer.GetDisplayName() for layer in stage.GetUsedLayers()}
    assert not used & {"rig.usdc", "growth.usdc", "rig_leaves.usdc", "growth_leaves.usdc", "skeleton.usdc"}
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).ComputePurpose() == "default"


def test_it_is_sound(assets, monkeypatch):
    monkeypatch.setattr(validation, "MAX_SELECTIONS", 16)  # the sets one by one, for time
    report = validation.validate_asset(assets[1], read_profile(default_profile()))
    assert [finding for finding in report.findings if finding.severity == "error"] == []
    ours = UsdValidation.ValidationContext(keywords=["usdFoliage"])
    for lod in ("both", "auto"):
        stage = opened(assets[1], lod=lod, rig="skel", growth="growing")
        assert [problem.GetMessage() for problem in ours.Validate(stage)] == []


@pytest.mark.parametrize("lod", ["leaves", "both"])
def test_its_hint_holds_all_frames(assets, lod):
    stage = opened(assets[1], lod=lod, rig="skel", representation="mesh")
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()).reshape(-1, 2, 3)
    number, purpose = (0, "default") if lod == "leaves" else (1, "render")
    for frame in range(1, 5):
        box = (
            UsdGeom.BBoxCache(frame, [purpose]).ComputeUntransformedBound(stage.GetDefaultPrim()).ComputeAlignedRange()
        )
        assert (hint[number, 0] <= np.array(box.min) + 1e-4).all()
        assert (hint[number, 1] >= np.array(box.max) - 1e-4).all()


@pytest.mark.parametrize("lod", [None, "both", "crown", "auto"])
def test_the_shape_that_the_writer_reports_is_that_of_the_composed_asset(assets, lod, tmp_path):
    shapes = []
    write_plant_asset(
        tmp_path,
        "oak",
        provenance=RUN,
        asset_from_capture=np.diag([0.01, 0.01, 0.01, 1.0]),
        branches=read_other_parts(assets[0]),
        foliage=leaves_on(fork(), "bezier", "mesh").foliage,
        crown=round_crown(),
        settings=PlantAssetSettings(lod=lod),
        pictures=lambda interface, shape: shapes.append(shape),
    )
    (shape,) = shapes
    assert {"lod", "representation", "rig", "growth"} <= shape.variants.keys()
    assert list_shape(shape) == list_shape(read_shape(tmp_path))
