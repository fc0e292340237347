"""How much a stage has to draw, and how it is drawn then."""

import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from weight import (
    CARD_TRIANGLES,
    MAX_FACES,
    Weight,
    choose_complexity,
    choose_scale,
    draw_lighter,
    draw_reliefs,
    lighten,
    weigh,
)

PURPOSES = ["default", "render"]


def add_mesh(stage, path, quads, subdivided=False):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray([(x, y, 0) for x in range(quads + 1) for y in (0, 1)]))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(quads, 4))
    mesh.CreateFaceVertexIndicesAttr([i for x in range(quads) for i in (2 * x, 2 * x + 2, 2 * x + 3, 2 * x + 1)])
    mesh.CreateSubdivisionSchemeAttr("catmullClark" if subdivided else "none")
    return mesh


def weight_of(stage):
    return weigh(stage, Usd.TimeCode.Default(), PURPOSES)


def test_instances_count_as_often_as_they_are_drawn():
    stage = Usd.Stage.CreateInMemory()
    add_mesh(stage, "/Wood", 7, subdivided=True)
    instancer = UsdGeom.PointInstancer.Define(stage, "/Leaves")
    add_mesh(stage, "/Leaves/Prototypes/Leaf", 3)
    add_mesh(stage, "/Leaves/Prototypes/Twig", 5, subdivided=True)
    instancer.CreatePrototypesRel().SetTargets(["/Leaves/Prototypes/Leaf", "/Leaves/Prototypes/Twig"])
    instancer.CreateProtoIndicesAttr([0, 1, 0, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0)] * 4)
    assert weight_of(stage) == Weight(triangles=3 * 6, cage_faces=7 + 5)
    source = Usd.Stage.CreateInMemory()
    add_mesh(source, "/Plant/Mesh", 4)
    for number in range(3):
        prim = stage.DefinePrim(f"/Plant_{number}")
        prim.GetReferences().AddReference(source.GetRootLayer().identifier, "/Plant")
        prim.SetInstanceable(True)
    assert weight_of(stage) == Weight(triangles=3 * 6 + 3 * 8, cage_faces=12)


def test_what_is_not_drawn_does_not_count():
    stage = Usd.Stage.CreateInMemory()
    add_mesh(stage, "/Seen", 2)
    add_mesh(stage, "/Guides/Guide", 9)
    UsdGeom.Imageable(UsdGeom.Scope.Define(stage, "/Guides")).CreatePurposeAttr("guide")
    add_mesh(stage, "/Hidden", 9).CreateVisibilityAttr("invisible")
    assert weight_of(stage) == Weight(triangles=4)


def test_a_prototype_that_holds_its_instancer_ends():
    stage = Usd.Stage.CreateInMemory()
    instancer = UsdGeom.PointInstancer.Define(stage, "/Above/Leaves")
    instancer.CreatePrototypesRel().SetTargets(["/Above"])
    instancer.CreateProtoIndicesAttr([0, 0])
    add_mesh(stage, "/Above/Mesh", 2)
    assert weight_of(stage).triangles >= 4


