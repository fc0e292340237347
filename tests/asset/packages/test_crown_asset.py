"""A crown as a USD asset: its layout, its values against tests/golden, its behaviour in a shot.

After a change that is meant, write the golden values anew and read the difference before committing it::

    USDFOLIAGE_UPDATE_GOLDEN=1 .venv/bin/python -m pytest tests/asset/packages/test_crown_asset.py -k golden
    git diff tests/golden
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, UsdValidation
from usdfoliage.asset.asset_record import is_asset_folder
from usdfoliage.asset.materials.cubemap_exr import read_cubemap
from usdfoliage.asset.packages.leaf_package import AssetSettings, write_crown_asset
from usdfoliage.asset.plant import asset_name
from usdfoliage.asset.provenance import Provenance
from usdfoliage.asset.publish import publish_folder
from usdfoliage.crown.model import CrownModel
from usdfoliage.errors import AssetError
from usdfoliage.geometry.cubemap import face_directions

from tests.support.usd_values import compare_with_golden, composed, hashes

GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "crown" / "oak.txt"
PROVENANCE = Provenance(
    species="Quercus robur",
    capture="oak 01.jpg",
    generator="usdfoliage 0.0.0",
    seed=7,
    settings={"relief": "0.2", "size": "8"},
    input_sha256="00" * 32,
)


def sphere_crown(size=8):
    """A sphere of 1.5 m around (0, 2, 0), each colour its direction; a pixel of the photograph is 1 cm."""
    asset_from_photo = np.diag([0.01, -0.01, 1.0, 1.0])
    asset_from_photo[:3, 3] = (-1.6, 3.6, 0.0)
    return CrownModel(
        radius_m=np.full((6, size, size), 1.5, np.float32),
        color=(0.5 + 0.25 * face_directions(size)).astype(np.float32),
        center_m=np.array([0.0, 2.0, 0.0]),
        relief_weight=0.25,
        asset_from_photo=asset_from_photo,
    )


def write_oak(folder, mesh_size=5):
    folder.mkdir(parents=True, exist_ok=True)
    return write_crown_asset(folder, "oak", sphere_crown(), PROVENANCE, AssetSettings(crown_mesh_size=mesh_size))


@pytest.fixture
def oak(tmp_path):
    return write_oak(tmp_path / "oak")


def test_golden(oak):
    stage = Usd.Stage.Open(str(write_oak(oak.parent.with_name("golden"), mesh_size=3)))
    compare_with_golden(composed(stage), GOLDEN)


def test_layout(oak):
    folder = oak.parent
    assert sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()) == [
        "maps/oak_crown_color.exr",
        "maps/oak_crown_leaf.png",
        "maps/oak_crown_leaf_colors.png",
        "maps/oak_crown_radius.exr",
        "oak.usda",
        "payload/crown.usdc",
        "payload/materials.usda",
        "payload/payload.usda",
        "shaders/usdFoliageCrown.glslfx",
        "shaders/usdFoliageCrownLeaves.glslfx",
        "shaders/usdFoliageCrownRelief.glslfx",
    ]
    assert is_asset_folder(folder)
    assert oak.read_text().startswith("#usda 1.0")


def test_the_interface_describes_the_asset(oak):
    stage = Usd.Stage.Open(str(oak), Usd.Stage.LoadNone)
    root = stage.GetDefaultPrim()
    assert root.GetPath() == "/oak"
    assert root.GetTypeName() == "Xform"
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    model = Usd.ModelAPI(root)
    assert model.GetKind() == Kind.Tokens.component
    assert model.GetAssetName() == "oak"
    assert model.GetAssetIdentifier().path == "./oak.usda"
    assert model.GetAssetVersion() == "1"
    assert root.GetInherits().GetAllDirectInherits() == ["/__class__/oak"]
    assert root.GetVariantSets().GetAllVariantSelections() == {"lod": "crown"}
    assert root.GetVariantSets().GetVariantSet("lod").GetVariantNames() == ["crown"]
    assert root.HasAPI("FoliagePlantAPI")
    assert root.GetAttribute("foliage:species").Get() == "Quercus robur"
    assert root.GetRelationship("foliage:crown").GetTargets() == ["/oak/geo/proxy/Crown"]
    # The pixel (160, 160) is the centre of the photographed crown.
    asset_from_capture = root.GetAttribute("foliage:captureToAsset").Get()
    assert Gf.IsClose(asset_from_capture.Transform(Gf.Vec3d(160, 160, 0)), Gf.Vec3d(0, 2, 0), 1e-9)
    record = stage.GetRootLayer().customLayerData["usdfoliage"]
    assert record["seed"] == 7
    assert record["settings"] == {"relief": "0.2", "size": "8"}
    assert record["inputSha256"] == "00" * 32


def test_unloaded_asset_reads_nothing_heavy_and_has_bounds(oak):
    stage = Usd.Stage.Open(str(oak), Usd.Stage.LoadNone)
    assert [Path(layer.realPath).name for layer in stage.GetUsedLayers() if layer.realPath] == ["oak.usda"]
    assert [str(prim.GetPath()) for prim in stage.Traverse()] == []  # an unloaded payload
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"], useExtentsHint=True)
    unloaded = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    stage.Load()
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"], useExtentsHint=False)
    loaded = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    forms = stage.GetPrimAtPath("/oak/geo/proxy").GetVariantSets().GetVariantSet("crown")
    around = Gf.Range3d(loaded)
    for form in ("relief", "leaves"):
        forms.SetVariantSelection(form)
        cache.Clear()
        around.UnionWith(cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange())
    np.testing.assert_allclose(unloaded.GetMin(), around.GetMin(), rtol=1e-6)
    np.testing.assert_allclose(unloaded.GetMax(), around.GetMax(), rtol=1e-6)
    forms.SetVariantSelection("mesh")
    cage_m = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown")).GetPointsAttr().Get()
    # What holds the cage holds its limit.
    np.testing.assert_allclose(loaded.GetMax(), np.max(cage_m, axis=0), rtol=1e-6)
    assert (np.array(loaded.GetMax()) > (1.5, 3.5, 1.5)).all()


def test_crown_is_a_closed_subdivision_surface_with_our_schema(oak):
    stage = Usd.Stage.Open(str(oak))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/proxy/Crown"))
    prim = mesh.GetPrim()
    assert prim.HasAPI("FoliageCrownAPI")
    assert mesh.GetSubdivisionSchemeAttr().Get() == "catmullClark"
    assert mesh.GetFaceVaryingLinearInterpolationAttr().Get() == "all"
    assert mesh.GetDoubleSidedAttr().Get() is False
    assert not mesh.GetNormalsAttr().HasAuthoredValue()  # those of the limit are
    assert len(mesh.GetPointsAttr().Get()) == 6 * 16 + 2
    assert list(mesh.GetExtentAttr().Get()) == list(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    assert UsdGeom.Imageable(prim).ComputePurpose() == "default"
    for layer in ("geo", "geo/proxy"):
        scope = stage.GetPrimAtPath(f"/oak/{layer}")
        assert scope.GetTypeName() == "Scope"
        assert not scope.GetAttribute("purpose").HasAuthoredValue()
    st = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st")
    assert st.GetInterpolation() == "faceVarying"
    assert len(st.ComputeFlattened()) == 6 * 16 * 4
    assert prim.GetAttribute("foliage:crown:radiusRange").Get() == Gf.Vec2f(1.5, 1.5)
    assert prim.GetAttribute("foliage:crown:reliefWeight").Get() == 0.25
    center = prim.GetAttribute("foliage:crown:center")
    assert center.GetTypeName() == "point3f"
    assert center.Get() == Gf.Vec3f(0, 2, 0)
    for name in ("radiusMap", "colorMap"):
        found = read_cubemap(Path(prim.GetAttribute(f"foliage:crown:{name}").Get().resolvedPath))
        assert found.attributes["foliage:crown:center"] == "0.0 2.0 0.0"


def test_crown_has_a_material_for_every_renderer(oak):
    stage = Usd.Stage.Open(str(oak))
    prim = stage.GetPrimAtPath("/oak/geo/proxy/Crown")
    material, relationship = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    assert relationship.GetPrim() == prim  # on the gprim itself
    assert material.GetPath() == "/oak/mtl/Crown"
    assert material.ComputeSurfaceSource()[0].GetIdAttr().Get() == "UsdPreviewSurface"
    assert material.ComputeSurfaceSource("mtlx")[0].GetIdAttr().Get() == "ND_open_pbr_surface_surfaceshader"
    storm = material.ComputeSurfaceSource("glslfx")[0]
    assert Path(storm.GetSourceAsset("glslfx").resolvedPath).is_file()
    texture = UsdShade.Shader(stage.GetPrimAtPath("/oak/mtl/Crown/ColorMap"))
    assert texture.GetInput("sourceColorSpace").Get() == "raw"
    assert {texture.GetInput(wrap).Get() for wrap in ("wrapS", "wrapT")} == {"clamp"}


def test_every_path_is_relative_and_resolves_after_a_move(oak, tmp_path):
    moved = tmp_path / "other place" / "trees"
    moved.parent.mkdir()
    shutil.move(oak.parent, moved)
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(moved / "oak.usda"))
    assert not unresolved
    inside = {Path(layer.realPath).resolve() for layer in layers} | {Path(asset).resolve() for asset in assets}
    assert inside == {path.resolve() for path in moved.rglob("*") if path.is_file()}
    for text in (moved / "oak.usda", *(moved / "payload").glob("*.usda")):
        assert all(path.startswith(("./", "../")) for path in text.read_text().split("@")[1::2])
        assert str(tmp_path) not in text.read_text()
    assert str(tmp_path).encode() not in (moved / "payload" / "crown.usdc").read_bytes()
    stage = Usd.Stage.Open(str(moved / "oak.usda"))
    assert stage.GetPrimAtPath("/oak/geo/proxy/Crown").GetTypeName() == "Mesh"


def test_asset_in_a_shot_takes_overrides(tmp_path):
    write_oak(tmp_path / "my assets" / "oak")
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot 010.usda"))
    for name in ("left", "right"):
        tree = UsdGeom.Xform.Define(shot, f"/World/{name}").GetPrim()
        tree.GetReferences().AddReference("./my assets/oak/oak.usda")
    shot.OverridePrim("/World/left").SetInstanceable(True)
    crown = shot.GetPrimAtPath("/World/right/geo/proxy/Crown")
    crown.GetAttribute("foliage:crown:reliefWeight").Set(0.5)
    roughness = UsdShade.Shader(shot.OverridePrim("/World/right/mtl/Crown/PreviewSurface")).GetInput("roughness")
    roughness.Set(0.1)
    shot.CreateClassPrim("/__class__")
    shot.CreateClassPrim("/__class__/oak").CreateAttribute("userProperties:season", Sdf.ValueTypeNames.String).Set(
        "autumn"
    )
    shot.Save()

    again = Usd.Stage.Open(shot.GetRootLayer().realPath)
    left, right = (again.GetPrimAtPath(f"/World/{name}") for name in ("left", "right"))
    assert left.IsInstance()
    assert right.GetChild("geo").GetChild("proxy").GetChild("Crown").GetAttribute(
        "foliage:crown:reliefWeight"
    ).Get() == pytest.approx(0.5)
    for tree in (left, right):  # one opinion on the class reaches all trees of the shot
        assert tree.GetAttribute("userProperties:season").Get() == "autumn"
        assert tree.GetRelationship("foliage:crown").GetForwardedTargets()[0].HasPrefix(tree.GetPath())
    material, _ = UsdShade.MaterialBindingAPI(right.GetPrimAtPath("geo/proxy/Crown")).ComputeBoundMaterial()
    assert material.GetPath() == "/World/right/mtl/Crown"
    assert material.ComputeSurfaceSource()[0].GetInput("roughness").Get() == pytest.approx(0.1)


def test_opens_whole_without_our_plugins(oak):
    """In a process that never imports usdfoliage: every property is there, and the mesh with its bounds."""
    program = (
        "from pxr import Usd, UsdGeom\n"
        f"stage = Usd.Stage.Open({str(oak)!r})\n"
        "crown = stage.GetPrimAtPath('/oak/geo/proxy/Crown')\n"
        "assert len(UsdGeom.Mesh(crown).GetPointsAttr().Get()) == 98\n"
        "assert Usd.SchemaRegistry().FindAppliedAPIPrimDefinition('FoliageCrownAPI') is None\n"
        "assert 'FoliageCrownAPI' in crown.GetPrimTypeInfo().GetAppliedAPISchemas()\n"
        "assert crown.GetAttribute('foliage:crown:center').Get() == (0, 2, 0)\n"
    )
    environment = {key: value for key, value in os.environ.items() if key != "PXR_PLUGINPATH_NAME"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_usd_validators_find_only_shaders_of_other_applications(oak):
    stage = Usd.Stage.Open(str(oak))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    findings = UsdValidation.ValidationContext(validators).Validate(stage)
    # MaterialX nodes and glslfx are known to a USD with usdMtlx and with imaging, which the wheel has not.
    assert {finding.GetName() for finding in findings} <= {"MissingShaderIdInRegistry", "MissingSourceTypeInRegistry"}
    messages = [finding.GetMessage() for finding in findings]
    assert all("ND_" in message or "glslfx" in message for message in messages), messages


WRITE_AND_HASH = """
import sys
from pathlib import Path
from tests.asset.packages.test_crown_asset import write_oak
from tests.support.usd_values import hashes
write_oak(Path(sys.argv[1]))
print(hashes(Path(sys.argv[1])))
"""


def test_same_inputs_give_the_same_bytes(oak, tmp_path):
    again = hashes(write_oak(tmp_path / "again").parent)
    assert again == hashes(oak.parent)
    keep_open = Usd.Stage.Open(str(oak))
    assert hashes(write_oak(oak.parent).parent) == again  # over itself, while it is open
    assert keep_open
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", WRITE_AND_HASH, str(tmp_path / f"process {seed}")],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == str(again)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("oak", "oak"),
        ("Old Oak-01", "Old_Oak_01"),
        ("5 oaks", "_5_oaks"),
        ("eiche_ä", "eiche_ä"),
        ("木", "木"),
        ("", "plant"),
        ("...", "plant"),
        ("__", "plant"),
        ("café.usd", "café_usd"),
        ("🌳", "plant"),
        ("x²", "x_"),
        ("not\udcffutf8", "not_utf8"),
    ],
)
def test_names(text, name):
    assert asset_name(text) == name
    assert Sdf.Path.IsValidIdentifier(asset_name(text))


def test_asset_named_in_another_alphabet(tmp_path):
    interface = write_crown_asset(tmp_path, asset_name("Größe 木"), sphere_crown(), PROVENANCE)
    stage = Usd.Stage.Open(str(interface))
    assert stage.GetDefaultPrim().GetName() == "Größe_木"
    assert UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/Größe_木/geo/proxy/Crown")).ComputeBoundMaterial()[0]


def test_wrong_arguments_are_refused(tmp_path):
    with pytest.raises(ValueError, match="identifier"):
        write_crown_asset(tmp_path, "5 oaks", sphere_crown(), PROVENANCE)
    with pytest.raises(ValueError, match="crown_mesh_size"):
        AssetSettings(crown_mesh_size=1)
    with pytest.raises(ValueError, match="folders"):
        Provenance(capture="photos/oak.jpg", generator="", seed=0, input_sha256="")


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 600 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if shutil.which("mount") is None:
        pytest.skip("mount is absent")
    command = ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(disk)]
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode != 0:
        pytest.skip(f"a small tmpfs cannot be mounted, it needs root: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def publish_oak(out, mesh_size):
    with publish_folder(out) as folder:
        write_oak(folder, mesh_size)


@pytest.mark.parametrize("free_kb", [0, 4, 12, 20, 24, 28, 32, 36])
def test_full_disk_leaves_the_old_asset_whole(small_disk, free_kb):
    """The disk is full after so many kB: before the first map, in a map, a layer, the shader."""
    out = small_disk / "oak"
    publish_oak(out, 5)
    before = hashes(out)
    filling = small_disk / "filling"
    filling.write_bytes(bytes(max(0, shutil.disk_usage(small_disk).free - 1024 * free_kb)))
    with pytest.raises(AssetError) as refused:
        publish_oak(out, 8)
    assert str(small_disk / "oak") in str(refused.value)
    assert "No space left" in str(refused.value) or "full" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert hashes(out) == before
    assert sorted(path.name for path in small_disk.iterdir()) == ["filling", "oak"]

    filling.unlink()
    publish_oak(out, 8)
    assert hashes(out) != before
