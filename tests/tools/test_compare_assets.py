"""The developers' comparison of two assets by their composed values."""

import shutil

import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.support.plant_assets import write_whole_plant
from tools.compare_assets import main


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a whole plant."""
    return write_whole_plant(tmp_path_factory.mktemp("whole") / "oak").parent


@pytest.fixture
def other(whole, tmp_path):
    """A copy of it."""
    shutil.copytree(whole, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture
def compare(capsys, monkeypatch):
    """Run the tool; its exit code and what it printed."""

    def run(old, new, *options):
        monkeypatch.setattr("sys.argv", ["compare_assets.py", str(old), str(new), *options])
        code = main()
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def change(folder, layer, path, value, time=None):
    opened = Sdf.Layer.FindOrOpen(str(folder / "payload" / layer))
    attribute = opened.GetAttributeAtPath(path)
    if time is None:
        attribute.default = value(attribute.default)
    else:
        opened.SetTimeSample(path, time, value(attribute.default))
    opened.Save()


def test_a_plant_is_as_itself_in_every_selection_and_under_another_name(compare, whole, tmp_path):
    other = write_whole_plant(tmp_path / "ash", "ash").parent
    for new in (whole, other):
        code, out, _ = compare(whole, new)
        assert code == 0, out
        assert out.startswith("32 selections")  # 4 lods, 4 representations, 2 surfaces
        assert ": 0 differences; ignored: foliage:generator, customLayerData" in out


def test_provenance_is_ignored(compare, whole, other):
    layer = Sdf.Layer.FindOrOpen(str(other / "oak.usda"))
    layer.customLayerData = {"usdfoliage": {"seed": 5}}
    layer.GetAttributeAtPath("/oak.foliage:generator").default = "another"
    layer.Save()
    assert compare(whole, other)[0] == 0


def move_first(points):
    return Vt.Vec3fArray([points[0] + type(points[0])(1e-4), *points[1:]])


def test_a_value_of_one_variant_a_sample_a_picture_and_a_prim_are_found(compare, whole, other):
    change(other, "leaves_mesh.usdc", "/oak/geo/render/Leaves.points", move_first)
    change(other, "skeleton.usdc", "/oak/geo/guide/Skeleton.widths", lambda widths: widths, time=1.0)
    (other / "maps" / "fork_bark.png").write_bytes(b"no picture")
    interface = other / "oak.usda"
    stage = Usd.Stage.Open(str(interface))
    UsdGeom.Xform.Define(stage, "/oak/more")
    stage.GetDefaultPrim().GetVariantSet("lod").SetVariantSelection("crown")
    stage.Save()
    code, out, _ = compare(whole, other)
    assert code == 1
    assert "/NAME/geo/render/Leaves.points: value: 3 of" in out
    assert "representation=mesh" in out
    assert "Skeleton.widths: times: [] and [1.0]" in out
    assert "the bytes of ../maps/fork_bark.png differ" in out
    assert "/NAME/more: only in NEW" in out
    assert "selected='crown'" in out


def test_a_tolerance_lets_numbers_differ(compare, whole, other):
    change(other, "leaves_mesh.usdc", "/oak/geo/render/Leaves.points", move_first)
    assert compare(whole, other)[0] == 1
    assert compare(whole, other, "--tolerance", "1e-3")[0] == 0


def test_what_is_no_asset_is_refused(compare, whole, tmp_path):
    code, _, err = compare(whole, tmp_path / "nowhere")
    assert code == 2
    assert "nowhere does not exist" in err
