"""The trunk that a crown leaves bare, in each lod that shows the crown."""

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade
from usdfoliage.asset.packages.other_parts import read_other_parts
from usdfoliage.asset.packages.plant_package import write_plant_asset
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError

from tests.support.plant_assets import RUN, high_crown, round_crown, write_whole_plant

BARE = "/oak/geo/proxy/Branches"
TRUNK_M, BRANCH_M = 0.05, 0.03  # radii


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return write_whole_plant(tmp_path_factory.mktemp("plant") / "oak", crown=high_crown())


def open_lod(asset, lod):
    session = Sdf.Layer.CreateAnonymous(".usda")
    Sdf.CreatePrimInLayer(session, "/oak").variantSelections["lod"] = lod
    return Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(asset)), session)


@pytest.mark.parametrize("lod", ["crown", "both", "auto"])
def test_the_trunk_is_drawn_with_the_crown_down_to_the_root(asset, lod):
    stage = open_lod(asset, lod)
    bare = UsdGeom.Mesh(stage.GetPrimAtPath(BARE))
    points = np.array(bare.GetPointsAttr().Get())
    assert points[:, 1].min() == pytest.approx(-TRUNK_M, abs=2 * TRUNK_M)
    assert points[:, 0].max() >= 1  # the branch too, which stands out at the side; of order 1, not the twig's 1.35
    assert points[:, 0].max() < 1.2
    inside = np.linalg.norm(points - (0, 2, 0), axis=1) < 0.6 * (1 - 0.15)
    faces = np.array(bare.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    assert not inside[faces].all(axis=1).any()
    assert UsdGeom.Imageable(bare).ComputePurpose() == ("proxy" if lod == "both" else "default")
    bound, _ = UsdShade.MaterialBindingAPI(bare).ComputeBoundMaterial()
    assert bound.GetPath() == Sdf.Path("/oak/mtl/Bark")


def test_what_is_kept_of_the_surface_is_as_it_was(asset):
    stage = open_lod(asset, "crown")
    bare = UsdGeom.Mesh(stage.GetPrimAtPath(BARE))
    layer = Usd.Stage.Open(str(asset.parent / "payload" / "branches_order1.usdc"))
    whole = UsdGeom.Mesh(layer.GetPrimAtPath("/oak/geo/render/Branches"))

    def corners(mesh):
        points, faces = (np.array(a.Get()) for a in (mesh.GetPointsAttr(), mesh.GetFaceVertexIndicesAttr()))
        st = np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").ComputeFlattened())
        return {tuple(face.ravel()) for face in np.concatenate([points[faces], st], axis=1).reshape(-1, 4, 5)}

    kept, all_of_them = corners(bare), corners(whole)
    assert kept < all_of_them
    color = [UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Get()[0] for mesh in (bare, whole)]
    assert color[0] == color[1]
    assert bare.GetSubdivisionSchemeAttr().Get() == "catmullClark"


def test_a_crown_down_to_the_ground_leaves_nothing_bare(tmp_path):
    asset = write_whole_plant(tmp_path / "oak", crown=round_crown())
    assert not open_lod(asset, "crown").GetPrimAtPath(BARE)
    assert not (asset.parent / "payload" / "branches_bare.usdc").exists()


def test_hints_hold_the_trunk(asset):
    for lod, number in (("crown", 0), ("both", 2)):
        stage = open_lod(asset, lod)
        hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()).reshape(-1, 2, 3)[number]
        extent = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(BARE)).GetExtentAttr().Get())
        assert (hint[0] <= extent[0]).all()
        assert (hint[1] >= extent[1]).all()
        assert hint[1, 1] == pytest.approx(crown_top(stage), abs=0.02)


def crown_top(stage: Usd.Stage) -> float:
    """The top of the crown in the form that goes farther: that of its mesh is 2.6."""
    forms = stage.GetPrimAtPath("/oak/geo/proxy").GetVariantSets().GetVariantSet("crown")
    tops = {}
    for form in forms.GetVariantNames():
        forms.SetVariantSelection(form)
        drawn = "CrownLeaves" if form == "leaves" else "Crown"
        crown = UsdGeom.Boundable(stage.GetPrimAtPath(f"/oak/geo/proxy/{drawn}"))
        tops[form] = float(crown.GetExtentAttr().Get()[1][1])
    assert tops["mesh"] == pytest.approx(2.6, abs=0.02)
    return max(tops.values())


def test_the_branches_collection_holds_it_so_that_looks_reach_it(asset):
    stage = open_lod(asset, "crown")
    query = Usd.CollectionAPI(stage.GetDefaultPrim(), "branches").ComputeMembershipQuery()
    assert query.IsPathIncluded(Sdf.Path(BARE))


