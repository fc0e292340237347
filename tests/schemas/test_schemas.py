"""The schemas: what they apply to, what each property is, and that nothing depends on the plug-in."""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom
from usdfoliage.asset.schema import SCHEMAS, register_plugins, require_schemas

from tests.support import plant_stages as stages

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "schemas" / "usdFoliage"

APPLIES_TO = {
    "FoliagePlantAPI": {"Xform"},
    "FoliageLeafAPI": {"PointInstancer", "NurbsPatch"},
    "FoliageLobedLeafAPI": {"Mesh"},
    "FoliageSkeletonAPI": {"BasisCurves"},
    "FoliageCrownAPI": {"Mesh"},
    "FoliageForestAPI": {"PointInstancer"},
}
PRIM_TYPES = ("Xform", "Scope", "Mesh", "PointInstancer", "NurbsPatch", "BasisCurves", "Points", "Camera", "Material")

FALLBACKS = {
    "primvars:leaf:edit:width": 1.0,
    "primvars:leaf:edit:axis1": Gf.Vec3f(0),
    "primvars:leaf:edit:axis2": Gf.Vec3f(0),
    "primvars:leaf:edit:silhouette1": Gf.Vec3f(0),
    "primvars:leaf:edit:silhouette2": Gf.Vec3f(0),
    "primvars:leaf:edit:silhouette3": Gf.Vec3f(0),
    "primvars:leaf:edit:curl": Gf.Vec3f(0),
    "primvars:leaf:edit:jitterAmplitude": 0.0,
    "primvars:leaf:edit:jitterFrequency": 8.0,
    "foliage:lobed:silhouetteDegree": 3,
}

