"""Every validator: nothing to find in a good stage, one named finding for each rule that is broken."""

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, Vt

from tests.support import plant_stages as stages

VALIDATORS = {
    "Plant",
    "LeafArrays",
    "LeafOrientations",
    "LeafPrototype",
    "LeafPatch",
    "LeafEdits",
    "LeafShape",
    "LobedLeaf",
    "Skeleton",
    "Crown",
    "CrownFiles",
    "Forest",
    "AssetInterface",
    "AssetPaths",
    "AssetBounds",
    "AssetPurposes",
    "AssetLods",
    "AssetCollections",
}
ERROR, WARN = UsdValidation.ValidationErrorType.Error, UsdValidation.ValidationErrorType.Warn


@pytest.mark.filterwarnings("error")
def test_numbers_that_are_none_are_no_indices() -> None:
    from usdFoliageValidators.values import indices, numbers

    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/a")
    for name, kind, given in (
        (
            "half",
            Sdf.ValueTypeNames.HalfArray,
            Vt.HalfArray.FromNumpy(np.array([0x7D01, 0x3C00], np.uint16).view("f2")),
        ),
        ("inf", Sdf.ValueTypeNames.DoubleArray, [1.0, float("inf")]),
        ("whole", Sdf.ValueTypeNames.DoubleArray, [1.0, 3.0]),
    ):
        prim.CreateAttribute(name, kind).Set(given)
    assert numbers(prim, "half") is not None
    assert indices(prim, "half") is None
    assert indices(prim, "inf") is None
    np.testing.assert_array_equal(indices(prim, "whole"), [1, 3])


Break = Callable[[Usd.Prim], None]


def findings(stage: Usd.Stage) -> list[tuple[str, str, str]]:
    """(validator, error name, path) of all that our validators find; each names its place and the remedy."""
    context = UsdValidation.ValidationContext(keywords=["usdFoliage"])
    found = []
    for problem in context.Validate(stage):
        (site,) = problem.GetSites()
        path = site.GetProperty().GetPath() if site.IsProperty() else site.GetPrim().GetPath()
        assert problem.GetMessage().startswith(f"<{path}> ")
        assert problem.GetType() in (ERROR, WARN)
        found.append((problem.GetValidator().GetMetadata().name.split(":")[1], problem.GetName(), str(path)))
    return sorted(found)


def put(name: str, value: object) -> Break:
    """Break a prim by giving an attribute another value."""

    def break_it(prim: Usd.Prim) -> None:
        assert prim.GetAttribute(name).Set(value)

    return break_it


def drop(name: str) -> Break:
    def break_it(prim: Usd.Prim) -> None:
        prim.GetAttribute(name).Block()

    return break_it


def interpolate(name: str, interpolation: str) -> Break:
    def break_it(prim: Usd.Prim) -> None:
        prim.GetAttribute(name).SetMetadata("interpolation", interpolation)

    return break_it


def vectors(*rows: tuple[float, ...]) -> list[Gf.Vec3f]:
    return [Gf.Vec3f(*row) for row in rows]


def test_registry_lists_every_validator_with_its_doc_and_keyword() -> None:
    registry = UsdValidation.ValidationRegistry()
    ours = registry.GetValidatorMetadataForPlugin("usdFoliageValidators")
    assert {metadata.name for metadata in ours} == {f"usdFoliageValidators:{name}" for name in VALIDATORS}
    for metadata in ours:
        assert metadata.doc
        assert metadata.GetKeywords() == ["usdFoliage"]
        assert registry.GetOrLoadValidatorByName(metadata.name)


def test_good_prims_have_no_finding(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "good.usda"))
    stages.build_leaves(stage)
    stages.build_hero_leaf(stage)
    stages.build_skeleton(stage)
    stages.build_lobed_leaf(stage)
    stages.build_forest(stage)
    stages.build_crown(stage, tmp_path / "maps")
    plant = UsdGeom.Xform.Define(stage, "/Group/Plant").GetPrim()  # below the root: no asset
    plant.ApplyAPI("FoliagePlantAPI")
    stages.author_plant(plant)
    assert findings(stage) == []


