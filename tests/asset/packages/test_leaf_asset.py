"""Leaves as a USD asset: its layout, its values against tests/golden, reading it back, what is refused.

After a change that is meant, write the golden values anew and read the difference before committing it::

    USDFOLIAGE_UPDATE_GOLDEN=1 .venv/bin/python -m pytest tests/asset/packages/test_leaf_asset.py -k golden
    git diff tests/golden
"""

import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from usdfoliage.asset.packages.contents import prototype_segments, read_leaf_appearance
from usdfoliage.asset.packages.leaf_package import write_leaf_asset
from usdfoliage.asset.parts.leaf_part import LeafAppearance, LeafAssetSettings
from usdfoliage.asset.parts.leaves import PROTOTYPE_MARGIN, author_leaves, leaves_prim, read_leaves
from usdfoliage.asset.validation.studio_profile import default_profile, read_profile
from usdfoliage.asset.validation.validate import validate_asset
from usdfoliage.errors import AssetError, CaptureError
from usdfoliage.leaf.model import Leaves, mean_leaf
from usdfoliage.leaf.shape.edits import NEUTRAL, LeafEdits, apply_edits
from usdfoliage.leaf.shape.jitter import NO_JITTER, Jitter
from usdfoliage.leaf.shape.mesh import PrototypeSettings
from usdfoliage.leaf.shape.surface import evaluate_grid
from usdfoliage.leaf.shape.variation import default_leaf

from tests.support.leaves.assets import PROVENANCE, random_leaves, two_leaves, write_spray
from tests.support.usd_values import compare_with_golden, composed, hashes

GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "leaves" / "spray.txt"
LEAVES = "/spray/geo/render/Leaves"
EDITS = LeafEdits(
    width=1.5,
    axis1=(0.125, 0, 0.25),
    silhouette2=(0.0625, 0.125, -0.25),
    curl=(0.25, 0.125, -0.125),
    jitter_amplitude=0.0625,
    jitter_frequency=4.0,
)


@pytest.fixture
def spray(tmp_path):
    return write_spray(tmp_path / "spray", representations=("bezier",))


@pytest.fixture
def leaves_of():
    """The leaves of an interface layer; their stages stay open until the test ends."""
    stages = []

    def open_leaves(interface):
        stages.append(Usd.Stage.Open(str(interface)))
        return stages[-1].GetPrimAtPath(LEAVES)

    return open_leaves


def assert_same_leaves(found, wanted):
    """The same but for what float32 cannot hold, and not even that where the numbers are float32."""
    for field in fields(Leaves):
        actual, expected = getattr(found, field.name), getattr(wanted, field.name)
        assert (actual is None) == (expected is None), field.name
        if expected is not None:
            kind = np.int32 if field.name in ("view", "origin") else np.float32
            np.testing.assert_array_equal(actual.astype(kind), expected.astype(kind), err_msg=field.name)


def test_golden(spray):
    lines = composed(Usd.Stage.Open(str(spray)))
    compare_with_golden([line for line in lines if not line.startswith("/spray/mtl/Leaf")], GOLDEN)


def test_layout(spray):
    folder = spray.parent
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    assert [file for file in files if not file.startswith("shaders/")] == [
        "payload/leaves.usdc",
        "payload/materials.usda",
        "payload/payload.usda",
        "spray.usda",
    ]
    assert {file for file in files if file.startswith("shaders/")} >= {"shaders/usdFoliageLeaf.glslfx"}
    assert "shaders/usdFoliageCrown.glslfx" not in files