def test_it_is_sound_in_every_selection(asset):
    report = validate_asset(asset, read_profile(default_profile()))
    assert [finding for finding in report.findings if not finding.accepted] == []


def test_other_leaves_leave_it_and_another_crown_renews_it(asset, tmp_path):
    parts = read_other_parts(asset)
    for name, crown in (("same", None), ("low", round_crown())):
        (tmp_path / name).mkdir()
        made = write_plant_asset(
            tmp_path / name, "oak", provenance=RUN, asset_from_capture=np.eye(4), branches=parts, crown=crown
        )
        stages = [open_lod(each, "crown") for each in (asset, made)]
        before, after = (UsdGeom.Mesh(stage.GetPrimAtPath(BARE)) for stage in stages)
        assert bool(after) == (crown is None)
        if after:
            assert np.array_equal(before.GetPointsAttr().Get(), after.GetPointsAttr().Get())


SURFACE = "/oak/geo/render/Branches"


def with_surface(tmp_path, change):
    """The asset built again on branches whose coarse surface somebody changed."""
    source = write_whole_plant(tmp_path / "oak", crown=high_crown())
    layer = Sdf.Layer.FindOrOpen(str(source.parent / "payload" / "branches_order1.usdc"))
    change(layer)
    layer.Save()
    (tmp_path / "again").mkdir()
    return write_plant_asset(
        tmp_path / "again",
        "oak",
        provenance=RUN,
        asset_from_capture=np.eye(4),
        branches=read_other_parts(source),
        crown=high_crown(),
    )


def set_value(name, change):
    def apply(layer):
        attribute = layer.GetAttributeAtPath(f"{SURFACE}.{name}")
        attribute.default = type(attribute.default)(change(list(attribute.default)))

    return apply


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("faceVertexIndices", lambda values: values[:-1], "Sum"),
        ("faceVertexIndices", lambda values: [99999, *values[1:]], "range"),
        ("faceVertexIndices", lambda values: [-1, *values[1:]], "range"),
        ("faceVertexCounts", lambda values: [0, values[0] + values[1], *values[2:]], "fewer than 3 vertices"),
        ("points", lambda values: [(np.nan, 0, 0), *values[1:]], "no finite number"),
    ],
)
def test_a_broken_surface_is_reported(tmp_path, name, change, reason):
    with pytest.raises(AssetError, match=rf"payload/branches_order1.usdc: .* <{SURFACE}> is broken \(.*{reason}.*mend"):
        with_surface(tmp_path, set_value(name, change))


def test_a_broken_texture_is_left_out(tmp_path):
    asset = with_surface(tmp_path, set_value("primvars:st:indices", lambda values: [99999, *values[1:]]))
    stage = open_lod(asset, "crown")
    bare = UsdGeom.Mesh(stage.GetPrimAtPath(BARE))
    assert len(bare.GetPointsAttr().Get())
    assert not UsdGeom.PrimvarsAPI(bare).GetPrimvar("st")


@pytest.mark.parametrize("name", ["subdivisionScheme", "orientation", "primvars:displayColor", "primvars:st"])
def test_what_is_of_another_type_is_left_out(tmp_path, name):
    def change(layer):
        prim = layer.GetPrimAtPath(SURFACE)
        old = prim.attributes[name]
        interpolation = old.GetInfo("interpolation") if old.HasInfo("interpolation") else None
        prim.RemoveProperty(old)
        new = Sdf.AttributeSpec(prim, name, Sdf.ValueTypeNames.Int)
        new.default = 3
        if interpolation:
            new.SetInfo("interpolation", interpolation)

    stage = open_lod(with_surface(tmp_path, change), "crown")
    bare = UsdGeom.Mesh(stage.GetPrimAtPath(BARE))
    assert len(bare.GetPointsAttr().Get())
    assert not bare.GetPrim().GetAttribute(name).HasAuthoredValue()


def test_a_surface_that_moves_gives_the_trunk_at_its_first_time(tmp_path, asset):
    def move(layer):
        points = layer.GetAttributeAtPath(f"{SURFACE}.points")
        rest = points.default
        layer.SetTimeSample(points.path, 1, rest)
        layer.SetTimeSample(points.path, 24, type(rest)([point + point for point in rest]))
        points.ClearDefaultValue()

    stages = [open_lod(each, "crown") for each in (with_surface(tmp_path, move), asset)]
    moved, still = (UsdGeom.Mesh(stage.GetPrimAtPath(BARE)) for stage in stages)
    assert np.array_equal(moved.GetPointsAttr().Get(), still.GetPointsAttr().Get())