# property, type, and of its doc the unit, the range and the array's length
PROPERTIES: dict[str, tuple[tuple[str, str, str, str, str], ...]] = {
    "FoliagePlantAPI": (
        ("foliage:capture", "string", "none", "any text", ""),
        ("foliage:captureToAsset", "matrix4d", "metres a unit of the capture", "finite and invertible", ""),
        ("foliage:crown", "rel", "none", "at most one target, none where the plant has no crown", ""),
        ("foliage:generator", "string", "none", "not empty", ""),
        ("foliage:leaves", "rel", "none", "at most one target, none where the plant has no leaves", ""),
        ("foliage:skeleton", "rel", "none", "at most one target, none where the plant has no skeleton", ""),
        ("foliage:species", "string", "none", "any text, empty where unknown", ""),
    ),
    "FoliageLeafAPI": (
        ("foliage:leaf:jitterMap", "asset", "none", "a relative path", ""),
        ("primvars:leaf:axis1", "float3[]", "leaf lengths", "finite, usually y in (0, 1)", "one element a leaf"),
        ("primvars:leaf:axis2", "float3[]", "leaf lengths", "finite, usually y in (0, 1)", "one element a leaf"),
        (
            "primvars:leaf:confidence",
            "float[]",
            "none",
            "0 (guessed) to 1 (sure)",
            "one element a leaf, or not authored",
        ),
        ("primvars:leaf:edit:axis1", "float3", "leaf lengths", "finite", ""),
        ("primvars:leaf:edit:axis2", "float3", "leaf lengths", "finite", ""),
        ("primvars:leaf:edit:curl", "float3", "leaf lengths", "finite", ""),
        ("primvars:leaf:edit:jitterAmplitude", "float", "leaf lengths", "0 or more", ""),
        ("primvars:leaf:edit:jitterFrequency", "float", "cycles a leaf", "above 0", ""),
        ("primvars:leaf:edit:silhouette1", "float3", "v none, x and z leaf lengths", "finite", ""),
        ("primvars:leaf:edit:silhouette2", "float3", "v none, x and z leaf lengths", "finite", ""),
        ("primvars:leaf:edit:silhouette3", "float3", "v none, x and z leaf lengths", "finite", ""),
        ("primvars:leaf:edit:width", "float", "none", "0 or more", ""),
        ("primvars:leaf:inner", "float3[]", "leaf lengths", "finite", "one element a leaf"),
        ("primvars:leaf:outer", "float3[]", "leaf lengths", "finite", "one element a leaf"),
        (
            "primvars:leaf:packed",
            "float[]",
            "none",
            "whole numbers",
            "1 and nineteen a leaf",
        ),
        (
            "primvars:leaf:phase",
            "float[]",
            "cycles",
            "0 to 64",
            "one element a leaf, or not authored for 0",
        ),
        ("primvars:leaf:residual", "float[]", "metres", "0 or more", "one element a leaf, or not authored"),
        (
            "primvars:leaf:silhouette1",
            "float3[]",
            "v none, x and z leaf lengths",
            "v in (0, 1) and below that of silhouette2, x above 0, z finite",
            "one element a leaf",
        ),
        (
            "primvars:leaf:silhouette2",
            "float3[]",
            "v none, x and z leaf lengths",
            "v between those of silhouette1 and silhouette3, x above 0, z finite",
            "one element a leaf",
        ),
        (
            "primvars:leaf:silhouette3",
            "float3[]",
            "v none, x and z leaf lengths",
            "v in (0, 1) and above that of silhouette2, x above 0, z finite",
            "one element a leaf",
        ),
        ("primvars:leaf:origin", "int[]", "none", "0 to 3", "one element a leaf, or not authored"),
        (
            "primvars:leaf:view",
            "int[]",
            "none",
            "0 or more, -1 where no photograph shows it",
            "one element a leaf, or not authored",
        ),
    ),
    "FoliageLobedLeafAPI": (
        (
            "foliage:lobed:bend:keyCounts",
            "int[]",
            "none",
            "0 or more, 0 for no bend",
            "one element a branch, or empty for no bend at all",
        ),
        (
            "foliage:lobed:bend:keys",
            "float2[]",
            "none, degrees",
            "position 0 to 1, rising within a branch",
            "the sum of bend:keyCounts",
        ),
        ("foliage:lobed:silhouetteDegree", "int", "none", "1 to 3", ""),
        ("foliage:lobed:silhouettePoints", "point3f[]", "the Mesh's", "finite", "4 or more"),
        (
            "foliage:lobed:skeletonBranches",
            "int[]",
            "none",
            "0 or more, every number up to the largest used",
            "that of skeletonPoints",
        ),
        (
            "foliage:lobed:skeletonParents",
            "int[]",
            "none",
            "-1 for the first node, else 0 to the node's own index - 1",
            "that of skeletonPoints",
        ),
        ("foliage:lobed:skeletonPoints", "point3f[]", "the Mesh's", "finite", "2 or more"),
        ("foliage:lobed:tie:branch", "int[]", "none", "0 to the number of branches - 1", "one element a tie"),
        ("foliage:lobed:tie:kLength", "float[]", "the Mesh's", "0 or more", "one element a tie"),
        ("foliage:lobed:tie:kTurn", "float[]", "degrees", "-180 to 180", "one element a tie"),
        ("foliage:lobed:tie:tLength", "float[]", "the Mesh's", "0 or more", "one element a tie"),
        ("foliage:lobed:tie:tTurn", "float[]", "degrees", "-180 to 180", "one element a tie"),
        (
            "foliage:lobed:turn:keyCounts",
            "int[]",
            "none",
            "0 or more, 0 for no turn",
            "one element a branch, or empty for no turn at all",
        ),
        (
            "foliage:lobed:turn:keys",
            "float2[]",
            "none, degrees",
            "position 0 to 1, rising within a branch",
            "the sum of turn:keyCounts",
        ),
        (
            "foliage:lobed:twist:keyCounts",
            "int[]",
            "none",
            "0 or more, 0 for no twist",
            "one element a branch, or empty for no twist at all",
        ),
        (
            "foliage:lobed:twist:keys",
            "float2[]",
            "none, degrees",
            "position 0 to 1, rising within a branch",
            "the sum of twist:keyCounts",
        ),
    ),
    "FoliageSkeletonAPI": (
        ("foliage:growth:allometryExponent", "float", "none", "above 0, usually 0.4 to 0.5", ""),
        ("foliage:growth:attraction", "float", "none", "0 or more", ""),
        ("foliage:growth:branchingAngle", "float", "degrees", "0 to 180", ""),
        ("foliage:growth:cycles", "int", "none", "0 or more", ""),
        ("foliage:growth:divergenceAngle", "float", "degrees", "0 to 360", ""),
        ("foliage:growth:initialGrowthUnits", "float", "internodes a cycle", "above 0", ""),
        ("foliage:growth:initialLength", "float", "metres", "above 0, below maximumLength", ""),
        ("foliage:growth:internodeLength", "float", "metres", "above 0", ""),
        ("foliage:growth:maximumLength", "float", "metres", "above 0", ""),
        ("foliage:growth:rootDiameter", "float", "metres", "above 0", ""),
        ("foliage:growth:seed", "int64", "none", "0 or more", ""),
        ("foliage:growth:tropism", "float", "none", "finite", ""),
        ("foliage:growth:tropismDirection", "vector3f", "none", "length 1", ""),
        ("foliage:inferred", "int[]", "none", "0 or 1", "one element a curve"),
        ("foliage:order", "int[]", "none", "0 or more", "one element a curve"),
        ("foliage:parentCurve", "int[]", "none", "-1 to the number of curves - 1", "one element a curve"),
        ("foliage:parentVertex", "int[]", "none", "a vertex of the parent curve, -1 for a root", "one element a curve"),
    ),
    "FoliageCrownAPI": (
        ("foliage:crown:center", "point3f", "metres", "finite, inside the crown", ""),
        ("foliage:crown:colorMap", "asset", "none", "finite, 0 or more", ""),
        ("foliage:crown:leafTexture", "asset", "none", "a path relative to the layer that authors it", ""),
        ("foliage:crown:radiusMap", "asset", "metres", "finite and above 0", ""),
        ("foliage:crown:radiusRange", "float2", "metres", "above 0, the first not above the second", ""),
        ("foliage:crown:reliefWeight", "float", "none", "0 (no relief) to below 2", ""),
    ),
    "FoliageForestAPI": (
        ("foliage:forest:lodDistance", "float2", "metres", "0 or more, the first not above the second", ""),
        ("foliage:forest:lodJitter", "float[]", "none", "0 to 1", "that of positions"),
        ("foliage:forest:orthophoto", "asset", "none", "a path relative to the layer that authors it", ""),
        ("foliage:forest:orthophotoBounds", "float4", "metres", "finite, the first two below the last two", ""),
        ("foliage:forest:seed", "int64", "none", "0 or more", ""),
        ("foliage:forest:species", "string[]", "none", "any text, not empty", "one element a prototype"),
        ("foliage:forest:speciesKind", "token[]", "none", "tree, shrub or grass", "one element a prototype"),
        (
            "foliage:forest:speciesScale",
            "float2[]",
            "none, a factor on the prototype",
            "above 0, the first not above the second",
            "one element a prototype",
        ),
        ("foliage:forest:speciesShare", "float[]", "none", "0 to 1", "one element a prototype"),
    ),
}
EVERY_PROPERTY = [(schema, *row) for schema, rows in PROPERTIES.items() for row in rows]