def test_the_interface_describes_the_asset(spray):
    stage = Usd.Stage.Open(str(spray), Usd.Stage.LoadNone)
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/spray"
    assert Usd.ModelAPI(root).GetKind() == Kind.Tokens.component
    assert root.GetInherits().GetAllDirectInherits() == ["/__class__/spray"]
    assert root.GetVariantSets().GetNames() == ["lod", "representation"]
    assert root.GetVariantSets().GetAllVariantSelections() == {"lod": "leaves", "representation": "bezier"}
    assert root.GetVariantSets().GetVariantSet("representation").GetVariantNames() == ["bezier"]
    assert root.GetRelationship("foliage:leaves").GetTargets() == [LEAVES]
    assert not root.GetRelationship("foliage:crown").HasAuthoredTargets()
    assert [Path(layer.realPath).name for layer in stage.GetUsedLayers() if layer.realPath] == ["spray.usda"]
    stage.Load()
    for scope in ("geo", "geo/render"):
        assert not stage.GetPrimAtPath(f"/spray/{scope}").GetAttribute("purpose").HasAuthoredValue()
    assert UsdGeom.Imageable(stage.GetPrimAtPath(LEAVES)).ComputePurpose() == "default"


def test_bounds_contain_what_is_drawn(tmp_path):
    leaves = random_leaves(20)
    interface = write_spray(tmp_path, leaves, edits=EDITS, representations=("bezier",))
    stage = Usd.Stage.Open(str(interface))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath(LEAVES))
    low, high = np.array(UsdGeom.Mesh(stage.GetPrimAtPath(f"{LEAVES}/Prototypes/Leaf")).GetExtentAttr().Get())
    u, v = np.linspace(-1, 1, 33), np.linspace(0, 1, 129)
    jitter = Jitter(amplitude=EDITS.jitter_amplitude, frequency=EDITS.jitter_frequency)
    points = evaluate_grid(apply_edits(leaves.parameters, EDITS), u, v, jitter, leaves.phase).points
    assert (points >= low - 1e-6).all()
    assert (points <= high + 1e-6).all()
    matrix = leaves.asset_from_leaf()
    points_m = np.einsum("nij,nvuj->nvui", matrix[:, :, :3], points) + matrix[:, None, None, :, 3]
    # Far enough for edits that the asset does not know.
    np.testing.assert_array_less(points.reshape(-1, 3).max(axis=0) + 0.99 * PROTOTYPE_MARGIN, high)
    np.testing.assert_array_less(low, points.reshape(-1, 3).min(axis=0) - 0.99 * PROTOTYPE_MARGIN)
    low_m, high_m = np.array(instancer.GetExtentAttr().Get())
    size = high_m - low_m
    assert (points_m >= low_m - 1e-6).all()
    assert (points_m <= high_m + 1e-6).all()
    assert (points_m.reshape(-1, 3).min(axis=0) - low_m < 0.05 * size).all()  # and not much more
    assert (high_m - points_m.reshape(-1, 3).max(axis=0) < 0.05 * size).all()
    hint = UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint()
    np.testing.assert_allclose(np.array(hint), [low_m, high_m], rtol=0, atol=1e-6)


