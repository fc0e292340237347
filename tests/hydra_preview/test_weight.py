"""How much a stage has to draw, and how it is drawn then."""

import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from weight import MAX_FACES, Weight, choose_complexity, choose_scale, weigh

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
    small, much = Weight(triangles=900_000), Weight(triangles=300_000, cage_faces=100_000)
    assert choose_scale(small, 1.0, 4, [(960, 960)]) == 1
    assert choose_scale(much, 1.0, 4, [(960, 960)]) == 1
    assert choose_scale(much, 1.1, 4, [(960, 960)]) == 2
    assert choose_scale(much, 1.1, 2, [(960, 960)]) == 2
    assert choose_scale(much, 1.1, 9, [(960, 960)]) == 3
    assert choose_scale(much, 1.1, 1, [(960, 960)]) == 1
    assert choose_scale(much, 1.1, 4, [(960, 960), (4097, 16)]) == 1
