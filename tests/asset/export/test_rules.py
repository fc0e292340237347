"""The rules of each profile: a good export keeps all, and each rule finds what breaks it."""

import zipfile

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdSkel, UsdValidation
from usdfoliage.asset.export.arkit_rules import check_arkit
from usdfoliage.asset.export.package import pack_usdz
from usdfoliage.asset.export.plain_rules import check_plain
from usdfoliage.asset.export.unreal_rules import check_unreal

from tests.support.leaves.commands import run
from tests.support.plant_assets import write_whole_plant


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The same plant in all three profiles, in a folder."""
    folder = tmp_path_factory.mktemp("exports")
    write_whole_plant(folder / "oak")
    for profile, out in (("standalone", "plain"), ("usdz", "ar.usdz"), ("unreal", "ue")):
        assert run("export", folder / "oak", "--profile", profile, "-o", folder / out, "--name", "oak") == 0
    return folder


def of(folder, profile):
    """A copy in memory, to be broken, whose files are found from the folder of the export."""
    path = folder / profile / "oak.usdc"
    layer = Sdf.Layer.CreateNew(str(path.with_name(f"broken_{len(list(path.parent.iterdir()))}.usdc")))
    layer.TransferContent(Sdf.Layer.FindOrOpen(str(path)))
    return Usd.Stage.Open(layer)


def rules(findings):
    return {finding.error for finding in findings}


def test_good_exports_keep_all_rules(exported):
    assert check_plain(Usd.Stage.Open(str(exported / "plain" / "oak.usdc")), instances=False) == []
    assert check_unreal(Usd.Stage.Open(str(exported / "ue" / "oak.usdc"))) == []
    assert check_arkit(exported / "ar.usdz") == []


@pytest.mark.parametrize("file", ["plain/oak.usdc", "ar.usdz", "ue/oak.usdc"])
def test_no_validator_of_usd_finds_an_error(exported, file):
    stage = Usd.Stage.Open(str(exported / file))
    registry = UsdValidation.ValidationRegistry()
    names = [each.name for each in registry.GetAllValidatorMetadata() if not each.name.startswith("usdFoliage")]
    context = UsdValidation.ValidationContext(validators=registry.GetOrLoadValidatorsByName(names))
    errors = [
        f"{each.GetName()} {each.GetMessage()}"
        for each in context.Validate(stage)
        if each.GetType() == UsdValidation.ValidationErrorType.Error
        and "Sdr" not in str(each.GetName())  # this USD has no parser of shaders
        and "shader" not in each.GetMessage().lower()
    ]
    assert errors == []


def apply_ours(stage):
    stage.GetDefaultPrim().AddAppliedSchema("FoliagePlantAPI")


def add_instancer(stage):
    UsdGeom.PointInstancer.Define(stage, "/oak/geo/Leaves")


def subdivide(stage):
    UsdGeom.Mesh(stage.GetPrimAtPath("/oak/geo/render/Branches")).GetSubdivisionSchemeAttr().Set("loop")


def lose_normals(stage):
    stage.GetPrimAtPath("/oak/geo/render/Leaves").RemoveProperty("normals")


def name_file_above(stage):
    texture = next(prim for prim in stage.Traverse() if prim.GetAttribute("inputs:file"))
    texture.GetAttribute("inputs:file").Set(Sdf.AssetPath("../elsewhere.png"))


def name_lost_file(stage):
    texture = next(prim for prim in stage.Traverse() if prim.GetAttribute("inputs:file"))
    texture.GetAttribute("inputs:file").Set(Sdf.AssetPath("./textures/lost.png"))


def add_shader_file(stage):
    shader = UsdShade.Shader.Define(stage, "/oak/mtl/Bark/Storm")
    shader.SetSourceAsset(Sdf.AssetPath(""), "glslfx")


def add_variants(stage):
    stage.GetDefaultPrim().GetVariantSets().AddVariantSet("lod").AddVariant("one")


def add_root(stage):
    stage.DefinePrim("/other")


def lose_units(stage):
    stage.GetRootLayer().pseudoRoot.ClearInfo("metersPerUnit")


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (apply_ours, "NoSchemas"),
        (add_instancer, "NoInstancer"),
        (subdivide, "Polygons"),
        (lose_normals, "Normals"),
        (name_file_above, "RelativePaths"),
        (name_lost_file, "Files"),
        (add_shader_file, "NoShaderSource"),
        (add_variants, "NoVariants"),
        (add_root, "OneRoot"),
        (lose_units, "Units"),
    ],
)
def test_each_plain_rule_finds_what_breaks_it(exported, change, rule):
    stage = of(exported, "plain")
    change(stage)
    assert rule in rules(check_plain(stage, instances=False))


def attribute(path, value):
    def change(stage):
        stage.GetAttributeAtPath(path).Set(value)

    return change


def remove(path):
    return lambda stage: stage.RemovePrim(path)


def drop_schema(path, name):
    def change(stage):
        spec = stage.GetRootLayer().GetPrimAtPath(path)
        kept = [each for each in spec.GetInfo("apiSchemas").GetAddedOrExplicitItems() if each != name]
        spec.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=kept))

    return change


def add_schema(path, name, kind="Xform"):
    def change(stage):
        stage.DefinePrim(path, kind)
        stage.GetRootLayer().GetPrimAtPath(path).SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[name]))

    return change


def lose_skeleton(stage):
    stage.GetDefaultPrim().GetRelationship("unreal:naniteAssembly:skeleton").SetTargets([])


def two_roots(stage):
    skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/oak/Base/Skeleton"))
    joints = list(skeleton.GetJointsAttr().Get())
    skeleton.GetJointsAttr().Set(["root", *(joint.removeprefix("root/") for joint in joints[1:])])


def bind_root(stage):
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/oak/Leaves")).Bind(
        UsdShade.Material(stage.GetPrimAtPath("/oak/mtl/Leaf"))
    )


def few_weights(stage):
    weights = stage.GetAttributeAtPath("/oak/Leaves.primvars:unreal:naniteAssembly:bindJointWeights")
    weights.Set(list(weights.Get())[:-1])


PART = "/oak/Leaves/Prototypes/leaf_0"


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (drop_schema("/oak", "NaniteAssemblyRootAPI"), "Root"),
        (attribute("/oak.unreal:naniteAssembly:meshType", "treeMesh"), "MeshType"),
        (lose_skeleton, "Skeleton"),
        (lambda stage: stage.GetPrimAtPath("/oak/Base").SetTypeName("Xform"), "SkelRoot"),
        (two_roots, "OneRootJoint"),
        (attribute("/oak/Base/Skeleton.joints", ["root", "root/a/b", "root/a"]), "JointOrder"),
        (attribute("/oak/Base/Skeleton.jointNames", ["root"]), "JointNames"),
        (attribute("/oak/Base/Skeleton.restTransforms", []), "Transforms"),
        (remove("/oak/Base/Branches"), "BaseMesh"),
        (attribute("/oak/Base/Branches.primvars:skel:jointIndices", [0]), "Skin"),
        (add_schema("/oak/inner", "NaniteAssemblyRootAPI"), "Nested"),
        (lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath("/oak/Leaves")).MakeInvisible(), "Visible"),
        (add_schema("/oak/twig", "NaniteAssemblyExternalRefAPI"), "ExternalRef"),
        (bind_root, "Bindings"),
        (remove("/oak/Leaves"), "Parts"),
        (attribute("/oak/Leaves.protoIndices", [99] * 6), "Parts"),
        (remove(f"{PART}/Part/Leaf"), "PartMesh"),
        (remove(f"{PART}/Part/Skeleton"), "PartSkeleton"),
        (drop_schema("/oak/Leaves", "NaniteAssemblySkelBindingAPI"), "PartBinding"),
        (attribute("/oak/Leaves.primvars:unreal:naniteAssembly:bindJoints", ["root"]), "PartBinding"),
        (few_weights, "PartWeights"),
        (attribute("/oak/Base/Skeleton.unreal:dynamicWind:jointSimulationGroups", [0]), "WindJoints"),
        (attribute("/oak/Base/Skeleton.unreal:dynamicWind:simulationGroupInfluences", [1.0]), "WindGroups"),
        (attribute("/oak/Base/Skeleton.unreal:dynamicWind:simulationGroupInfluences", [2.0] * 3), "WindInfluences"),
    ],
)
def test_each_rule_of_unreal_finds_what_breaks_it(exported, change, rule):
    stage = of(exported, "ue")
    change(stage)
    assert rule in rules(check_unreal(stage))


def packed(exported, tmp_path, change):
    """The package with its layer changed."""
    with zipfile.ZipFile(exported / "ar.usdz") as archive:
        archive.extractall(tmp_path)
    layer = Sdf.Layer.OpenAsAnonymous(str(tmp_path / "oak.usdc"))
    change(Usd.Stage.Open(layer))
    layer.Export(str(tmp_path / "oak.usdc"))
    return tmp_path / "oak.usdc"


def dangle(stage):
    stage.GetPrimAtPath("/oak/geo/render/Leaves").GetRelationship("material:binding").SetTargets(["/oak/geo"])


def other_node(stage):
    stage.GetAttributeAtPath("/oak/mtl/Leaf/PreviewSurface.info:id").Set("ND_standard_surface_surfaceshader")


def loose_input(stage):
    shader = UsdShade.Shader(stage.GetPrimAtPath("/oak/mtl/Leaf/PreviewSurface"))
    shader.GetInput("roughness").GetAttr().SetConnections(["/oak/mtl/Leaf/Nothing.outputs:r"])


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        (lambda stage: UsdGeom.SetStageUpAxis(stage, "Z"), "UpAxis"),
        (lambda stage: UsdGeom.BasisCurves.Define(stage, "/oak/curves"), "PrimTypes"),
        (other_node, "Shaders"),
        (loose_input, "Connections"),
        (dangle, "MaterialBinding"),
    ],
)
def test_each_rule_of_ar_finds_what_breaks_it(exported, tmp_path, change, rule):
    layer = packed(exported, tmp_path, change)
    pack_usdz(layer, tmp_path / "broken.usdz")
    assert rule in rules(check_arkit(tmp_path / "broken.usdz"))


def test_rules_of_the_package_itself(exported, tmp_path):
    layer = packed(exported, tmp_path, lambda stage: None)
    (tmp_path / "textures").mkdir(exist_ok=True)
    (tmp_path / "textures" / "leaf.exr").write_bytes(b"exr")
    (tmp_path / "second.usdc").write_bytes(layer.read_bytes())
    pack_usdz(layer, tmp_path / "more.usdz")
    assert {"FileTypes", "OneLayer"} <= rules(check_arkit(tmp_path / "more.usdz"))
    with zipfile.ZipFile(tmp_path / "zipped.usdz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(layer, "oak.usdc")
    assert {"Stored", "Alignment"} <= rules(check_arkit(tmp_path / "zipped.usdz"))
    (tmp_path / "none.usdz").write_bytes(b"nothing")
    assert "Package" in rules(check_arkit(tmp_path / "none.usdz"))