def test_both_orientations_come_from_one_source(tmp_path, leaves_of):
    leaves = random_leaves(50)
    instancer = UsdGeom.PointInstancer(leaves_of(write_spray(tmp_path, leaves)))
    exact = np.array(instancer.GetOrientationsfAttr().Get())
    half = np.array(instancer.GetOrientationsAttr().Get())
    np.testing.assert_array_equal(half, exact.astype(np.float16))
    np.testing.assert_array_equal(exact, leaves.orientation.astype(np.float32))  # x, y, z, w in both
    wanted = leaves.asset_from_leaf()
    time = Usd.TimeCode.Default()
    found = np.array(instancer.ComputeInstanceTransformsAtTime(time, time, UsdGeom.PointInstancer.ExcludeProtoXform))
    np.testing.assert_allclose(found[:, :3, :3].transpose(0, 2, 1), wanted[:, :, :3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[:, 3, :3], wanted[:, :, 3], rtol=0, atol=1e-6)


def test_prototype_is_the_mean_leaf(spray, leaves_of):
    prototype = UsdGeom.Mesh(leaves_of(spray).GetPrimAtPath("Prototypes/Leaf"))
    points, places = (
        np.array(attribute.Get())
        for attribute in (prototype.GetPointsAttr(), prototype.GetPrim().GetAttribute("primvars:st"))
    )
    mean = mean_leaf(two_leaves().parameters)
    for point, (s, t) in zip(points, places, strict=True):
        exact = evaluate_grid(mean[None], np.array([2 * s - 1]), np.array([t])).points[0, 0, 0]
        np.testing.assert_allclose(point, exact, rtol=0, atol=1e-6)
    assert prototype.GetDoubleSidedAttr().Get()
    assert prototype.GetSubdivisionSchemeAttr().Get() == "none"
    material, relationship = UsdShade.MaterialBindingAPI(prototype).ComputeBoundMaterial()
    assert relationship.GetPrim() == prototype.GetPrim()  # on the gprim itself
    assert material.GetPath() == "/spray/mtl/Leaf"


@settings(max_examples=20, deadline=None)
@given(count=st.integers(0, 40), seed=st.integers(0, 2**32 - 1), facts=st.booleans())
def test_reading_gives_back_what_was_written(count, seed, facts):
    leaves = random_leaves(count, seed, facts)
    stage = Usd.Stage.CreateInMemory()
    prim = leaves_prim(leaves, NEUTRAL, NO_JITTER, (0.1, 0.2, 0.1), "", PrototypeSettings())
    author_leaves(stage, Sdf.Path("/Leaves"), prim)
    found = read_leaves(stage.GetPrimAtPath("/Leaves"))
    assert_same_leaves(found.leaves, leaves)
    assert found.edits == NEUTRAL
    assert found.jitter_map is None


def test_reading_gives_back_what_is_on_the_disk(tmp_path, leaves_of):
    image = tmp_path / "wave.PNG"
    cv2.imwrite(str(image), np.arange(0, 256, 8, np.uint8)[None])
    leaves = random_leaves(300, facts=True)
    interface = write_spray(tmp_path / "spray", leaves, LeafAppearance(jitter_map=image), EDITS)
    found = read_leaves(leaves_of(interface))
    assert_same_leaves(found.leaves, leaves)
    assert found.edits == EDITS
    assert found.jitter_map == interface.parent / "maps" / "spray_leaf_jitter.png"
    assert found.jitter_map.read_bytes() == image.read_bytes()
    again = write_spray(tmp_path / "again", found.leaves, LeafAppearance(jitter_map=found.jitter_map), found.edits)
    assert hashes(again.parent) == hashes(interface.parent)


def test_an_edit_of_a_stronger_layer_is_read(spray, tmp_path, leaves_of):
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    shot.DefinePrim("/World/plant").GetReferences().AddReference("./spray/spray.usda")
    prim = shot.GetPrimAtPath("/World/plant/geo/render/Leaves")
    prim.GetAttribute("primvars:leaf:edit:width").Set(0.5)
    prim.GetAttribute("primvars:leaf:edit:curl").Set(Gf.Vec3f(0, 0.25, 0))
    assert read_leaves(prim).edits == LeafEdits(width=0.5, curl=(0, 0.25, 0))
    assert read_leaves(leaves_of(spray)).edits == NEUTRAL


def test_hidden_leaves_are_not_read(spray, leaves_of):
    prim = leaves_of(spray)
    UsdGeom.PointInstancer(prim).DeactivateId(0)
    assert_same_leaves(read_leaves(prim).leaves, two_leaves().take([1]))


def test_older_orientations_alone_are_enough(spray, leaves_of):
    prim = leaves_of(spray)
    prim.GetAttribute("orientationsf").Block()
    found = read_leaves(prim).leaves.orientation
    np.testing.assert_allclose(found, two_leaves().orientation, rtol=0, atol=1e-3)


def test_no_leaves_are_a_valid_empty_asset(tmp_path, leaves_of):
    interface = write_spray(tmp_path / "spray", random_leaves(0))
    found = read_leaves(leaves_of(interface))
    assert len(found.leaves) == 0
    prototype = UsdGeom.Mesh(leaves_of(interface).GetPrimAtPath("Prototypes/Leaf"))
    low, high = np.array(prototype.GetExtentAttr().Get())
    tip = evaluate_grid(default_leaf()[None], np.array([0.0]), np.array([1.0])).points.reshape(3)
    assert (low <= tip).all()
    assert (tip <= high).all()


def change(prim, name, value):
    prim.GetAttribute(name).Set(value)


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda p: p.GetAttribute("primvars:leaf:axis2").Block(), "primvars:leaf:axis2 is missing"),
        (lambda p: p.GetAttribute("scales").Block(), "scales is missing"),
        (lambda p: change(p, "primvars:leaf:inner", [Gf.Vec3f(0)]), "primvars:leaf:inner has 1 elements where 2"),
        (lambda p: change(p, "positions", [Gf.Vec3f(0)] * 3), "scales has 2 elements where 3"),
        (lambda p: change(p, "primvars:leaf:phase", [0.0]), "primvars:leaf:phase has 1 elements where 2"),
        (
            lambda p: change(p, "primvars:leaf:outer", [Gf.Vec3f(0), Gf.Vec3f(0, float("nan"), 0)]),
            "primvars:leaf:outer is not finite in 1 of 2 leaves, the first is leaf 1",
        ),
        (lambda p: change(p, "positions", [Gf.Vec3f(float("inf")), Gf.Vec3f(0)]), "positions is not finite in 1 of 2"),
        (lambda p: change(p, "scales", [Gf.Vec3f(1), Gf.Vec3f(-1)]), "scales is not above 0 .* leaf 1"),
        (lambda p: change(p, "scales", [Gf.Vec3f(1, 2, 1), Gf.Vec3f(1)]), "the same for all axes in 1 of 2"),
        (lambda p: change(p, "primvars:leaf:edit:width", float("nan")), "width must be"),
        (
            lambda p: change(p, "foliage:leaf:jitterMap", Sdf.AssetPath("./none.png")),
            "map ./none.png is missing",
        ),
    ],
)
def test_broken_leaves_are_refused(spray, break_it, message, leaves_of):
    prim = leaves_of(spray)
    break_it(prim)
    with pytest.raises(AssetError, match=message) as refused:
        read_leaves(prim)
    assert f"{spray} <{LEAVES}>" in str(refused.value)