LEAF = [
    ("LeafArrays", "LeafArrayMissing", "primvars:leaf:inner", drop("primvars:leaf:inner")),
    ("LeafArrays", "LeafArrayLength", "primvars:leaf:axis1", put("primvars:leaf:axis1", vectors((0, 0, 0)))),
    (
        "LeafArrays",
        "LeafArrayNotFinite",
        "primvars:leaf:outer",
        put("primvars:leaf:outer", vectors((0, 0, 0), (0, float("nan"), 0), (0, 0, 0))),
    ),
    (
        "LeafArrays",
        "LeafArrayInterpolation",
        "primvars:leaf:axis2",
        interpolate("primvars:leaf:axis2", "vertex"),
    ),
    (
        "LeafArrays",
        "SilhouetteRange",
        "primvars:leaf:silhouette1",
        put("primvars:leaf:silhouette3", vectors((0.8, 0.2, 0), (1, 0.2, 0), (0.8, 0.2, 0))),
    ),
    (
        "LeafArrays",
        "SilhouetteOrder",
        "primvars:leaf:silhouette1",
        put("primvars:leaf:silhouette2", vectors((0.5, 0.2, 0), (0.2, 0.2, 0), (0.5, 0.2, 0))),
    ),
    (
        "LeafArrays",
        "SilhouetteWidth",
        "primvars:leaf:silhouette1",
        put("primvars:leaf:silhouette2", vectors((0.5, 0.2, 0), (0.5, 0.2, 0), (0.5, -0.2, 0))),
    ),
    (
        "LeafArrays",
        "SilhouetteWidth",
        "primvars:leaf:silhouette1",
        lambda prim: [
            put(f"primvars:leaf:silhouette{i}", vectors((v, 0.2, 0), (v, 0, 0), (v, 0.2, 0)))(prim)
            for i, v in ((1, 0.25), (2, 0.5), (3, 0.75))
        ],
    ),
    ("LeafArrays", "LeafArrayLength", "primvars:leaf:view", put("primvars:leaf:view", [1])),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:confidence", put("primvars:leaf:confidence", [0, 0.5, 1.5])),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:residual", put("primvars:leaf:residual", [0, -1, 0])),
    ("LeafArrays", "LeafArrayLength", "primvars:leaf:phase", put("primvars:leaf:phase", [0.0, 1.0])),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:phase", put("primvars:leaf:phase", [0.0, float("nan"), 1.0])),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:phase", put("primvars:leaf:phase", [0.0, 65.0, 1.0])),
    (
        "LeafArrays",
        "LeafArrayInterpolation",
        "primvars:leaf:phase",
        interpolate("primvars:leaf:phase", "constant"),
    ),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:view", put("primvars:leaf:view", [0, -2, 0])),
    ("LeafArrays", "LeafFactRange", "primvars:leaf:origin", put("primvars:leaf:origin", [0, 4, 0])),
    ("LeafArrays", "LeafPackedMissing", "primvars:leaf:packed", drop("primvars:leaf:packed")),
    ("LeafArrays", "LeafPackedLength", "primvars:leaf:packed", put("primvars:leaf:packed", [3.0, 1.0])),
    ("LeafArrays", "LeafPackedDiffers", "primvars:leaf:packed", put("primvars:leaf:phase", [7.5, 7.5, 8.0])),
    (
        "LeafArrays",
        "LeafPackedDiffers",
        "primvars:leaf:packed",
        put("primvars:leaf:inner", vectors((0, 0, 0), (0, 0, 0), (0, 0, 0.01))),
    ),
    (
        "LeafEdits",
        "EditNotFinite",
        "primvars:leaf:edit:curl",
        put("primvars:leaf:edit:curl", Gf.Vec3f(0, float("inf"), 0)),
    ),
    ("LeafEdits", "EditRange", "primvars:leaf:edit:width", put("primvars:leaf:edit:width", -1.0)),
    ("LeafEdits", "EditRange", "primvars:leaf:edit:jitterFrequency", put("primvars:leaf:edit:jitterFrequency", 0.0)),
    (
        "LeafEdits",
        "EditInterpolation",
        "primvars:leaf:edit:curl",
        interpolate("primvars:leaf:edit:curl", "varying"),
    ),
    ("LeafEdits", "EditRange", "primvars:leaf:edit:jitterAmplitude", put("primvars:leaf:edit:jitterAmplitude", -0.1)),
    ("LeafEdits", "EditRange", "primvars:leaf:edit:width", put("primvars:leaf:edit:width", float("nan"))),
    (
        "LeafEdits",
        "JitterMapMissing",
        "foliage:leaf:jitterMap",
        put("foliage:leaf:jitterMap", Sdf.AssetPath("./no.exr")),
    ),
    ("LeafArrays", "PositionsNotFinite", "positions", put("positions", vectors((0, 0, 0), (0, 0, 0), (0, 1e39, 0)))),
    ("LeafArrays", "ScalesLength", "scales", put("scales", vectors((1, 1, 1)))),
    ("LeafArrays", "ScalesNotPositive", "scales", put("scales", vectors((1, 1, 1), (0, 0, 0), (1, 1, 1)))),
    ("LeafArrays", "ScalesNotPositive", "scales", put("scales", vectors((1, 1, 1), (-1, -1, -1), (1, 1, 1)))),
    ("LeafArrays", "ScalesNotPositive", "scales", put("scales", vectors((1, 1, 1), (float("nan"),) * 3, (1, 1, 1)))),
    ("LeafArrays", "ScalesNotUniform", "scales", put("scales", vectors((1, 1, 1), (1, 2, 1), (1, 1, 1)))),
    ("LeafOrientations", "OrientationsMissing", "orientations", drop("orientations")),
    ("LeafOrientations", "OrientationsMissing", "orientationsf", drop("orientationsf")),
    ("LeafOrientations", "OrientationsLength", "orientations", put("orientations", [Gf.Quath(1)])),
    ("LeafOrientations", "OrientationsNotUnit", "orientationsf", put("orientationsf", [Gf.Quatf(2)] * 3)),
    ("LeafOrientations", "OrientationsDiffer", "orientations", put("orientations", [Gf.Quath(1)] * 3)),
    ("LeafPrototype", "PrototypeIndex", "protoIndices", put("protoIndices", [0, 0, 1])),
]