@pytest.fixture
def stage() -> Usd.Stage:
    return Usd.Stage.CreateInMemory()


def test_generated_files_are_those_of_the_source(tmp_path: Path) -> None:
    program = [sys.executable, str(ROOT / "tools" / "generate_schema.py"), "-o", str(tmp_path / "made")]
    outcome = subprocess.run(program, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    for name in ("generatedSchema.usda", "plugInfo.json"):
        assert (tmp_path / "made" / name).read_bytes() == (FOLDER / name).read_bytes(), (
            f"run tools/generate_schema.py: {name}"
        )
    assert "@" not in (FOLDER / "plugInfo.json").read_text()


def test_library_is_codeless_and_has_only_api_schemas() -> None:
    lines = (FOLDER / "plugInfo.json").read_text().splitlines()
    (plugin,) = json.loads("\n".join(line for line in lines if not line.startswith("#")))["Plugins"]
    assert (plugin["Name"], plugin["Type"], plugin["LibraryPath"]) == ("usdFoliage", "resource", "")
    kinds = {schema["schemaIdentifier"]: schema["schemaKind"] for schema in plugin["Info"]["Types"].values()}
    assert kinds == dict.fromkeys(SCHEMAS, "singleApplyAPI")


@pytest.mark.parametrize("schema", SCHEMAS)
@pytest.mark.parametrize("prim_type", PRIM_TYPES)
def test_schema_applies_where_it_may_and_is_refused_elsewhere(stage: Usd.Stage, schema: str, prim_type: str) -> None:
    prim = stage.DefinePrim("/Prim", prim_type)
    allowed, why_not = prim.CanApplyAPI(schema)
    assert allowed == (prim_type in APPLIES_TO[schema])
    if allowed:
        assert prim.ApplyAPI(schema)
        assert prim.GetAppliedSchemas() == [schema]
        assert prim.GetTypeName() == prim_type
    else:
        assert "can only be applied" in why_not


@pytest.mark.parametrize("schema", SCHEMAS)
def test_schema_has_the_properties_of_the_table_and_no_other(schema: str) -> None:
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(schema)
    assert sorted(definition.GetPropertyNames()) == sorted(row[0] for row in PROPERTIES[schema])
    assert definition.GetDocumentation()


@pytest.mark.parametrize(("schema", "name", "type_name", "unit", "value_range", "length"), EVERY_PROPERTY)
def test_property(schema: str, name: str, type_name: str, unit: str, value_range: str, length: str) -> None:
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(schema)
    doc = " ".join(definition.GetPropertyDocumentation(name).split())
    meaning, clauses = doc.split("; unit: ")
    assert len(meaning) > 15
    assert clauses.startswith(f"{unit}; range: {value_range}")
    assert bool(length) == ("; length: " in clauses)
    assert length in clauses
    assert not doc.endswith("...")  # usdGenSchema cuts a doc that is too long
    spec = definition.GetSchemaPropertySpec(name)
    if type_name == "rel":
        assert isinstance(spec, Sdf.RelationshipSpec)
        return
    assert str(spec.typeName) == type_name
    assert spec.variability == Sdf.VariabilityVarying
    assert bool(length) == spec.typeName.isArray
    assert definition.GetAttributeFallbackValue(name) == FALLBACKS.get(name)


def test_edits_are_neutral_until_somebody_authors_one(stage: Usd.Stage) -> None:
    prim = UsdGeom.PointInstancer.Define(stage, "/Leaves").GetPrim()
    prim.ApplyAPI("FoliageLeafAPI")
    primvars = UsdGeom.PrimvarsAPI(prim)
    assert not primvars.GetPrimvarsWithAuthoredValues()
    for name, fallback in FALLBACKS.items():
        if ":edit:" in name:
            primvar = primvars.GetPrimvar(name.removeprefix("primvars:"))
            assert primvar.Get() == fallback
            assert primvar.GetInterpolation() == UsdGeom.Tokens.constant


def test_registering_again_changes_nothing() -> None:
    assert register_plugins() == (FOLDER, ROOT / "usd_plugins" / "usdFoliageValidators")
    require_schemas()


def run_python(program: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {name: value for name, value in os.environ.items() if name not in ("PXR_PLUGINPATH_NAME", "PYTHONPATH")}
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), *arguments],
        env={**clean, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_import_is_harmless_where_the_environment_has_registered_the_plugin() -> None:
    program = """
        import usdfoliage
        from usdfoliage.asset.schema import require_schemas
        from pxr import Plug
        require_schemas()
        print([plugin.name for plugin in Plug.Registry().GetAllPlugins() if plugin.name.startswith("usdFoliage")])
    """
    for paths in ({}, {"PXR_PLUGINPATH_NAME": f"{FOLDER}{os.pathsep}{ROOT / 'usd_plugins' / 'usdFoliageValidators'}"}):
        outcome = run_python(program, **paths)
        assert (outcome.returncode, outcome.stderr) == (0, "")
        assert sorted(json.loads(outcome.stdout.replace("'", '"'))) == ["usdFoliage", "usdFoliageValidators"]


def test_an_import_after_the_first_stage_is_reported() -> None:
    program = """
        from pxr import Usd
        Usd.Stage.CreateInMemory().DefinePrim("/Prim", "Xform")
        import usdfoliage
        from usdfoliage.asset.schema import require_schemas
        try:
            require_schemas()
        except usdfoliage.AssetError as error:
            print(error)
    """
    outcome = run_python(program)
    assert "import usdfoliage first" in outcome.stdout, outcome.stderr


def test_nothing_is_lost_without_the_plugin(tmp_path: Path) -> None:
    """All opinions of stages written with the plug-in, as a program without it reads and writes them again."""
    path = tmp_path / "all.usda"
    stage = Usd.Stage.CreateNew(str(path))
    stages.build_leaves(stage)
    stages.build_hero_leaf(stage)
    stages.build_skeleton(stage)
    stages.build_lobed_leaf(stage)
    stages.build_forest(stage)
    stages.build_crown(stage, tmp_path / "maps")
    plant = UsdGeom.Xform.Define(stage, "/Plant").GetPrim()
    plant.ApplyAPI("FoliagePlantAPI")
    stages.author_plant(plant)
    plant.GetRelationship("foliage:crown").SetTargets(["/Crown"])
    stage.GetRootLayer().Save()

    program = """
        import json, sys
        from pxr import Plug, Usd
        assert not [plugin for plugin in Plug.Registry().GetAllPlugins() if plugin.name.startswith("usdFoliage")]
        stage = Usd.Stage.Open(sys.argv[1])
        found = {}
        for prim in stage.TraverseAll():
            found[str(prim.GetPath())] = [prim.GetTypeName(), prim.GetPrimTypeInfo().GetAppliedAPISchemas()]
            for field in prim.GetAuthoredProperties():
                value = field.Get() if isinstance(field, Usd.Attribute) else field.GetTargets()
                kind = str(field.GetTypeName()) if isinstance(field, Usd.Attribute) else "rel"
                metadata = {name: value for name, value in field.GetAllAuthoredMetadata().items() if name != "custom"}
                found[str(field.GetPath())] = [kind, str(value), sorted(map(str, metadata.items()))]
        stage.GetRootLayer().Export(sys.argv[2])
        print(json.dumps(found))
    """
    outcome = run_python(program, str(path), str(tmp_path / "again.usda"))
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert (tmp_path / "again.usda").read_bytes() == path.read_bytes()

    expected: dict[str, list[object]] = {}
    for prim in stage.TraverseAll():
        expected[str(prim.GetPath())] = [prim.GetTypeName(), list(prim.GetPrimTypeInfo().GetAppliedAPISchemas())]
        for field in prim.GetAuthoredProperties():
            is_attribute = isinstance(field, Usd.Attribute)
            value = field.Get() if is_attribute else field.GetTargets()
            kind = str(field.GetTypeName()) if is_attribute else "rel"
            metadata = {name: value for name, value in field.GetAllAuthoredMetadata().items() if name != "custom"}
            expected[str(field.GetPath())] = [kind, str(value), sorted(map(str, metadata.items()))]
    assert json.loads(outcome.stdout) == expected
    assert len(expected) > 80