def test_what_is_no_instancer_of_leaves_is_refused():
    stage = Usd.Stage.CreateInMemory()
    for prim in (stage.DefinePrim("/a", "Mesh"), stage.DefinePrim("/b", "PointInstancer"), stage.GetPrimAtPath("/c")):
        with pytest.raises(AssetError, match="FoliageLeafAPI"):
            read_leaves(prim)


def test_wrong_arguments_are_refused(tmp_path):
    leaves = two_leaves()
    with pytest.raises(ValueError, match="identifier"):
        write_leaf_asset(tmp_path, "2 leaves", leaves, PROVENANCE)
    for wrong, message in (
        (replace(leaves, length_m=np.array([1.0, 0.0])), "length_m must be above 0"),
        (replace(leaves, base_m=leaves.base_m * np.nan), "base_m is not finite in 2 of 2"),
        (replace(leaves, orientation=leaves.orientation * [[1], [0]]), "1 of 2 orientations"),
    ):
        for representation in ("bezier", "nurbs", "subdiv", "mesh"):
            with pytest.raises(ValueError, match=message):
                write_spray(tmp_path, wrong, representations=(representation,))
    for names in ((), ("bezier", "bezier"), ("polygons",)):
        with pytest.raises(ValueError, match="representations must be one or more of bezier, nurbs, subdiv, mesh"):
            LeafAssetSettings(representations=names)


@pytest.mark.parametrize(
    ("frequency", "amplitude", "segments"),
    [(4.0, 0.02, 128), (12.5, 0.02, 200), (100.0, 0.02, 512), (100.0, 0.0, 128)],
)
def test_the_prototype_is_as_fine_as_its_jitter_needs(tmp_path, leaves_of, frequency, amplitude, segments):
    edits = LeafEdits(jitter_amplitude=amplitude, jitter_frequency=frequency)
    chosen = {"prototype": PrototypeSettings(), "representations": ("bezier",)}
    leaves = leaves_of(write_spray(tmp_path / "spray", edits=edits, **chosen))
    assert prototype_segments(leaves) == segments


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (None, "missing"),
        (b"no image", "not an image"),
        (np.full((1, 8), 2.0, np.float32), "values from 2 to 2"),
        (np.full((4, 1), 0.5, np.float32), "is 1 pixel wide; a wave needs 2 or more"),
    ],
)
def test_a_jitter_map_that_is_none_is_refused(tmp_path, pixels, message):
    path = tmp_path / "wave.tif"
    if isinstance(pixels, bytes):
        path.write_bytes(pixels)
    elif pixels is not None:
        cv2.imwrite(str(path), pixels)
    with pytest.raises(CaptureError, match=message):
        write_spray(tmp_path / "spray", appearance=LeafAppearance(jitter_map=path))