@pytest.mark.parametrize(("validator", "name", "place", "break_it"), LEAF)
def test_broken_leaves(validator: str, name: str, place: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateInMemory()
    break_it(stages.build_leaves(stage))
    assert findings(stage) == [(validator, name, f"/Leaves.{place}")]


def test_blocked_edit_is_a_warning_with_the_neutral_value() -> None:
    stage = Usd.Stage.CreateInMemory()
    stages.build_leaves(stage).GetAttribute("primvars:leaf:edit:jitterFrequency").Block()
    (problem,) = UsdValidation.ValidationContext(keywords=["usdFoliage"]).Validate(stage)
    assert (problem.GetName(), problem.GetType()) == ("EditBlocked", WARN)
    assert "author 8.0 instead" in problem.GetMessage()


def test_copy_of_the_leaves_that_guides_is_passed_over() -> None:
    """Only below geo/guide/Leaves, and only while it is a guide."""
    stage = Usd.Stage.CreateInMemory()
    scopes = {"/oak/geo/guide": "guide", "/elm/geo/guide": "default", "/ash/geo/other": "guide"}
    for path, purpose in scopes.items():
        UsdGeom.Scope.Define(stage, path).CreatePurposeAttr(purpose)
        leaves = stages.build_leaves(stage, f"{path}/Leaves/geo/render/Leaves")
        put("primvars:leaf:edit:width", -1.0)(leaves)  # LeafEdits
        put("primvars:leaf:silhouette1", vectors(*[(0.6, 0.2, 0)] * 3))(leaves)  # LeafArrays
        put("orientationsf", [Gf.Quatf(2)] * 3)(leaves)
        put("protoIndices", [0, 0, 1])(leaves)
    for path in scopes:
        found = {validator for validator, _, place in findings(stage) if place.startswith(path)}
        broken = {"LeafEdits", "LeafArrays", "LeafOrientations", "LeafPrototype"}
        assert found == (set() if path == "/oak/geo/guide" else broken), path


def test_shape_of_the_copy_that_guides_is_passed_over() -> None:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Scope.Define(stage, "/oak/geo/guide").CreatePurposeAttr("guide")
    for path in ("/oak/geo/guide/Leaves/geo/render/Leaves", "/Leaves"):
        put("primvars:leaf:edit:silhouette2", Gf.Vec3f(1, 0, 0))(stages.build_leaves(stage, path))
    places = {place for validator, _, place in findings(stage) if validator == "LeafShape"}
    assert places
    assert all(place.startswith("/Leaves") for place in places)


def test_only_the_width_is_a_warning() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    put("primvars:leaf:silhouette1", vectors(*[(0.2, 3, 0)] * 3))(prim)
    stage.GetPrimAtPath("/Leaves/Prototypes/Leaf").GetAttribute("extent").Set([Gf.Vec3f(-4), Gf.Vec3f(4)])
    (problem,) = UsdValidation.ValidationContext(keywords=["usdFoliage"]).Validate(stage)
    assert problem.GetType() == WARN
    assert "3 of 3 leaves (the first is 0)" in problem.GetMessage()


def test_leaves_without_positions() -> None:
    stage = Usd.Stage.CreateInMemory()
    drop("positions")(stages.build_leaves(stage))
    assert findings(stage) == [("LeafArrays", "PositionsMissing", "/Leaves.positions")]


def test_opposite_quaternions_are_the_same_rotation() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    prim.GetAttribute("orientationsf").Set([-1 * q for q in prim.GetAttribute("orientationsf").Get()])
    assert findings(stage) == []


@pytest.mark.parametrize("prototype", [True, False])
def test_no_leaf_at_all_is_a_good_set_of_leaves(prototype: bool) -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    for attribute in prim.GetAttributes():
        if attribute.HasAuthoredValue() and attribute.GetTypeName().isArray:
            attribute.Set(attribute.GetTypeName().defaultValue)
    if not prototype:
        _no_prototypes(prim)
    assert findings(stage) == []


@pytest.mark.parametrize(
    ("name", "place", "break_it"),
    [
        ("LeafArrayLength", ".primvars:leaf:inner", put("primvars:leaf:inner", vectors((0, 0, 0), (0, 0, 0)))),
        ("LeafArrayInterpolation", ".primvars:leaf:inner", interpolate("primvars:leaf:inner", "varying")),
        ("LeafArrayMissing", ".primvars:leaf:silhouette2", drop("primvars:leaf:silhouette2")),
    ],
)
def test_broken_hero_leaf(name: str, place: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateInMemory()
    break_it(stages.build_hero_leaf(stage))
    assert findings(stage) == [("LeafArrays", name, f"/Hero{place}")]


def _remove_prototype(prim: Usd.Prim) -> None:
    prim.GetStage().RemovePrim("/Leaves/Prototypes/Leaf")


def _no_prototypes(prim: Usd.Prim) -> None:
    prim.GetRelationship("prototypes").SetTargets([])


def _prototype_elsewhere(prim: Usd.Prim) -> None:
    stages.build_quad(prim.GetStage(), "/Elsewhere")
    prim.GetRelationship("prototypes").SetTargets(["/Elsewhere"])


def _no_extent(prim: Usd.Prim) -> None:
    prim.GetStage().GetPrimAtPath("/Leaves/Prototypes/Leaf").GetAttribute("extent").Block()


def _small_extent(prim: Usd.Prim) -> None:
    leaf = prim.GetStage().GetPrimAtPath("/Leaves/Prototypes/Leaf")
    leaf.GetAttribute("extent").Set([Gf.Vec3f(0), Gf.Vec3f(0.1)])


def _empty_prototype(prim: Usd.Prim) -> None:
    _remove_prototype(prim)
    UsdGeom.Xform.Define(prim.GetStage(), "/Leaves/Prototypes/Leaf")


HERO = [
    ("PatchShape", "uVertexCount", put("uVertexCount", 5)),
    ("PatchShape", "vOrder", put("vOrder", 4)),
    ("PatchKnots", "uKnots", put("uKnots", [0.0] * 4 + [0.5] * 3 + [1.0] * 4)),
    ("PatchKnots", "vKnots", put("vKnots", [0.0] * 5)),
    ("PatchPoints", "points", put("points", vectors(*[(0, 0, 0)] * 34))),
    ("PatchPoints", "points", put("points", vectors(*[(0, float("nan"), 0)] * 35))),
    ("PatchExtent", "extent", put("extent", vectors((0, 0, 0), (0.35, 1, 0)))),
    ("PatchExtent", "extent", drop("extent")),
]


@pytest.mark.parametrize(("name", "place", "break_it"), HERO)
def test_broken_patch(name: str, place: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateInMemory()
    break_it(stages.build_hero_leaf(stage))
    assert findings(stage) == [("LeafPatch", name, f"/Hero.{place}")]


def test_hero_leaf_needs_no_edits() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_hero_leaf(stage)
    for name in [name for name in prim.GetPropertyNames() if ":edit:" in name]:
        prim.RemoveProperty(name)
    assert findings(stage) == []


def _nested(prim: Usd.Prim) -> None:
    UsdGeom.PointInstancer.Define(prim.GetStage(), "/Leaves/Prototypes/Leaf/More")


@pytest.mark.parametrize(
    ("name", "path", "break_it"),
    [
        ("PrototypeMissing", "/Leaves.prototypes", _remove_prototype),
        ("PrototypeMissing", "/Leaves.prototypes", _no_prototypes),
        ("PrototypeElsewhere", "/Leaves.prototypes", _prototype_elsewhere),
        ("PrototypeExtent", "/Leaves/Prototypes/Leaf.extent", _no_extent),
        ("PrototypeExtent", "/Leaves/Prototypes/Leaf.extent", _small_extent),
        ("PrototypeEmpty", "/Leaves/Prototypes/Leaf", _empty_prototype),
        ("NestedInstancer", "/Leaves/Prototypes/Leaf/More", _nested),
    ],
)
def test_broken_prototype(name: str, path: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateInMemory()
    break_it(stages.build_leaves(stage))
    assert [found for found in findings(stage) if found[0] != "LeafShape"] == [("LeafPrototype", name, path)]


def problems_of_shape(stage: Usd.Stage) -> list[UsdValidation.ValidationError]:
    found = UsdValidation.ValidationContext(keywords=["usdFoliage"]).Validate(stage)
    return [problem for problem in found if problem.GetValidator().GetMetadata().name.endswith(":LeafShape")]


FOLDED = [
    ("primvars:leaf:silhouette2", vectors((0.5, 0.35, 0), (0.5, 0.35, 0), (1.5, 0.35, 0))),
    ("primvars:leaf:axis1", vectors((0, 1 / 3, 0), (0, 1 / 3, 0), (1.5, 2, 0))),
]


def _room(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath("/Leaves/Prototypes/Leaf").GetAttribute("extent").Set([Gf.Vec3f(-9), Gf.Vec3f(9)])


@pytest.mark.parametrize(("name", "value"), FOLDED)
def test_leaf_that_folds_over_itself_is_a_warning(name: str, value: list[Gf.Vec3f]) -> None:
    stage = Usd.Stage.CreateInMemory()
    put(name, value)(stages.build_leaves(stage))
    _room(stage)
    (problem,) = problems_of_shape(stage)
    assert (problem.GetName(), problem.GetType()) == ("LeafFolds", WARN)
    assert "fold over themselves: 1 of 3 leaves (2)" in problem.GetMessage()


def test_patches_that_fold_are_one_warning() -> None:
    stage = Usd.Stage.CreateInMemory()
    for number in range(20):
        prim = stages.build_hero_leaf(stage, f"/Leaves/leaf_{number}")
        if number % 4 == 1:
            put("primvars:leaf:axis1", vectors((1.5, 2, 0)))(prim)
    (problem,) = problems_of_shape(stage)
    assert (problem.GetName(), problem.GetType()) == ("LeafFolds", WARN)
    assert "5 of 20 patches (leaf_1, leaf_5, leaf_9, leaf_13 and leaf_17)" in problem.GetMessage()


def test_edit_that_folds_leaves_is_a_warning_that_names_it() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    _room(stage)
    put("primvars:leaf:edit:silhouette2", Gf.Vec3f(1, 0, 0))(prim)
    found = {problem.GetName(): problem for problem in problems_of_shape(stage)}
    assert set(found) == {"EditedSilhouetteOrder", "LeafFolds"}
    assert all(problem.GetType() == WARN for problem in found.values())
    place = found["EditedSilhouetteOrder"].GetSites()[0].GetProperty().GetPath()
    assert place == "/Leaves.primvars:leaf:edit:silhouette2"
    assert "(0, 1 and 2)" in found["LeafFolds"].GetMessage()


SHAPE = [
    ("EditedSilhouetteOrder", "primvars:leaf:edit:silhouette1", Gf.Vec3f(-0.2, 0, 0)),
    ("EditedSilhouetteOrder", "primvars:leaf:edit:silhouette3", Gf.Vec3f(0.3, 0, 0)),
    ("EditedSilhouetteWidth", "primvars:leaf:edit:silhouette1", Gf.Vec3f(0, -0.25, 0)),
    ("EditedSilhouetteWidth", "primvars:leaf:edit:width", 0.0),
]


@pytest.mark.parametrize(("name", "place", "value"), SHAPE)
def test_edit_that_takes_silhouettes_out_of_order(name: str, place: str, value: object) -> None:
    stage = Usd.Stage.CreateInMemory()
    put(place, value)(stages.build_leaves(stage))
    _room(stage)
    found = [problem for problem in problems_of_shape(stage) if problem.GetName() == name]
    assert {str(problem.GetSites()[0].GetProperty().GetPath()) for problem in found} == {f"/Leaves.{place}"}
    assert all("3 of 3 leaves (the first is 0)" in problem.GetMessage() for problem in found)


@pytest.mark.parametrize(
    ("edit", "value"),
    [
        ("width", 3.0),
        ("curl", Gf.Vec3f(0, 0, 0.5)),
        ("axis1", Gf.Vec3f(3, 0, 0)),
        ("jitterAmplitude", 0.5),
    ],
)
def test_extent_that_does_not_hold_the_edited_leaves(edit: str, value: object) -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    UsdGeom.PointInstancer(prim).CreateExtentAttr([Gf.Vec3f(-0.1, 0.9, -0.1), Gf.Vec3f(2.1, 1.1, 0.1)])
    assert findings(stage) == []
    put(f"primvars:leaf:edit:{edit}", value)(prim)
    (problem,) = [problem for problem in problems_of_shape(stage) if problem.GetName() == "DisplacedExtent"]
    assert problem.GetType() == ERROR
    assert problem.GetSites()[0].GetProperty().GetPath() == "/Leaves/Prototypes/Leaf.extent"
    _room(stage)
    assert findings(stage) in ([], [("LeafShape", "LeafFolds", "/Leaves")])
    put("extent", [Gf.Vec3f(-0.1, 0.9, -0.1), Gf.Vec3f(2.0, 1.1, 0.1)])(prim)
    assert ("LeafShape", "LeavesExtent", "/Leaves.extent") in findings(stage)


def test_jitter_map_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_text("no image")
    stage = Usd.Stage.CreateNew(str(tmp_path / "leaves.usda"))
    put("foliage:leaf:jitterMap", Sdf.AssetPath("./map.png"))(stages.build_leaves(stage))
    assert findings(stage) == [("LeafShape", "JitterMapUnusable", "/Leaves.foliage:leaf:jitterMap")]


def test_leaves_are_not_looked_at_as_drawn_where_usdfoliage_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Usd.Stage.CreateInMemory()
    stages.build_leaves(stage)
    monkeypatch.setitem(sys.modules, "usdfoliage.leaf.shape.fold", None)
    (problem,) = UsdValidation.ValidationContext(keywords=["usdFoliage"]).Validate(stage)
    assert (problem.GetName(), problem.GetType()) == ("LeafShapeNotChecked", WARN)
    assert "usdfoliage.leaf.shape.fold" in problem.GetMessage()


def test_hundred_thousand_leaves_take_seconds() -> None:
    import time

    count = 100_000
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_leaves(stage)
    for attribute in prim.GetAttributes():
        current = attribute.Get()
        if attribute.HasAuthoredValue() and attribute.GetTypeName().isArray and attribute.GetName() != "extent":
            attribute.Set(type(current)(count, current[0]))
    prim.GetAttribute("primvars:leaf:packed").Set(stages.packed_leaves(count))
    start = time.process_time()
    assert findings(stage) == []
    assert time.process_time() - start < 10


def _moved_child(prim: Usd.Prim) -> None:
    points = list(prim.GetAttribute("points").Get())
    points[3] += Gf.Vec3f(0, 0.01, 0)
    prim.GetAttribute("points").Set(points)


SKELETON = [
    ("CurveType", ".type", put("type", "cubic")),
    ("CurvesMissing", "", drop("points")),
    ("CurveVertexCounts", ".curveVertexCounts", put("curveVertexCounts", [3, 2, 3])),
    ("CurveVertexCounts", ".curveVertexCounts", put("curveVertexCounts", [3, 3, 1])),
    ("WidthsLength", ".widths", put("widths", [0.1])),
    ("WidthsInterpolation", ".widths", interpolate("widths", "varying")),
    ("WidthsNotPositive", ".widths", put("widths", [0.2, 0.15, 0, 0.08, 0.04, 0.02, 0.01])),
    ("WidthsNotPositive", ".widths", put("widths", [0.2, 0.15, float("nan"), 0.08, 0.04, 0.02, 0.01])),
    ("SkeletonArrayLength", ".foliage:parentCurve", put("foliage:parentCurve", [-1, 0])),
    ("SkeletonArrayLength", ".foliage:order", drop("foliage:order")),
    ("SkeletonArrayLength", ".foliage:inferred", put("foliage:inferred", [0, 1])),
    ("SkeletonArrayLength", ".foliage:inferred", put("foliage:inferred", [0, 1, 2])),
    ("ParentCurveRange", ".foliage:parentCurve", put("foliage:parentCurve", [-1, 0, 3])),
    ("ParentVertexRange", ".foliage:parentVertex", put("foliage:parentVertex", [-1, 4, 4])),
    ("ParentVertexRange", ".foliage:parentVertex", put("foliage:parentVertex", [0, 1, 4])),
    ("ParentVertexApart", ".foliage:parentVertex", _moved_child),
    ("OrderRange", ".foliage:order", put("foliage:order", [1, 1, 2])),
    ("OrderRange", ".foliage:order", put("foliage:order", [0, -1, 0])),
    ("OrderStep", ".foliage:order", put("foliage:order", [0, 1, 3])),
    ("GrowthRange", ".foliage:growth:branchingAngle", put("foliage:growth:branchingAngle", 200.0)),
    ("GrowthRange", ".foliage:growth:internodeLength", put("foliage:growth:internodeLength", 0.0)),
    (
        "GrowthRange",
        ".foliage:growth:tropismDirection",
        put("foliage:growth:tropismDirection", Gf.Vec3f(0, -2, 0)),
    ),
]


@pytest.mark.parametrize(("name", "place", "break_it"), SKELETON)
def test_broken_skeleton(name: str, place: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateInMemory()
    break_it(stages.build_skeleton(stage))
    assert findings(stage) == [("Skeleton", name, f"/Skeleton{place}")]


def test_skeleton_in_a_circle() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_skeleton(stage)
    prim.GetAttribute("foliage:parentCurve").Set([-1, 2, 1])
    prim.GetAttribute("foliage:parentVertex").Set([-1, 5, 4])
    assert ("Skeleton", "ParentCycle", "/Skeleton.foliage:parentCurve") in findings(stage)
    prim.GetAttribute("foliage:parentCurve").Set([1, 2, 0])
    prim.GetAttribute("foliage:parentVertex").Set([3, 5, 0])
    assert ("Skeleton", "NoRoot", "/Skeleton.foliage:parentCurve") in findings(stage)


def test_skeleton_point_that_is_not_finite() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_skeleton(stage)
    points = list(prim.GetAttribute("points").Get())
    points[2] = Gf.Vec3f(float("nan"), 0, 0)
    prim.GetAttribute("points").Set(points)
    assert findings(stage) == [("Skeleton", "PointsNotFinite", "/Skeleton.points")]


CROWN = [
    ("Crown", "CubemapMissing", "radiusMap", drop("foliage:crown:radiusMap")),
    ("Crown", "CubemapMissing", "colorMap", put("foliage:crown:colorMap", Sdf.AssetPath(""))),
    ("Crown", "CrownCenter", "center", drop("foliage:crown:center")),
    ("Crown", "CrownCenter", "center", put("foliage:crown:center", Gf.Vec3f(0, float("nan"), 0))),
    ("Crown", "RadiusRange", "radiusRange", drop("foliage:crown:radiusRange")),
    ("Crown", "ReliefWeight", "reliefWeight", put("foliage:crown:reliefWeight", 2.0)),
    ("Crown", "LeafTextureMissing", "leafTexture", put("foliage:crown:leafTexture", Sdf.AssetPath("./leaf.png"))),
    ("CrownFiles", "CubemapNotFound", "radiusMap", put("foliage:crown:radiusMap", Sdf.AssetPath("./no.exr"))),
    ("CrownFiles", "RadiusRangeOfFile", "radiusRange", put("foliage:crown:radiusRange", Gf.Vec2f(1, 1.9))),
]


@pytest.mark.parametrize(("validator", "name", "place", "break_it"), CROWN)
def test_broken_crown(tmp_path: Path, validator: str, name: str, place: str, break_it: Break) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    break_it(stages.build_crown(stage, tmp_path / "maps"))
    assert findings(stage) == [(validator, name, f"/Crown.foliage:crown:{place}")]


def test_crown_range_upside_down_is_found_by_both_validators(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    put("foliage:crown:radiusRange", Gf.Vec2f(2, 1))(stages.build_crown(stage, tmp_path / "maps"))
    place = "/Crown.foliage:crown:radiusRange"
    assert findings(stage) == [("Crown", "RadiusRange", place), ("CrownFiles", "RadiusRangeOfFile", place)]


def _step_at_border(radius: np.ndarray) -> np.ndarray:
    radius[4, 0, 3] += 1e-3
    return radius


def _one(number: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(radius: np.ndarray) -> np.ndarray:
        radius[2, 3, 3] = number
        return radius

    return change


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("CubemapBorders", _step_at_border),
        ("CubemapNotFinite", _one(float("nan"))),
        ("CubemapNotFinite", _one(float("inf"))),
        ("RadiusNotPositive", _one(0.0)),
        ("CubemapShape", lambda radius: radius[:5]),
        ("CubemapShape", lambda radius: radius[:, :1, :1]),
    ],
)
def test_broken_radius_map(tmp_path: Path, name: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    prim = stages.build_crown(stage, tmp_path / "maps")
    radius = np.ascontiguousarray(change(stages.radius_map()))
    stages.write_cubemap(tmp_path / "maps" / "radius.exr", {"R": radius})
    if name == "RadiusNotPositive":
        prim.GetAttribute("foliage:crown:radiusRange").Clear()
    found = [(validator, problem, path) for validator, problem, path in findings(stage) if validator == "CrownFiles"]
    assert found == [("CrownFiles", name, "/Crown.foliage:crown:radiusMap")]


def test_radius_map_without_the_header_or_with_other_channels(tmp_path: Path) -> None:
    import OpenEXR

    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    stages.build_crown(stage, tmp_path / "maps")
    path, radius = tmp_path / "maps" / "radius.exr", stages.radius_map()
    stages.write_cubemap(path, {"R": radius}, header={"envmap": OpenEXR.ENVMAP_LATLONG})
    assert findings(stage) == [("CrownFiles", "CubemapHeader", "/Crown.foliage:crown:radiusMap")]
    stages.write_cubemap(path, {"Z": radius})
    assert findings(stage) == [("CrownFiles", "CubemapChannels", "/Crown.foliage:crown:radiusMap")]
    stages.write_cubemap(path, {"R": radius, "G": radius, "B": radius})
    assert findings(stage) == [("CrownFiles", "CubemapChannels", "/Crown.foliage:crown:radiusMap")]


@pytest.mark.parametrize("content", [b"", b"no image at all", b"v/1\x01\x02\x00\x00\x00"])
def test_map_that_is_no_openexr(tmp_path: Path, content: bytes) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    stages.build_crown(stage, tmp_path / "maps")
    (tmp_path / "maps" / "color.exr").write_bytes(content)
    assert findings(stage) == [("CrownFiles", "CubemapUnreadable", "/Crown.foliage:crown:colorMap")]


def test_truncated_map(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    stages.build_crown(stage, tmp_path / "maps")
    path = tmp_path / "maps" / "radius.exr"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert findings(stage) == [("CrownFiles", "CubemapUnreadable", "/Crown.foliage:crown:radiusMap")]


def test_negative_color(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    stages.build_crown(stage, tmp_path / "maps")
    grey = np.full((6, 8, 8), -0.1, np.float16)
    stages.write_cubemap(tmp_path / "maps" / "color.exr", {"R": grey, "G": grey, "B": grey})
    assert findings(stage) == [("CrownFiles", "ColorNegative", "/Crown.foliage:crown:colorMap")]


def test_maps_are_not_checked_where_openexr_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "crown.usda"))
    stages.build_crown(stage, tmp_path / "maps")
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    problems = UsdValidation.ValidationContext(keywords=["usdFoliage"]).Validate(stage)
    assert [problem.GetName() for problem in problems] == ["CubemapNotChecked"] * 2
    assert all(problem.GetType() == WARN and "no module OpenEXR" in problem.GetMessage() for problem in problems)


LOBED = [
    ("LobedSilhouette", "silhouettePoints", vectors((0, 0, 0), (1, 0, 0), (0, 1, 0))),
    ("LobedSilhouetteDegree", "silhouetteDegree", 4),
    ("LobedSkeleton", "skeletonPoints", vectors((0, 0, 0))),
    ("LobedSkeletonLength", "skeletonParents", [-1, 0]),
    ("LobedSkeletonParents", "skeletonParents", [-1, 0, 3, 1]),
    ("LobedBranches", "skeletonBranches", [0, 0, 0, 2]),
    ("LobedTiesMissing", "tie:branch", []),
    ("LobedTieBranch", "tie:branch", [0, 0, 2]),
    ("LobedTieLength", "tie:tTurn", [90.0]),
    ("LobedTieRange", "tie:kLength", [0.2, -0.4, 0.1]),
    ("LobedTieRange", "tie:kTurn", [0.0, 190.0, 0.0]),
    ("LobedFunctionCounts", "bend:keyCounts", [2, 1]),
    ("LobedFunctionCounts", "bend:keyCounts", [2]),
    ("LobedFunctionKeys", "bend:keys", [Gf.Vec2f(0.5, 0), Gf.Vec2f(0.2, 30)]),
    ("LobedFunctionKeys", "bend:keys", [Gf.Vec2f(0.5, 0), Gf.Vec2f(1.2, 30)]),
]


@pytest.mark.parametrize(("name", "attribute", "value"), LOBED)
def test_broken_lobed_leaf(name: str, attribute: str, value: object) -> None:
    stage = Usd.Stage.CreateInMemory()
    put(f"foliage:lobed:{attribute}", value)(stages.build_lobed_leaf(stage))
    assert findings(stage) == [("LobedLeaf", name, f"/Lobed.foliage:lobed:{attribute}")]


FOREST = [
    ("SpeciesTableLength", "species", ["Quercus robur"]),
    ("SpeciesName", "species", ["Quercus robur", " "]),
    ("SpeciesKind", "speciesKind", ["tree", "moss"]),
    ("SpeciesShare", "speciesShare", [1.0, -1.0]),
    ("SpeciesShare", "speciesShare", [1.0, 0.5]),
    ("SpeciesScale", "speciesScale", [Gf.Vec2f(1, 0.5), Gf.Vec2f(0.5, 1)]),
    ("ForestSeed", "seed", -1),
    ("LodJitterLength", "lodJitter", [0.5]),
    ("LodJitterRange", "lodJitter", [0.5, 1.5, 0, 0]),
    ("LodDistance", "lodDistance", Gf.Vec2f(200, 100)),
]


@pytest.mark.parametrize(("name", "attribute", "value"), FOREST)
def test_broken_forest(name: str, attribute: str, value: object) -> None:
    stage = Usd.Stage.CreateInMemory()
    put(f"foliage:forest:{attribute}", value)(stages.build_forest(stage))
    assert findings(stage) == [("Forest", name, f"/Forest.foliage:forest:{attribute}")]


def test_forest_with_an_orthophoto_that_is_not_there() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stages.build_forest(stage)
    prim.GetAttribute("foliage:forest:orthophoto").Set(Sdf.AssetPath("./ground.tif"))
    place = "/Forest.foliage:forest:orthophoto"
    assert findings(stage) == [("Forest", "OrthophotoBounds", f"{place}Bounds"), ("Forest", "OrthophotoMissing", place)]


@pytest.mark.parametrize(
    ("schema", "validator", "other"),
    [
        ("FoliagePlantAPI", "Plant", "Mesh"),
        ("FoliageLeafAPI", "LeafArrays", "Mesh"),
        ("FoliageLobedLeafAPI", "LobedLeaf", "Xform"),
        ("FoliageSkeletonAPI", "Skeleton", "Mesh"),
        ("FoliageCrownAPI", "Crown", "Xform"),
        ("FoliageForestAPI", "Forest", "Xform"),
    ],
)
def test_schema_on_a_prim_that_it_is_not_for(schema: str, validator: str, other: str) -> None:
    stage = Usd.Stage.CreateInMemory()
    stage.DefinePrim("/Group", "Xform")
    stage.DefinePrim("/Group/Wrong", other).AddAppliedSchema(schema)
    assert findings(stage) == [(validator, "WrongPrimType", "/Group/Wrong")]


def test_values_of_another_type_do_not_stop_the_validators() -> None:
    text = """#usda 1.0
def PointInstancer "L" (prepend apiSchemas = ["FoliageLeafAPI"]) {
    point3f[] positions = [(0, 0, 0)]
    string primvars:leaf:axis1 = "none"
    float primvars:leaf:axis2 = 1
    asset primvars:leaf:inner = @x@
    string primvars:leaf:edit:width = "wide"
}
def BasisCurves "S" (prepend apiSchemas = ["FoliageSkeletonAPI"]) {
    string points = "none"
    float[] foliage:parentCurve = [0.5]
}
def Mesh "C" (prepend apiSchemas = ["FoliageCrownAPI", "FoliageLobedLeafAPI"]) {
    string foliage:crown:radiusMap = "x.exr"
    string foliage:crown:center = "here"
    string[] foliage:lobed:silhouettePoints = ["a"]
}
def PointInstancer "F" (prepend apiSchemas = ["FoliageForestAPI"]) {
    string foliage:forest:species = "oak"
    string foliage:forest:lodJitter = "oak"
}
def "G" {
    def Xform "P" (prepend apiSchemas = ["FoliagePlantAPI"]) {
        int foliage:generator = 3
        string foliage:captureToAsset = "none"
    }
}
"""
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(text)
    names = {name for _, name, _ in findings(stage)}
    assert {"LeafArrayMissing", "EditRange", "CurvesMissing", "CubemapMissing", "CrownCenter"} <= names
    assert {"LobedSilhouette", "LodJitterLength", "GeneratorMissing", "CaptureToAsset"} <= names


PLANT = [
    ("GeneratorMissing", "generator", " "),
    ("CaptureToAsset", "captureToAsset", Gf.Matrix4d(0)),
    ("CaptureToAsset", "captureToAsset", Gf.Matrix4d(1).SetScale((1, 1, 0))),
    ("CaptureToAsset", "captureToAsset", Gf.Matrix4d(float("nan"))),
]


@pytest.mark.parametrize(("name", "attribute", "value"), PLANT)
def test_broken_plant(name: str, attribute: str, value: object) -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Xform.Define(stage, "/Group/Plant").GetPrim()
    prim.ApplyAPI("FoliagePlantAPI")
    stages.author_plant(prim)
    put(f"foliage:{attribute}", value)(prim)
    assert findings(stage) == [("Plant", name, f"/Group/Plant.foliage:{attribute}")]


def test_small_units_do_not_make_a_matrix_singular() -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Xform.Define(stage, "/Group/Plant").GetPrim()
    prim.ApplyAPI("FoliagePlantAPI")
    stages.author_plant(prim)
    put("foliage:captureToAsset", Gf.Matrix4d(1).SetScale(1e-6))(prim)
    assert findings(stage) == []


def test_good_asset_loaded_and_unloaded_has_no_finding(tmp_path: Path) -> None:
    path = str(stages.write_asset(tmp_path / "an oak"))
    assert findings(Usd.Stage.Open(path)) == []
    assert findings(Usd.Stage.Open(path, Usd.Stage.LoadNone)) == []


def _edit_plant(change: Callable[[Usd.Prim], object]) -> Callable[[Path], None]:
    def break_it(path: Path) -> None:
        stage = Usd.Stage.Open(str(path))
        change(stage.GetDefaultPrim())
        stage.GetRootLayer().Save()

    return break_it


def _edit_payload(change: Callable[[Usd.Stage], object]) -> Callable[[Path], None]:
    def break_it(path: Path) -> None:
        stage = Usd.Stage.Open(str(path.parent / "payload" / "payload.usda"))
        change(stage)
        stage.GetRootLayer().Save()

    return break_it


def _point(name: str, *targets: str) -> Callable[[Path], None]:
    return _edit_plant(lambda plant: plant.GetRelationship(f"foliage:{name}").SetTargets(targets))


def _second_payload(plant: Usd.Prim) -> None:
    plant.GetPayloads().AddPayload("./payload/payload.usda", Sdf.Path("/oak/geo"))


def _purpose(path: str, purpose: str) -> Callable[[Path], None]:
    return _edit_payload(lambda stage: UsdGeom.Imageable(stage.GetPrimAtPath(path)).CreatePurposeAttr(purpose))


def _leave(*kept: str) -> Callable[[Path], None]:
    def change(stage: Usd.Stage) -> None:
        for name in {"render", "proxy", "guide"} - set(kept):
            stage.RemovePrim(f"/oak/geo/{name}")

    return _edit_payload(change)


def _color_map(path: str) -> Callable[[Path], None]:
    def change(stage: Usd.Stage) -> None:
        crown = stage.GetPrimAtPath("/oak/geo/proxy/Crown")
        crown.GetAttribute("foliage:crown:colorMap").Set(Sdf.AssetPath(path))

    return _edit_payload(change)


def _junk_shader(stage: Usd.Stage) -> None:
    Path(stage.GetRootLayer().realPath).with_name("junk.glslfx").write_text("junk")
    crown = stage.GetPrimAtPath("/oak/geo/proxy/Crown")
    crown.CreateAttribute("info:glslfx:sourceAsset", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath("./junk.glslfx"))


def _wrong_variant(plant: Usd.Prim) -> None:
    plant.GetVariantSets().AddVariantSet("lod").AddVariant("crown")
    plant.GetVariantSets().SetSelection("lod", "leaves")


def _copy_beside(path: Path) -> None:
    path.with_name("old.usdc").write_bytes(path.read_bytes())


ASSET = [
    ("AssetInterface", "DefaultPrim", "/oak", _edit_plant(lambda plant: plant.GetStage().ClearDefaultPrim())),
    ("AssetInterface", "Kind", "/oak", _edit_plant(lambda plant: Usd.ModelAPI(plant).SetKind("group"))),
    (
        "AssetInterface",
        "MetersPerUnit",
        "/oak",
        _edit_plant(lambda plant: UsdGeom.SetStageMetersPerUnit(plant.GetStage(), 0.01)),
    ),
    (
        "AssetInterface",
        "MetersPerUnit",
        "/oak",
        _edit_plant(lambda plant: plant.GetStage().ClearMetadata("metersPerUnit")),
    ),
    ("AssetInterface", "UpAxis", "/oak", _edit_plant(lambda plant: UsdGeom.SetStageUpAxis(plant.GetStage(), "Z"))),
    ("AssetInterface", "UpAxis", "/oak", _edit_plant(lambda plant: plant.GetStage().ClearMetadata("upAxis"))),
    ("AssetInterface", "Payload", "/oak", _edit_plant(_second_payload)),
    ("AssetInterface", "VariantSelection", "/oak", _edit_plant(_wrong_variant)),
    ("AssetInterface", "FolderTop", "/oak", _copy_beside),
    ("AssetPaths", "PathNotRelative", "/oak", _color_map("/abs/color.exr")),
    ("AssetPaths", "PathNotRelative", "/oak", _color_map("https://example.org/color.exr")),
    ("AssetPaths", "PathNotRelative", "/oak", _color_map("C:/maps/color.exr")),
    ("AssetPaths", "PathOutside", "/oak", _color_map("../../color.exr")),
    ("AssetPaths", "PathSearched", "/oak", _color_map("maps/color.exr")),
    ("AssetPaths", "ShaderSource", "/oak", _edit_payload(_junk_shader)),
    (
        "AssetBounds",
        "ExtentsHintMissing",
        "/oak.extentsHint",
        _edit_plant(lambda plant: plant.GetAttribute("extentsHint").Clear()),
    ),
    (
        "AssetBounds",
        "ExtentsHintTooSmall",
        "/oak.extentsHint",
        _edit_plant(lambda plant: plant.GetAttribute("extentsHint").Set([Gf.Vec3f(0), Gf.Vec3f(1)] * 4)),
    ),
    (
        "AssetPurposes",
        "PurposeNotOnScope",
        "/oak/geo/proxy/Crown.purpose",
        _purpose("/oak/geo/proxy/Crown", "proxy"),
    ),
    ("AssetPurposes", "PurposeAlone", "/oak/geo/proxy.purpose", _leave("proxy", "guide")),
    ("AssetPurposes", "PurposeAlone", "/oak/geo/render.purpose", _leave("render", "guide")),
    ("Plant", "RelationshipTargets", "/oak.foliage:crown", _point("crown", "/oak/geo/proxy/Crown", "/oak/geo")),
    ("Plant", "RelationshipOutside", "/oak.foliage:crown", _point("crown", "/other")),
    ("Plant", "RelationshipTargetMissing", "/oak.foliage:crown", _point("crown", "/oak/geo/Crown")),
    ("Plant", "RelationshipTargetKind", "/oak.foliage:leaves", _point("leaves", "/oak/geo/proxy/Crown")),
]


@pytest.mark.parametrize(("validator", "name", "place", "break_it"), ASSET)
def test_broken_asset(tmp_path: Path, validator: str, name: str, place: str, break_it: Callable[[Path], None]) -> None:
    path = stages.write_asset(tmp_path / "oak")
    break_it(path)
    assert (validator, name, place) in findings(Usd.Stage.Open(str(path)))


def test_a_shot_that_references_an_asset_is_no_asset(tmp_path: Path) -> None:
    path = stages.write_asset(tmp_path / "oak")
    shot = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    shot.OverridePrim("/Oak").GetReferences().AddReference(str(path))
    assert findings(shot) == []


def test_a_part_that_only_another_variant_has(tmp_path: Path) -> None:
    path = stages.write_asset(tmp_path / "oak")
    stage = Usd.Stage.Open(str(path))
    plant = stage.GetDefaultPrim()
    lod = plant.GetVariantSets().AddVariantSet("lod")
    for variant in ("both", "leaves"):
        lod.AddVariant(variant)
        lod.SetVariantSelection(variant)
        with lod.GetVariantEditContext():
            stage.OverridePrim("/oak/geo/proxy").SetActive(variant == "both")
    stage.GetRootLayer().Save()
    names = {name for _, name, _ in findings(stage)}
    assert names == {"PurposeAlone"}


def test_stock_usd_finds_the_validators_through_the_environment(tmp_path: Path) -> None:
    """As usdchecker does: PXR_PLUGINPATH_NAME and PYTHONPATH, and no import of usdfoliage."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "skeleton.usda"))
    put("widths", [-1.0] * 7)(stages.build_skeleton(stage))
    stage.GetRootLayer().Save()
    name = str(tmp_path / "skeleton.usda")
    program = f"""
        import sys
        from pxr import Usd, UsdValidation
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open({name!r}))
        assert "usdfoliage" not in sys.modules
        print([problem.GetName() for problem in found if problem.GetName().startswith("Widths")])
    """
    root = Path(__file__).parents[2]
    environment = {
        **os.environ,
        "PXR_PLUGINPATH_NAME": f"{root / 'schemas/usdFoliage'}{os.pathsep}{root / 'usd_plugins/usdFoliageValidators'}",
        "PYTHONPATH": str(root / "usd_plugins"),
    }
    outcome = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], env=environment, capture_output=True, text=True, check=False
    )
    assert outcome.stdout.strip() == "['WidthsNotPositive']", outcome.stderr