@pytest.mark.parametrize(
    ("cage_faces", "wanted", "chosen"),
    [(0, 1.3, 1.3), (MAX_FACES // 16, 1.2, 1.2), (MAX_FACES // 16 + 1, 1.2, 1.1), (10 * MAX_FACES, 1.2, 1.0)],
)
def test_surfaces_are_refined_as_far_as_storm_holds_them(cage_faces, wanted, chosen):
    assert choose_complexity(Weight(cage_faces=cage_faces), wanted) == pytest.approx(chosen)


def test_pictures_of_much_are_larger_where_they_may_be():
    small, much = Weight(triangles=90_000), Weight(triangles=30_000, cage_faces=10_000)
    assert choose_scale(small, 1.0, 4, [(960, 960)]) == 1
    assert choose_scale(much, 1.0, 4, [(960, 960)]) == 1
    assert choose_scale(much, 1.1, 4, [(960, 960)]) == 2
    assert choose_scale(much, 1.1, 2, [(960, 960)]) == 2
    assert choose_scale(much, 1.1, 9, [(960, 960)]) == 3
    assert choose_scale(much, 1.1, 1, [(960, 960)]) == 1
    assert choose_scale(much, 1.1, 4, [(960, 960), (4097, 16)]) == 1


def plant_stage(*, cards, crown):
    """A stage of one plant, of 400 triangles or with a crown of 10."""
    stage = Usd.Stage.CreateInMemory()
    plant = UsdGeom.Xform.Define(stage, "/Plant").GetPrim()
    stage.SetDefaultPrim(plant)
    Usd.ModelAPI(plant).SetKind("component")
    model = UsdGeom.ModelAPI.Apply(plant)
    if cards:
        model.CreateModelCardTextureXPosAttr("./x.png")
    lods = plant.GetVariantSets().AddVariantSet("lod")
    for name, quads in (("leaves", 200), *((("crown", 5),) if crown else ())):
        lods.AddVariant(name)
        lods.SetVariantSelection(name)
        with lods.GetVariantEditContext():
            add_mesh(stage, "/Plant/Mesh", quads)
    lods.SetVariantSelection("leaves")
    return stage


def scene_of(plant, count):
    scene = Usd.Stage.CreateInMemory()
    for number in range(count):
        prim = scene.DefinePrim(f"/Set/Row/Plant_{number}", "Xform")
        prim.GetReferences().AddReference(plant.GetRootLayer().identifier)
        prim.SetInstanceable(True)
    return scene


def test_plants_of_a_scene_are_drawn_as_their_cards():
    plant = plant_stage(cards=True, crown=True)
    scene = scene_of(plant, 3)
    assert weight_of(scene) == Weight(triangles=3 * 400)
    assert draw_lighter(scene) == "cards"
    assert weight_of(scene) == Weight(triangles=3 * CARD_TRIANGLES)
    for number in range(3):
        prim = scene.GetPrimAtPath(f"/Set/Row/Plant_{number}")
        assert prim.IsModel()  # else they would not be drawn as cards
        assert UsdGeom.ModelAPI(prim).ComputeModelDrawMode() == "cards"
    assert (
        scene.GetPrimAtPath("/Set/Row/Plant_0").GetPrototype() == scene.GetPrimAtPath("/Set/Row/Plant_2").GetPrototype()
    )


def test_plants_without_cards_and_a_plant_alone_are_drawn_as_their_crown():
    scene = scene_of(plant_stage(cards=False, crown=True), 3)
    assert draw_lighter(scene) == "crown"
    assert weight_of(scene) == Weight(triangles=3 * 10)
    alone = plant_stage(cards=True, crown=True)
    assert draw_lighter(alone) == "crown"
    assert weight_of(alone) == Weight(triangles=10)


def test_what_has_no_lighter_form_is_drawn_as_it_is():
    plant = plant_stage(cards=True, crown=False)
    assert draw_lighter(plant) == ""
    assert weight_of(plant) == Weight(triangles=400)
    assert draw_lighter(scene_of(plant_stage(cards=False, crown=False), 2)) == ""


def test_plants_in_instances_of_groups_are_drawn_as_their_cards():
    plant = plant_stage(cards=True, crown=True)
    clump = scene_of(plant, 2)
    clump.SetDefaultPrim(clump.GetPrimAtPath("/Set"))
    wood = scene_of(clump, 3)  # instances of groups that hold instances
    forest = Usd.Stage.CreateInMemory()
    for number in range(2):
        prim = forest.DefinePrim(f"/Forest/Wood_{number}", "Xform")
        prim.GetReferences().AddReference(wood.GetRootLayer().identifier, "/Set")
        prim.SetInstanceable(True)
    assert weight_of(forest) == Weight(triangles=2 * 3 * 2 * 400)
    assert draw_lighter(forest) == "cards"
    assert weight_of(forest) == Weight(triangles=2 * 3 * 2 * CARD_TRIANGLES)


def test_plants_of_an_instancer_that_are_hidden_in_a_frame_do_not_count():
    stage = Usd.Stage.CreateInMemory()
    instancer = UsdGeom.PointInstancer.Define(stage, "/Plants")
    source = plant_stage(cards=False, crown=False)
    plant = stage.DefinePrim("/Plants/Plant")
    plant.GetReferences().AddReference(source.GetRootLayer().identifier)
    instancer.CreatePrototypesRel().SetTargets([plant.GetPath()])
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0)] * 3)
    instancer.CreateIdsAttr([7, 8, 9])
    instancer.CreateInvisibleIdsAttr().Set([7, 9], 1.0)
    instancer.CreateInvisibleIdsAttr().Set([], 2.0)
    assert weigh(stage, Usd.TimeCode(1.0), ["default"]) == Weight(triangles=400)
    assert weigh(stage, Usd.TimeCode(2.0), ["default"]) == Weight(triangles=3 * 400)


def test_plants_of_a_forest_are_drawn_as_reliefs():
    stage = Usd.Stage.CreateInMemory()
    levels = stage.DefinePrim("/Forest", "Xform").GetVariantSets().AddVariantSet("level")
    for level in ("crown", "relief"):
        levels.AddVariant(level)
    levels.SetVariantSelection("crown")
    assert draw_reliefs(stage) == "relief"
    assert levels.GetVariantSelection() == "relief"
    assert draw_reliefs(plant_stage(cards=True, crown=True)) == ""


@pytest.mark.parametrize(
    ("chosen", "form", "level"),
    [(["lod"], "", "crown"), (["level"], "crown", "crown"), ([], "crown", "relief")],
)
def test_what_is_chosen_is_not_drawn_lighter(monkeypatch, chosen, form, level):
    monkeypatch.setattr("weight.MAX_TRIANGLES", 100)
    forest = Usd.Stage.CreateInMemory()
    source = plant_stage(cards=False, crown=True)
    forest.DefinePrim("/Forest/Plant", "Xform").GetReferences().AddReference(source.GetRootLayer().identifier)
    levels = forest.GetPrimAtPath("/Forest").GetVariantSets().AddVariantSet("level")
    for each in ("crown", "relief"):
        levels.AddVariant(each)
    levels.SetVariantSelection("crown")
    weight, lighter = lighten(forest, Usd.TimeCode.Default(), ["default"], chosen)
    assert (weight, lighter) == (Weight(triangles=10 if form else 400), form)
    assert levels.GetVariantSelection() == level