def test_a_texture_that_is_missing_is_refused(tmp_path):
    with pytest.raises(AssetError, match=r"none\.png cannot be copied"):
        write_spray(tmp_path / "spray", appearance=LeafAppearance(texture=tmp_path / "none.png"))


def test_a_tinted_texture_is_read_back(tmp_path):
    image = tmp_path / "leaf.png"
    cv2.imwrite(str(image), np.full((4, 4, 4), 128, np.uint8))
    median = (0.25, 0.5, 0.125)
    for name, look in (
        ("tinted", LeafAppearance(texture=image, texture_color=median)),
        ("plain", LeafAppearance(texture=image)),
    ):
        interface = write_spray(tmp_path / name, appearance=look)
        stage = Usd.Stage.Open(str(interface))
        appearance = read_leaf_appearance(stage.GetPrimAtPath("/spray/geo/render/Leaves"), None, [interface.parent])
        assert appearance.texture_color == look.texture_color
        # MaterialX multiplies by the ratio of the leaf's colour to the picture's median.
        assert bool(stage.GetPrimAtPath("/spray/mtl/Leaf/MtlxTint")) == (look.texture_color is not None)


def test_every_path_is_relative_and_resolves_after_a_move(tmp_path):
    image = tmp_path / "leaf.png"
    cv2.imwrite(str(image), np.full((4, 4, 4), 128, np.uint8))
    interface = write_spray(tmp_path / "spray", appearance=LeafAppearance(texture=image, jitter_map=image))
    moved = (tmp_path / "other place").resolve()
    interface.parent.rename(moved)
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(moved / "spray.usda"))
    assert not unresolved
    used = {Path(layer.realPath).resolve() for layer in layers} | {Path(asset).resolve() for asset in assets}
    kept = {path for path in moved.rglob("*") if path.is_file()}
    assert used <= kept
    assert {path for path in kept - used if path.suffix != ".glslfx"} == set()
    for text in (moved / "spray.usda", *(moved / "payload").glob("*.usda")):
        assert all(path.startswith(("./", "../")) for path in text.read_text().split("@")[1::2])
    for path in kept:
        assert str(tmp_path).encode() not in path.read_bytes()


def test_validators_find_nothing(tmp_path):
    for name, leaves in (("two", two_leaves()), ("none", random_leaves(0)), ("many", random_leaves(30))):
        report = validate_asset(write_spray(tmp_path / name, leaves, edits=EDITS), read_profile(default_profile()))
        assert report.open_errors == 0, report.findings
        assert report.count("warning") == 0, report.findings


WRITE_AND_HASH = """
import sys
from pathlib import Path
from tests.support.leaves.assets import random_leaves, write_spray
from tests.support.usd_values import hashes
write_spray(Path(sys.argv[1]), random_leaves(200))
print(hashes(Path(sys.argv[1])))
"""


def test_same_inputs_give_the_same_bytes(tmp_path):
    wanted = hashes(write_spray(tmp_path / "here", random_leaves(200)).parent)
    keep_open = Usd.Stage.Open(str(tmp_path / "here" / "spray.usda"))
    assert hashes(write_spray(tmp_path / "here", random_leaves(200)).parent) == wanted  # over itself, while it is open
    assert keep_open
    done = subprocess.run(
        [sys.executable, "-c", WRITE_AND_HASH, str(tmp_path / "elsewhere")],
        env={**os.environ, "PYTHONHASHSEED": "5"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == str(wanted)
